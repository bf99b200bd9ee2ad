//! Lines from a stream: numbered, bounded, blank ones left out.

use std::io::{self, BufRead, BufReader, Read};

use super::Fault;
use crate::stop::{EndAsked, Stop};

/// A longer line is no state \[bytes\].
const MAX_LINE: usize = 1 << 20;

const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

/// The lines of a stream, one at a time in one buffer.
#[derive(Debug)]
pub struct Lines<R> {
    source: BufReader<R>,
    line: Vec<u8>,
    /// Lines begun so far, blank ones counted.
    number: u64,
    held: bool,
}

impl<R: Read> Lines<R> {
    /// Reads nothing yet.
    pub fn new(source: R) -> Self {
        Self {
            source: BufReader::with_capacity(1 << 16, source),
            line: Vec::new(),
            number: 0,
            held: false,
        }
    }

    /// The current line without its end.
    pub fn line(&self) -> &[u8] {
        self.line.strip_suffix(b"\r").unwrap_or(&self.line)
    }

    /// Gives the current line once more at the next [`Lines::advance`].
    pub fn hold(&mut self) {
        self.held = true;
    }

    /// True if a whole line can be had without waiting for the writer.
    pub fn line_waits(&self) -> bool {
        self.held || memchr::memchr(b'\n', self.source.buffer()).is_some()
    }

    /// Goes to the next line that is not blank; false at the end, or where one is asked for: half a line is none then.
    ///
    /// # Errors
    /// [`Stop`] if the stream cannot be read or the line is too long; no more than a line's limit is ever held.
    pub fn advance(&mut self) -> Result<bool, Stop> {
        if self.held {
            self.held = false;
            return Ok(true);
        }
        while self.next_line()? {
            if !self.line.trim_ascii().is_empty() {
                return Ok(true);
            }
        }
        Ok(false)
    }

    fn next_line(&mut self) -> Result<bool, Stop> {
        self.line.clear();
        let mut begun = false;
        loop {
            let buffer = match self.source.fill_buf() {
                Ok(buffer) => buffer,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
                Err(error) if EndAsked::is_behind(&error) => return Ok(false),
                Err(error) => return Err(self.fault(&Fault::line(error.to_string()))),
            };
            if buffer.is_empty() {
                break;
            }
            if !begun {
                begun = true;
                self.number += 1;
            }
            let newline = memchr::memchr(b'\n', buffer);
            let content = &buffer[..newline.unwrap_or(buffer.len())];
            if self.line.len() + content.len() > MAX_LINE {
                let sentence = format!("longer than {MAX_LINE} bytes, expected one state per line");
                return Err(self.fault(&Fault::line(sentence)));
            }
            self.line.extend_from_slice(content);
            let used = content.len() + usize::from(newline.is_some());
            self.source.consume(used);
            if newline.is_some() {
                break;
            }
        }
        if self.number == 1 && self.line.starts_with(BYTE_ORDER_MARK) {
            self.line.drain(..BYTE_ORDER_MARK.len());
        }
        Ok(begun)
    }

    /// The fault with its place.
    pub fn fault(&self, fault: &Fault) -> Stop {
        Stop::Because(if self.number == 0 {
            format!("stdin{fault}")
        } else {
            format!("stdin, line {}{fault}", self.number)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all(text: &[u8]) -> Vec<(u64, Vec<u8>)> {
        let mut lines = Lines::new(text);
        let mut found = Vec::new();
        while lines.advance().unwrap() {
            found.push((lines.number, lines.line().to_vec()));
        }
        found
    }

    #[test]
    fn lines_keep_their_numbers() {
        let found = all(b"\xef\xbb\xbfa\r\n\n \t\nb c\t\nd");
        let expected: [(u64, &[u8]); 3] = [(1, b"a"), (4, b"b c\t"), (5, b"d")];
        assert_eq!(
            found,
            expected.map(|(number, line)| (number, line.to_vec()))
        );
    }

    #[test]
    fn a_held_line_comes_again() {
        let mut lines = Lines::new(&b"a\nb\n"[..]);
        assert!(lines.advance().unwrap());
        lines.hold();
        assert!(lines.advance().unwrap());
        assert_eq!(lines.line(), b"a");
        assert!(lines.line_waits());
        assert!(lines.advance().unwrap());
        assert!(!lines.line_waits());
    }

    #[test]
    fn an_endless_line_is_refused_early() {
        let mut lines = Lines::new(io::repeat(b'1'));
        assert!(lines.advance().is_err());
        assert!(lines.line.len() <= MAX_LINE);
    }

    /// Half a line, and then nothing but the wish to end.
    struct Ending(&'static [u8]);

    impl Read for Ending {
        fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
            match self.0.read(out)? {
                0 => Err(io::Error::other(EndAsked)),
                n => Ok(n),
            }
        }
    }

    #[test]
    fn half_a_line_at_an_end_that_was_asked_for_is_none() {
        let mut lines = Lines::new(Ending(b"1,2\n1,"));
        assert!(lines.advance().unwrap());
        assert_eq!(lines.line(), b"1,2");
        assert!(!lines.advance().unwrap());
    }

    #[test]
    fn the_limit_is_exact() {
        let text = [vec![b'1'; MAX_LINE], b"\n".to_vec()].concat();
        assert!(Lines::new(&text[..]).advance().unwrap());
        let text = [vec![b'1'; MAX_LINE + 1], b"\n".to_vec()].concat();
        assert!(Lines::new(&text[..]).advance().is_err());
    }
}
