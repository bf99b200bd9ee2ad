//! The cells of one CSV line.

/// Delimiters that are told apart by counting, as the Python reader does.
const DELIMITERS: [u8; 3] = [b',', b';', b'\t'];

/// The delimiter that a header uses most.
pub fn delimiter_of(header: &[u8]) -> u8 {
    let mut best = DELIMITERS[0];
    for delimiter in DELIMITERS {
        if count(header, delimiter) > count(header, best) {
            best = delimiter;
        }
    }
    best
}

fn count(line: &[u8], byte: u8) -> usize {
    memchr::memchr_iter(byte, line).count()
}

/// A quote that is not closed, or text after a closed one.
#[derive(Debug, PartialEq, Eq)]
pub struct BrokenQuote;

/// The cells of a line, without white space and quotes around them.
#[derive(Debug)]
pub struct Cells<'a> {
    rest: Option<&'a [u8]>,
    delimiter: u8,
}

impl<'a> Cells<'a> {
    /// The cells of `line`; an empty line has one, which is empty.
    pub fn new(line: &'a [u8], delimiter: u8) -> Self {
        Self {
            rest: Some(line),
            delimiter,
        }
    }

    /// A cell in quotes and what follows its delimiter. A doubled quote stays as it is: no name and no number has one.
    fn quoted(&self, line: &'a [u8]) -> Result<(&'a [u8], Option<&'a [u8]>), BrokenQuote> {
        let mut end = 1;
        loop {
            end += memchr::memchr(b'"', &line[end..]).ok_or(BrokenQuote)?;
            if line.get(end + 1) != Some(&b'"') {
                break;
            }
            end += 2;
        }
        let cell = &line[1..end];
        // A tab is white space and may be the delimiter.
        let after = &line[end + 1..];
        let blank = after
            .iter()
            .take_while(|byte| byte.is_ascii_whitespace() && **byte != self.delimiter)
            .count();
        match after[blank..].split_first() {
            None => Ok((cell, None)),
            Some((byte, rest)) if *byte == self.delimiter => Ok((cell, Some(rest))),
            Some(_) => Err(BrokenQuote),
        }
    }
}

impl<'a> Iterator for Cells<'a> {
    type Item = Result<&'a [u8], BrokenQuote>;

    fn next(&mut self) -> Option<Self::Item> {
        let line = self.rest.take()?;
        let blank = line
            .iter()
            .take_while(|byte| byte.is_ascii_whitespace() && **byte != self.delimiter)
            .count();
        if line.get(blank) == Some(&b'"') {
            return Some(self.quoted(&line[blank..]).map(|(cell, rest)| {
                self.rest = rest;
                cell.trim_ascii()
            }));
        }
        Some(Ok(match memchr::memchr(self.delimiter, line) {
            Some(at) => {
                self.rest = Some(&line[at + 1..]);
                line[..at].trim_ascii()
            }
            None => line.trim_ascii(),
        }))
    }
}

/// The number in a cell, correctly rounded; `nan` and `inf` are numbers here.
pub fn number(cell: &[u8]) -> Option<f64> {
    std::str::from_utf8(cell).ok()?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cells(line: &str, delimiter: u8) -> Result<Vec<String>, BrokenQuote> {
        Cells::new(line.as_bytes(), delimiter)
            .map(|cell| cell.map(|cell| String::from_utf8_lossy(cell).into_owned()))
            .collect()
    }

    #[test]
    fn cells_are_split_as_everybody_expects() {
        assert_eq!(cells("", b',').unwrap(), [""]);
        assert_eq!(cells("a", b',').unwrap(), ["a"]);
        assert_eq!(cells(" a , b,,c ,", b',').unwrap(), ["a", "b", "", "c", ""]);
        assert_eq!(cells("\t1\t\t2", b'\t').unwrap(), ["", "1", "", "2"]);
        assert_eq!(
            cells("\"a,b\" , \"c\",\"\"", b',').unwrap(),
            ["a,b", "c", ""]
        );
        assert_eq!(cells("\"a\"\t\"b\"\t", b'\t').unwrap(), ["a", "b", ""]);
        assert_eq!(cells("\"a\"\"b\",c", b',').unwrap(), ["a\"\"b", "c"]);
    }

    #[test]
    fn a_broken_quote_is_not_guessed_at() {
        for line in ["\"", "a,\"b", "\"1\"2,3", "\"a\"\"", "\"\"\""] {
            assert_eq!(cells(line, b','), Err(BrokenQuote), "{line}");
        }
    }

    #[test]
    fn the_delimiter_is_the_commonest() {
        assert_eq!(delimiter_of(b"t,q_0"), b',');
        assert_eq!(delimiter_of(b"t;q_0;a,b"), b';');
        assert_eq!(delimiter_of(b"t\tq_0"), b'\t');
        assert_eq!(delimiter_of(b""), b',');
    }

    #[test]
    fn numbers_are_decimal_numbers() {
        assert_eq!(number(b"-1.5e-3"), Some(-0.0015));
        assert_eq!(number(b"+.5"), Some(0.5));
        assert_eq!(
            number(b"-0.0").map(f64::to_bits),
            Some((-0.0_f64).to_bits())
        );
        assert!(number(b"NaN").unwrap().is_nan());
        assert_eq!(number(b"-Inf"), Some(f64::NEG_INFINITY));
        for cell in [
            &b""[..],
            b"1,5",
            b"0x10",
            b"1_000",
            b"abc",
            b"1 2",
            b"\xff",
            b".",
        ] {
            assert_eq!(number(cell), None);
        }
    }
}
