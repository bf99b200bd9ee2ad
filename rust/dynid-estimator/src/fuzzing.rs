//! The doors through which a stranger's bytes come in, each as a function of bytes: for `fuzz/`, not for programs.
//!
//! Every one goes on to an answer, and checks what an answer promises.

use std::sync::atomic::Ordering;
use std::sync::Arc;

use dynid_core::uncertainty::{Direction, Tail};
use dynid_core::watch::{Healthy, WatchSettings};
use dynid_core::{AdaptSettings, ObserverSettings, TorqueModel, Uncertainty};
use dynid_io::{ContactFile, WatchFile};

use crate::args::Format;
use crate::cycle::{Cycle, Settings};
use crate::frame::Frame;
use crate::input::{Lines, Parser};
use crate::output::{Answer, Writer};
use crate::run::frame_for;
use crate::shm::Scratch;
use crate::wire;

/// A model at work.
#[derive(Debug)]
pub struct Door {
    model: Arc<TorqueModel>,
    settings: Settings,
    fresh: Cycle,
    cycle: Cycle,
    frame: Frame,
    memory: Scratch,
    received: Vec<u8>,
    sent: Vec<u8>,
}

impl Door {
    /// All memory that datagrams need. None where the observer does not fit the model.
    pub fn new(model: TorqueModel) -> Option<Self> {
        let model = Arc::new(model);
        let n = model.robot().n_joints();
        let joints = model.robot().joints().iter();
        let watch = WatchFile {
            joints: joints.map(|joint| joint.name.clone()).collect(),
            settings: WatchSettings {
                row: 0.003, // so that short streams have rows
                ..WatchSettings::default()
            },
            healthy: Healthy {
                frozen_after: vec![0.002; n],
                ..Healthy::untold(n)
            },
        };
        let mut settings = Settings {
            observer: Some(ObserverSettings::default()),
            watch: Some(Arc::new(watch)),
            guide: true,
            adapt: Some(AdaptSettings {
                payload: true,
                row: 0.003,
                mass: 10.0,
                ..AdaptSettings::default()
            }),
            ..Settings::default()
        };
        settings.take_contacts(contacts(&model), None);
        let cycle = Cycle::new(Arc::clone(&model), &settings).ok()?;
        Some(Self {
            fresh: cycle.clone(),
            cycle,
            frame: frame_for(&model, &settings, false),
            memory: Scratch::new(n),
            received: vec![0; wire::most_state_bytes(n).div_ceil(8) * 8 + 8],
            sent: vec![0; wire::answer_bytes(n, model.n_terms())],
            model,
            settings,
        })
    }

    /// Forgets all states that came.
    pub fn reset(&mut self) {
        self.cycle.mirror(&self.fresh);
    }

    /// One datagram, or none where `bytes` is none. True if it was a state.
    ///
    /// # Panics
    /// If an answer is not finite.
    pub fn datagram(&mut self, bytes: Option<&[u8]>) -> bool {
        let n = self.model.robot().n_joints();
        self.cycle.begin();
        let used = bytes.is_some_and(|bytes| {
            wire::decode(bytes, n, &mut self.frame).is_ok()
                && self.cycle.step(&self.frame.sample()).is_ok()
        });
        if !used {
            self.cycle.hold();
        }
        let answer = self.cycle.answer(Some(self.frame.time));
        check(&answer);
        let length = wire::encode(&answer, self.frame.sequence.unwrap_or(0), &mut self.sent);
        assert!(length > 0, "an answer of this model has room");
        used
    }

    /// Shared memory whose slot somebody has filled with `words`: counter, length, then whatever follows.
    ///
    /// # Panics
    /// If an answer is not finite.
    pub fn memory(&mut self, words: impl Iterator<Item = u64>) -> bool {
        for (place, word) in self.memory.words().iter().zip(words) {
            place.store(word, Ordering::Relaxed);
        }
        let length = self.memory.receive(&mut self.received);
        let received = std::mem::take(&mut self.received);
        let used = self.datagram(length.and_then(|length| received.get(..length)));
        self.received = received;
        used
    }

    /// Standard input from its first byte to its end; how many states were answered, and the sentence it ended with.
    ///
    /// # Panics
    /// If an answer is not finite, or a refusal is no short sentence.
    pub fn lines(&mut self, bytes: &[u8], format: Format) -> (usize, Option<String>) {
        self.reset();
        let mut answered = 0;
        let ended = self.answer_lines(bytes, format, &mut answered);
        if let Some(sentence) = &ended {
            assert!(
                sentence.chars().count() < 600 && !sentence.contains('\n'),
                "{sentence}"
            );
        }
        (answered, ended)
    }

    fn answer_lines(
        &mut self,
        bytes: &[u8],
        format: Format,
        answered: &mut usize,
    ) -> Option<String> {
        let mut frame = frame_for(&self.model, &self.settings, false);
        let mut lines = Lines::new(bytes);
        let begun = Parser::begin(None, &mut lines, self.model.robot(), &mut frame);
        let mut parser = match begun {
            Ok(parser) => parser,
            Err(stop) => return Some(stop.to_string()),
        };
        let writer = Writer::new(
            format,
            &self.model,
            [true, true, self.settings.adapt.is_some()],
        );
        let mut out = Vec::new();
        loop {
            match lines.advance() {
                Ok(true) => {}
                Ok(false) => return None,
                Err(stop) => return Some(stop.to_string()),
            }
            if let Err(fault) = parser.parse(lines.line(), &mut frame) {
                return Some(lines.fault(&fault).to_string());
            }
            self.cycle.begin();
            if let Err(error) = self.cycle.step(&frame.sample()) {
                return Some(error.to_string());
            }
            let answer = self
                .cycle
                .answer(frame.present().time.then_some(frame.time));
            check(&answer);
            out.clear();
            assert!(writer.write(&answer, &mut out).is_ok(), "memory takes it");
            *answered += 1;
        }
    }
}

/// An observer that knows every joint worse by a direction of its own model, for samples a millisecond apart.
fn contacts(model: &TorqueModel) -> ContactFile {
    let n = model.robot().n_joints();
    let joints = model.robot().joints().iter();
    let terms = model.effects().iter();
    ContactFile {
        joints: joints.map(|joint| joint.name.clone()).collect(),
        torque_unit: model.torque_unit().to_owned(),
        step: 0.001,
        window: None,
        settings: ObserverSettings::default(),
        uncertainty: Uncertainty {
            moving: vec![0.5; n],
            standing: vec![0.1; n],
            turning: vec![1.0; n],
            torque: vec![1e-4; n],
            stops_known: vec![true; n],
            turns_known: vec![false; n],
            directions: vec![Direction {
                phi: model.phi().iter().map(|x| 0.1 * x + 0.01).collect(),
                effects: terms.map(|term| term.coefficients().to_vec()).collect(),
            }],
            tails: vec![
                Tail {
                    level: 10.0,
                    per_hour: 700.0,
                    growth: 2.0,
                };
                n
            ],
        },
    }
}

/// Numbers are numbers.
fn check(answer: &Answer<'_>) {
    let all = [
        answer.tau,
        answer.terms,
        answer.std,
        answer.external.unwrap_or(&[]),
        answer.guide.unwrap_or(&[]),
    ];
    for part in all {
        assert!(part.iter().all(|x| x.is_finite()), "{answer:?}");
    }
}

pub use crate::args::Format as LineFormat;
