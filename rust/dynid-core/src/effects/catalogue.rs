//! Every kind of effect: one entry each, with names, units, signs, search grid, signals and the formula's place.
//!
//! Units name `{torque}` and `{angle}`, which depend on the model's torque channel and on the joint: "N*m" or "A", "rad"
//! or "m".

use super::entry::{
    Coefficient, Diagnosis, Entry, Need, Places, Reference, Rule, Scale, ShapeParameter, Sign,
};
use super::{
    bearing_friction, counterbalance, coupled_friction, friction, friction_hysteresis,
    gear_hysteresis, inertial_coupling, joint_spring, load_dependent_friction, load_hysteresis,
    position_dependent_friction, rotor_inertia, smooth_friction, stribeck, temperature_friction,
    thermal_friction, torque_offset, torque_ripple, torque_saturation, FRICTION_NAMES, N_FRICTION,
    TAU_MOTOR,
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
        relative_to: None,
        range: None,
        absent: None,
        not_below: None,
    }
}

fn nothing_more(_shape: &[f64]) -> Result<(), &'static str> {
    Ok(())
}

/// Found on one joint, from the signals alone, and drawn against its own column.
const ON_A_JOINT: Diagnosis = Diagnosis {
    places: Places::Joint,
    sought: true,
    requires: &[],
    drawn_against: None,
    reaction: &[],
    most_relative: None,
};

/// Part of a declared model.
const DECLARED: Diagnosis = Diagnosis {
    sought: false,
    ..ON_A_JOINT
};

const fn drawn_against(signal: &'static str, unit: &'static str) -> Diagnosis {
    Diagnosis {
        drawn_against: Some((signal, unit)),
        ..ON_A_JOINT
    }
}

/// What goes round with a joint that turns.
const AROUND_THE_TURN: Diagnosis = Diagnosis {
    requires: &[Need::Revolute],
    ..drawn_against("q", "rad")
};

const SPEED: &str = "{angle}/s";

/// Width of the step at standstill: friction's own.
const TRANSITION_WIDTH: ShapeParameter = shape(
    "transition_width",
    SPEED,
    Rule::Positive,
    &[0.003, 0.01, 0.03],
)
.of(Reference::FrictionWidth);

/// Sharpness of that step: friction's own. Zero is a hyperbolic tangent, as Eqs. 10-11 have it.
const SHARPNESS: ShapeParameter = ShapeParameter {
    absent: Some(0.0),
    ..shape("sharpness", "1", Rule::NonNegative, &[0.0])
}
.of(Reference::FrictionSharpness);

/// Way over which bristles bend until they slip. A shorter one than the range has is a sign's that keeps its value at rest.
const PRESLIDING_DISTANCE: ShapeParameter = shape(
    "presliding_distance",
    "{angle}",
    Rule::Positive,
    &[3e-4, 1e-3, 3e-3, 1e-2, 3e-2],
)
.refined(Scale::Log, friction_hysteresis::SHORTEST_WAY, 0.3);

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

/// Every kind of effect; those of declared models come first.
pub static CATALOGUE: [Entry; 19] = [
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
        diagnosis: DECLARED,
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
        diagnosis: DECLARED,
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
        diagnosis: DECLARED,
        check: nothing_more,
        columns: friction::columns,
    },
    Entry {
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
    },
    Entry {
        kind: "counterbalance",
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
    },
    Entry {
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
    },
    Entry {
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
        diagnosis: drawn_against("tau_link", "{torque}"),
        check: nothing_more,
        columns: bearing_friction::columns,
    },
    Entry {
        kind: "position_dependent_friction",
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
    },
    Entry {
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
    },
    Entry {
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
    },
    Entry {
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
                "N*m",
                Rule::Positive,
                &[0.03, 0.1, 0.3, 1.0],
            )
            .of(Reference::Load)
            .refined(Scale::Log, 1e-4, 1e5),
            shape("carried_load", "N*m", Rule::NonNegative, &[0.05])
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
    },
    Entry {
        kind: "coupled_friction",
        formula: "k s(u) + d u, u = dq_motor + r dq_motor of the partner",
        coefficients: &[
            coefficient("coupled_friction", "{torque}", Sign::NonNegative),
            coefficient("coupled_viscous", "{torque}*s/{angle}", Sign::NonNegative),
        ],
        shape: &[
            PARTNER,
            shape("ratio", "1", Rule::Any, &[-1.0, -0.5, 0.5, 1.0]).refined(
                Scale::Linear,
                -5.0,
                5.0,
            ),
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
        // Kinetic energy c dq_j dq_p: the mass matrix is symmetric.
        diagnosis: Diagnosis {
            places: Places::Pair,
            reaction: &[0],
            ..drawn_against("ddq", "rad/s^2")
        },
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
        diagnosis: drawn_against("q", "rad"),
        check: nothing_more,
        columns: joint_spring::columns,
    },
    Entry {
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
            SHARPNESS,
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
        diagnosis: drawn_against("temperature", "degC"),
        check: nothing_more,
        columns: temperature_friction::columns,
    },
];

/// The entry of a kind.
#[must_use]
pub fn find(kind: &str) -> Option<&'static Entry> {
    CATALOGUE.iter().find(|entry| entry.kind == kind)
}

#[cfg(test)]
mod tests {
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
