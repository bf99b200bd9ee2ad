//! What a model is, for people and for machines.

use std::fmt::Write;

use dynid_core::differentiator::{delay, first_answer, usual_window};
use dynid_core::online::USUAL_STEP;
use dynid_core::{JointKind, Regression, Residual, Signal, TorqueModel};
use serde_json::json;

use crate::cycle::Settings;

fn kind_name(kind: JointKind) -> &'static str {
    match kind {
        JointKind::Revolute => "revolute",
        JointKind::Prismatic => "prismatic",
    }
}

/// Unit of a position.
fn unit(kind: JointKind) -> &'static str {
    match kind {
        JointKind::Revolute => "rad",
        JointKind::Prismatic => "m",
    }
}

/// Joints whose torque the third loop corrects.
fn residual_joints(model: &TorqueModel) -> Vec<&str> {
    let Some(residual) = model.residual() else {
        return Vec::new();
    };
    let joints = model.robot().joints().iter().zip(residual.joints());
    joints
        .filter(|(_, mixture)| mixture.is_some())
        .map(|(joint, _)| joint.name.as_str())
        .collect()
}

/// Which regressions the third loop is made of, `"mixture"` or `"rbf"`; both where joints differ.
fn residual_methods(residual: &Residual) -> String {
    let mut names: Vec<_> = residual
        .joints()
        .iter()
        .flatten()
        .map(Regression::name)
        .collect();
    names.sort_unstable();
    names.dedup();
    names.join(" and ")
}

/// Name and joint of what every joint's regression sees, where they see signals by name.
fn signals(residual: &Residual) -> Option<Vec<Vec<(&'static str, usize)>>> {
    let of_joint = |signals: &Vec<Signal>| {
        let signals = signals.iter();
        signals
            .map(|signal| (signal.kind.name(), signal.joint))
            .collect()
    };
    let joints = residual.inputs().signals()?.iter();
    Some(joints.map(of_joint).collect())
}

/// Delays in ms: one number where all joints have the same, else those that are `told`, by name.
fn delays(model: &TorqueModel, told: impl Fn(f64) -> bool, sign: f64) -> String {
    let delays = model.torque_delay();
    let ms = |delay: f64| format!("{} ms", short(sign * 1e3 * delay));
    if let [first, others @ ..] = delays {
        if others.iter().all(|delay| delay == first) {
            return ms(*first);
        }
    }
    let joints = model.robot().joints().iter().zip(delays);
    let joints: Vec<String> = joints
        .filter(|(_, delay)| told(**delay))
        .map(|(joint, delay)| format!("{} {}", joint.name, ms(*delay)))
        .collect();
    joints.join(", ")
}

/// How late the torque channels are, and what that makes of the answers.
fn torque_delay(model: &TorqueModel) -> String {
    let said = delays(model, |delay| delay != 0.0, 1.0);
    if model.torque_delay().iter().all(|delay| *delay >= 0.0) {
        format!("{said}: answers are what the channel shows, the torque of the state of then")
    } else {
        format!("{said}: answers of an early channel are the torque of the state, which it showed before")
    }
}

/// Which torque channels are early, and by how much; none where none is.
pub fn early_channels(model: &TorqueModel) -> Option<String> {
    let any = model.torque_delay().iter().any(|delay| *delay < 0.0);
    any.then(|| delays(model, |delay| delay < 0.0, -1.0))
}

/// How positions that come alone would be differentiated: window, time between samples, delay.
fn differentiation(model: &TorqueModel, settings: &Settings) -> (usize, f64, f64) {
    let step = settings.step.or(model.step()).unwrap_or(USUAL_STEP);
    let window = settings.window.unwrap_or_else(|| usual_window(step));
    (window, step, delay(window, step))
}

