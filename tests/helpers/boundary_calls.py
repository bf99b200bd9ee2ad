"""Every function, class and method of the compiled module with arguments that it accepts."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy import signal

from dynid_rs import Recording, Watch, _core
from helpers.small_arm import URDF

N, M = 3, 60
"""Joints and samples."""
ROBOT_TOML = 'angle = "rad"\n[[joint]]\nalpha = 0.0\na = 0.1\nd = 0.2\ntheta = 0.0\n'


class Call(NamedTuple):
    """A function and arguments that it accepts, positional ones by their place."""

    function: Callable[..., Any]
    arguments: dict[str | int, Any]

    def __call__(self, arguments: dict[str | int, Any] | None = None) -> Any:
        given = self.arguments if arguments is None else arguments
        places = sorted(name for name in given if isinstance(name, int))
        return self.function(*(given[k] for k in places), **{k: v for k, v in given.items() if isinstance(k, str)})


def _positional(*arguments: Any) -> dict[str | int, Any]:
    return dict(enumerate(arguments))


def _closed(plot: Callable[..., Any]) -> Callable[..., None]:
    """A plot that is not kept."""

    def drawn(*arguments: Any, **named: Any) -> None:
        from matplotlib import pyplot

        try:
            plot(*arguments, **named)
        finally:
            pyplot.close("all")

    return drawn


def _contact_file(model: _core.TorqueModel) -> str:
    """An observer's uncertainty, without directions."""
    ones, no = [1.0] * N, [False] * N
    said = {"format": "dynid-contact", "version": 2, "joints": list(model.robot.joint_names), "step": 0.01}
    said |= {
        "torque_unit": model.torque_unit,
        "window": None,
        "time_constant": 0.02,
        "false_contacts_per_hour": 1.0,
        "directions": [],
    }
    said |= dict.fromkeys(("moving", "standing", "turning", "torque"), ones)
    said |= dict.fromkeys(("stops_known", "turns_known"), no)
    return json.dumps(said | {"tail": dict.fromkeys(("level", "per_hour", "growth"), ones)})


