//! The loop over datagrams or shared memory: whatever arrives, and whether anything does, every cycle has an answer.
//!
//! ```text
//! sleep until the cycle begins (or wait for a datagram) -> every new state through the estimator -> one answer
//! ```
//!
//! After the first cycle it calls the system for the clock, the sleep and the transport only, and allocates nothing.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use dynid_core::TorqueModel;

use crate::changes::Outbox;
use crate::cycle::{Cycle, Settings};
use crate::frame::{Frame, TEMPERATURE, TORQUE};
use crate::pace::Pace;
use crate::rate::Rate;
use crate::realtime::RealTime;
use crate::rehearsal::Rehearsal;
use crate::remember::Notebook;
use crate::run::{frame_for, note_what_is_missing, tell, with_report};
use crate::shm::SharedMemory;
use crate::stop::Stop;
use crate::swap::{self, Inbox, MOST_TERMS};
use crate::sys;
use crate::timing::Timing;
use crate::udp::Udp;
use crate::wire;

/// States that one cycle takes; more wait for the next.
const MOST_STATES: usize = 64;

/// Input is stale after so many periods without any.
const PATIENCE: f64 = 2.0;

/// Where states come from and answers go.
#[derive(Clone, Debug, PartialEq)]
pub enum Transport {
    /// An address to listen on.
    Udp(String),
    /// A file to share.
    Shm(PathBuf),
}

/// A transport at work.
#[derive(Debug)]
enum Link {
    Udp(Udp),
    Shm(SharedMemory),
}

impl Link {
    fn receive(&mut self, out: &mut [u8]) -> Option<usize> {
        match self {
            Self::Udp(udp) => udp.receive(out),
            Self::Shm(memory) => memory.receive(out),
        }
    }

    /// The newest state where that can be seen without asking the system; it stays as new as it was.
    fn look(&self, out: &mut [u8]) -> Option<usize> {
        match self {
            Self::Udp(_) => None,
            Self::Shm(memory) => memory.look(out),
        }
    }

    fn trust_sender(&mut self) {
        if let Self::Udp(udp) = self {
            udp.trust_sender();
        }
    }

    fn send(&self, bytes: &[u8]) {
        match self {
            Self::Udp(udp) => udp.send(bytes),
            Self::Shm(memory) => memory.send(bytes),
        }
    }
}

/// Counts at the end of a run.
#[derive(Clone, Copy, Debug, Default)]
struct Counts {
    states: u64,
    refused: u64,
}

/// Answers until somebody asks for an end or the duration is over; what there is to report then.
///
/// # Errors
/// [`Stop`] if the transport cannot be opened or something asked of the machine is not permitted.
pub fn run(
    model: TorqueModel,
    transport: &Transport,
    settings: &Settings,
    real_time: &RealTime,
    watched: Option<PathBuf>,
) -> Result<Option<String>, Stop> {
    let model = Arc::new(model);
    let mut cycle = Cycle::new(Arc::clone(&model), settings)?;
    let notebook = Notebook::open(&mut cycle, settings)?;
    let most_terms = model.n_terms().max(MOST_TERMS);
    let n = model.robot().n_joints();
    // Before it says that it is there: whoever reads that may ask for its end at once.
    sys::catch_signals(watched.is_some()).map_err(|error| Stop::Because(error.to_string()))?;
    let link = match transport {
        Transport::Udp(address) => {
            let patience = real_time
                .rate
                .is_none()
                .then(|| Duration::from_secs_f64(PATIENCE * cycle.step_seconds()));
            let udp = Udp::listen(address, patience, n, most_terms)?;
            if let Ok(address) = udp.address() {
                tell("note", &format!("listening on {address}"));
            }
            Link::Udp(udp)
        }
        Transport::Shm(_) if real_time.rate.is_none() => {
            return Err(Stop::Because(
                "--shm: nobody wakes a reader of shared memory; give --rate".to_owned(),
            ))
        }
        Transport::Shm(name) => {
            let memory = SharedMemory::create(name, n, most_terms)?;
            tell(
                "note",
                &format!("sharing {}", crate::shm::path_of(name).display()),
            );
            Link::Shm(memory)
        }
    };
    real_time.lock_memory(watched.is_some())?;
    let inbox = watched.map(|path| swap::watch(path, Arc::clone(&model), settings.clone(), false));
    cycle = cycle.warm();
    let frame = frame_for(&model, settings, inbox.is_some());
    let mut live = Live::new(link, frame, &cycle, settings, most_terms);
    live.inbox = inbox;
    live.notebook = notebook;
    live.outbox = settings.speaks().then(|| Outbox::open(&model));
    let (sleeper, pace) = real_time.begin()?;
    let mut timing = Timing::new(pace.as_ref().map(Pace::period), real_time.histogram);
    live.work(&model, &mut cycle, (pace, real_time.end()), &mut timing);
    let Counts { states, refused } = live.counts;
    drop(live.outbox);
    let kept = live.notebook.map_or(Ok(()), Notebook::end);
    if refused > 0 {
        tell("note", &format!("{refused} messages were no states of this robot and not used, beside {states} that were"));
    }
    with_report(real_time.report(&timing, sleeper), kept)
}

