//! The command line.

use std::path::PathBuf;

use lexopt::{Arg, Parser, ValueExt};

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
    },
    /// Answer states.
    Run {
        /// `model.json`.
        model: PathBuf,
        /// None: told by the first byte.
        input: Option<Format>,
        /// None: as the input.
        output: Option<Format>,
        /// Time between states \[s\]; none: as the model says.
        step: Option<f64>,
    },
}

const HELP: &str = "\
The torque of an identified model, online: one state per line in, one line of torques out.

Usage: dynid-estimator MODEL.json [OPTIONS] < STATES > TORQUES

Options:
  --input-format auto|csv|jsonl  how states are written; auto (default): JSON lines if the first byte is '{'
  --format csv|jsonl             how torques are written; default: as the states
  --step SECONDS                 time between states, for effects that change with time; default: as at identification
  --info                         print what the model is, and read nothing
  --json                         with --info: as JSON
  -h, --help                     print this
  -V, --version                  print the version

States in, SI units, joints by index along the chain or by name:
  CSV   t,q_0,...,dq_0,...,ddq_0,...           one header line (q_shoulder_joint is q_0 of a chain that begins there)
  JSON  {\"t\":0.0,\"q\":[...],\"dq\":[...],\"ddq\":[...]}
  t is optional. q_motor, dq_motor, ddq_motor (motor side, divided by the gear ratio) are optional, for all joints or
  none; a signal that is not given equals the link side. Other names: time, timestamp; qd, qdd, qm, qmd. temperature (or
  temp, degC) is read where the model's friction follows it. Columns and keys that are not named here are ignored.

Torques out, in the model's unit:
  CSV   t,tau_0,...,rigid_body_0,...,status    tau is the sum, then every term
  JSON  {\"t\":0.0,\"tau\":[...],\"terms\":{\"rigid_body\":[...],...},\"status\":0}
  Numbers are the shortest decimals that come back bit for bit. Every line is flushed as soon as no further state waits.

Status, a sum of: 0 good, 1 the state held a NaN or an infinity (CSV nan, JSON null) and the last good torque is repeated,
  2 outside the states that the model was trained on, 4 far from the data of the residual, whose torque was faded out,
  8 without a temperature that friction follows, whose torque is then zero.

A line that cannot be read ends the program: exit 2 and one sentence on stderr, as for wrong use or an unreadable model.
";

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
    let mut step = None;
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
            Arg::Long("step") => step = Some(parser.value()?.parse_with(seconds)?),
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
        (true, json) => Ok(Command::Info { model, json }),
        (false, true) => {
            Err("--json goes with --info; for torques as JSON lines give --format jsonl".into())
        }
        (false, false) => Ok(Command::Run {
            model,
            input,
            output,
            step,
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

fn seconds(text: &str) -> Result<f64, &'static str> {
    let step: Option<f64> = text.parse().ok();
    step.filter(|step| *step > 0.0 && step.is_finite())
        .ok_or("expected a positive number of seconds")
}
