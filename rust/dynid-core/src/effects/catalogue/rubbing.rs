//! What brakes the motion: friction that the declared law lacks.

use super::declared::LAW;
use super::words::{
    coefficient, drawn_against, nothing_more, shape, AROUND_THE_TURN, CYCLES, ON_A_JOINT, PARTNER,
    PRESLIDING_DISTANCE, SHARPNESS, SPEED, TRANSITION_WIDTH,
};
use crate::effects::entry::{Diagnosis, Entry, Need, Places, Reference, Rule, Scale, Sign};
use crate::effects::{
    bearing_friction, coupled_friction, friction_hysteresis, gear_hysteresis,
    load_dependent_friction, load_hysteresis, position_dependent_friction, stribeck,
    temperature_friction, thermal_friction,
};

pub(super) const STRIBECK: Entry = Entry {
    kind: stribeck::KIND,
    formula: "k s(dq_motor) exp(-(|dq_motor| / v_s)^d), k of the direction",
    coefficients: &[
        coefficient("stribeck_pos", "{torque}", Sign::NonNegative),
        coefficient("stribeck_neg", "{torque}", Sign::NonNegative),
    ],
    shape: &[
        shape(
            "stribeck_velocity",
            SPEED,
            Rule::Positive,
            &[0.01, 0.03, 0.1, 0.3],
        )
        .of(Reference::Speed)
        .refined(Scale::Log, 1e-3, 10.0)
        // What has fallen before the sign has turned round is another rounding of the sign, of any size.
        .not_below(TRANSITION_WIDTH.name),
        // From boundary lubrication to a full film that builds up; beyond, a step that rounding hides.
        shape("exponent", "1", Rule::Positive, &[1.0, 2.0]).refined(Scale::Log, 0.5, 2.1),
        TRANSITION_WIDTH,
        SHARPNESS,
    ],
    signals: &["dq_motor"],
    memory: 0,
    declared: false,
    diagnosis: drawn_against("dq", "rad/s"),
    check: nothing_more,
    columns: stribeck::columns,
};

pub(super) const LOAD_DEPENDENT_FRICTION: Entry = Entry {
    kind: "load_dependent_friction",
    formula: "(m0 + m1 |dq_motor|) |tau_link| s(dq_motor)",
    coefficients: &[
        coefficient("load_friction", "1", Sign::NonNegative),
        coefficient("load_friction_speed", "s/{angle}", Sign::Free),
    ],
    shape: &[TRANSITION_WIDTH, SHARPNESS],
    signals: &["dq_motor", "tau_link"],
    memory: 0,
    declared: false,
    diagnosis: drawn_against("tau_link", "{torque}"),
    check: nothing_more,
    columns: load_dependent_friction::columns,
};

pub(super) const BEARING_FRICTION: Entry = Entry {
    kind: "bearing_friction",
    formula: "m |tau_link_n| s(dq_motor), n the joint before or behind",
    coefficients: &[coefficient("bearing_friction", "1", Sign::NonNegative)],
    shape: &[
        shape("side", "1", Rule::Side, &[-1.0, 1.0]).of(Reference::Chain),
        TRANSITION_WIDTH,
        SHARPNESS,
    ],
    signals: &["dq_motor", "tau_link"],
    memory: 0,
    declared: false,
    diagnosis: Diagnosis {
        // Between a joint that slides and one that turns it would be no number, and no bearing tilts.
        requires: &[Need::Revolute],
        ..drawn_against("tau_link", "{torque}")
    },
    check: nothing_more,
    columns: bearing_friction::columns,
};

pub(super) const POSITION_DEPENDENT_FRICTION: Entry = Entry {
    kind: position_dependent_friction::KIND,
    formula: "s(dq_motor) (a cos N q + b sin N q)",
    coefficients: &[
        coefficient("position_friction_cos", "{torque}", Sign::Free),
        coefficient("position_friction_sin", "{torque}", Sign::Free),
    ],
    shape: &[
        shape(
            "cycles",
            CYCLES,
            Rule::Positive,
            &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0],
        ),
        TRANSITION_WIDTH,
        SHARPNESS,
    ],
    signals: &["q", "dq_motor"],
    memory: 0,
    declared: false,
    diagnosis: AROUND_THE_TURN,
    check: nothing_more,
    columns: position_dependent_friction::columns,
};

pub(super) const FRICTION_HYSTERESIS: Entry = Entry {
    kind: friction_hysteresis::KIND,
    formula: "k z, dz = dx/d (1 - z sign(dx)) along q_motor",
    coefficients: &[coefficient("hysteresis", "{torque}", Sign::NonNegative)],
    shape: &[PRESLIDING_DISTANCE],
    signals: &["q_motor"],
    memory: friction_hysteresis::MEMORY,
    declared: false,
    diagnosis: ON_A_JOINT,
    check: nothing_more,
    columns: friction_hysteresis::columns,
};

