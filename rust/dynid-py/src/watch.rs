//! The watch along a run, by the code that runs online.

use std::path::PathBuf;
use std::sync::Arc;

use dynid_core::watch::{Change, Healthy, Watch, WatchSettings};
use dynid_core::OnlineEstimator;
use dynid_io::remembered::{digits_of, identity, parse_remembered};
use dynid_io::{Remembered, WatchFile};
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::lists::List;
use crate::model::PyTorqueModel;
use crate::samples::Samples;
use crate::{arrays, errors};

type Watched<'py> = (
    Vec<Bound<'py, PyDict>>,
    Bound<'py, PyArray1<usize>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
    (Vec<Bound<'py, PyDict>>, String),
    [Bound<'py, PyArray2<f64>>; 2],
);

/// Changes in the order in which they were named, each a dict; then of every row the sample that ended it (n_rows,), and
/// (n_rows, n) of what was left, the variance that the model expects, and 1 where the joint says something; and what stood before
/// the run, and the text of what the watch remembers at the end; and mean speeds of the rows (n_rows, n), and of every channel how many values it showed, how long all
/// together, the longest while which the torque was fast, and how far the model's went while one was shown, (n, 4). It goes on with what `remembered` says, the text of another run.
#[pyfunction]
#[pyo3(signature = (model, t, motion, tau, *, temperature=None, step, window=None, inflation, memory, least_speed, frozen_after, frozen_way, row, false_per_day, friction, gain, offset, load, delay, slip, unknown, remembered=None))]
#[expect(clippy::too_many_arguments, reason = "a keyword function")]
pub fn watch_run<'py>(
    py: Python<'py>,
    model: &PyTorqueModel,
    t: &Bound<'py, PyAny>,
    motion: [Option<Bound<'py, PyAny>>; 6],
    tau: &Bound<'py, PyAny>,
    temperature: Option<&Bound<'py, PyAny>>,
    step: f64,
    window: Option<usize>,
    inflation: List<f64>,
    memory: List<f64>,
    least_speed: List<f64>,
    frozen_after: List<f64>,
    frozen_way: List<f64>,
    row: f64,
    false_per_day: f64,
    friction: f64,
    gain: f64,
    offset: f64,
    load: f64,
    delay: f64,
    slip: f64,
    unknown: f64,
    remembered: Option<&str>,
) -> PyResult<Watched<'py>> {
    let n = model.0.robot().n_joints();
    let run = Samples::of(n, t, &motion, tau, temperature)?;
    let settings = WatchSettings {
        row,
        false_per_day,
        friction,
        gain,
        offset,
        load,
        delay,
        slip,
        unknown,
    };
    let healthy = Healthy {
        inflation: inflation.to_vec(),
        memory: memory.to_vec(),
        least_speed: least_speed.to_vec(),
        frozen_after: frozen_after.to_vec(),
        frozen_way: frozen_way.to_vec(),
    };
    let online = OnlineEstimator::new(Arc::clone(&model.0), Some(step), window);
    let mut online = online
        .and_then(|online| online.watching(settings, &healthy))
        .map_err(errors::core)?;
    let watch = WatchFile {
        joints: Vec::new(),
        settings,
        healthy,
    };
    let of = digits_of(&identity(&model.0, &watch).map_err(errors::model_file)?);
    if let Some(text) = remembered {
        recall(&mut online, text, &of)?;
    }
    let stood: Vec<Change> = online
        .watch()
        .map_or(vec![], |watch| watch.standing().collect());
    let mut numbers = online
        .watch()
        .map_or(vec![], |watch| vec![f64::NAN; watch.n_remembered()]);
    let (mut changes, mut ends) = (Vec::<(usize, Change)>::new(), Vec::new());
    let (mut left, mut variance, mut moves) = (Vec::new(), Vec::new(), Vec::new());
    let mut speed = Vec::new();
    let (samples, n_samples) = (run.rows()?, run.len());
    py.detach(|| {
        let (mut n_rows, mut noted) = (0, 0);
        // A run in which no row is judged to its end adds nothing to what is known.
        if let Some(watch) = online.watch_mut() {
            watch.remember(&mut numbers)?;
        }
        for k in 0..n_samples {
            online.step(&samples.at(k))?;
            changes.extend(online.change().map(|change| (k, *change)));
            let Some(watch) = online.watch_mut() else {
                continue;
            };
            if watch.row().0 > noted && watch.remember(&mut numbers)? {
                noted = watch.row().0;
            }
            let (now, of_left, of_variance, of_moves) = watch.row();
            if now > n_rows {
                n_rows = now;
                ends.push(k);
                left.extend_from_slice(of_left);
                variance.extend_from_slice(of_variance);
                speed.extend_from_slice(watch.row_speed());
                moves.extend(of_moves.iter().map(|moves| f64::from(*moves)));
            }
        }
        Ok(())
    })
    .map_err(errors::core)?;
    let channels = online.watch().into_iter().flat_map(Watch::repeats);
    let repeats = channels
        .flat_map(|channel| [channel.n as f64, channel.time, channel.longest, channel.way])
        .collect();
    let text = Remembered { of, numbers }.to_text();
    let changes = changes.iter().map(|(k, change)| told(py, *k, change));
    Ok((
        changes.collect::<PyResult<_>>()?,
        PyArray1::from_vec(py, ends),
        arrays::to_matrix(py, left, n)?,
        arrays::to_matrix(py, variance, n)?,
        arrays::to_matrix(py, moves, n)?,
        (
            stood
                .iter()
                .map(|change| told(py, 0, change))
                .collect::<PyResult<_>>()?,
            text.map_err(|error| errors::value(error.to_string()))?,
        ),
        [
            arrays::to_matrix(py, speed, n)?,
            arrays::to_matrix(py, repeats, 4)?,
        ],
    ))
}

