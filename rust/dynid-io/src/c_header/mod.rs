//! A model as one self-contained C99 file: its numbers as tables, its formulas from the texts in `c/`.
//!
//! The texts are the second home of formulas whose first is `dynid-core`, because C cannot call it: one text per effect
//! under the name of its kind, and `tests/online/test_c_header.py` holds both together. In them `dynid_` and `DYNID_` stand for the
//! header's own prefix. Nothing of a model file enters the C but numbers, and names inside comments and strings, where
//! they cannot end either.

mod effects;
mod names;
mod numbers;
mod residual;

use std::fmt::Write;

use dynid_core::delay_line::{n_delay_rows, shared_and_own};
use dynid_core::limits::believed;
use dynid_core::{JointKind, TorqueModel};

pub use names::prefix_of;
use names::{comment, string};
use numbers::{number, table};

/// The guide to libdynid.
const GUIDE: &str = concat!(
    env!("CARGO_PKG_REPOSITORY"),
    "/blob/main/docs/how_to/c_interface.md"
);

/// Why a model has no C header.
#[derive(Debug, thiserror::Error)]
pub enum CHeaderError {
    /// An effect has no text in `c/effects`.
    #[error("the effect {0} has no C form, so this model cannot be one C file; use libdynid ({guide})", guide = GUIDE)]
    Effect(String),
    /// The prefix is no beginning of a C name.
    #[error("{0:?} cannot begin the names of a C header; give a letter, then letters, digits and underscores, at most 40, other than \"dynid\"")]
    Prefix(String),
}

/// The C99 header of `model`, whose names begin with `prefix`.
///
/// # Errors
/// [`CHeaderError`] if an effect has no C form or the prefix is no beginning of a name.
pub fn c_header(model: &TorqueModel, prefix: &str) -> Result<String, CHeaderError> {
    names::check_prefix(prefix)?;
    let effects = effects::EffectTexts::of(model)?;
    let mut text = String::new();
    // Writing to a string does not fail; the pieces come one blank line apart.
    let mut piece = |part: &str| {
        let _ = writeln!(text, "{}\n", part.trim_end());
    };
    piece(&opening(model));
    piece(&sizes(model));
    piece(include_str!("c/status.c"));
    piece(include_str!("c/types.c"));
    piece(&tables(model));
    piece(&name_functions(model));
    piece(include_str!("c/limits.c"));
    if n_delay(model) > 0 {
        piece(include_str!("c/delay.c"));
    }
    piece(include_str!("c/true_state.c"));
    piece(include_str!("c/rigid_body.c"));
    piece(include_str!("c/weigh.c"));
    for part in &effects.formulas {
        piece(part);
    }
    for part in residual::parts(model) {
        piece(&part);
    }
    piece(&other_terms(model, &effects.calls));
    if n_late(model) > 0 {
        piece(include_str!("c/late.c"));
    }
    piece(include_str!("c/estimate.c"));
    text.push_str("#endif\n");
    Ok(with_prefix(&text, prefix))
}

/// `dynid_` and `DYNID_` become the header's own; what a model file says holds neither ([`names`]).
fn with_prefix(text: &str, prefix: &str) -> String {
    let (lower, upper) = (
        format!("{prefix}_"),
        format!("{}_", prefix.to_ascii_uppercase()),
    );
    // Piece by piece, because the prefix may hold a stand-in itself.
    let parts = text.split("dynid_");
    let parts: Vec<String> = parts.map(|part| part.replace("DYNID_", &upper)).collect();
    parts.join(&lower)
}

