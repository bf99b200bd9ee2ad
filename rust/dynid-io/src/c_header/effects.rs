//! The effects of a model in C: each kind's text once, a table and a loop for each term.

use std::fmt::Write;

use dynid_core::effects::TAU_MOTOR;
use dynid_core::TorqueModel;

use super::numbers::table;
use super::CHeaderError;

/// One kind of effect in C.
struct Form {
    kind: &'static str,
    /// `dynid_kind(shape, j, x, memory, columns)`, the twin of `dynid_core::effects::kind::columns`.
    text: &'static str,
    /// Texts that it calls, in the order in which they come.
    needs: &'static [&'static str],
}

/// For effects that end at angles: the twin of `dynid_core::effects::held`.
const HELD: &str = include_str!("c/effects/held.c");
const DIRECTION: &str = include_str!("c/effects/direction.c");
const FRICTION_SIGN: &str = include_str!("c/effects/friction_sign.c");
const BRISTLES: &str = include_str!("c/effects/bristles.c");
const FRICTION_COLUMNS: &str = include_str!("c/effects/friction_columns.c");

macro_rules! form {
    ($kind:literal, $needs:expr) => {
        Form {
            kind: $kind,
            text: include_str!(concat!("c/effects/", $kind, ".c")),
            needs: &$needs,
        }
    };
}

static FORMS: [Form; 19] = [
    form!("rotor_inertia", []),
    form!("torque_offset", []),
    form!("friction", [DIRECTION, FRICTION_COLUMNS]),
    form!("smooth_friction", [DIRECTION, FRICTION_SIGN]),
    form!("stribeck", [DIRECTION, FRICTION_SIGN]),
    form!("counterbalance", []),
    form!("load_dependent_friction", [DIRECTION, FRICTION_SIGN]),
    form!("bearing_friction", [DIRECTION, FRICTION_SIGN]),
    form!("position_dependent_friction", [DIRECTION, FRICTION_SIGN]),
    form!("friction_hysteresis", [BRISTLES]),
    form!("load_hysteresis", [BRISTLES]),
    form!("gear_hysteresis", []),
    form!("coupled_friction", [DIRECTION, FRICTION_SIGN]),
    form!("torque_ripple", []),
    form!("inertial_coupling", []),
    form!("joint_spring", []),
    form!("torque_saturation", []),
    form!("thermal_friction", [DIRECTION, FRICTION_SIGN]),
    form!(
        "temperature_friction",
        [DIRECTION, FRICTION_SIGN, FRICTION_COLUMNS]
    ),
];

fn form_of(kind: &str) -> Result<&'static Form, CHeaderError> {
    let found = FORMS.iter().find(|form| form.kind == kind);
    found.ok_or_else(|| CHeaderError::Effect(kind.to_owned()))
}

/// The effects' part of a header.
pub(super) struct EffectTexts {
    /// Tables and functions.
    pub formulas: Vec<String>,
    /// Statements that fill the rows of the terms.
    pub calls: String,
}