impl Live {
    fn new(
        link: Link,
        frame: Frame,
        cycle: &Cycle,
        settings: &Settings,
        most_terms: usize,
    ) -> Self {
        let n = frame.n_joints();
        // One word more than any state, so that a longer message is seen to be one.
        let mut received = touched(wire::most_state_bytes(n).div_ceil(8) * 8 + 8);
        // The first state is rehearsed with a state of rest.
        let rest = wire::zero_state(n);
        received[..rest.len()].copy_from_slice(&rest);
        Self {
            link,
            rehearsal: Rehearsal::new(cycle, &frame),
            frame,
            n_joints: n,
            received,
            newest: rest.len(),
            sent: touched(wire::answer_bytes(n, most_terms)),
            inbox: None,
            outbox: None,
            rate: Rate::new(settings),
            notebook: None,
            counts: Counts::default(),
        }
    }
}

/// Bytes whose pages are in place.
fn touched(length: usize) -> Vec<u8> {
    vec![0xff; length]
}

struct Live {
    link: Link,
    frame: Frame,
    n_joints: usize,
    rehearsal: Rehearsal,
    received: Vec<u8>,
    /// Bytes of the last message in it.
    newest: usize,
    sent: Vec<u8>,
    inbox: Option<Inbox>,
    outbox: Option<Outbox>,
    rate: Rate,
    notebook: Option<Notebook>,
    counts: Counts,
}

impl Live {
    fn work(
        &mut self,
        model: &TorqueModel,
        cycle: &mut Cycle,
        (mut pace, end): (Option<Pace>, u64),
        timing: &mut Timing,
    ) {
        let mut met = false;
        timing.start();
        while !sys::stop_asked() && sys::now() < end {
            let begin = pace.as_mut().map(|pace| {
                pace.wait(|| {
                    timing.rehearse();
                    self.rehearse(cycle);
                })
            });
            if begin.is_some() && sys::stop_asked() {
                break; // the sleep was cut short, so this is no cycle
            }
            let due = begin.map(|begin| {
                timing.begin(begin, sys::now());
                begin.due
            });
            let done = self.cycle(cycle, due.is_some());
            let end_to_end = done.left.saturating_sub(due.unwrap_or(done.came));
            timing.end(done.compute, end_to_end, done.messages);
            if done.is_new && !met {
                // The first state says what the input has; nothing is said after it, and page faults count from here.
                met = true;
                note_what_is_missing(model, &self.frame, cycle);
                if self.frame.wants(TORQUE) && !self.frame.present().signals[TORQUE] {
                    tell(
                        "note",
                        "--observe, --changes and --adapt need the measured torque, which the first state does not have: status bit 8 says so",
                    );
                }
                timing.start();
            }
        }
        timing.stop();
    }

    /// Does what a cycle would do now and leaves no trace.
    fn rehearse(&mut self, cycle: &Cycle) {
        self.newest = self.link.look(&mut self.received).unwrap_or(self.newest);
        let message = self.received.get(..self.newest).unwrap_or_default();
        self.rehearsal
            .of_message(cycle, &self.frame, message, &mut self.sent);
    }

    /// Takes what came, and answers.
    fn cycle(&mut self, cycle: &mut Cycle, paced: bool) -> Done {
        cycle.begin();
        let (mut came, mut compute, mut is_new, mut messages) = (None, 0, false, 0);
        let mut waiting = self.link.receive(&mut self.received);
        // Now, because a driven loop waited above.
        if let Some(inbox) = &self.inbox {
            inbox.take(cycle, self.rehearsal.twin());
            self.frame.want(TEMPERATURE, cycle.follows_temperature());
        }
        for more in (0..MOST_STATES).rev() {
            let Some(length) = waiting else { break };
            let start = sys::now();
            came.get_or_insert(start);
            is_new |= self.use_message(length, cycle);
            messages += 1;
            compute += sys::now() - start;
            waiting = if paced && more > 0 {
                self.link.receive(&mut self.received)
            } else {
                None
            };
        }
        let start = sys::now();
        let mut length = 0;
        // What is no state is not answered; silence is.
        if is_new || paced || came.is_none() {
            if !is_new {
                cycle.hold();
                if !paced {
                    cycle.hold(); // it has been waited for as long as two periods
                }
            }
            let time = self.frame.present().time.then_some(self.frame.time);
            let sequence = self.frame.sequence.unwrap_or(0);
            length = wire::encode(&cycle.answer(time), sequence, &mut self.sent);
        }
        compute += sys::now() - start;
        if length > 0 {
            self.link.send(self.sent.get(..length).unwrap_or_default());
        }
        Done {
            came: came.unwrap_or(start),
            compute,
            left: sys::now(),
            is_new,
            messages,
        }
    }

    /// True if the message was a state.
    fn use_message(&mut self, length: usize, cycle: &mut Cycle) -> bool {
        self.newest = length;
        let bytes = self.received.get(..length).unwrap_or_default();
        let used = wire::decode(bytes, self.n_joints, &mut self.frame).is_ok()
            && cycle.step(&self.frame.sample()).is_ok();
        if used {
            if let Some(outbox) = &mut self.outbox {
                let rate = self.rate.note(self.frame.time);
                outbox.put(self.frame.time, cycle.told().chain(rate));
            }
            if let Some(notebook) = &mut self.notebook {
                notebook.note(cycle);
            }
            self.counts.states += 1;
            self.link.trust_sender();
        } else {
            self.counts.refused += 1;
        }
        used
    }
}

/// Times of a cycle \[ns\].
struct Done {
    /// When its first message had come.
    came: u64,
    compute: u64,
    /// When its answer had left.
    left: u64,
    is_new: bool,
    messages: u64,
}

#[cfg(all(test, target_os = "linux"))]
pub mod tests;
