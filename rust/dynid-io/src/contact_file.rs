//! `contact.json`: how far off the observer of an arm is where nothing pushes, as `dyn.MomentumObserver.save` writes it.

use std::path::Path;

use dynid_core::uncertainty::{Direction, Tail, MOST_DIRECTIONS};
use dynid_core::{ObserverSettings, Uncertainty};
use serde::de::IgnoredAny;
use serde::Deserialize;

use crate::small_file::Kind;
use crate::text::shorten_said;
use crate::ModelFileError;

/// Name in the `format` field.
pub const FORMAT: &str = "dynid-contact";
/// Newest version of the file that this reader understands.
pub const VERSION: u32 = 2;
/// Larger files are refused before memory is taken \[bytes\].
pub const MAX_BYTES: u64 = 4 << 20;

/// The observer of one arm: for `OnlineEstimator::observing` and `OnlineEstimator::knowing`.
#[derive(Clone, Debug, PartialEq)]
pub struct ContactFile {
    /// Names of the joints, along the chain.
    pub joints: Vec<String>,
    /// Of the runs and the model.
    pub torque_unit: String,
    /// Time between the samples of the healthy runs \[s\].
    pub step: f64,
    /// Samples that they were differentiated over; none: the usual number.
    pub window: Option<usize>,
    /// How the observer listens.
    pub settings: ObserverSettings,
    /// How far off it is.
    pub uncertainty: Uncertainty,
}

const KIND: Kind = Kind {
    none: "not an observer's uncertainty",
    format: FORMAT,
    version: VERSION,
    max_bytes: MAX_BYTES,
    mend: "write it anew with `dynid contact MODEL --healthy RUN --save`",
};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Parts {
    #[serde(rename = "format")]
    _format: IgnoredAny,
    #[serde(rename = "version")]
    _version: IgnoredAny,
    joints: Vec<String>,
    torque_unit: String,
    step: f64,
    window: Option<usize>,
    time_constant: f64,
    false_contacts_per_hour: f64,
    moving: Vec<f64>,
    standing: Vec<f64>,
    turning: Vec<f64>,
    torque: Vec<f64>,
    stops_known: Vec<bool>,
    turns_known: Vec<bool>,
    tail: TailParts,
    directions: Vec<DirectionParts>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct TailParts {
    level: Vec<f64>,
    per_hour: Vec<f64>,
    growth: Vec<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct DirectionParts {
    phi: Vec<f64>,
    effects: Vec<Vec<f64>>,
}

/// Reads the file.
///
/// # Errors
/// [`ModelFileError`], with one sentence that names the file and the mend.
pub fn load_contact(path: &Path) -> Result<ContactFile, ModelFileError> {
    KIND.load(path, read)
}

/// Reads it from bytes; `name` is used in messages. Whether it is of a model is for [`Uncertainty::check`] to say.
///
/// # Errors
/// [`ModelFileError::Invalid`].
pub fn parse_contact(bytes: &[u8], name: &str) -> Result<ContactFile, ModelFileError> {
    KIND.parse(bytes, name, read)
}

fn read(bytes: &[u8]) -> Result<ContactFile, String> {
    let parts: Parts = KIND.parts(bytes)?;
    for (what, seconds) in [("step", parts.step), ("time_constant", parts.time_constant)] {
        if !(1e-5..=100.0).contains(&seconds) {
            return Err(format!("{what} is no time from 0.00001 to 100 s"));
        }
    }
    if parts.directions.len() > MOST_DIRECTIONS {
        return Err(format!(
            "{} directions, at most {MOST_DIRECTIONS} are read",
            parts.directions.len()
        ));
    }
    let settings = ObserverSettings {
        time_constant: parts.time_constant,
        correlation_time: None,
        false_per_hour: parts.false_contacts_per_hour,
    };
    settings
        .check()
        .map_err(|error| shorten_said(&error.to_string()))?;
    let n = parts.joints.len();
    let lengths = [
        ("moving", parts.moving.len()),
        ("standing", parts.standing.len()),
        ("turning", parts.turning.len()),
        ("torque", parts.torque.len()),
        ("stops_known", parts.stops_known.len()),
        ("turns_known", parts.turns_known.len()),
        ("level", parts.tail.level.len()),
        ("per_hour", parts.tail.per_hour.len()),
        ("growth", parts.tail.growth.len()),
    ];
    for (what, length) in lengths {
        if length != n {
            return Err(format!("{length} values of {what} for {n} joints"));
        }
    }
    let directions = parts.directions.into_iter().map(|direction| Direction {
        phi: direction.phi,
        effects: direction.effects,
    });
    let TailParts {
        level,
        per_hour,
        growth,
    } = parts.tail;
    let tails = level.into_iter().zip(per_hour).zip(growth);
    let tails = tails.map(|((level, per_hour), growth)| Tail {
        level,
        per_hour,
        growth,
    });
    Ok(ContactFile {
        joints: parts.joints,
        torque_unit: parts.torque_unit,
        step: parts.step,
        window: parts.window,
        settings,
        uncertainty: Uncertainty {
            moving: parts.moving,
            standing: parts.standing,
            turning: parts.turning,
            torque: parts.torque,
            stops_known: parts.stops_known,
            turns_known: parts.turns_known,
            directions: directions.collect(),
            tails: tails.collect(),
        },
    })
}
