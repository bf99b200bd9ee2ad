//! The loop over lines: a line in, a measurement, an answer, a line out.

use std::io::{self, Read, Write};
use std::path::PathBuf;
use std::sync::Arc;

use dynid_core::TorqueModel;

use crate::args::Format;
use crate::changes::Outbox;
use crate::cycle::{Cycle, Settings};
use crate::frame::{Frame, Present, TEMPERATURE, TORQUE};
use crate::info::early_channels;
use crate::input::{Lines, Parser};
use crate::output::Writer;
use crate::pace::Pace;
use crate::rate::Rate;
use crate::realtime::RealTime;
use crate::rehearsal::Rehearsal;
use crate::remember::Notebook;
use crate::stop::Stop;
use crate::swap;
use crate::sys;
use crate::timing::Timing;

/// Answers every state of `source` on `out`. Nothing waits: as soon as no further line is there to be read, all answers
/// are flushed. A line that is not a state ends the work, because what follows a broken line cannot be trusted either,
/// and a controller must see that at once.
///
/// # Errors
/// [`Stop`] if a line cannot be read or an answer cannot be written.
pub fn run(
    model: TorqueModel,
    (input, output): (Option<Format>, Option<Format>),
    settings: &Settings,
    real_time: &RealTime,
    watched: Option<PathBuf>,
    source: impl Read,
    out: &mut impl Write,
) -> Result<Option<String>, Stop> {
    let model = Arc::new(model);
    let mut cycle = Cycle::new(Arc::clone(&model), settings)?;
    real_time.lock_memory(watched.is_some())?;
    let inbox = watched.map(|path| swap::watch(path, Arc::clone(&model), settings.clone(), true));
    let open = match real_time.rate {
        Some(_) => Outbox::open,
        None => Outbox::patient,
    };
    let mut outbox = settings.speaks().then(|| open(&model));
    let mut notebook = Notebook::open(&mut cycle, settings)?;
    let mut clock = Clock::new(&model, settings.step);
    let mut rate = Rate::new(settings);
    let mut frame = frame_for(&model, settings, inbox.is_some());

    let mut lines = Lines::new(source);
    let mut parser = Parser::begin(input, &mut lines, model.robot(), &mut frame)?;
    let writer = Writer::new(
        output.unwrap_or(parser.format()),
        &model,
        [
            settings.observer.is_some(),
            settings.guide,
            settings.adapt.is_some(),
        ],
    );
    note_what_is_missing(&model, &frame, &cycle);
    if frame.wants(TORQUE) && !frame.present().signals[TORQUE] {
        return Err(Stop::Because(
            format!(
                "--observe, --changes and --adapt need the measured torque of every joint in the model's unit, {}_0 and so on, which the input does not have",
                frame.names()[TORQUE][0]
            ),
        ));
    }
    if frame.present().is_differentiated() {
        clock.watch_for_the_filter(&model, settings.step);
    }
    writer
        .begin(frame.present().time, out)
        .map_err(Stop::output)?;
    cycle = cycle.warm();
    let mut rehearsal = Rehearsal::new(&cycle, &frame);
    let (sleeper, mut pace) = real_time.begin()?;
    let end = real_time.end();
    let mut timing = Timing::new(pace.as_ref().map(Pace::period), real_time.histogram);
    loop {
        if !lines.line_waits() {
            out.flush().map_err(Stop::output)?;
        }
        if sys::now() >= end || !lines.advance()? {
            break;
        }
        let due = pace.as_mut().map(|pace| {
            let begin = pace.wait(|| {
                timing.rehearse();
                rehearsal.of_line(&cycle, &frame, (&mut parser, lines.line()), &writer);
            });
            timing.begin(begin, sys::now());
            begin.due
        });
        let start = sys::now();
        if let Some(inbox) = &inbox {
            inbox.take(&mut cycle, rehearsal.twin());
            frame.want(TEMPERATURE, cycle.follows_temperature());
        }
        parser
            .parse(lines.line(), &mut frame)
            .map_err(|fault| lines.fault(&fault))?;
        clock.note_another_step(frame.time);
        cycle.begin();
        cycle
            .step(&frame.sample())
            .map_err(|error| Stop::Because(error.to_string()))?;
        let computed = sys::now();
        if let Some(outbox) = &mut outbox {
            outbox.put(frame.time, cycle.told().chain(rate.note(frame.time)));
        }
        if let Some(notebook) = &mut notebook {
            notebook.note(&mut cycle);
        }
        let answer = cycle.answer(frame.present().time.then_some(frame.time));
        writer.write(&answer, out).map_err(Stop::output)?;
        // A sleep that was cut short by a wish to end leaves before it is due.
        let end_to_end = sys::now().saturating_sub(due.unwrap_or(start));
        timing.end(computed - start, end_to_end, 1);
    }
    out.flush().map_err(Stop::output)?;
    timing.stop();
    let kept = notebook.map_or(Ok(()), Notebook::end);
    with_report(real_time.report(&timing, sleeper), kept)
}