/// For people.
pub fn text(model: &TorqueModel, settings: &Settings) -> String {
    let robot = model.robot();
    let mut text = String::new();
    let mut line = |name: &str, value: &str| {
        // Writing to a string does not fail.
        let _ = writeln!(text, "{name:<13} {value}");
    };
    line(
        "robot",
        &format!("{}, {} joints", robot.name(), robot.n_joints()),
    );
    let gravity = robot.gravity();
    line(
        "gravity",
        &format!("{} {} {} m/s^2", gravity.x, gravity.y, gravity.z),
    );
    line("torque unit", model.torque_unit());
    line("terms", &model.term_names().join(" + "));
    if let Some(step) = model.step() {
        line("step", &format!("{} ms between states", 1e3 * step));
    }
    if model.torque_delay().iter().any(|delay| *delay != 0.0) {
        line("torque delay", &torque_delay(model));
    }
    if let Some(residual) = model.residual() {
        let joints = residual_joints(model).join(", ");
        line(
            "residual",
            &format!(
                "{} of {}, on {joints}",
                residual_methods(residual),
                residual.inputs().name()
            ),
        );
    }
    let (window, step, delay) = differentiation(model, settings);
    line(
        "without dq",
        &format!(
            "positions alone are differentiated over {window} samples, {} ms late at {} ms between states; the first answer is that of state {}",
            short(1e3 * delay),
            short(1e3 * step),
            first_answer(window)
        ),
    );
    text.push_str("\ntrained on\n");
    text.push_str(&table(model));
    text
}

/// One row per joint: the domain, the channel delay and the noise.
fn table(model: &TorqueModel) -> String {
    let header = [
        "",
        "joint",
        "",
        "position",
        "",
        "speed up to",
        "acceleration up to",
        "encoder delay",
        "noise (std)",
    ];
    let mut rows = vec![header.map(str::to_owned)];
    let domain = model.domain();
    for (j, joint) in model.robot().joints().iter().enumerate() {
        let [low, high] = domain.q[j];
        let unit = unit(joint.kind);
        rows.push([
            j.to_string(),
            joint.name.clone(),
            kind_name(joint.kind).to_owned(),
            format!("{low:.4} to {high:.4}"),
            unit.to_owned(),
            format!("{:.4} {unit}/s", domain.dq[j]),
            format!("{:.4} {unit}/s^2", domain.ddq[j]),
            format!("{:.4} ms", 1e3 * model.encoder_delay()[j]),
            format!("{:.4} {}", model.noise_std()[j], model.torque_unit()),
        ]);
    }
    let widths: Vec<usize> = (0..header.len())
        .map(|k| {
            rows.iter()
                .map(|row| row[k].chars().count())
                .max()
                .unwrap_or(0)
        })
        .collect();
    let mut text = String::new();
    for row in rows {
        let cells: Vec<String> = row
            .iter()
            .zip(&widths)
            .map(|(cell, width)| format!("{cell:<width$}"))
            .collect();
        text.push_str(cells.join("  ").trim_end());
        text.push('\n');
    }
    text
}

/// A number without the noise of its last digits.
fn short(number: f64) -> f64 {
    (1e6 * number).round() / 1e6
}

/// For machines.
pub fn json(model: &TorqueModel, settings: &Settings) -> String {
    let (window, step, delay) = differentiation(model, settings);
    let robot = model.robot();
    let domain = model.domain();
    let error = model.encoder_error();
    let limits = dynid_core::limits::believed(model);
    let joints: Vec<_> = robot
        .joints()
        .iter()
        .enumerate()
        .map(|(j, joint)| {
            json!({
                "name": joint.name,
                "kind": kind_name(joint.kind),
                "domain": {"q": domain.q[j], "dq": domain.dq[j], "ddq": domain.ddq[j]},
                "limits": {"q": limits[j][0], "dq": limits[j][1], "ddq": limits[j][2]},
                "encoder_delay": model.encoder_delay()[j],
                "encoder_error": error.map_or([0.0; 2], |error| error.cos_sin[j]),
                "noise_std": model.noise_std()[j],
                "torque_scale": model.torque_scale()[j],
            })
        })
        .collect();
    let residual = model.residual().map(
        |residual| json!({"inputs": residual.inputs().name(), "signals": signals(residual), "method": residual_methods(residual), "joints": residual_joints(model)}),
    );
    let info = json!({
        "robot": robot.name(),
        "gravity": robot.gravity().as_slice(),
        "torque_unit": model.torque_unit(),
        "step": model.step(),
        "torque_delay": model.torque_delay(),
        "terms": model.term_names(),
        "residual": residual,
        "differentiation": {"window": window, "step": step, "delay": delay, "first_answer": first_answer(window)},
        "joints": joints,
    });
    format!("{info:#}\n")
}
