//! The command line.

use std::path::PathBuf;

use dynid_core::differentiator::{MAX_WINDOW, MIN_WINDOW};
use dynid_core::{AdaptSettings, ObserverSettings};
use lexopt::{Arg, Parser, ValueExt};

use crate::cycle::Settings;
use crate::live::Transport;
use crate::realtime::RealTime;
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
    Run(Box<Run>),
}

/// How states are answered.
#[derive(Debug)]
pub struct Run {
    /// `model.json`.
    pub model: PathBuf,
    /// Of the input (none: told by the first byte) and of the output (none: as the input).
    pub formats: (Option<Format>, Option<Format>),
    /// How answers are made.
    pub settings: Settings,
    /// The settings of a watch, as `dynid watch --save` writes them.
    pub changes: Option<PathBuf>,
    /// Where watch and adaptation keep what they remember.
    pub remember: Option<PathBuf>,
    /// How far off the observer is, as `MomentumObserver.save` writes it; and how many false contacts are put up with, if not as
    /// the file says.
    pub contacts: Option<(PathBuf, Option<f64>)>,
    /// What is asked of the machine.
    pub real_time: RealTime,
    /// None: stdin and stdout.
    pub transport: Option<Transport>,
    /// Whether the model's file is watched.
    pub watch: bool,
}

/// What goes with `--info`.
const OF_INFO: [&str; 4] = ["info", "json", "step", "window"];

const HELP: &str = include_str!("help.txt");

/// Reads the command line.
///
/// # Errors
/// [`Stop::Because`] for wrong use.
pub fn parse(parser: Parser) -> Result<Command, Stop> {
    let mut option = String::new();
    read(parser, &mut option).map_err(|error| {
        let error = match error {
            // Of many options with numbers the one that is wrong is to be named.
            lexopt::Error::ParsingFailed { value, error } => {
                format!("{option}: {error}, got {value:?}")
            }
            other => other.to_string(),
        };
        Stop::Because(format!("{error}; see dynid-estimator --help"))
    })
}

