//! Every kind of effect: one entry each, with names, units, signs, search grid, signals and the formula's place.
//!
//! Units name `{torque}` and `{angle}`, which depend on the model's torque channel and on the joint: "N*m" or "A", "rad"
//! or "m".

mod declared;
mod forces;
mod rubbing;
mod words;

use super::entry::Entry;

/// Every kind of effect; those of declared models come first.
pub static CATALOGUE: [Entry; 19] = [
    declared::ROTOR_INERTIA,
    declared::TORQUE_OFFSET,
    declared::FRICTION,
    declared::SMOOTH_FRICTION,
    rubbing::STRIBECK,
    forces::COUNTERBALANCE,
    rubbing::LOAD_DEPENDENT_FRICTION,
    rubbing::BEARING_FRICTION,
    rubbing::POSITION_DEPENDENT_FRICTION,
    rubbing::FRICTION_HYSTERESIS,
    rubbing::LOAD_HYSTERESIS,
    rubbing::GEAR_HYSTERESIS,
    rubbing::COUPLED_FRICTION,
    forces::TORQUE_RIPPLE,
    forces::INERTIAL_COUPLING,
    forces::JOINT_SPRING,
    forces::TORQUE_SATURATION,
    rubbing::THERMAL_FRICTION,
    rubbing::TEMPERATURE_FRICTION,
];

/// The entry of a kind.
#[must_use]
pub fn find(kind: &str) -> Option<&'static Entry> {
    CATALOGUE.iter().find(|entry| entry.kind == kind)
}

#[cfg(test)]
mod tests {
    use super::super::entry::{Places, Rule, Scale};
    use super::*;

    #[test]
    fn what_names_a_partner_acts_on_two_joints() {
        for entry in &CATALOGUE {
            let named = entry.shape.iter().any(|p| p.rule == Rule::Partner);
            let alone = entry.diagnosis.places == Places::Joint;
            assert_eq!(named, !alone, "{}", entry.kind);
        }
    }

    #[test]
    fn what_is_declared_is_not_sought() {
        for entry in &CATALOGUE {
            assert!(
                !(entry.declared && entry.diagnosis.sought),
                "{}",
                entry.kind
            );
        }
    }

    #[test]
    fn ranges_hold_the_grids_that_are_in_their_unit() {
        for entry in &CATALOGUE {
            for parameter in entry.shape {
                let Some(range) = parameter.range else {
                    continue;
                };
                let name = (entry.kind, parameter.name);
                assert!(range.lowest < range.highest, "{name:?}");
                let is_log = range.scale == Scale::Log;
                assert!(!is_log || range.lowest > 0.0, "{name:?}");
                if parameter.relative_to.is_some() {
                    continue;
                }
                let size = |x: &f64| if is_log { x.abs() } else { *x };
                let within = |x: &f64| (range.lowest..=range.highest).contains(&size(x));
                assert!(!parameter.grid.is_empty(), "{name:?}");
                assert!(parameter.grid.iter().all(within), "{name:?}");
            }
        }
    }
}
