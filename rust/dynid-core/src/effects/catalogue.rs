//! Every kind of effect: one entry each, with names, units, signs, search grid, signals and the formula's place.
//!
//! Units name `{torque}` and `{angle}`, which depend on the model's torque channel and on the joint: "N*m" or "A", "rad"
//! or "m".

use super::entry::{Coefficient, Entry, Rule, ShapeParameter, Sign};
use super::{
    counterbalance, coupled_friction, friction, friction_hysteresis, gear_hysteresis,
    inertial_coupling, joint_spring, load_dependent_friction, load_hysteresis,
    position_dependent_friction, rotor_inertia, stribeck, temperature_friction, thermal_friction,
    torque_offset, torque_ripple, torque_saturation, FRICTION_NAMES, N_FRICTION,
};

const fn coefficient(name: &'static str, unit: &'static str, sign: Sign) -> Coefficient {
    Coefficient { name, unit, sign }
}

const fn shape(
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
    }
}

fn nothing_more(_shape: &[f64]) -> Result<(), &'static str> {
    Ok(())
}

const SPEED: &str = "{angle}/s";

/// Width of the step at standstill; friction's own is the best guess.
const TRANSITION_WIDTH: ShapeParameter = shape(
    "transition_width",
    SPEED,
    Rule::Positive,
    &[0.003, 0.01, 0.03],
);

/// Way over which bristles bend until they slip.
const PRESLIDING_DISTANCE: ShapeParameter = shape(
    "presliding_distance",
    "{angle}",
    Rule::Positive,
    &[1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2],
);

/// Cycles per turn of the joint.
const CYCLES: &str = "1/turn";

const PARTNER: ShapeParameter = shape("partner", "joint", Rule::Partner, &[]);

const FRICTION: [Coefficient; N_FRICTION] = [
    coefficient(FRICTION_NAMES[0], "{torque}", Sign::NonNegative),
    coefficient(FRICTION_NAMES[1], "{torque}", Sign::NonNegative),
    coefficient(FRICTION_NAMES[2], "{torque}*s/{angle}", Sign::Free),
    coefficient(FRICTION_NAMES[3], "{torque}*s/{angle}", Sign::Free),
    coefficient(FRICTION_NAMES[4], "{torque}*(s/{angle})^2", Sign::Free),
    coefficient(FRICTION_NAMES[5], "{torque}*(s/{angle})^2", Sign::Free),
    coefficient(FRICTION_NAMES[6], "{torque}*(s/{angle})^3", Sign::Free),
    coefficient(FRICTION_NAMES[7], "{torque}*(s/{angle})^3", Sign::Free),
];