fn opening(model: &TorqueModel) -> String {
    let robot = model.robot();
    let joints = robot.joints().iter();
    let joints: Vec<String> = joints.map(|joint| comment(&joint.name)).collect();
    format!(
        "/*\n * The torque model of {} in C99: {} joints, torques in {}.\n *\n * Joints: {}\n * Terms:  {}\n *\n * \
         Written by `dynid export --c-header` of dynid-rs {}. No allocation and no library but math.h. Use:\n *\n *     \
         dynid_estimator estimator;\n *     dynid_init(&estimator);\n *     every cycle: unsigned status = \
         dynid_estimate(&estimator, &state, tau);\n *\n * An estimator belongs to one thread at a time. Compile without \
         -ffast-math; -ffp-contract=off gives the same bits\n * on every processor whose math.h does.\n */\n\
         #ifndef DYNID_H\n#define DYNID_H\n\n#include <float.h>\n#include <math.h>\n\n#if defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__ > 0)\n#error \"NaN and \
         infinity must be seen here: compile without -ffast-math and -ffinite-math-only\"\n#endif",
        comment(robot.name()),
        robot.n_joints(),
        comment(model.torque_unit()),
        joints.join(", "),
        comment(&model.term_names().join(" + ")),
        env!("CARGO_PKG_VERSION"),
    )
}

/// An array has one element at least, used or not.
fn n_memory(model: &TorqueModel) -> usize {
    let n = model.robot().n_joints();
    let effects = model.effects().iter();
    let all: usize = effects.map(|term| term.effect().memory_len(n)).sum();
    all.max(1)
}

/// Rows that are kept for something that is late by `delay` \[s\].
fn n_rows(model: &TorqueModel, delay: f64) -> usize {
    let rows = model.step().and_then(|step| n_delay_rows(delay, step));
    rows.filter(|_| delay > 0.0).unwrap_or(0)
}

/// States that are kept for torque channels that are late together.
fn n_delay(model: &TorqueModel) -> usize {
    n_rows(model, shared_and_own(model.torque_delay(), 0.0).0)
}

/// How much later than all the channel of every joint is \[s\].
fn own_delay(model: &TorqueModel) -> Vec<f64> {
    shared_and_own(model.torque_delay(), 0.0).1
}

/// Steps whose terms are kept for torque channels that are late by themselves.
fn n_late(model: &TorqueModel) -> usize {
    n_rows(model, own_delay(model).into_iter().fold(0.0, f64::max))
}

fn sizes(model: &TorqueModel) -> String {
    let encoder_error = match model.encoder_error() {
        None => "0 /* no encoder shows too much */",
        Some(error) if error.both_sides => {
            "2 /* link and motor side are one encoder, which shows too much */"
        }
        Some(_) => "1 /* the link encoders show too much */",
    };
    let delays = model.torque_delay();
    let (shared, _) = shared_and_own(delays, 0.0);
    let all_early = delays
        .first()
        .filter(|first| **first < 0.0 && delays.iter().all(|delay| delay == *first));
    let joints = model.robot().joints().iter().zip(delays);
    let early = joints.filter(|(_, delay)| **delay < 0.0);
    let early: Vec<String> = early
        .map(|(joint, delay)| format!("{} by {} s", comment(&joint.name), -delay))
        .collect();
    format!(
        "#define DYNID_N_JOINTS {}\n#define DYNID_N_TERMS {}\n#define DYNID_N_MEMORY {}\n#define DYNID_STEP {} /* between \
         states [s]; 0 where nothing depends on it */\n#define DYNID_ENCODER_ERROR {encoder_error}\n#define DYNID_TORQUE_DELAY {} /* of all torque \
         channels behind the encoders [s]{} */\n{}\n{}",
        model.robot().n_joints(),
        model.n_terms(),
        n_memory(model),
        number(model.step().unwrap_or(0.0)),
        number(all_early.copied().unwrap_or(shared)),
        if early.is_empty() {
            String::new()
        } else {
            format!("; early: {}; torques there are those of the state", early.join(", "))
        },
        ring("DELAY", n_delay(model)),
        ring("LATE", n_late(model)),
    )
}

/// How many rows a ring has; a program whose states come faster than the model's step says needs more of them.
fn ring(name: &str, n_rows: usize) -> String {
    let size = format!("#define DYNID_N_{name} {n_rows}");
    if n_rows == 0 {
        return size;
    }
    format!(
        "/* Rows of a ring. Where states come faster than DYNID_STEP, define more before: the longest delay over the step, \
         rounded\n * up, and two. With too few DYNID_SETTLING never ends. */\n#ifndef DYNID_N_{name}\n{size}\n#endif"
    )
}