impl EffectTexts {
    /// # Errors
    /// [`CHeaderError::Effect`] if one of them has no C form.
    pub fn of(model: &TorqueModel) -> Result<Self, CHeaderError> {
        let n = model.robot().n_joints();
        let (mut functions, mut tables) = (Vec::<&str>::new(), String::new());
        let (mut calls, mut of_motor) = (String::new(), String::new());
        let mut memory = 0;
        for (k, term) in model.effects().iter().enumerate() {
            let (row, effect) = (k + 1, term.effect());
            let form = form_of(effect.kind())?;
            for text in form.needs.iter().chain([&form.text]) {
                if !functions.contains(text) {
                    functions.push(text);
                }
            }
            let (shape, width, own) = (effect.shape(), effect.n_columns(), effect.entry().memory);
            let shape_row = if shape.is_empty() {
                "(const double *)0".to_owned()
            } else {
                let values: Vec<f64> = (0..n)
                    .flat_map(|j| shape.iter().map(move |(_, v)| v[j]))
                    .collect();
                let names: Vec<&str> = shape.iter().map(|(name, _)| *name).collect();
                let _ = writeln!(
                    tables,
                    "/* Term {row}, {}, joint by joint: {} */",
                    form.kind,
                    names.join(", ")
                );
                tables.push_str(&table(&format!("shape_{row}"), shape.len(), &values));
                // A table of one column is a row, and then j is what leads to the joint.
                let at = if shape.len() == 1 { "&" } else { "" };
                format!("{at}dynid_shape_{row}[j]")
            };
            let names: Vec<&str> = effect.coefficient_names().collect();
            let _ = writeln!(
                tables,
                "/* Term {row}, {}, joint by joint: {} */",
                form.kind,
                names.join(", ")
            );
            tables.push_str(&table(&format!("size_{row}"), width, term.coefficients()));
            let size_at = if width == 1 { "&" } else { "" };
            // What is of the motors' torque comes after all that makes it.
            let is_of_motor = effect.entry().needs(TAU_MOTOR);
            let calls = if is_of_motor {
                &mut of_motor
            } else {
                &mut calls
            };
            let (before, after) = if effect.is_held() {
                if !functions.contains(&HELD) {
                    functions.push(HELD);
                }
                let ends = effect.entry().shape.len();
                let hold =
                    format!("        dynid_hold_angle(x, j, {shape_row} + {ends}, unheld);\n");
                (hold, "        dynid_release_angle(x, j, unheld);\n")
            } else {
                (String::new(), "")
            };
            let _ = write!(
                calls,
                "    for (j = 0; j < DYNID_N_JOINTS; j++) {{\n{before}        dynid_{}({shape_row}, j, x, memory + {memory} + \
                 {own} * j, columns);\n{after}        terms[{row}][j] = dynid_weigh(columns, {size_at}dynid_size_{row}[j], \
                 {width});\n    }}\n",
                form.kind,
            );
            memory += own * n;
        }
        if !of_motor.is_empty() {
            calls.push_str(&motor_torque(model));
            calls.push_str(&of_motor);
        }
        if !calls.is_empty() {
            calls.insert_str(
                0,
                &format!(
                    "    double columns[{}]{};\n    int j;\n",
                    dynid_core::effects::MAX_COLUMNS,
                    if functions.contains(&HELD) {
                        ", unheld[2]"
                    } else {
                        ""
                    },
                ),
            );
        }
        let formulas = functions.into_iter().map(str::to_owned);
        Ok(Self {
            formulas: formulas
                .chain((!tables.is_empty()).then_some(tables))
                .collect(),
            calls,
        })
    }
}

/// Statement that sums the torque of the motors up, in the order of `dynid_core::effects::motor_torque_into`.
fn motor_torque(model: &TorqueModel) -> String {
    let effects = model.effects().iter().enumerate();
    let declared = effects.filter(|(_, term)| term.effect().is_declared());
    let rows: Vec<String> = std::iter::once(0)
        .chain(declared.map(|(k, _)| k + 1))
        .map(|row| format!("terms[{row}][j]"))
        .collect();
    format!(
        "    for (j = 0; j < DYNID_N_JOINTS; j++) {{\n        x->tau_motor[j] = {};\n    }}\n",
        rows.join(" + ")
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use dynid_core::effects::CATALOGUE;

    #[test]
    fn every_effect_of_the_catalogue_has_its_c_form() {
        for entry in &CATALOGUE {
            assert!(
                form_of(entry.kind).is_ok(),
                "the effect {kind} has no C form: write rust/dynid-io/src/c_header/c/effects/{kind}.c after \
                 rust/dynid-core/src/effects/{kind}.rs and name it in FORMS (effects.rs beside it)",
                kind = entry.kind
            );
        }
        assert_eq!(FORMS.len(), CATALOGUE.len(), "a C form is of no effect");
    }

    #[test]
    fn texts_define_what_their_name_says_and_name_what_they_call() {
        for form in &FORMS {
            let definition = format!("static inline void dynid_{}(", form.kind);
            assert!(form.text.contains(&definition), "{}", form.kind);
            for (call, text) in [
                ("dynid_direction(", DIRECTION),
                ("dynid_friction_sign(", FRICTION_SIGN),
                ("dynid_bristles(", BRISTLES),
                ("dynid_friction_columns(", FRICTION_COLUMNS),
            ] {
                let needed = form.needs.contains(&text);
                let called = form.text.contains(call);
                assert!(needed || !called, "{} calls {call}", form.kind);
            }
        }
    }

    #[test]
    fn an_effect_without_a_c_form_is_refused_in_a_sentence() {
        let error = form_of("wobble").err().map(|error| error.to_string());
        let words = "the effect wobble has no C form, so this model cannot be one C file; use libdynid (https://github.com/dynid-rs/dynid_rs/blob/main/docs/how_to/c_interface.md)";
        assert_eq!(error.as_deref(), Some(words));
    }
}