pub(super) const LOAD_HYSTERESIS: Entry = Entry {
    kind: "load_hysteresis",
    formula: "k |tau_link| z, dz = dx/d (1 - z sign(dx)) along q_motor",
    coefficients: &[coefficient("load_hysteresis", "1", Sign::NonNegative)],
    // Over a shorter way it is friction under load, whose sign is rounded.
    shape: &[shape(
        "presliding_distance",
        "{angle}",
        Rule::Positive,
        &[1e-3, 3e-3, 1e-2, 3e-2],
    )
    .refined(Scale::Log, 5e-4, 0.3)],
    signals: &["q_motor", "tau_link"],
    memory: friction_hysteresis::MEMORY,
    declared: false,
    diagnosis: drawn_against("tau_link", "{torque}"),
    check: nothing_more,
    columns: load_hysteresis::columns,
};

pub(super) const GEAR_HYSTERESIS: Entry = Entry {
    kind: "gear_hysteresis",
    formula: "k z, dz = dx/d (1 - z sign(dx)) along x = tau_link - c z",
    coefficients: &[coefficient(
        "gear_hysteresis",
        "{torque}",
        Sign::NonNegative,
    )],
    shape: &[
        shape(
            "hysteresis_load",
            "{torque}",
            Rule::Positive,
            &[0.03, 0.1, 0.3, 1.0],
        )
        .of(Reference::Load)
        .refined(Scale::Log, 1e-4, 1e5),
        shape("carried_load", "{torque}", Rule::NonNegative, &[0.05])
            .of(Reference::Load)
            .refined(Scale::Log, 1e-4, 1e5),
    ],
    signals: &["tau_link"],
    memory: friction_hysteresis::MEMORY,
    declared: false,
    diagnosis: Diagnosis {
        // Which show that the gear yields.
        requires: &[Need::TwoEncoders],
        ..ON_A_JOINT
    },
    check: nothing_more,
    columns: gear_hysteresis::columns,
};

pub(super) const COUPLED_FRICTION: Entry = Entry {
    kind: coupled_friction::KIND,
    formula: "k s(u) + d u, u = dq_motor + r dq_motor of the partner",
    coefficients: &[
        coefficient("coupled_friction", "{torque}", Sign::NonNegative),
        coefficient("coupled_viscous", "{torque}*s/{angle}", Sign::NonNegative),
    ],
    shape: &[
        PARTNER,
        shape("ratio", "1", Rule::Any, &[-1.0, -0.5, 0.5, 1.0]).refined(Scale::Linear, -5.0, 5.0),
        TRANSITION_WIDTH,
        SHARPNESS,
    ],
    signals: &["dq_motor"],
    memory: 0,
    declared: false,
    diagnosis: Diagnosis {
        // Joints that share a gear sit in one housing.
        places: Places::Neighbours,
        reaction: &[1, 2],
        ..ON_A_JOINT
    },
    check: nothing_more,
    columns: coupled_friction::columns,
};

pub(super) const THERMAL_FRICTION: Entry = Entry {
    kind: "thermal_friction",
    formula: "f (c0 s(dq_motor) + c1 dq_motor), T df/dt = u - f, u = 1 or |dq_motor| / v_r",
    coefficients: &[
        coefficient("warm_coulomb", "{torque}", Sign::NonPositive),
        coefficient("warm_viscous", "{torque}*s/{angle}", Sign::NonPositive),
    ],
    shape: &[
        shape(
            "time_constant",
            "s",
            Rule::Positive,
            &[10.0, 30.0, 100.0, 300.0],
        )
        .refined(Scale::Log, 5.0, 300.0),
        shape("reference_speed", SPEED, Rule::NonNegative, &[0.0, 1.0]),
        TRANSITION_WIDTH,
        SHARPNESS,
    ],
    signals: &["dq_motor", "step"],
    memory: thermal_friction::MEMORY,
    declared: false,
    diagnosis: drawn_against("t", "s"),
    check: nothing_more,
    columns: thermal_friction::columns,
};

pub(super) const TEMPERATURE_FRICTION: Entry = Entry {
    kind: "temperature_friction",
    formula: "c (T - T_0) F(dq_motor), T the measured temperature, F the joint's friction at T_0",
    coefficients: &[coefficient("friction_per_kelvin", "1/K", Sign::NonPositive)],
    shape: &[
        // Friction beside it takes up any other choice, so a search holds one.
        shape("reference_temperature", "degC", Rule::Any, &[25.0]),
        TRANSITION_WIDTH,
        SHARPNESS,
        // F is the fitted friction, so there is nothing to search.
        shape(LAW[0].name, LAW[0].unit, Rule::Any, &[]),
        shape(LAW[1].name, LAW[1].unit, Rule::Any, &[]),
        shape(LAW[2].name, LAW[2].unit, Rule::Any, &[]),
        shape(LAW[3].name, LAW[3].unit, Rule::Any, &[]),
        shape(LAW[4].name, LAW[4].unit, Rule::Any, &[]),
        shape(LAW[5].name, LAW[5].unit, Rule::Any, &[]),
        shape(LAW[6].name, LAW[6].unit, Rule::Any, &[]),
        shape(LAW[7].name, LAW[7].unit, Rule::Any, &[]),
    ],
    signals: &["dq_motor", "temperature"],
    memory: 0,
    declared: false,
    diagnosis: drawn_against("temperature", "degC"),
    check: nothing_more,
    columns: temperature_friction::columns,
};