fn tables(model: &TorqueModel) -> String {
    let robot = model.robot();
    let n = robot.n_joints();
    let mut text = String::from("static const dynid_joint dynid_joints[DYNID_N_JOINTS] = {\n");
    let row = |values: &[f64]| {
        let values: Vec<String> = values.iter().map(|x| number(*x)).collect();
        format!("{{{}}}", values.join(", "))
    };
    for (joint, phi) in robot.joints().iter().zip(model.phi().chunks_exact(10)) {
        let slides = u8::from(joint.kind == JointKind::Prismatic);
        // nalgebra keeps columns together, the C text rows.
        let rotation = joint.rotation.transpose();
        let _ = writeln!(
            text,
            "    {{{slides},\n     {},\n     {},\n     {},\n     {}}},",
            row(rotation.as_slice()),
            row(joint.translation.as_slice()),
            row(joint.axis.as_slice()),
            row(phi)
        );
    }
    text.push_str("};\n");
    let error = model.encoder_error();
    let error = error.map_or_else(|| vec![0.0; 2 * n], |error| error.cos_sin.concat());
    let domain = model.domain();
    let believed = believed(model);
    // No number is beyond the largest one.
    let limits = |k: usize| -> Vec<f64> {
        let rows = believed.iter().flat_map(|joint| joint[k]);
        rows.map(|x| x.clamp(-f64::MAX, f64::MAX)).collect()
    };
    for (name, width, values) in [
        ("torque_scale", 1, model.torque_scale().to_vec()),
        ("noise_std", 1, model.noise_std().to_vec()),
        ("encoder_delay", 1, model.encoder_delay().to_vec()),
        ("encoder_error", 2, error),
        ("domain_q", 2, domain.q.concat()),
        ("domain_dq", 1, domain.dq.clone()),
        ("domain_ddq", 1, domain.ddq.clone()),
        ("limits_q", 2, limits(0)),
        ("limits_dq", 2, limits(1)),
        ("limits_ddq", 2, limits(2)),
    ] {
        text.push_str(&table(name, width, &values));
    }
    if n_late(model) > 0 {
        text.push_str(&table("own_delay", 1, &own_delay(model)));
    }
    text.push_str(&table("gravity", 1, robot.gravity().as_slice()));
    let wants = model.wants_temperature();
    let wants: Vec<&str> = wants.iter().map(|w| if *w { "1" } else { "0" }).collect();
    let wants = wants.join(", ");
    let _ = write!(
        text,
        "static const int dynid_wants_temperature[DYNID_N_JOINTS] = {{{wants}}};"
    );
    text
}

/// Names as functions: a table that nobody reads would be a warning.
fn name_functions(model: &TorqueModel) -> String {
    let function = |what: &str, of: &str, names: &mut dyn Iterator<Item = &str>| {
        let cases: Vec<String> = names
            .enumerate()
            .map(|(k, name)| format!("    case {k}: return {};\n", string(name)))
            .collect();
        format!(
            "/* Name of {what}, counted from 0; empty where there is none. */\nstatic inline const char *dynid_{of}_name(int \
             {of})\n{{\n    switch ({of}) {{\n{}    default: return \"\";\n    }}\n}}\n",
            cases.concat()
        )
    };
    let joints = &mut model.robot().joints().iter().map(|j| j.name.as_str());
    let names = model.term_names();
    let terms = &mut names.iter().map(String::as_str);
    function("a joint", "joint", joints) + "\n" + &function("a term", "term", terms)
}

/// Every term but the rigid body, in order.
fn other_terms(model: &TorqueModel, calls: &str) -> String {
    format!(
        "/* Every term but the rigid body; 1 if the residual was faded. */\nstatic inline int \
         dynid_other_terms(dynid_input *x, double *memory, double (*terms)[DYNID_N_JOINTS], double *variance)\n{{\n    int faded = 0;\n    \
         (void)x, (void)memory, (void)terms, (void)variance;\n{calls}{}    return faded;\n}}",
        residual::calls(model)
    )
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