/// `option` is the last one that was looked at.
fn read(mut parser: Parser, option: &mut String) -> Result<Command, lexopt::Error> {
    let (mut model, mut input, mut output, mut transport) = (None, None, None, None);
    let mut settings = Settings::default();
    let (mut observe, mut listening) = (false, ObserverSettings::default());
    let mut real_time = RealTime::default();
    let (mut info, mut json, mut watch) = (false, false, false);
    let (mut changes, mut remember) = (None, None);
    let (mut contacts, mut per_hour_given) = (None, None);
    let (mut adapt, mut limits) = (None, AdaptSettings::default());
    let mut of_running = None;
    while let Some(arg) = parser.next()? {
        if let Arg::Long(name) = arg {
            *option = format!("--{name}");
            if !OF_INFO.contains(&name) {
                of_running = Some(option.clone());
            }
        }
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
            Arg::Long("format") => {
                let named = |text: &str| format_named(text, "csv or jsonl");
                output = Some(parser.value()?.parse_with(named)?);
            }
            Arg::Long("step") => settings.step = Some(parser.value()?.parse_with(loop_time)?),
            Arg::Long("window") => settings.window = Some(parser.value()?.parse_with(window)?),
            Arg::Long("unlimited") => settings.unlimited = true,
            Arg::Long("observe") => observe = true,
            Arg::Long("observer-time") => {
                listening.time_constant = parser.value()?.parse_with(loop_time)?;
            }
            Arg::Long("noise-correlation") => {
                listening.correlation_time = Some(parser.value()?.parse_with(loop_time)?);
            }
            Arg::Long("false-contacts") => {
                listening.false_per_hour = parser.value()?.parse_with(per_hour)?;
                per_hour_given = Some(listening.false_per_hour);
            }
            Arg::Long("contacts") => contacts = Some(PathBuf::from(parser.value()?)),
            Arg::Long("guide") => settings.guide = true,
            Arg::Long("udp") => transport = Some(Transport::Udp(parser.value()?.string()?)),
            Arg::Long("shm") => transport = Some(Transport::Shm(parser.value()?.into())),
            Arg::Long("rate") => real_time.rate = Some(parser.value()?.parse_with(hertz)?),
            Arg::Long("early") => real_time.early = Some(parser.value()?.parse_with(early)?),
            Arg::Long("duration") => {
                real_time.duration = Some(parser.value()?.parse_with(seconds)?);
            }
            Arg::Long("histogram") => real_time.histogram = true,
            Arg::Long("jitter") => real_time.jitter = true,
            Arg::Long("mlock") => real_time.mlock = true,
            Arg::Long("fifo") => real_time.fifo = Some(parser.value()?.parse_with(priority)?),
            Arg::Long("core") => real_time.core = Some(parser.value()?.parse_with(core)?),
            Arg::Long("watch") => watch = true,
            Arg::Long("changes") => changes = Some(PathBuf::from(parser.value()?)),
            Arg::Long("adapt") => adapt = Some(parser.value()?.parse_with(parts)?),
            Arg::Long("adapt-memory") => limits.memory = parser.value()?.parse_with(memory)?,
            Arg::Long("adapt-factor") => limits.factor = parser.value()?.parse_with(factor)?,
            Arg::Long("adapt-mass") => limits.mass = parser.value()?.parse_with(mass)?,
            Arg::Long("adapt-reach") => limits.reach = parser.value()?.parse_with(reach)?,
            Arg::Long("remember") => remember = Some(PathBuf::from(parser.value()?)),
            Arg::Value(path) if model.is_none() => model = Some(PathBuf::from(path)),
            other => return Err(other.unexpected()),
        }
    }
    let model = model.ok_or("no model given, expected dynid-estimator MODEL.json")?;
    if info {
        if let Some(option) = of_running {
            return Err(
                format!("--info reads nothing and says nothing of {option}; leave it out").into(),
            );
        }
        return Ok(Command::Info {
            model,
            json,
            settings,
        });
    }
    if json && !real_time.histogram {
        return Err(
            "--json goes with --info or --histogram; for torques as JSON lines give --format jsonl"
                .into(),
        );
    }
    if contacts.is_some() {
        let of_file = ObserverSettings {
            time_constant: listening.time_constant,
            correlation_time: listening.correlation_time,
            ..ObserverSettings::default()
        };
        if of_file != ObserverSettings::default() {
            return Err(
                "--observer-time and --noise-correlation: --contacts FILE says these".into(),
            );
        }
        if settings.step.is_some() || settings.window.is_some() {
            return Err("--step and --window: --contacts FILE says these".into());
        }
    }
    if !observe && (contacts.is_some() || settings.guide) {
        return Err("--contacts and --guide go with --observe".into());
    }
    if observe {
        settings.observer = Some(listening);
    } else if listening != ObserverSettings::default() {
        return Err(
            "--observer-time, --noise-correlation and --false-contacts go with --observe".into(),
        );
    }
    if real_time.jitter && !(real_time.histogram && real_time.rate.is_some()) {
        return Err("--jitter goes with --histogram and --rate".into());
    }
    settings.adapt = adapted(adapt, limits)?;
    if remember.is_some() && changes.is_none() && settings.adapt.is_none() {
        return Err("--remember goes with --changes or --adapt".into());
    }
    match (real_time.early, real_time.rate) {
        (Some(_), None) => return Err("--early goes with --rate".into()),
        (Some(early), Some(rate)) if early > 0.5 / rate => {
            return Err("--early: expected half a period at most".into())
        }
        _ => {}
    }
    if transport.is_some() && (input.is_some() || output.is_some()) {
        return Err(
            "--input-format and --format are for standard input, not for --udp or --shm".into(),
        );
    }
    real_time.json = json;
    Ok(Command::Run(Box::new(Run {
        model,
        formats: (input, output),
        settings,
        changes,
        remember,
        contacts: contacts.map(|path| (path, per_hour_given)),
        real_time,
        transport,
        watch,
    })))
}

