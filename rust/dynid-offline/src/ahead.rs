//! Runs whose torque channel is early: the torque at a sample is that of a later state, which a record has.

use dynid_core::delay_line::between;
use dynid_core::State;

use crate::observation::slice_state;

/// Shows the states of a run a while ahead of its samples.
#[derive(Debug)]
pub struct Ahead {
    n: usize,
    /// Whole samples, and the part of one more.
    whole: usize,
    part: f64,
    row: Vec<f64>,
}

impl Ahead {
    /// `None` for a `delay` \[s\] that is none or late: an estimator remembers earlier states by itself.
    #[must_use]
    pub fn of(delay: f64, step: f64, n: usize) -> Option<Self> {
        (delay < 0.0 && step > 0.0).then(|| {
            let steps = -delay / step;
            Self {
                n,
                whole: steps as usize,
                part: steps.fract(),
                row: vec![0.0; 6 * n],
            }
        })
    }

    /// The state that sample `k` of a run of `n_samples` shows the torque of, on the straight line between its neighbours;
    /// false beyond the last one, which then stands for it.
    pub fn state<'a>(
        &'a mut self,
        states: &State<'a>,
        k: usize,
        n_samples: usize,
    ) -> (State<'a>, bool) {
        let n = self.n;
        let (at, known) = (k + self.whole, n_samples - 1);
        let inside = at < known || (at == known && self.part == 0.0);
        let [one, other] = [at, at + 1].map(|at| at.min(known) * n);
        for (row, (_, signal)) in self.row.chunks_exact_mut(n).zip(states.signals()) {
            let pairs = signal[one..one + n].iter().zip(&signal[other..other + n]);
            for (x, (one, other)) in row.iter_mut().zip(pairs) {
                *x = between(*one, *other, self.part);
            }
        }
        let temperature = slice_state(states, k * n..(k + 1) * n).temperature;
        let signal = |k: usize| &self.row[k * n..(k + 1) * n];
        let state = State {
            q: signal(0),
            dq: signal(1),
            ddq: signal(2),
            q_motor: signal(3),
            dq_motor: signal(4),
            ddq_motor: signal(5),
            temperature,
        };
        (state, inside)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_early_channel_is_shown_later_states_between_their_neighbours() {
        let q: Vec<f64> = (0..10)
            .flat_map(|k| [f64::from(k), 100.0 + f64::from(k * k)])
            .collect();
        // Of the sample itself: warmth is what the thermometer shows now.
        let warmth: Vec<f64> = (0..20).map(f64::from).collect();
        let states = State {
            temperature: Some(&warmth),
            ..State::single(&q, &q, &q)
        };
        let Some(mut ahead) = Ahead::of(-0.0025, 0.001, 2) else {
            panic!("an early channel")
        };
        for (k, expected, known) in [
            (0, [2.5, 106.5], true),
            (6, [8.5, 172.5], true),
            (7, [9.0, 181.0], false),
            (9, [9.0, 181.0], false),
        ] {
            let (state, inside) = ahead.state(&states, k, 10);
            assert_eq!((state.q, inside), (&expected[..], known), "{k}");
            assert_eq!(state.ddq_motor, expected);
            assert_eq!(state.temperature, Some(&warmth[2 * k..2 * k + 2]));
        }
        assert!(Ahead::of(0.0, 0.001, 2).is_none() && Ahead::of(-0.1, 0.0, 2).is_none());
    }
}
