//! What the next cycle will do, done before on a twin of the state, so that code, model and state are near when it is due.
//!
//! The twin becomes like the state first, which reads all of it; the state itself is only looked at, so no answer can
//! depend on whether there was a rehearsal. No allocation, no lock, no system call but the clock.

use std::hint::black_box;

use crate::cycle::Cycle;
use crate::frame::Frame;
use crate::input::Parser;
use crate::output::Writer;
use crate::sys;
use crate::wire;

/// Bytes of a line that is written and thrown away; what is longer is cut.
const LINE: usize = 1 << 13;

/// A twin of the state, of the frame, and somewhere to write lines to.
#[derive(Debug)]
pub struct Rehearsal {
    twin: Cycle,
    frame: Frame,
    line: Vec<u8>,
}

impl Rehearsal {
    /// The last allocation.
    pub fn new(cycle: &Cycle, frame: &Frame) -> Self {
        Self {
            twin: cycle.clone(),
            frame: frame.clone(),
            line: vec![0xff; LINE],
        }
    }

    /// The twin, which gets another model when the state does.
    pub fn twin(&mut self) -> &mut Cycle {
        &mut self.twin
    }

    /// Answers a message, the newest there is, into `out`; how long that took \[ns\]. One that was used already stands for
    /// the one that has not come yet.
    pub fn of_message(
        &mut self,
        cycle: &Cycle,
        frame: &Frame,
        message: &[u8],
        out: &mut [u8],
    ) -> u64 {
        let start = sys::now();
        self.twin.mirror(cycle);
        self.frame.mirror(frame);
        // What is no state leaves the one before.
        let _ = wire::decode(message, self.frame.n_joints(), &mut self.frame);
        self.step(frame);
        let time = self.frame.present().time.then_some(self.frame.time);
        let sequence = self.frame.sequence.unwrap_or(0);
        black_box(wire::encode(&self.twin.answer(time), sequence, out));
        self.twin.hold();
        sys::now() - start
    }

    /// Answers a line; how long that took \[ns\].
    pub fn of_line(
        &mut self,
        cycle: &Cycle,
        frame: &Frame,
        (parser, line): (&mut Parser, &[u8]),
        writer: &Writer,
    ) -> u64 {
        let start = sys::now();
        self.twin.mirror(cycle);
        self.frame.mirror(frame);
        // A line that is none is said by its own cycle.
        if parser.parse(line, &mut self.frame).is_ok() {
            self.step(frame);
        }
        let time = self.frame.present().time.then_some(self.frame.time);
        let mut out = self.line.as_mut_slice();
        let _ = black_box(writer.write(&self.twin.answer(time), &mut out));
        sys::now() - start
    }

    fn step(&mut self, before: &Frame) {
        // The same number again would be answered without computing.
        if self.frame.sequence == before.sequence {
            self.frame.sequence = before.sequence.map(|number| number.wrapping_add(1));
            self.frame.time = before.time + self.twin.step_seconds();
        }
        self.twin.begin();
        let _ = black_box(self.twin.step(&self.frame.sample()));
    }
}