def calls(folder: Path) -> dict[str, Call]:
    """Calls by their name in the stub; files are read from `folder`, and written there."""
    rng = np.random.default_rng(0)
    q, dq, ddq, tau = (rng.normal(size=(M, N)) for _ in range(4))
    t = 1e-2 * np.arange(M)
    motion = {"q": q, "dq": dq, "ddq": ddq}
    motor = {f"{name}_motor": x + 1e-3 for name, x in motion.items()}
    sos = signal.butter(2, 0.4, output="sos")
    low_pass = (sos, signal.sosfilt_zi(sos), 5)
    kept = list(range(0, M, 2))
    seconds = 1e-2 * np.arange(4 * M)
    swing = np.stack([np.sin((2 + j) * seconds) for j in range(N)], axis=1)
    run = Recording(seconds, swing, tau=5 * swing, q_motor=swing, temperature=30 + 0 * swing, name="run.csv")
    robot = _core.RobotModel.from_urdf_string(URDF)
    base = robot.base_parameters()
    phi = rng.normal(size=10 * N)
    friction = _core.Effect.friction([0.01] * N, [0.02] * N)
    effects = [_core.Effect.rotor_inertia(), friction]
    rows, one = rng.normal(size=(M, 3)), np.ones(1)
    linear = ([rows.T @ rows], [np.arange(2)], 3, np.eye(2), np.zeros(2), one, 10 * one, 1e-6 * one, float(M), False)
    mixture_parts = ([0.5, 0.5], rng.normal(size=(2, 3)), np.tile(np.eye(3), (2, 1, 1)))
    mixture = _core.GaussianMixtureRegression(*mixture_parts)
    rbf_parts = (rng.normal(size=(2, 2)), np.ones(2), [0.1, 0.2], [0.01, 0.02])
    rbf = _core.NormalisedRbf(*rbf_parts)
    model_parts = {
        "residual": ("deflection", [mixture, rbf, None]),
        "torque_scale": [1.0] * N,
        "encoder_delay": [0.001] * N,
        "encoder_error": np.full((N, 2), 1e-3),
        "encoder_error_sides": "link",
        "noise_std": [0.1] * N,
        "domain": ([[-3.0, 3.0]] * N, [3.0] * N, [9.0] * N),
        "torque_unit": "N*m",
        "step": 0.01,
    }
    model_effects = [(effects[0], np.full((N, 1), 0.1)), (friction, np.full((N, 8), 0.2))]
    model = _core.TorqueModel(robot, phi, model_effects, **model_parts)
    signals = [[("q", 0)], [("dq", 1), ("tau_link", 1)], []]
    named = {
        "residual": ("signals", [_core.NormalisedRbf([[0.0]], [1.0], [0.1], [0.01]), rbf, None]),
        "residual_signals": signals,
    }
    body = np.tile([2.0, 0.1, 0.0, 0.0, 0.1, 0.0, 0.1, 0.0, 0.0, 0.1], (N, 1))
    body_parts = {"damping": np.zeros(N), "friction": np.zeros(N), "drive_gain": np.ones(N)}
    physical = _core.PhysicalSet(body.ravel(), np.zeros(N), **body_parts)
    excitation = _core.Excitation(robot, base.pivots.tolist())
    samples = rng.normal(size=(60, 3))
    factors = [np.triu(rng.normal(size=(5, 5))) for _ in range(2)]
    observed = (robot, effects, base.pivots.tolist(), *motion.values(), *motor.values(), tau)
    fitted = _core.fold(*observed)
    search = ([(dq[:, 0], low_pass, kept, None)], rng.normal(size=(len(kept), 2)), rng.normal(size=len(kept)))
    found = _core.FrictionSearch(*search, weak=1e-3)
    (folder / "robot.urdf").write_text(URDF)
    (folder / "robot.toml").write_text(ROBOT_TOML)
    model.save(folder / "model.json")
    Watch(model).save(folder / "watch.json")
    (folder / "contact.json").write_text(_contact_file(model))
    urdf_options = {"base": "base", "tip": "hand", "gravity": [0.0, 0.0, -9.81], "rotor_inertia": [0.1] * N}
    mdh_options = {"gravity": [0.0, 0.0, -9.81], "rotor_inertia": [0.1]}
    of_effect = {"tau_link": tau, "tau_motor": tau, "step": 0.01, "temperature": np.full((M, N), 20.0)}
    listed: dict[str, tuple[Callable[..., Any], dict[str | int, Any]]] = {
        "RobotModel.from_urdf": (_core.RobotModel.from_urdf, {0: folder / "robot.urdf", **urdf_options}),
        "RobotModel.from_urdf_string": (_core.RobotModel.from_urdf_string, {0: URDF, **urdf_options}),
        "RobotModel.from_mdh": (_core.RobotModel.from_mdh, {0: folder / "robot.toml", **mdh_options}),
        "RobotModel.from_mdh_string": (_core.RobotModel.from_mdh_string, {0: ROBOT_TOML, **mdh_options}),
        "RobotModel.from_file": (_core.RobotModel.from_file, {0: folder / "robot.urdf", **urdf_options}),
        "RobotModel.with_gravity": (robot.with_gravity, _positional([0.0, 0.0, 9.81])),
        "RobotModel.with_joint_moved": (robot.with_joint_moved, _positional(1, [0.0, 0.1, 0.0], [0.0, 0.0, 0.1])),
        "RobotModel.link_frame": (robot.link_frame, _positional("fore")),
        "RobotModel.inverse_dynamics": (robot.inverse_dynamics, {**motion, "phi": phi, "out": np.empty((M, N))}),
        "RobotModel.rnea": (robot.rnea, {**motion, "phi": phi, "out": np.empty((M, N))}),
        "RobotModel.joint_torque_regressor": (
            robot.joint_torque_regressor,
            {**motion, "out": np.empty((M, N, 10 * N))},
        ),
        "RobotModel.base_parameters": (robot.base_parameters, {"random_state": 1, "rtol": 1e-9}),
        "BaseParameters.reduce": (base.reduce, _positional(rng.normal(size=(M, 10 * N)))),
        "BaseParameters.project": (base.project, _positional(phi)),
        "BaseParameters.lift": (base.lift, _positional(rng.normal(size=base.n_base))),
        "Effect.rotor_inertia": (_core.Effect.rotor_inertia, {}),
        "Effect.torque_offset": (_core.Effect.torque_offset, {}),
        "Effect.friction": (_core.Effect.friction, _positional([0.01] * N, [0.02] * N)),
        "Effect.reaction": (friction.reaction, _positional(1)),
        "Effect.of": (_core.Effect.of, {0: "friction", "velocity_threshold": [0.01], "transition_width": [0.1]}),
        "FrictionSearch.__new__": (
            _core.FrictionSearch,
            {**_positional(*search), "weak": 1e-3, "n_orders": 2, "fixed": None},
        ),
        "FrictionSearch.power": (found.power, {**_positional([0.01, 0.02], [0.1, 0.1]), "all_links": True}),
        "GaussianMixtureRegression.__new__": (_core.GaussianMixtureRegression, _positional(*mixture_parts)),
        "GaussianMixtureRegression.predict": (mixture.predict, _positional(rng.normal(size=(M, 2)))),
        "GaussianMixtureRegression.responsibilities": (mixture.responsibilities, _positional(rng.normal(size=(M, 2)))),
        "NormalisedRbf.__new__": (_core.NormalisedRbf, _positional(*rbf_parts)),
        "NormalisedRbf.predict": (rbf.predict, _positional(rng.normal(size=(M, 2)))),
        "NormalisedRbf.basis": (rbf.basis, _positional(rng.normal(size=(M, 2)))),
        "NormalisedRbf.shares": (rbf.shares, _positional(rng.normal(size=(M, 2)))),
        "PhysicalSet.__new__": (_core.PhysicalSet, {0: body.ravel(), 1: np.zeros(N), **body_parts}),
        "TorqueModel.__new__": (_core.TorqueModel, {0: robot, 1: phi, 2: model_effects, **model_parts}),
        "TorqueModel.__new__ (signals)": (
            _core.TorqueModel,
            {0: robot, 1: phi, 2: model_effects, **model_parts, **named},
        ),
        "TorqueModel.load": (_core.TorqueModel.load, _positional(folder / "model.json")),
        "TorqueModel.save": (model.save, _positional(folder / "saved.json")),
        "TorqueModel.evaluate": (model.evaluate, {**motion, **motor, "step": 0.01, "temperature": None}),
        "TorqueModel.torque": (model.torque, {**motion, **motor, "out": np.empty((M, N))}),
        "TorqueModel.predicted_std": (model.predicted_std, {**motion, **motor}),
        "TorqueModel.summary": (model.summary, {}),
        "TorqueModel._repr_html_": (model._repr_html_, {}),
        "TorqueModel.predict": (model.predict, _positional(run)),
        "TorqueModel.score": (model.score, {0: run, "per_joint": True, "as_recorded": True}),
        "TorqueModel.plot_friction": (_closed(model.plot_friction), {"runs": run, "joints": [0, 2]}),
        "TorqueModel.plot_residual": (_closed(model.plot_residual), {0: run, "joints": [0, 2]}),
        "TorqueModel.with_physical": (model.with_physical, _positional(physical)),
        "TorqueModel.with_torque_delay": (model.with_torque_delay, _positional(0.02)),
        "friction_basis": (_core.friction_basis, _positional(dq[:, 0], 0.01, 0.1)),
        "effect_catalogue": (_core.effect_catalogue, {}),
        "effect_columns": (
            _core.effect_columns,
            {0: friction, **motion, **motor, **of_effect, "joints": [0, 2], "filter": low_pass, "kept": kept},
        ),
        "effect_torque": (_core.effect_torque, {0: friction, 1: np.full((N, 8), 0.2), **motion, **motor, **of_effect}),
        "motor_torque": (
            _core.motor_torque,
            {
                0: [(friction, np.full((N, 8), 0.2))],
                1: [1.0] * N,
                **motion,
                **motor,
                **{name: value for name, value in of_effect.items() if name != "tau_motor"},
            },
        ),
        "residual_inputs": (_core.residual_inputs, _positional("load_free_deflection", q, dq, q, dq, 1e-3 * tau)),
        "named_signals": (_core.named_signals, {0: [("q", 0), ("tau_link", 2)], **motion, **motor, "tau_link": tau}),
        "align_link_side": (_core.align_link_side, _positional(q, dq, ddq, [0.001] * N)),
        "true_motion": (_core.true_motion, _positional(q, dq, ddq, np.full((N, 2), 1e-3))),
        "observe_momentum": (
            _core.observe_momentum,
            {
                **_positional(model, t, (q, dq, ddq, None, None, None), tau),
                **{"temperature": None, "step": 0.01, "window": None, "time_constant": 0.02},
                **{"correlation_time": 0.01, "false_per_hour": 1.0, "uncertainty": _contact_file(model)},
            },
        ),
        "read_contact": (_core.read_contact, _positional(folder / "contact.json", model)),
        "read_watch": (_core.read_watch, _positional(folder / "watch.json")),
        "watch_run": (
            _core.watch_run,
            {
                **_positional(model, t, (q, dq, ddq, None, None, None), tau),
                **{"temperature": None, "step": 0.01, "window": None, "inflation": [1.0] * N, "memory": [2.0] * N},
                **{"least_speed": [0.0] * N, "frozen_after": [0.1] * N, "frozen_way": [0.0] * N},
                **{"delay": 0.004, "slip": 0.005},
                **{"row": 0.05, "false_per_day": 1.0, "friction": 0.1, "gain": 0.05, "offset": 2.0, "load": 0.1},
                **{"unknown": 1.0, "remembered": None},
            },
        ),
        "adapt_run": (
            _core.adapt_run,
            {
                **_positional(model, t, (q, dq, ddq, None, None, None), tau),
                **{"temperature": None, "step": 0.01, "window": None, "inflation": [1.0] * N, "observe": False},
                **{"noise_memory": [2.0] * N, "friction": True, "payload": True, "row": 0.05, "memory": 60.0},
                **{"factor": (0.5, 2.0), "mass": 5.0, "reach": 0.2, "said": 0.05, "remembered": None},
            },
        ),
        "with_adapted": (_core.with_adapted, _positional(model, [1.1] * N, (1.0, 0.1, 0.0, 0.0))),
        "observe": (_core.observe, {**_positional(*observed), "filter": low_pass, "kept": kept, **of_effect}),
        "sign_slopes": (
            _core.sign_slopes,
            {**_positional(dq[:, 0], 0.01, 1.5), "filter": low_pass, "kept": kept},
        ),
        "fold": (_core.fold, {**_positional(*observed), "filter": low_pass, "kept": kept, **of_effect}),
        "weighted_fit": (
            _core.weighted_fit,
            {**_positional(fitted, base.pivots.tolist(), 100), "n_reweightings": 2},
        ),
        "processor_path": (_core.processor_path, {}),
        "low_pass": (_core.low_pass, _positional(q, low_pass)),
        "extent": (_core.extent, _positional(q)),
        "slope": (_core.slope, _positional(q, 100.0)),
        "triangular_factor": (_core.triangular_factor, _positional(rng.normal(size=(9, 4)))),
        "likeliest": (_core.likeliest, _positional([linear])),
        "merge_factors": (_core.merge_factors, _positional(factors)),
        "Excitation.__new__": (
            _core.Excitation,
            {0: robot, 1: base.pivots.tolist(), "whitening": None, "random_state": 1, "rtol": 1e-9},
        ),
        "Excitation.blocks": (excitation.blocks, motion),
        "Excitation.conditions": (excitation.conditions, motion),
        "Excitation.value": (excitation.value, {**motion, "criterion": "condition", "weights": None}),
        "Excitation.value_and_gradient": (
            excitation.value_and_gradient,
            {**motion, "criterion": "condition", "weights": None},
        ),
        "inverse_dynamics_gradient": (_core.inverse_dynamics_gradient, _positional(robot, q, dq, ddq, tau, phi)),
        "point_places": (_core.point_places, _positional(robot, q, [0, 2], np.ones((2, 3)))),
        "point_gradient": (_core.point_gradient, _positional(robot, q, [0, 2], np.ones((2, 3)), np.ones((M, 2, 3)))),
        "pseudo_inertia": (_core.pseudo_inertia, _positional(body.ravel())),
        "phi_from_pseudo_inertia": (_core.phi_from_pseudo_inertia, _positional(np.tile(np.eye(4), (2, 1, 1)))),
        "urdf_with_physical": (
            _core.urdf_with_physical,
            {0: model.with_physical(physical), 1: URDF.encode(), "source_name": "f"},
        ),
        "mjcf_with_physical": (_core.mjcf_with_physical, _positional(model.with_physical(physical))),
        "c_header": (_core.c_header, _positional(model, "arm")),
        "c_prefix": (_core.c_prefix, _positional("my arm")),
        "fit_mixture": (
            _core.fit_mixture,
            {0: samples, **dict(enumerate(mixture_parts, 1)), "reg_covar": 1e-6, "tol": 1e-3, "max_iter": 20},
        ),
    }
    return {name: Call(*call) for name, call in listed.items()}