/// Lets the watch go on with what another run's one remembered.
fn recall(online: &mut OnlineEstimator, text: &str, of: &str) -> PyResult<()> {
    const NAME: &str = "remembered";
    let said = |words: &str| errors::FormatError::new_err(format!("{NAME}: {words}; begin anew"));
    let found = parse_remembered(text.as_bytes(), NAME).map_err(errors::model_file)?;
    if found.of != of {
        return Err(said("of another model, or of a watch with other settings"));
    }
    match online.watch_mut().map(|watch| watch.recall(&found.numbers)) {
        Some(Err(_)) => Err(said("numbers that no watch remembers")),
        _ => Ok(()),
    }
}

/// What a `watch.json` holds: a dict of joints, row, false_per_day, friction, gain, offset, load, delay, slip, unknown, inflation, memory, least_speed,
/// frozen_after, frozen_way.
#[pyfunction]
pub fn read_watch(py: Python<'_>, path: PathBuf) -> PyResult<Bound<'_, PyDict>> {
    let file = py
        .detach(|| dynid_io::load_watch(&path))
        .map_err(errors::model_file)?;
    let (found, settings) = (PyDict::new(py), file.settings);
    found.set_item("joints", file.joints)?;
    for (name, value) in [
        ("row", settings.row),
        ("false_per_day", settings.false_per_day),
        ("friction", settings.friction),
        ("gain", settings.gain),
        ("offset", settings.offset),
        ("load", settings.load),
        ("delay", settings.delay),
        ("slip", settings.slip),
        ("unknown", settings.unknown),
    ] {
        found.set_item(name, value)?;
    }
    let healthy = file.healthy;
    for (name, values) in [
        ("inflation", healthy.inflation),
        ("memory", healthy.memory),
        ("least_speed", healthy.least_speed),
        ("frozen_after", healthy.frozen_after),
        ("frozen_way", healthy.frozen_way),
    ] {
        found.set_item(name, values)?;
    }
    Ok(found)
}

fn told<'py>(py: Python<'py>, sample: usize, change: &Change) -> PyResult<Bound<'py, PyDict>> {
    let told = PyDict::new(py);
    told.set_item("sample", sample)?;
    told.set_item("kind", change.kind.word())?;
    told.set_item("joint", change.joint)?;
    told.set_item("size", change.size)?;
    told.set_item("std", change.std)?;
    told.set_item("moments", change.moments)?;
    told.set_item("said", change.said.word())?;
    let or = change.or.map(|(kind, joint)| (kind.word(), joint));
    told.set_item("or", or)?;
    Ok(told)
}