/// The report of a run's times. Where what was to be `kept` is not, it goes to stderr before that is said.
pub fn with_report(report: Option<String>, kept: Result<(), Stop>) -> Result<Option<String>, Stop> {
    if let (Some(report), Err(_)) = (&report, &kept) {
        let _ = io::stderr().write_all(report.as_bytes());
    }
    kept.map(|()| report)
}

/// A frame for what the model wants to know; where it is watched, the one that comes may want more.
pub fn frame_for(model: &TorqueModel, settings: &Settings, watched: bool) -> Frame {
    let follows_temperature = model.wants_temperature().contains(&true);
    Frame::new(model.robot().n_joints())
        .wanting(TEMPERATURE, follows_temperature)
        .seeking(TEMPERATURE, watched)
        .wanting(TORQUE, settings.wants_torque())
        .measured_in(model.torque_unit())
}

/// Watches that states come as far apart as the effects that change with time were told.
struct Clock {
    /// Time between states \[s\], as long as it is to be watched.
    step: Option<f64>,
    before: f64,
}

impl Clock {
    /// A step that was given with `--step` is believed.
    fn new(model: &TorqueModel, given: Option<f64>) -> Self {
        let mut effects = model.effects().iter();
        let matters = effects.any(|term| term.effect().entry().needs("step"))
            || model.torque_delay().iter().any(|delay| *delay > 0.0);
        Self {
            step: model.step().filter(|_| matters && given.is_none()),
            before: f64::NAN,
        }
    }

    /// A filter counts the step too.
    fn watch_for_the_filter(&mut self, model: &TorqueModel, given: Option<f64>) {
        let counted = model.step().unwrap_or(dynid_core::online::USUAL_STEP);
        self.step = given.is_none().then_some(counted);
    }

    /// Says once if two times are not a step apart, by more than their digits explain.
    fn note_another_step(&mut self, time: f64) {
        let Some(step) = self.step else { return };
        let apart = time - self.before;
        self.before = time;
        if apart.is_finite() {
            self.step = None;
            if (apart - step).abs() > 0.1 * step {
                tell(
                    "note",
                    &format!("the first states are {apart} s apart, the model counts {step} s from one to the next; give --step"),
                );
            }
        }
    }
}

/// What the input does not have is made up for, but not silently.
pub fn note_what_is_missing(model: &TorqueModel, frame: &Frame, cycle: &Cycle) {
    let present = frame.present();
    note_a_missing_encoder(model, present);
    if let Some(early) = early_channels(model) {
        tell(
            "note",
            &format!(
                "the model's torque channel is early ({early}), and no state is known before it comes: its answers are the torque of the state, not what it shows at that time"
            ),
        );
    }
    if model.wants_temperature().contains(&true) && !present.signals[TEMPERATURE] {
        tell(
            "note",
            "the model's friction follows a measured temperature, the input has none: that term is zero, status bit 8 says so",
        );
    }
    if present.is_differentiated() {
        tell(
            "note",
            &format!(
                "the input has no dq or no ddq: positions are differentiated, and every answer is that of {:.4} ms before",
                1e3 * cycle.delay()
            ),
        );
    }
}

/// Two encoders at identification and one now is allowed, but not silent.
fn note_a_missing_encoder(model: &TorqueModel, present: Present) {
    let deflection = model
        .residual()
        .is_some_and(|residual| residual.inputs().two_encoders());
    let two_encoders = deflection || model.encoder_delay().iter().any(|delay| *delay != 0.0);
    let q_motor = present.signals[3];
    // Where everything is differentiated, so is the motor side.
    let dq_motor = present.signals[4] || (present.is_differentiated() && q_motor);
    for (name, there) in [("q_motor", q_motor), ("dq_motor", dq_motor)] {
        if two_encoders && !there {
            tell(
                "note",
                &format!("the model was identified with two encoders, the input has no {name}: the link side is taken for it"),
            );
        }
    }
}

/// One sentence on stderr; that stderr is closed is no reason to stop.
pub fn tell(kind: &str, sentence: &str) {
    let sentence = sentence.replace(['\n', '\r'], " ");
    let _ = writeln!(io::stderr(), "{kind}: {sentence}");
}
