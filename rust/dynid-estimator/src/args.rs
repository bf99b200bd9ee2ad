//! The command line.

use std::path::PathBuf;

use dynid_core::differentiator::{MAX_WINDOW, MIN_WINDOW};
use lexopt::{Arg, Parser, ValueExt};

use crate::cycle::Settings;
use crate::stop::Stop;

/// How states or torques are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// A header line, then one row per state.
    Csv,
    /// One JSON object per line.
    Jsonl,
}

/// What to do.
#[derive(Debug)]
pub enum Command {
    /// Print a text: `--help`, `--version`.
    Print(String),
    /// Say what the model is.
    Info {
        /// `model.json`.
        model: PathBuf,
        /// For machines.
        json: bool,
        /// How answers would be made.
        settings: Settings,
    },
    /// Answer states.
    Run {
        /// `model.json`.
        model: PathBuf,
        /// None: told by the first byte.
        input: Option<Format>,
        /// None: as the input.
        output: Option<Format>,
        /// How answers are made.
        settings: Settings,
    },
}

const HELP: &str = include_str!("help.txt");

/// Reads the command line.
///
/// # Errors
/// [`Stop::Because`] for wrong use.
pub fn parse(parser: Parser) -> Result<Command, Stop> {
    read(parser).map_err(|error| {
        let error = error.to_string();
        Stop::Because(format!("{error}; see dynid-estimator --help"))
    })
}

fn read(mut parser: Parser) -> Result<Command, lexopt::Error> {
    let (mut model, mut input, mut output) = (None, None, None);
    let mut settings = Settings::default();
    let (mut info, mut json) = (false, false);
    while let Some(arg) = parser.next()? {
        match arg {
            Arg::Short('h') | Arg::Long("help") => return Ok(Command::Print(HELP.to_owned())),
            Arg::Short('V') | Arg::Long("version") => {
                let version = env!("CARGO_PKG_VERSION");
                return Ok(Command::Print(format!("dynid-estimator {version}\n")));
            }
            Arg::Long("info") => info = true,
            Arg::Long("json") => json = true,
            Arg::Long("input-format") => {
                input = parser.value()?.parse_with(|text| match text {
                    "auto" => Ok(None),
                    other => format_named(other, "auto, csv or jsonl").map(Some),
                })?;
            }
            Arg::Long("step") => settings.step = Some(parser.value()?.parse_with(seconds)?),
            Arg::Long("window") => settings.window = Some(parser.value()?.parse_with(window)?),
            Arg::Long("format") => {
                let named = |text: &str| format_named(text, "csv or jsonl");
                output = Some(parser.value()?.parse_with(named)?);
            }
            Arg::Value(path) if model.is_none() => model = Some(PathBuf::from(path)),
            other => return Err(other.unexpected()),
        }
    }
    let model = model.ok_or("no model given, expected dynid-estimator MODEL.json")?;
    match (info, json) {
        (true, json) => Ok(Command::Info {
            model,
            json,
            settings,
        }),
        (false, true) => {
            Err("--json goes with --info; for torques as JSON lines give --format jsonl".into())
        }
        (false, false) => Ok(Command::Run {
            model,
            input,
            output,
            settings,
        }),
    }
}

fn format_named(text: &str, expected: &str) -> Result<Format, String> {
    match text {
        "csv" => Ok(Format::Csv),
        "jsonl" => Ok(Format::Jsonl),
        _ => Err(format!("expected {expected}")),
    }
}

fn window(text: &str) -> Result<usize, String> {
    let samples: Option<usize> = text.parse().ok();
    samples
        .filter(|samples| (MIN_WINDOW..=MAX_WINDOW).contains(samples) && samples % 2 == 1)
        .ok_or_else(|| format!("expected an odd number of samples, {MIN_WINDOW} to {MAX_WINDOW}"))
}

fn seconds(text: &str) -> Result<f64, &'static str> {
    let step: Option<f64> = text.parse().ok();
    step.filter(|step| *step > 0.0 && step.is_finite())
        .ok_or("expected a positive number of seconds")
}
