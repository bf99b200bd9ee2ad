//! Bytes in, states out.

mod cells;
mod csv;
mod json;
mod lines;

use std::fmt;
use std::io::Read;

use dynid_core::RobotModel;

pub use lines::Lines;

use crate::args::Format;
use crate::frame::Frame;
use crate::stop::Stop;

/// What is wrong with a line.
#[derive(Debug)]
pub struct Fault {
    column: Option<String>,
    sentence: String,
}

impl Fault {
    /// A fault of a whole line.
    fn line(sentence: impl Into<String>) -> Self {
        Self {
            column: None,
            sentence: sentence.into(),
        }
    }

    /// A fault of one cell.
    fn cell(column: &str, sentence: impl Into<String>) -> Self {
        Self {
            column: Some(shown(column.as_bytes())),
            sentence: sentence.into(),
        }
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.column {
            Some(column) => write!(f, ", column {column}: {}", self.sentence),
            None => write!(f, ": {}", self.sentence),
        }
    }
}

/// Quoted, escaped and cut, so that whatever came in stays one short sentence.
fn shown(bytes: &[u8]) -> String {
    const MOST: usize = 60;
    let text = String::from_utf8_lossy(&bytes[..bytes.len().min(4 * MOST)]).into_owned();
    if text.chars().count() > MOST || bytes.len() > 4 * MOST {
        let start: String = text.chars().take(MOST).collect();
        format!("{start:?}...")
    } else {
        format!("{text:?}")
    }
}

/// How lines become states.
#[derive(Debug)]
pub enum Parser {
    /// By the columns of the header.
    Csv(csv::Columns),
    /// By the keys of every object.
    Jsonl(json::Objects),
}

impl Parser {
    /// Finds the format and which signals the input has; the next line is then the first state.
    ///
    /// # Errors
    /// [`Stop`] if the input is empty or unreadable, or its header does not fit the robot.
    pub fn begin<R: Read>(
        format: Option<Format>,
        lines: &mut Lines<R>,
        robot: &RobotModel,
        frame: &mut Frame,
    ) -> Result<Self, Stop> {
        if !lines.advance()? {
            return Err(lines.fault(&Fault::line(
                "the input is empty, expected a CSV header or a JSON object",
            )));
        }
        let format = format.unwrap_or(if lines.line().trim_ascii_start().starts_with(b"{") {
            Format::Jsonl
        } else {
            Format::Csv
        });
        match format {
            Format::Csv => {
                lines.hold();
                csv::Columns::read(lines, robot, frame).map(Self::Csv)
            }
            Format::Jsonl => {
                let mut objects = json::Objects::default();
                objects
                    .parse(lines.line(), frame)
                    .map_err(|fault| lines.fault(&fault))?;
                lines.hold();
                Ok(Self::Jsonl(objects))
            }
        }
    }

    /// The format of the input.
    pub fn format(&self) -> Format {
        match self {
            Self::Csv(_) => Format::Csv,
            Self::Jsonl(_) => Format::Jsonl,
        }
    }

    /// Reads one state.
    ///
    /// # Errors
    /// [`Fault`] if the line is not a state like the ones before.
    pub fn parse(&mut self, line: &[u8], frame: &mut Frame) -> Result<(), Fault> {
        match self {
            Self::Csv(columns) => columns.parse(line, frame),
            Self::Jsonl(objects) => objects.parse(line, frame),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whatever_is_shown_is_short_and_on_one_line() {
        assert_eq!(shown(b"a\nb"), "\"a\\nb\"");
        let long = shown(&[b'x'; 1000]);
        assert_eq!(long, format!("\"{}\"...", "x".repeat(60)));
        assert!(shown(&[0xff; 1000]).chars().count() < 70);
    }
}
