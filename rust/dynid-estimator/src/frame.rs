//! One state as it came in: the numbers, and which signals they are.

use dynid_core::State;

/// Signals of a state.
pub const N_SIGNALS: usize = 6;

/// Names of the signals, first ours, then what else is read as it; the order is that of [`State::signals`].
pub const NAMES: [&[&str]; N_SIGNALS] = [
    &["q"],
    &["dq", "qd"],
    &["ddq", "qdd"],
    &["q_motor", "qm"],
    &["dq_motor", "qmd"],
    &["ddq_motor"],
];

/// Names of the temperature, which only some models want, and which need not be there.
pub const TEMPERATURE_NAMES: [&str; 2] = ["temperature", "temp"];

/// Names of the time.
pub const TIME_NAMES: [&str; 3] = ["t", "time", "timestamp"];

/// Signals that every state needs: position, velocity, acceleration of the link side.
pub const N_NEEDED: usize = 3;

/// Which signals the input has.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Present {
    /// Time.
    pub time: bool,
    /// The signals, in the order of [`NAMES`].
    pub signals: [bool; N_SIGNALS],
    /// Temperature, where the model wants it.
    pub temperature: bool,
}

impl Present {
    /// Without the temperature, which may come and go.
    pub fn motion(self) -> Self {
        Self {
            temperature: false,
            ..self
        }
    }
}

/// The numbers of one state, reused from line to line.
#[derive(Debug)]
pub struct Frame {
    n_joints: usize,
    /// Time \[s\]; passed through.
    pub time: f64,
    /// Signal by signal, joint by joint.
    values: Vec<f64>,
    /// Joint by joint \[degC\], NaN where it is not known; `None` where the model does not want it.
    temperature: Option<Vec<f64>>,
    present: Present,
}

impl Frame {
    /// A frame for `n_joints` joints.
    pub fn new(n_joints: usize) -> Self {
        Self {
            n_joints,
            time: f64::NAN,
            values: vec![f64::NAN; N_SIGNALS * n_joints],
            temperature: None,
            present: Present::default(),
        }
    }

    /// The same for a model that wants the temperature.
    pub fn with_temperature(self) -> Self {
        Self {
            temperature: Some(vec![f64::NAN; self.n_joints]),
            ..self
        }
    }

    /// Where the temperature goes, if the model wants it.
    pub fn temperature_mut(&mut self) -> Option<&mut [f64]> {
        self.temperature.as_deref_mut()
    }

    /// Number of joints.
    pub fn n_joints(&self) -> usize {
        self.n_joints
    }

    /// Which signals the input has.
    pub fn present(&self) -> Present {
        self.present
    }

    /// Tells which signals the input has; the others follow from them.
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

    /// A signal; the motor side equals the link side where it is not given.
    fn signal(&self, signal: usize) -> &[f64] {
        let given = if self.present.signals[signal] {
            signal
        } else {
            signal % N_NEEDED
        };
        &self.values[given * self.n_joints..][..self.n_joints]
    }

    /// The state, as `TorqueModel.evaluate` in Python makes it.
    pub fn state(&self) -> State<'_> {
        State {
            q: self.signal(0),
            dq: self.signal(1),
            ddq: self.signal(2),
            q_motor: self.signal(3),
            dq_motor: self.signal(4),
            ddq_motor: self.signal(5),
            temperature: self.temperature.as_deref(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_stand_in_the_order_of_a_state() {
        let state = State::single(&[], &[], &[]);
        assert_eq!(
            state.signals().map(|(name, _)| name),
            NAMES.map(|names| names[0])
        );
    }

    #[test]
    fn the_motor_side_falls_back_signal_by_signal() {
        let mut frame = Frame::new(1);
        for signal in 0..N_SIGNALS {
            *frame.value_mut(signal, 0) = signal as f64;
        }
        let given = [true, true, true, false, true, false];
        frame.set_present(Present {
            signals: given,
            ..Present::default()
        });
        let values = frame.state().signals().map(|(_, signal)| signal[0]);
        assert_eq!(values, [0.0, 1.0, 2.0, 0.0, 4.0, 2.0]);
    }
}
