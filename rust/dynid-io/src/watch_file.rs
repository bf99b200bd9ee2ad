//! `watch.json`: how a model is watched, as `dynid watch --save` writes it, and what healthy runs said of its error.

use std::path::Path;

use dynid_core::watch::{Healthy, WatchSettings};
use serde::de::IgnoredAny;
use serde::Deserialize;

use crate::small_file::Kind;
use crate::text::shorten_said;
use crate::ModelFileError;

/// Name in the `format` field.
pub const FORMAT: &str = "dynid-watch-settings";
/// Newest version of the file that this reader understands.
pub const VERSION: u32 = 3;
/// Larger files are refused before memory is taken \[bytes\].
pub const MAX_BYTES: u64 = 1 << 20;

/// A watch of one arm: for `OnlineEstimator::watching`.
#[derive(Clone, Debug, PartialEq)]
pub struct WatchFile {
    /// Names of the joints, along the chain.
    pub joints: Vec<String>,
    /// What is tolerated, and how many false alarms.
    pub settings: WatchSettings,
    /// What healthy runs said; a time without a number is infinite, as null in the file.
    pub healthy: Healthy,
}

const KIND: Kind = Kind {
    none: "not a watch's settings",
    format: FORMAT,
    version: VERSION,
    max_bytes: MAX_BYTES,
    mend: "write it anew with `dynid watch MODEL.json --save`",
};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Parts {
    #[serde(rename = "format")]
    _format: IgnoredAny,
    #[serde(rename = "version")]
    _version: IgnoredAny,
    joints: Vec<String>,
    row: f64,
    false_alarms_per_day: f64,
    tolerated: Tolerated,
    inflation: Vec<f64>,
    memory: Vec<f64>,
    /// JSON has no infinity: null is never, and of a speed too fast for any row.
    least_speed: Vec<Option<f64>>,
    frozen_after: Vec<Option<f64>>,
    frozen_way: Vec<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Tolerated {
    friction: f64,
    gain: f64,
    offset: f64,
    load: f64,
    delay: f64,
    slip: f64,
    unknown: f64,
}

/// Reads the file.
///
/// # Errors
/// [`ModelFileError`], with one sentence that names the file and the mend.
pub fn load_watch(path: &Path) -> Result<WatchFile, ModelFileError> {
    KIND.load(path, read)
}

/// Reads it from bytes; `name` is used in messages.
///
/// # Errors
/// [`ModelFileError::Invalid`].
pub fn parse_watch(bytes: &[u8], name: &str) -> Result<WatchFile, ModelFileError> {
    KIND.parse(bytes, name, read)
}

fn read(bytes: &[u8]) -> Result<WatchFile, String> {
    let parts: Parts = KIND.parts(bytes)?;
    let settings = WatchSettings {
        row: parts.row,
        false_per_day: parts.false_alarms_per_day,
        friction: parts.tolerated.friction,
        gain: parts.tolerated.gain,
        offset: parts.tolerated.offset,
        load: parts.tolerated.load,
        delay: parts.tolerated.delay,
        slip: parts.tolerated.slip,
        unknown: parts.tolerated.unknown,
    };
    settings
        .check()
        .map_err(|error| shorten_said(&error.to_string()))?;
    let n = parts.joints.len();
    let lists = [
        ("inflation", parts.inflation.len()),
        ("memory", parts.memory.len()),
        ("least_speed", parts.least_speed.len()),
        ("frozen_after", parts.frozen_after.len()),
        ("frozen_way", parts.frozen_way.len()),
    ];
    if let Some((what, values)) = lists.into_iter().find(|(_, values)| *values != n) {
        return Err(format!("{values} values of {what} for {n} joints"));
    }
    if !(1e-3..=3600.0).contains(&parts.row) {
        return Err("a row is no time from 0.001 to 3600 s".to_owned());
    }
    if !parts.inflation.iter().all(|x| *x > 1e-12 && *x < 1e12) {
        return Err("an inflation is no number from 1e-12 to 1e12".to_owned());
    }
    if !parts.memory.iter().all(|x| *x >= 1.0 && *x < 1e12) {
        return Err("a memory is no number of rows from 1 to 1e12".to_owned());
    }
    let mut after = parts.frozen_after.iter().flatten();
    if !after.all(|x| *x > 0.0 && *x < 1e12) {
        return Err("a frozen_after is neither null nor a time from 0 to 1e12 s".to_owned());
    }
    let ways = parts.least_speed.iter().flatten().chain(&parts.frozen_way);
    if !ways.copied().all(|x| (0.0..1e12).contains(&x)) {
        return Err("a least_speed or a frozen_way is no number from 0 to 1e12".to_owned());
    }
    let or_infinite = |x: Vec<Option<f64>>| x.into_iter().map(|x| x.unwrap_or(f64::INFINITY));
    Ok(WatchFile {
        joints: parts.joints,
        settings,
        healthy: Healthy {
            inflation: parts.inflation,
            memory: parts.memory,
            least_speed: or_infinite(parts.least_speed).collect(),
            frozen_after: or_infinite(parts.frozen_after).collect(),
            frozen_way: parts.frozen_way,
        },
    })
}
