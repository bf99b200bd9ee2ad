//! What pulls, pushes and hums: springs, cylinders, ripple, motors on other joints, drives that droop.

use super::words::{
    coefficient, drawn_against, nothing_more, shape, AROUND_THE_TURN, CYCLES, PARTNER,
};
use crate::effects::entry::{Diagnosis, Entry, Places, Rule, Scale, Sign};
use crate::effects::{
    counterbalance, inertial_coupling, joint_spring, torque_ripple, torque_saturation, TAU_MOTOR,
};

pub(super) const COUNTERBALANCE: Entry = Entry {
    kind: counterbalance::KIND,
    formula: "c / (gas_length - (L - |a - b|)) dL/dq, L^2 = a^2 + b^2 + 2 a b cos(q + phase)",
    coefficients: &[coefficient("counterbalance", "{torque}", Sign::NonNegative)],
    shape: &[
        // Only ratios of the lengths matter, so a search holds one of them. A rod that goes into its tube at most
        // doubles the cylinder's length: b is a third of a where the joint turns round, two thirds where it turns a
        // quarter about the dead point. Beyond, the pins nearly meet, and the torque bends as any stop's does.
        shape("a", "m", Rule::Positive, &[1.0]),
        shape("b", "m", Rule::Positive, &[0.2, 0.35, 0.6]).refined(Scale::Log, 0.02, 2.0 / 3.0),
        shape(
            "phase",
            "rad",
            Rule::Any,
            &[
                -2.5, -2.0, -1.5, -1.0, -0.5, 0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0,
            ],
        )
        .refined(Scale::Linear, -4.0, 4.0),
        shape("gas_length", "m", Rule::Any, &[0.75, 1.25, 10.0, -1.5]).refined(
            Scale::Log,
            0.05,
            100.0,
        ),
    ],
    signals: &["q"],
    memory: 0,
    declared: false,
    diagnosis: AROUND_THE_TURN,
    check: counterbalance::check,
    columns: counterbalance::columns,
};

pub(super) const TORQUE_RIPPLE: Entry = Entry {
    kind: torque_ripple::KIND,
    formula: "a1 cos N q_motor + b1 sin N q_motor + a2 cos 2 N q_motor + b2 sin 2 N q_motor",
    coefficients: &[
        coefficient("ripple_cos1", "{torque}", Sign::Free),
        coefficient("ripple_sin1", "{torque}", Sign::Free),
        coefficient("ripple_cos2", "{torque}", Sign::Free),
        coefficient("ripple_sin2", "{torque}", Sign::Free),
    ],
    shape: &[shape(
        "cycles",
        CYCLES,
        Rule::Positive,
        // Slower ones look like gravity, springs and cylinders.
        &[
            4.0, 5.0, 6.0, 7.0, 8.5, 10.0, 12.0, 14.0, 17.0, 20.0, 24.0, 28.0,
        ],
    )
    .refined(Scale::Log, 3.5, 1e4)],
    signals: &["q_motor"],
    memory: 0,
    declared: false,
    diagnosis: AROUND_THE_TURN,
    check: nothing_more,
    columns: torque_ripple::columns,
};

pub(super) const INERTIAL_COUPLING: Entry = Entry {
    kind: "inertial_coupling",
    formula: "c ddq_motor of the partner",
    coefficients: &[coefficient(
        "inertial_coupling",
        "{torque}*s^2/{angle}",
        Sign::Free,
    )],
    shape: &[PARTNER],
    signals: &["ddq_motor"],
    memory: 0,
    declared: false,
    // Kinetic energy c dq_j dq_p: the mass matrix is symmetric.
    diagnosis: Diagnosis {
        places: Places::Pair,
        reaction: &[0],
        ..drawn_against("ddq", "rad/s^2")
    },
    check: nothing_more,
    columns: inertial_coupling::columns,
};

pub(super) const JOINT_SPRING: Entry = Entry {
    kind: "joint_spring",
    formula: "k (q - q_0)",
    coefficients: &[coefficient(
        "spring_stiffness",
        "{torque}/{angle}",
        Sign::Free,
    )],
    shape: &[shape("rest_position", "{angle}", Rule::Any, &[0.0])],
    signals: &["q"],
    memory: 0,
    declared: false,
    diagnosis: drawn_against("q", "rad"),
    check: nothing_more,
    columns: joint_spring::columns,
};

pub(super) const TORQUE_SATURATION: Entry = Entry {
    kind: "torque_saturation",
    formula: "c tau_motor^3",
    coefficients: &[coefficient("saturation", "1/({torque})^2", Sign::Free)],
    shape: &[],
    signals: &[TAU_MOTOR],
    memory: 0,
    declared: false,
    diagnosis: Diagnosis {
        // A drive that droops claims more than it gives, a sensor that saturates less; neither is half of the torque.
        most_relative: Some(0.5),
        ..drawn_against(TAU_MOTOR, "{torque}")
    },
    check: nothing_more,
    columns: torque_saturation::columns,
};
