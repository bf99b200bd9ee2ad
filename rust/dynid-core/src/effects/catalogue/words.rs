//! What entries have in common: how one is written, shape parameters and ways to look for an effect that several have.

use crate::effects::entry::{
    Coefficient, Diagnosis, Need, Places, Reference, Rule, Scale, ShapeParameter, Sign,
};
use crate::effects::friction_hysteresis;

pub(super) const fn coefficient(name: &'static str, unit: &'static str, sign: Sign) -> Coefficient {
    Coefficient { name, unit, sign }
}

pub(super) const fn shape(
    name: &'static str,
    unit: &'static str,
    rule: Rule,
    grid: &'static [f64],
) -> ShapeParameter {
    ShapeParameter {
        name,
        unit,
        rule,
        grid,
        relative_to: None,
        range: None,
        absent: None,
        not_below: None,
    }
}

pub(super) fn nothing_more(_shape: &[f64]) -> Result<(), &'static str> {
    Ok(())
}

/// Found on one joint, from the signals alone, and drawn against its own column.
pub(super) const ON_A_JOINT: Diagnosis = Diagnosis {
    places: Places::Joint,
    sought: true,
    requires: &[],
    drawn_against: None,
    reaction: &[],
    most_relative: None,
};

/// Part of a declared model.
pub(super) const DECLARED: Diagnosis = Diagnosis {
    sought: false,
    ..ON_A_JOINT
};

pub(super) const fn drawn_against(signal: &'static str, unit: &'static str) -> Diagnosis {
    Diagnosis {
        drawn_against: Some((signal, unit)),
        ..ON_A_JOINT
    }
}

/// What goes round with a joint that turns.
pub(super) const AROUND_THE_TURN: Diagnosis = Diagnosis {
    requires: &[Need::Revolute],
    ..drawn_against("q", "rad")
};

pub(super) const SPEED: &str = "{angle}/s";

/// Width of the step at standstill: friction's own.
pub(super) const TRANSITION_WIDTH: ShapeParameter = shape(
    "transition_width",
    SPEED,
    Rule::Positive,
    &[0.003, 0.01, 0.03],
)
.of(Reference::FrictionWidth);

/// Sharpness of that step: friction's own. Zero is a hyperbolic tangent, as Eqs. 10-11 have it.
pub(super) const SHARPNESS: ShapeParameter = ShapeParameter {
    absent: Some(0.0),
    ..shape("sharpness", "1", Rule::NonNegative, &[0.0])
}
.of(Reference::FrictionSharpness);

/// Way over which bristles bend until they slip. A shorter one than the range has is a sign's that keeps its value at rest.
pub(super) const PRESLIDING_DISTANCE: ShapeParameter = shape(
    "presliding_distance",
    "{angle}",
    Rule::Positive,
    &[3e-4, 1e-3, 3e-3, 1e-2, 3e-2],
)
.refined(Scale::Log, friction_hysteresis::SHORTEST_WAY, 0.3);

/// Cycles per turn of the joint.
pub(super) const CYCLES: &str = "1/turn";

pub(super) const PARTNER: ShapeParameter = shape("partner", "joint", Rule::Partner, &[]);
