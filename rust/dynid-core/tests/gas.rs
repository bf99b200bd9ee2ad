//! A gas cylinder's torque is what its gas does along the way.

use dynid_core::{Effect, EffectInput, State};

/// Work of the gas at an angle, of unit size: `-ln |s - x|`, x the stroke from the shortest length.
fn work([a, b, phase, gas_length]: [f64; 4], q: f64) -> f64 {
    let length = (a * a + b * b + 2.0 * a * b * (q + phase).cos()).sqrt();
    -(gas_length - (length - (a - b).abs())).abs().ln()
}

#[test]
fn the_torque_is_the_slope_of_the_work() {
    for shape in [
        [0.8, 0.2, 0.4, 0.6],
        [0.3, 0.7, -2.0, 0.9],
        [1.0, 0.5, 3.0, -0.3],
    ] {
        let names = ["a", "b", "phase", "gas_length"];
        let named: Vec<_> = names.into_iter().zip(shape.map(|x| [x])).collect();
        let effect = Effect::new("counterbalance", &named).expect("a shape");
        for q in [-2.5, -1.0, -0.1, 0.3, 1.2, 2.9] {
            let row = [q];
            let input = EffectInput {
                state: State::single(&row, &[0.0], &[0.0]),
                tau_link: &[0.0],
                tau_motor: &[0.0],
                step: 0.0,
                sign: None,
            };
            let mut column = [0.0];
            effect.columns_into(0, &input, &mut [], &mut column);
            let slope = (work(shape, q + 1e-6) - work(shape, q - 1e-6)) / 2e-6;
            assert!(
                (column[0] - slope).abs() < 1e-6 * (1.0 + slope.abs()),
                "{shape:?} {q}"
            );
        }
    }
}
