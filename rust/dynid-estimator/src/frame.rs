//! One measurement as it came in: the numbers, and which signals they are.

use dynid_core::online::{Sample, N_MOTION};

/// Signals of a measurement: the motion, then the temperature, then the measured torque.
pub const N_SIGNALS: usize = N_MOTION + 2;

/// Place of the temperature, which only some models want, and which need not be there.
pub const TEMPERATURE: usize = N_MOTION;

/// Place of the measured torque, which only an observer wants.
pub const TORQUE: usize = N_MOTION + 1;

/// Names of the signals, first ours, then what else is read as it.
pub type Names = [&'static [&'static str]; N_SIGNALS];

/// The motion in the order of [`Sample::motion`]; what is measured in ampere is a current, all else a torque.
const NAMES: Names = [
    &["q"],
    &["dq", "qd"],
    &["ddq", "qdd"],
    &["q_motor", "qm"],
    &["dq_motor", "qmd"],
    &["ddq_motor"],
    &["temperature", "temp"],
    &["tau"],
];
const CURRENT: &[&str] = &["current"];

/// Names of the time.
pub const TIME_NAMES: [&str; 3] = ["t", "time", "timestamp"];

/// Which signals the input has.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Present {
    /// Time.
    pub time: bool,
    /// The signals, in the order of [`NAMES`].
    pub signals: [bool; N_SIGNALS],
}

impl Present {
    /// Without the temperature, which may come and go.
    pub fn steady(mut self) -> Self {
        self.signals[TEMPERATURE] = false;
        self
    }

    /// True if velocities or accelerations have to be found from what is below them.
    pub fn is_differentiated(self) -> bool {
        self.signals[..3] != [true; 3]
    }
}

/// The numbers of one measurement, reused from one to the next.
#[derive(Clone, Debug)]
pub struct Frame {
    n_joints: usize,
    /// Its number, where the sender counts.
    pub sequence: Option<u64>,
    /// Time \[s\]; passed through.
    pub time: f64,
    /// Signal by signal, joint by joint.
    values: Vec<f64>,
    wanted: [bool; N_SIGNALS],
    /// What another model may want later.
    sought: [bool; N_SIGNALS],
    names: Names,
    present: Present,
}

impl Frame {
    /// A frame for `n_joints` joints: the motion, and nothing else.
    pub fn new(n_joints: usize) -> Self {
        Self {
            n_joints,
            sequence: None,
            time: f64::NAN,
            values: vec![f64::NAN; N_SIGNALS * n_joints],
            wanted: std::array::from_fn(|signal| signal < N_MOTION),
            sought: [false; N_SIGNALS],
            names: NAMES,
            present: Present::default(),
        }
    }

    /// The same with another signal.
    pub fn wanting(mut self, signal: usize, wanted: bool) -> Self {
        self.wanted[signal] = wanted;
        self
    }

    /// The same, where a model that comes later may want this signal: [`want`](Self::want) says when.
    pub fn seeking(mut self, signal: usize, sought: bool) -> Self {
        self.sought[signal] = sought;
        self
    }

    /// Whether a signal is read from now on.
    pub fn want(&mut self, signal: usize, wanted: bool) {
        self.wanted[signal] = wanted;
    }

    /// The same for torques in this unit.
    pub fn measured_in(mut self, torque_unit: &str) -> Self {
        self.names[TORQUE] = if torque_unit == "A" {
            CURRENT
        } else {
            NAMES[TORQUE]
        };
        self
    }

    /// What the signals are called.
    pub fn names(&self) -> Names {
        self.names
    }

    /// Becomes like `of`, a clone of which it was once; takes no memory.
    pub fn mirror(&mut self, of: &Self) {
        self.values.copy_from_slice(&of.values);
        (self.sequence, self.time, self.present) = (of.sequence, of.time, of.present);
        self.wanted = of.wanted;
    }

    /// Joints of the robot.
    pub fn n_joints(&self) -> usize {
        self.n_joints
    }

    /// True if a signal is read.
    pub fn wants(&self, signal: usize) -> bool {
        self.wanted[signal]
    }

    /// True if a signal is looked for, now or for later.
    pub fn seeks(&self, signal: usize) -> bool {
        self.wanted[signal] || self.sought[signal]
    }

    /// Which signals the input has.
    pub fn present(&self) -> Present {
        self.present
    }

    /// Tells which signals the input has.
    pub fn set_present(&mut self, present: Present) {
        self.present = present;
    }

    /// Where a number of one signal and joint goes.
    pub fn value_mut(&mut self, signal: usize, joint: usize) -> &mut f64 {
        &mut self.values[signal * self.n_joints + joint]
    }

    /// Where the numbers of one signal go.
    pub fn signal_mut(&mut self, signal: usize) -> &mut [f64] {
        &mut self.values[signal * self.n_joints..][..self.n_joints]
    }

    /// A signal, if the input has it.
    fn signal(&self, signal: usize) -> Option<&[f64]> {
        self.present.signals[signal]
            .then(|| &self.values[signal * self.n_joints..][..self.n_joints])
    }

    /// The measurement. A temperature that is wanted is there, of NaNs where the input has none.
    pub fn sample(&self) -> Sample<'_> {
        let temperature = TEMPERATURE * self.n_joints;
        Sample {
            sequence: self.sequence,
            time: self.time,
            motion: std::array::from_fn(|signal| self.signal(signal)),
            temperature: self.wanted[TEMPERATURE]
                .then(|| &self.values[temperature..][..self.n_joints]),
            tau: self.signal(TORQUE),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dynid_core::State;

    #[test]
    fn names_stand_in_the_order_of_a_state() {
        let state = State::single(&[], &[], &[]);
        let names: Vec<&str> = NAMES.iter().map(|names| names[0]).collect();
        assert_eq!(state.signals().map(|(name, _)| name), names[..N_MOTION]);
        assert_eq!((names[TEMPERATURE], names[TORQUE]), ("temperature", "tau"));
        let measured = |unit| Frame::new(1).measured_in(unit).names()[TORQUE];
        assert_eq!((measured("A"), measured("N*m")), (CURRENT, NAMES[TORQUE]));
    }

    #[test]
    fn a_sample_has_what_the_input_has() {
        let mut frame = Frame::new(1).wanting(TEMPERATURE, true);
        for signal in 0..N_SIGNALS {
            *frame.value_mut(signal, 0) = signal as f64;
        }
        *frame.value_mut(TEMPERATURE, 0) = f64::NAN;
        let mut present = Present::default();
        for signal in [0, 1, 4, TORQUE] {
            present.signals[signal] = true;
        }
        frame.set_present(present);
        assert!(present.is_differentiated());
        let sample = frame.sample();
        let values = sample.motion.map(|signal| signal.map(|values| values[0]));
        assert_eq!(values, [Some(0.0), Some(1.0), None, None, Some(4.0), None]);
        assert!(sample.temperature.is_some_and(|values| values[0].is_nan()));
        assert_eq!(sample.tau, Some(&[7.0][..]));
        assert_eq!(Frame::new(1).sample().temperature, None);
    }
}