/// What follows the arm, within which limits.
fn adapted(
    parts: Option<[bool; 2]>,
    limits: AdaptSettings,
) -> Result<Option<AdaptSettings>, lexopt::Error> {
    let Some([friction, payload]) = parts else {
        if limits != AdaptSettings::default() {
            return Err(
                "--adapt-memory, --adapt-factor, --adapt-mass and --adapt-reach go with --adapt"
                    .into(),
            );
        }
        return Ok(None);
    };
    let of_payload = AdaptSettings {
        mass: limits.mass,
        reach: limits.reach,
        ..AdaptSettings::default()
    };
    if !payload && of_payload != AdaptSettings::default() {
        return Err(
            "--adapt-mass and --adapt-reach are limits of a payload; give --adapt friction,payload"
                .into(),
        );
    }
    if payload && limits.mass == 0.0 {
        return Err(
            "--adapt payload: give --adapt-mass KG, what the arm may carry; a payload follows within it".into(),
        );
    }
    Ok(Some(AdaptSettings {
        friction,
        payload,
        ..limits
    }))
}

/// Whether friction follows, and payload.
fn parts(text: &str) -> Result<[bool; 2], &'static str> {
    match text {
        "friction" => Ok([true, false]),
        "payload" => Ok([false, true]),
        "friction,payload" | "payload,friction" => Ok([true, true]),
        _ => Err("expected friction, payload or friction,payload, each once"),
    }
}

fn between(text: &str, low: f64, high: f64) -> Option<f64> {
    let number: Option<f64> = text.parse().ok();
    number.filter(|x| (low..=high).contains(x))
}

fn memory(text: &str) -> Result<f64, &'static str> {
    between(text, 1.0, 1e5).ok_or("expected seconds of motion, 1 to 100000")
}

fn mass(text: &str) -> Result<f64, &'static str> {
    between(text, 1e-3, 1e5).ok_or("expected kg, 0.001 to 100000")
}

fn reach(text: &str) -> Result<f64, &'static str> {
    between(text, 1e-3, 100.0).ok_or("expected m, 0.001 to 100")
}

fn factor(text: &str) -> Result<[f64; 2], &'static str> {
    let (least, most) = text.split_once(':').unwrap_or_default();
    let (least, most) = (between(least, 0.0, 0.99), between(most, 1.01, 100.0));
    let both = least.zip(most).map(|(least, most)| [least, most]);
    both.ok_or("expected LEAST:MOST, 0 to 0.99 and 1.01 to 100")
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

fn hertz(text: &str) -> Result<f64, &'static str> {
    let rate: Option<f64> = text.parse().ok();
    rate.filter(|rate| (0.01..=100_000.0).contains(rate))
        .ok_or("expected cycles per second, 0.01 to 100000")
}

fn priority(text: &str) -> Result<i32, &'static str> {
    let priority: Option<i32> = text.parse().ok();
    priority
        .filter(|priority| (1..=99).contains(priority))
        .ok_or("expected a priority, 1 to 99")
}

fn core(text: &str) -> Result<usize, &'static str> {
    text.parse()
        .map_err(|_| "expected the number of a core, counted from 0")
}

fn per_hour(text: &str) -> Result<f64, &'static str> {
    let count: Option<f64> = text.parse().ok();
    count
        .filter(|count| *count > 0.0 && count.is_finite())
        .ok_or("expected false contacts per hour, a number above 0")
}

fn early(text: &str) -> Result<f64, &'static str> {
    let early: Option<f64> = text.parse().ok();
    early
        .filter(|early| (0.0..=0.01).contains(early))
        .ok_or("expected seconds, 0 to 0.01")
}

/// A step, or a time over which a loop remembers: periods of what [`hertz`] takes.
fn loop_time(text: &str) -> Result<f64, &'static str> {
    let time: Option<f64> = text.parse().ok();
    time.filter(|time| (1e-5..=100.0).contains(time))
        .ok_or("expected a positive number of seconds, 0.00001 to 100")
}

fn seconds(text: &str) -> Result<f64, &'static str> {
    let step: Option<f64> = text.parse().ok();
    step.filter(|step| *step > 0.0 && step.is_finite())
        .ok_or("expected a positive number of seconds")
}
