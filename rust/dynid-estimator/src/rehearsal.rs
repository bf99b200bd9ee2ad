//! What the next cycle will do, done before on a twin of the state, so that code, model and state are near when it is due.
//!
//! The twin becomes like the state first, which reads all of it; the state itself is only looked at, so no answer can
//! depend on whether there was a rehearsal. No allocation, no lock, no system call.

use std::hint::black_box;

use crate::cycle::Cycle;
use crate::frame::Frame;
use crate::input::Parser;
use crate::output::Writer;
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

    /// Answers a message, the newest there is, into `out`. One that was used already stands for the one that has not come
    /// yet.
    pub fn of_message(&mut self, cycle: &Cycle, frame: &Frame, message: &[u8], out: &mut [u8]) {
        self.twin.mirror(cycle);
        self.frame.mirror(frame);
        // What is no state leaves the one before.
        let _ = wire::decode(message, self.frame.n_joints(), &mut self.frame);
        self.step(frame);
        let time = self.frame.present().time.then_some(self.frame.time);
        let sequence = self.frame.sequence.unwrap_or(0);
        black_box(wire::encode(&self.twin.answer(time), sequence, out));
        self.twin.hold();
    }

    /// Answers a line.
    pub fn of_line(
        &mut self,
        cycle: &Cycle,
        frame: &Frame,
        (parser, line): (&mut Parser, &[u8]),
        writer: &Writer,
    ) {
        self.twin.mirror(cycle);
        self.frame.mirror(frame);
        // A line that is none is said by its own cycle.
        if parser.parse(line, &mut self.frame).is_ok() {
            self.step(frame);
        }
        let time = self.frame.present().time.then_some(self.frame.time);
        let mut out = self.line.as_mut_slice();
        let _ = black_box(writer.write(&self.twin.answer(time), &mut out));
    }

    fn step(&mut self, before: &Frame) {
        // The same number again would be answered without computing; a state without one has its own time.
        if self.frame.sequence.is_some() && self.frame.sequence == before.sequence {
            self.frame.sequence = before.sequence.map(|number| number.wrapping_add(1));
            self.frame.time = before.time + self.twin.step_seconds();
        }
        self.twin.begin();
        let _ = black_box(self.twin.step(&self.frame.sample()));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::args::Format;
    use crate::counting;
    use crate::cycle::Settings;
    use crate::input::Lines;
    use crate::live::tests::model;

    /// Lines are rehearsed without taking memory, and leave the state as it was, also those that are no state.
    #[test]
    fn a_rehearsed_line_takes_no_memory_and_leaves_no_trace() {
        let lines: [(&[u8], &[u8]); 2] = [
            (b"q_0,dq_0,ddq_0\n0,0,0\n", b"0.5,0.25,1e-3"),
            (
                b"{\"q\":[0],\"dq\":[0],\"ddq\":[0]}\n",
                b"{\"q\":[0.5],\"dq\":[0.25],\"ddq\":[1e-3]}",
            ),
        ];
        for (begin, line) in lines {
            let model = model(1.0);
            let mut frame = Frame::new(1);
            let mut source = Lines::new(begin);
            let mut parser = Parser::begin(None, &mut source, model.robot(), &mut frame).unwrap();
            let writer = Writer::new(Format::Jsonl, &model, [false; 3]);
            let cycle = Cycle::new(model, &Settings::default()).unwrap();
            let mut rehearsal = Rehearsal::new(&cycle, &frame);
            let before = (format!("{cycle:?}"), format!("{frame:?}"));
            let calls = counting::calls();
            for _ in 0..1000 {
                rehearsal.of_line(&cycle, &frame, (&mut parser, line), &writer);
            }
            assert_eq!(counting::calls() - calls, 0);
            // It did compute, and on the twin alone.
            let rest = cycle.answer(None).tau.to_vec();
            assert_ne!(rehearsal.twin.answer(None).tau, rest);
            rehearsal.of_line(&cycle, &frame, (&mut parser, b"no state"), &writer);
            assert_eq!((format!("{cycle:?}"), format!("{frame:?}")), before);
        }
    }

    #[test]
    fn lines_keep_their_own_time() {
        let model = model(1.0);
        let mut frame = Frame::new(1);
        let mut source = Lines::new(b"t,q_0,dq_0,ddq_0\n0,0,0,0\n".as_slice());
        let mut parser = Parser::begin(None, &mut source, model.robot(), &mut frame).unwrap();
        frame.time = 1.0;
        let writer = Writer::new(Format::Csv, &model, [false; 3]);
        let cycle = Cycle::new(model, &Settings::default()).unwrap();
        let mut rehearsal = Rehearsal::new(&cycle, &frame);
        let line = b"7.5,0.5,0.25,1e-3";
        rehearsal.of_line(&cycle, &frame, (&mut parser, line), &writer);
        assert_eq!(
            (rehearsal.frame.time, rehearsal.frame.sequence),
            (7.5, None)
        );
    }

    #[test]
    fn a_numbered_state_that_was_used_stands_for_the_next() {
        let model = model(1.0);
        let cycle = Cycle::new(model, &Settings::default()).unwrap();
        let mut frame = Frame::new(1);
        let mut message = wire::zero_state(1);
        let mut out = [0; 512];
        wire::decode(&message, 1, &mut frame).unwrap();
        let used = (frame.sequence, frame.time);
        let mut rehearsal = Rehearsal::new(&cycle, &frame);
        rehearsal.of_message(&cycle, &frame, &message, &mut out);
        assert_eq!(rehearsal.frame.sequence, used.0.map(|number| number + 1));
        assert_eq!(rehearsal.frame.time, used.1 + cycle.step_seconds());
        // One that has not been used stands for itself.
        message[16..24].copy_from_slice(&9_u64.to_le_bytes());
        rehearsal.of_message(&cycle, &frame, &message, &mut out);
        assert_eq!(rehearsal.frame.sequence, Some(9));
    }
}
