//! Every kind of the catalogue with a valid shape.

use dynid_core::effects::CATALOGUE;
use dynid_core::Effect;

/// One effect of every kind for `n` joints, in the order of the catalogue.
pub fn every_effect(n: usize) -> Vec<Effect> {
    CATALOGUE
        .iter()
        .map(|entry| {
            let shape: Vec<(&str, Vec<f64>)> = entry
                .shape
                .iter()
                .map(|parameter| {
                    (
                        parameter.name,
                        (0..n).map(|j| value(parameter.name, j)).collect(),
                    )
                })
                .collect();
            Effect::new(entry.kind, &shape).expect("a valid shape")
        })
        .collect()
}

/// A value for joint `j`; every joint's partner is the one before, the first has none.
fn value(parameter: &str, j: usize) -> f64 {
    let k = j as f64;
    match parameter {
        "a" => 0.8 + 0.1 * k,
        "b" => 0.2 + 0.05 * k,
        "phase" => 1.0 + k,
        "gas_length" => 2.0 - 0.1 * k,
        "partner" => k - 1.0,
        "side" if j == 0 => 1.0,
        "side" => -1.0,
        "ratio" => 0.5 - k,
        "cycles" => 2.0 + k,
        "presliding_distance" => 0.01,
        "sharpness" => 1.0 + k,
        "time_constant" => 0.05,
        "reference_speed" if j.is_multiple_of(2) => 0.0,
        _ => 0.02 + 0.01 * k,
    }
}
