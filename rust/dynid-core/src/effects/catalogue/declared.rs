//! What every declared model is made of.

use super::words::{coefficient, nothing_more, shape, DECLARED, SPEED};
use crate::effects::entry::{Coefficient, Entry, Rule, Sign};
use crate::effects::{
    friction, rotor_inertia, smooth_friction, torque_offset, FRICTION_NAMES, N_FRICTION,
};

pub(super) const LAW: [Coefficient; N_FRICTION] = [
    coefficient(FRICTION_NAMES[0], "{torque}", Sign::NonNegative),
    coefficient(FRICTION_NAMES[1], "{torque}", Sign::NonNegative),
    coefficient(FRICTION_NAMES[2], "{torque}*s/{angle}", Sign::Free),
    coefficient(FRICTION_NAMES[3], "{torque}*s/{angle}", Sign::Free),
    coefficient(FRICTION_NAMES[4], "{torque}*(s/{angle})^2", Sign::Free),
    coefficient(FRICTION_NAMES[5], "{torque}*(s/{angle})^2", Sign::Free),
    coefficient(FRICTION_NAMES[6], "{torque}*(s/{angle})^3", Sign::Free),
    coefficient(FRICTION_NAMES[7], "{torque}*(s/{angle})^3", Sign::Free),
];

pub(super) const ROTOR_INERTIA: Entry = Entry {
    kind: "rotor_inertia",
    formula: "J ddq_motor",
    coefficients: &[coefficient(
        "rotor_inertia",
        "{torque}*s^2/{angle}",
        Sign::NonNegative,
    )],
    shape: &[],
    signals: &["ddq_motor"],
    memory: 0,
    declared: true,
    diagnosis: DECLARED,
    check: nothing_more,
    columns: rotor_inertia::columns,
};

pub(super) const TORQUE_OFFSET: Entry = Entry {
    kind: "torque_offset",
    formula: "o",
    coefficients: &[coefficient("torque_offset", "{torque}", Sign::Free)],
    shape: &[],
    signals: &[],
    memory: 0,
    declared: true,
    diagnosis: DECLARED,
    check: nothing_more,
    columns: torque_offset::columns,
};

pub(super) const FRICTION: Entry = Entry {
    kind: "friction",
    formula: "Eqs. 9-11 at dq_motor",
    coefficients: &LAW,
    shape: &[
        shape("velocity_threshold", SPEED, Rule::NonNegative, &[]),
        shape("transition_width", SPEED, Rule::Positive, &[]),
    ],
    signals: &["dq_motor"],
    memory: 0,
    declared: true,
    diagnosis: DECLARED,
    check: nothing_more,
    columns: friction::columns,
};

pub(super) const SMOOTH_FRICTION: Entry = Entry {
    kind: smooth_friction::KIND,
    formula: "(c + c' sign v) s + (d + d' sign v) v + (k + k' sign v) v |v| at v = dq_motor, \
              s = v / (|v|^p + e^p)^(1/p)",
    coefficients: &[
        coefficient("coulomb", "{torque}", Sign::NonNegative),
        coefficient("coulomb_asymmetry", "{torque}", Sign::Free),
        coefficient("viscous", "{torque}*s/{angle}", Sign::Free),
        coefficient("viscous_asymmetry", "{torque}*s/{angle}", Sign::Free),
        coefficient("quadratic", "{torque}*(s/{angle})^2", Sign::Free),
        coefficient("quadratic_asymmetry", "{torque}*(s/{angle})^2", Sign::Free),
    ],
    shape: &[
        shape(
            "transition_width",
            SPEED,
            Rule::Positive,
            &[0.0005, 0.001, 0.002, 0.004, 0.008, 0.016, 0.03, 0.06, 0.12],
        ),
        // Like an arctan, like a tanh, nearly a corner.
        shape("sharpness", "1", Rule::Positive, &[1.0, 1.5, 2.5, 6.0]),
    ],
    signals: &["dq_motor"],
    memory: 0,
    declared: true,
    diagnosis: DECLARED,
    check: nothing_more,
    columns: smooth_friction::columns,
};
