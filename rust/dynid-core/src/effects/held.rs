//! Functions of a joint's angle that end where they were learned: beyond that they keep the value that they have there.
//!
//! A torque that was found but has no name is whatever function fits. What it would say elsewhere, nobody knows; a law of
//! physics, which has a name, says the same everywhere.

use super::entry::Entry;
use super::EffectInput;
use crate::error::{CoreError, EffectError};
use crate::slices::at;
use crate::state::State;

/// Names of the two ends \[rad, m\] beside the shape parameters, one value per joint each.
pub const NAMES: [&str; 2] = ["held_from", "held_to"];

/// Signals that a function of the joint's own angle reads.
const ANGLES: [&str; 2] = ["q", "q_motor"];

/// Ends joint by joint.
///
/// # Errors
/// [`EffectError`] if the kind is no function of its joint's angle alone, lengths differ, or an end is not finite or above
/// the other.
pub fn ranges(
    entry: &'static Entry,
    from: &[f64],
    to: &[f64],
) -> Result<Vec<[f64; 2]>, EffectError> {
    let refused = |joint, rule| CoreError::Shape {
        kind: entry.kind,
        what: NAMES[0],
        joint,
        rule,
    };
    let of_angle = entry.signals.iter().all(|signal| ANGLES.contains(signal));
    if !of_angle || entry.signals.is_empty() || entry.memory > 0 {
        return Err(refused(0, "is for functions of a joint's own angle").into());
    }
    if from.is_empty() || from.len() != to.len() {
        return Err(EffectError::Lengths {
            entry,
            what: NAMES[1],
            actual: to.len(),
            expected: from.len(),
        });
    }
    let ends = from.iter().zip(to).map(|(from, to)| [*from, *to]);
    ends.enumerate()
        .map(|(joint, [from, to])| {
            let in_order = from.is_finite() && to.is_finite() && from <= to;
            let rule = "must be finite and not above held_to";
            in_order
                .then_some([from, to])
                .ok_or_else(|| refused(joint, rule).into())
        })
        .collect()
}

/// The effect's columns at the nearest angle of joint `j` within `range`.
pub fn columns(
    entry: &Entry,
    shape: &[f64],
    j: usize,
    [from, to]: [f64; 2],
    input: &EffectInput<'_>,
    columns: &mut [f64],
) {
    let nearest = |angles: &[f64]| match at(angles, j) {
        angle if angle < from => [from],
        angle if angle > to => [to],
        angle => [angle], // one that is no number stays none
    };
    let (q, q_motor) = (nearest(input.state.q), nearest(input.state.q_motor));
    let state = State {
        q: &q,
        q_motor: &q_motor,
        ..input.state
    };
    // A function of the joint's own angle reads nothing else, so the joint may be the only one.
    (entry.columns)(shape, 0, &EffectInput { state, ..*input }, &mut [], columns);
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use crate::effects::{Effect, EffectInput};
    use crate::state::State;

    #[test]
    fn the_nearest_angle_within_the_ends_counts_and_no_number_stays_none() {
        let shape = [
            ("rest_position", [0.25]),
            ("held_from", [-0.5]),
            ("held_to", [1.0]),
        ];
        let spring = Effect::new("joint_spring", &shape).unwrap();
        for (q, expected) in [
            (-2.0, -0.75),
            (0.5, 0.25),
            (3.0, 0.75),
            (f64::NAN, f64::NAN),
        ] {
            let (row, mut column) = ([q], [0.0]);
            let input = EffectInput {
                state: State::single(&row, &row, &row),
                tau_link: &[],
                tau_motor: &[],
                step: 0.0,
                sign: None,
            };
            spring.columns_into(0, &input, &mut [], &mut column);
            assert_eq!(column[0].to_bits(), f64::to_bits(expected), "{q}");
        }
    }
}