/// Every kind of effect; those of every model come first.
pub static CATALOGUE: [Entry; 17] = [
    Entry {
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
        check: nothing_more,
        columns: rotor_inertia::columns,
    },
    Entry {
        kind: "torque_offset",
        formula: "o",
        coefficients: &[coefficient("torque_offset", "{torque}", Sign::Free)],
        shape: &[],
        signals: &[],
        memory: 0,
        declared: true,
        check: nothing_more,
        columns: torque_offset::columns,
    },
    Entry {
        kind: "friction",
        formula: "Eqs. 9-11 at dq_motor",
        coefficients: &FRICTION,
        shape: &[
            shape("velocity_threshold", SPEED, Rule::NonNegative, &[]),
            shape("transition_width", SPEED, Rule::Positive, &[]),
        ],
        signals: &["dq_motor"],
        memory: 0,
        declared: true,
        check: nothing_more,
        columns: friction::columns,
    },
    Entry {
        kind: "stribeck",
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
                &[0.01, 0.03, 0.1, 0.3, 1.0],
            ),
            shape("exponent", "1", Rule::Positive, &[1.0, 2.0]),
            TRANSITION_WIDTH,
        ],
        signals: &["dq_motor"],
        memory: 0,
        declared: false,
        check: nothing_more,
        columns: stribeck::columns,
    },
    Entry {
        kind: "counterbalance",
        formula: "c / (gas_length - (L - |a - b|)) dL/dq, L^2 = a^2 + b^2 + 2 a b cos(q + phase)",
        coefficients: &[coefficient("counterbalance", "{torque}", Sign::NonNegative)],
        shape: &[
            // Only ratios of the lengths matter, so a search holds one of them.
            shape("a", "m", Rule::Positive, &[1.0]),
            shape("b", "m", Rule::Positive, &[0.15, 0.25, 0.4, 0.6]),
            shape(
                "phase",
                "rad",
                Rule::Any,
                &[
                    -2.5, -2.0, -1.5, -1.0, -0.5, 0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0,
                ],
            ),
            shape(
                "gas_length",
                "m",
                Rule::Any,
                &[0.75, 1.25, 2.5, 10.0, -1.0, -10.0],
            ),
        ],
        signals: &["q"],
        memory: 0,
        declared: false,
        check: counterbalance::check,
        columns: counterbalance::columns,
    },
    Entry {
        kind: "load_dependent_friction",
        formula: "(m0 + m1 |dq_motor|) |tau_link| s(dq_motor)",
        coefficients: &[
            coefficient("load_friction", "1", Sign::NonNegative),
            coefficient("load_friction_speed", "s/{angle}", Sign::Free),
        ],
        shape: &[TRANSITION_WIDTH],
        signals: &["dq_motor", "tau_link"],
        memory: 0,
        declared: false,
        check: nothing_more,
        columns: load_dependent_friction::columns,
    },
    Entry {
        kind: "position_dependent_friction",
        formula: "s(dq_motor) (a cos N q + b sin N q)",
        coefficients: &[
            coefficient("position_friction_cos", "{torque}", Sign::Free),
            coefficient("position_friction_sin", "{torque}", Sign::Free),
        ],
        shape: &[
            shape("cycles", CYCLES, Rule::Positive, &[1.0, 2.0, 3.0, 4.0]),
            TRANSITION_WIDTH,
        ],
        signals: &["q", "dq_motor"],
        memory: 0,
        declared: false,
        check: nothing_more,
        columns: position_dependent_friction::columns,
    },
    Entry {
        kind: "friction_hysteresis",
        formula: "k z, dz = dx/d (1 - z sign(dx)) along q_motor",
        coefficients: &[coefficient("hysteresis", "{torque}", Sign::NonNegative)],
        shape: &[PRESLIDING_DISTANCE],
        signals: &["q_motor"],
        memory: friction_hysteresis::MEMORY,
        declared: false,
        check: nothing_more,
        columns: friction_hysteresis::columns,
    },
    Entry {
        kind: "load_hysteresis",
        formula: "k |tau_link| z, dz = dx/d (1 - z sign(dx)) along q_motor",
        coefficients: &[coefficient("load_hysteresis", "1", Sign::NonNegative)],
        shape: &[PRESLIDING_DISTANCE],
        signals: &["q_motor", "tau_link"],
        memory: friction_hysteresis::MEMORY,
        declared: false,
        check: nothing_more,
        columns: load_hysteresis::columns,
    },
    Entry {
        kind: "gear_hysteresis",
        formula: "k z, dz = dx/d (1 - z sign(dx)) along x = tau_link - c z",
        coefficients: &[coefficient(
            "gear_hysteresis",
            "{torque}",
            Sign::NonNegative,
        )],
        // Of the load's own scatter, so a search brings them.
        shape: &[
            shape("hysteresis_load", "N*m", Rule::Positive, &[]),
            shape("carried_load", "N*m", Rule::NonNegative, &[]),
        ],
        signals: &["tau_link"],
        memory: friction_hysteresis::MEMORY,
        declared: false,
        check: nothing_more,
        columns: gear_hysteresis::columns,
    },
    Entry {
        kind: "coupled_friction",
        formula: "k s(dq_motor + r dq_motor of the partner)",
        coefficients: &[coefficient(
            "coupled_friction",
            "{torque}",
            Sign::NonNegative,
        )],
        shape: &[
            PARTNER,
            shape("ratio", "1", Rule::Any, &[-1.0, -0.5, 0.5, 1.0]),
            TRANSITION_WIDTH,
        ],
        signals: &["dq_motor"],
        memory: 0,
        declared: false,
        check: nothing_more,
        columns: coupled_friction::columns,
    },
    Entry {
        kind: "torque_ripple",
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
            &[1.0, 2.0, 50.0, 100.0],
        )],
        signals: &["q_motor"],
        memory: 0,
        declared: false,
        check: nothing_more,
        columns: torque_ripple::columns,
    },
    Entry {
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
        check: nothing_more,
        columns: inertial_coupling::columns,
    },
    Entry {
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
        check: nothing_more,
        columns: joint_spring::columns,
    },
    Entry {
        kind: "torque_saturation",
        formula: "c tau_link^3",
        coefficients: &[coefficient("saturation", "1/({torque})^2", Sign::Free)],
        shape: &[],
        signals: &["tau_link"],
        memory: 0,
        declared: false,
        check: nothing_more,
        columns: torque_saturation::columns,
    },
    Entry {
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
                &[30.0, 100.0, 300.0, 1000.0, 3000.0],
            ),
            shape("reference_speed", SPEED, Rule::NonNegative, &[0.0, 1.0]),
            TRANSITION_WIDTH,
        ],
        signals: &["dq_motor", "step"],
        memory: thermal_friction::MEMORY,
        declared: false,
        check: nothing_more,
        columns: thermal_friction::columns,
    },
    Entry {
        kind: "temperature_friction",
        formula:
            "c (T - T_0) F(dq_motor), T the measured temperature, F the joint's friction at T_0",
        coefficients: &[coefficient("friction_per_kelvin", "1/K", Sign::NonPositive)],
        shape: &[
            // Friction beside it takes up any other choice, so a search holds one.
            shape("reference_temperature", "degC", Rule::Any, &[25.0]),
            TRANSITION_WIDTH,
            // F is the fitted friction, so there is nothing to search.
            shape(FRICTION[0].name, FRICTION[0].unit, Rule::Any, &[]),
            shape(FRICTION[1].name, FRICTION[1].unit, Rule::Any, &[]),
            shape(FRICTION[2].name, FRICTION[2].unit, Rule::Any, &[]),
            shape(FRICTION[3].name, FRICTION[3].unit, Rule::Any, &[]),
            shape(FRICTION[4].name, FRICTION[4].unit, Rule::Any, &[]),
            shape(FRICTION[5].name, FRICTION[5].unit, Rule::Any, &[]),
            shape(FRICTION[6].name, FRICTION[6].unit, Rule::Any, &[]),
            shape(FRICTION[7].name, FRICTION[7].unit, Rule::Any, &[]),
        ],
        signals: &["dq_motor", "temperature"],
        memory: 0,
        declared: false,
        check: nothing_more,
        columns: temperature_friction::columns,
    },
];

/// The entry of a kind.
#[must_use]
pub fn find(kind: &str) -> Option<&'static Entry> {
    CATALOGUE.iter().find(|entry| entry.kind == kind)
}
