"""From a fitted identifier and its test runs to `result.json` and `residuals.parquet`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.base.findings import Finding
from dynid_rs.base.wording import residual_reason, verdict
from dynid_rs.identification.doubt import Doubt
from dynid_rs.identification.separability import examine, not_separable
from dynid_rs.identification.smooth_friction import SmoothFrictionIdentifier
from dynid_rs.identification.three_loops import ThreeLoopIdentifier
from dynid_rs.model.assembly import evaluate
from dynid_rs.model.physical import PhysicalIdentifier
from dynid_rs.model.physical_result import physical_section
from dynid_rs.model.units import own_unit, torque_units
from dynid_rs.regression.columns import Plan
from dynid_rs.regression.error_interval import rmse_interval
from dynid_rs.regression.evaluation import (
    FLOOR_METHOD,
    Comparison,
    band_rmse,
    compare,
    noise_floor,
    raw_rmse,
    rmse,
    torque_std,
)
from dynid_rs.regression.instruments import InstrumentalVariables, endogeneity
from dynid_rs.regression.systems import stack
from dynid_rs.regression.uncertainty import NORMAL_95
from dynid_rs.runs.preprocessing import States
from dynid_rs.runs.recording import Recording

FloatArray = NDArray[np.float64]

FORMAT, VERSION = "dynid-result", 1


@dataclass(frozen=True, eq=False)
class Scores:
    """Errors of one model on several runs; (n_joints,) each, in the torque unit."""

    comparisons: list[Comparison]

    @property
    def rmse(self) -> FloatArray:
        """In the band, in motion."""
        return band_rmse(self.comparisons)

    @property
    def raw(self) -> FloatArray:
        """As recorded, in motion."""
        return raw_rmse(self.comparisons)


def score(model: _core.TorqueModel, runs: Sequence[States]) -> Scores:
    """Predict every run with the code that runs online, and compare."""
    return Scores([compare(states, evaluate(model, states)[0]) for states in runs])


@dataclass(frozen=True, eq=False)
class Evaluated:
    """One run and the fitted model's torque along it: `total` (n, n_joints), `terms` (n, n_terms, n_joints)."""

    recording: Recording
    states: States
    total: FloatArray
    terms: FloatArray
    comparison: Comparison


def evaluate_runs(model: _core.TorqueModel, recordings: Sequence[Recording], runs: Sequence[States]) -> list[Evaluated]:
    """Predict every run once, with the code that runs online; `runs` are the states of `recordings`, as recorded."""
    evaluated = []
    for recording, states in zip(recordings, runs, strict=True):
        total, terms, _ = evaluate(model, states)
        evaluated.append(Evaluated(recording, states, total, terms, compare(states, total)))
    return evaluated


@dataclass(frozen=True, eq=False)
class LearnedFrom:
    """Training runs in all: names, samples, samples at rest, and the model's error on them, (n_joints,)."""

    names: list[str]
    n_samples: int
    n_dropped: int
    rmse: FloatArray

    @staticmethod
    def of(train: Sequence[Evaluated]) -> LearnedFrom:
        """What runs in memory are."""
        error = Scores([run.comparison for run in train]).rmse
        names = [run.recording.name for run in train]
        return LearnedFrom(names, _count(train), _standing_still([run.states for run in train]), error)


def summarise(
    identifier: ThreeLoopIdentifier,
    train: Sequence[Evaluated],
    test: Sequence[Evaluated],
    findings: Sequence[Finding],
    physical: PhysicalIdentifier | None = None,
    learned_from: LearnedFrom | None = None,
) -> dict[str, Any]:
    """Content of `result.json`: errors on the test runs, parameters with intervals, what was found in the data.

    `learned_from`: the training runs, where `train` is only what memory holds of them.
    """
    from threadpoolctl import threadpool_limits

    # One BLAS thread: the last digits must not depend on the machine's cores.
    with threadpool_limits(limits=1, user_api="blas"):
        return _summarise(identifier, train, test, findings, physical, learned_from or LearnedFrom.of(train))


def _summarise(
    identifier: ThreeLoopIdentifier,
    train: Sequence[Evaluated],
    test: Sequence[Evaluated],
    findings: Sequence[Finding],
    physical: PhysicalIdentifier | None,
    learned_from: LearnedFrom,
) -> dict[str, Any]:
    robot = identifier.robot
    train_states, test_states = [run.states for run in train], [run.states for run in test]
    doubt = Doubt.of(identifier)
    covariance = doubt.covariance if identifier.loops_.gains is None else identifier.parameter_covariance()
    tested = Scores([run.comparison for run in test])
    baseline = score(identifier.baseline_, test_states)
    whole = [run.states.band.apply(run.states.tau - run.total, run.states.rate)[run.states.grid] for run in test]
    with_standstill = rmse(whole)
    notes = [
        Finding("signal_replaced", "info", note, file=states.name)
        for states in (*train_states, *test_states)
        for note in states.notes
    ]
    known = examine(identifier, test_states)
    told = not_separable(known, prior_used=identifier.links_.posterior_ is not None)
    result: dict[str, Any] = {
        "format": FORMAT,
        "version": VERSION,
        "robot": robot.name,
        "joints": list(robot.joint_names),
        "torque_unit": identifier.torque_unit_,
        "torque_units": torque_units(identifier.model_),
        "data": {
            "train": learned_from.names,
            "test": [run.recording.name for run in test],
            "n_samples": {"train": learned_from.n_samples, "test": _count(test)},
            "n_dropped": {"train": learned_from.n_dropped, "test": _standing_still(test_states)},
            "rate_hz": train_states[0].rate,
            "cutoff_hz": identifier.band_.cutoff,
            "findings": [finding.to_json() for finding in (*findings, *told, *_standstill(test_states, whole), *notes)],
        },
        "rmse": {
            "train": {"before": learned_from.rmse, "after": learned_from.rmse},
            "test": {
                "torque_std": torque_std(tested.comparisons),
                "wls": baseline.rmse,
                "before": tested.rmse,
                "after": tested.rmse,
                "after_interval": rmse_interval(tested.comparisons),
                "floor": [None if np.isnan(floor) else floor for floor in noise_floor(test_states)],
                "raw": tested.raw,
                "with_standstill": with_standstill,
            },
            "by_run": [
                {
                    "run": run.recording.name,
                    "after": Scores([run.comparison]).rmse,
                    "raw": Scores([run.comparison]).raw,
                }
                for run in test
            ],
        },
        "floor_method": FLOOR_METHOD,
        "prior": _prior(identifier),
        "known": known,
        "effects": [],
        "unexplained": [],
        "residual": _residual(identifier, test_states, tested),
        "encoder_delay": _encoder_delay(identifier),
        "parameters": _parameters(identifier, covariance),
        "base_parameters": _base(identifier),
        # Of a model that is not the one that was fitted nothing is known.
        "covariance": doubt.to_json() if doubt.is_of(identifier.model_, identifier.links_.phi_base_) else None,
        "history": [
            {"iteration": k + 1, "rmse_train": after["residual"], "rmse_train_after": after}
            for k, after in enumerate(identifier.history_)
        ],
        "loops": loops_section(identifier, test_states, tested),
        "n_iter": identifier.n_iter_,
        "converged": identifier.converged_,
    }
    in_memory = identifier.in_memory_
    instruments = InstrumentalVariables().fit(in_memory.observations, in_memory.links, identifier.runs_)
    result["endogeneity"] = endogeneity(instruments, _unknowns(identifier.observations_.plan))
    if physical is not None:
        error = score(physical.torque_model(identifier.model_), test_states).rmse
        result["physical"] = physical_section(physical, identifier.model_, tested.rmse, error)
    result["residual"]["reason"] = residual_reason(result)
    result["verdict"] = verdict(result)
    content: dict[str, Any] = plain(result)
    return content


def residual_table(
    model: _core.TorqueModel, train: Sequence[Evaluated], test: Sequence[Evaluated]
) -> dict[str, NDArray[Any]]:
    """Content of `residuals.parquet`: per row and joint measured, predicted, every term, residual; in the band.

    `moves_j`: whether the joint moves there; errors are those of such rows.
    """
    parts: list[dict[str, NDArray[Any]]] = []
    for kind, runs in (("train", train), ("test", test)):
        for run in runs:
            states, comparison = run.states, run.comparison
            filtered = states.in_band(run.terms)
            n_rows = len(states.rows)
            part: dict[str, NDArray[Any]] = {
                "run": np.full(n_rows, run.recording.name, dtype=object),
                "set": np.full(n_rows, kind, dtype=object),
                "t": states.t[states.rows],
            }
            for j in range(model.robot.n_joints):
                part[f"q_{j}"], part[f"dq_{j}"] = states.q[states.rows, j], states.dq_motor[states.rows, j]
                part[f"moves_{j}"] = states.counted[:, j]
                part[f"measured_{j}"], part[f"predicted_{j}"] = comparison.measured[:, j], comparison.predicted[:, j]
                part[f"residual_{j}"] = comparison.error[:, j]
                for k, name in enumerate(model.term_names):
                    part[f"{'residual_term' if name == 'residual' else name}_{j}"] = filtered[:, k, j]
                part.setdefault(f"residual_term_{j}", np.zeros(n_rows))
            parts.append(part)
    return {column: np.concatenate([part[column] for part in parts]) for column in parts[0]}


def loops_section(identifier: ThreeLoopIdentifier, test: list[States], tested: Scores) -> dict[str, Any]:
    """What each loop gave: test errors of the baseline, with the first loop's friction, with fitted links, of all."""
    without = identifier.model_with([None] * identifier.robot.n_joints)
    stages = (("wls", identifier.baseline_), ("friction", identifier.friction_model_), ("links", without))
    return {"test": {stage: score(model, test).rmse for stage, model in stages} | {"residual": tested.rmse}}


def _residual(identifier: ThreeLoopIdentifier, test: list[States], tested: Scores) -> dict[str, Any]:
    third = identifier.residual_
    n = identifier.robot.n_joints
    if third is None:
        return {"kind": "gmr", "inputs": None, "kept": False, "kept_on": [], "switched_off": True}
    without = score(identifier.model_with([None] * n), test) if third.kept.any() else tested
    candidates = [kept or candidate for kept, candidate in zip(third.mixtures_, third.candidates_, strict=True)]
    with_all = score(identifier.model_with(candidates), test)
    return {
        "kind": {"mixture": "gmr", "rbf": "rbf"}[third.method],
        "inputs": third.inputs_,
        "kept": bool(third.kept.any()),
        "kept_on": [joint for joint, kept in zip(identifier.robot.joint_names, third.kept, strict=True) if kept],
        "rmse_test_without": without.rmse,
        "rmse_test_with": with_all.rmse,
        "left_out_ratio": third.ratio_,
        "n_components": [regression.n_components if regression else 0 for regression in candidates],
    }


def _encoder_delay(identifier: ThreeLoopIdentifier) -> dict[str, Any] | None:
    delay = identifier.encoder_delay_
    if delay is None:
        return None
    spread = NORMAL_95 * delay.std_error
    return {
        "value": delay.value,
        "interval": np.stack([delay.value - spread, delay.value + spread], axis=1),
        "measured": delay.measured,
        "unit": "s",
    }


def _base(identifier: ThreeLoopIdentifier) -> dict[str, Any]:
    base = identifier.robot.base_parameters()
    links, observations = identifier.links_, identifier.observations_
    system = stack(observations.plan, observations.factors(), links.weights_, links.torque_scale_)
    columns = system[:, : base.n_base]
    norms = np.linalg.norm(columns, axis=0)
    values = np.linalg.svd(columns[:, norms > 0] / norms[norms > 0], compute_uv=False)
    return {
        "n_base": base.n_base,
        "n_standard": base.n_standard,
        "gap": base.gap if np.isfinite(base.gap) else None,
        "condition_number": float(values[0] / values[-1]) if values[-1] > 0 else None,
        "ridge": identifier.links_.ridge_,
        "torque_scale": identifier.links_.torque_scale_,
    }


def _prior(identifier: ThreeLoopIdentifier) -> dict[str, Any] | None:
    """How far off the robot file is, and how far the data moved every parameter from it, in the prior's own measure."""
    posterior, plan = identifier.links_.posterior_, identifier.observations_.plan
    if posterior is None or posterior.choice.centre == 0:
        return None  # the file's inertials are not believed, or there are none
    names, mean = base_names(plan), posterior.choice.centre * posterior.prior.unit * posterior.prior.mean
    std = posterior.prior.std(posterior.choice)
    moved = [
        {
            "name": names[k],
            "link": identifier.robot.link_names[plan.pivots[k] // 10],
            "declared": mean[k],
            "value": posterior.x[k],
            "std": std[k],
            "shift": (posterior.x[k] - mean[k]) / std[k],
        }
        for k in range(plan.n_base)
        if std[k] > 0
    ]
    return {
        "kind": "robot",
        "relative_uncertainty": {"links": posterior.relative_uncertainty, "rotors": None},
        "gain": None if identifier.torque_unit_ == "N*m" else posterior.prior.unit,
        "n_directions": posterior.n_directions,
        "n_determined": posterior.n_determined,
        "n_effective": posterior.n_effective,
        "n_rows": identifier.observations_.n_rows,
        "moved": moved,
    }


def _parameters(identifier: ThreeLoopIdentifier, covariance: FloatArray) -> dict[str, Any]:
    plan = identifier.observations_.plan
    robot, links = identifier.robot, identifier.links_
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    units = {"m": "kg", "h": "kg*m", "I": "kg*m^2"}
    current = "" if identifier.torque_unit_ == "N*m" else "*A/(N*m)"
    base = []
    for k, (pivot, name) in enumerate(zip(plan.pivots, base_names(plan), strict=True)):
        unit = units[_core.LINK_PARAMETER_NAMES[pivot % 10][0]] + current
        entry = _parameter(name, links.x_[k], std[k], unit)
        base.append({**entry, "link": robot.link_names[pivot // 10]})
    names = [(effect, name) for effect in plan.effects for name in effect.coefficient_names]
    joint = [
        {
            **_parameter(name, links.own_[j, k], std[plan.n_base + j * plan.n_own + k], unit),
            "joint": robot.joint_names[j],
            "effect": effect.kind,
            "declared": effect.is_declared,
        }
        for j in range(robot.n_joints)
        for k, (effect, name) in enumerate(names)
        for unit in [own_unit(name, identifier.torque_unit_, robot.joint_kinds[j])]
        if plan.own[j, k]
    ]
    friction = identifier.friction_
    shapes = [
        {
            "joint": robot.joint_names[j],
            "velocity_threshold": identifier.friction_.velocity_threshold_[j],
            "transition_width": identifier.friction_.transition_width_[j],
            **({"sharpness": friction.sharpness_[j]} if isinstance(friction, SmoothFrictionIdentifier) else {}),
            "unit": "rad/s" if robot.joint_kinds[j] == "revolute" else "m/s",
        }
        for j in range(robot.n_joints)
    ]
    return {"base": base, "joint": joint, "friction_shape": shapes}


def base_names(plan: Plan) -> list[str]:
    """Names of the base parameters with everything they stand for, rotors included. For display only."""
    names: list[str] = list(plan.robot.base_parameters().names)
    labels = [name for effect in plan.effects for name in effect.coefficient_names]
    for (j, column), share in plan.absorbed.items():
        for k in np.flatnonzero(np.abs(share) > 1e-9):
            size = "" if abs(abs(share[k]) - 1) < 1e-9 else f"{abs(share[k]):.4g} "
            names[k] += f" {'-' if share[k] < 0 else '+'} {size}{labels[column]}[{plan.robot.joint_names[j]}]"
    return names


def _unknowns(plan: Plan) -> list[str]:
    """Names of all unknowns of the fit, (n_columns,)."""
    own = [name for effect in plan.effects for name in effect.coefficient_names]
    return base_names(plan) + [f"{name} of {joint}" for joint in plan.robot.joint_names for name in own]


def _parameter(name: str, value: float, std: float, unit: str) -> dict[str, Any]:
    interval = [value - NORMAL_95 * std, value + NORMAL_95 * std]
    return {"name": name, "value": value, "unit": unit, "std_error": std, "interval": interval}


def _count(runs: Sequence[Evaluated]) -> int:
    return sum(run.recording.n_samples for run in runs)


def _standing_still(runs: Sequence[States]) -> int:
    return int(sum(np.sum(~states.moving) for states in runs))


def _standstill(runs: Sequence[States], errors: Sequence[FloatArray]) -> list[Finding]:
    """One word per test run on what was not scored, and on the error with it."""
    found = []
    for states, error in zip(runs, errors, strict=True):
        seconds = float(np.sum(~states.moving) / states.rate)
        share = 100 * rmse([error]) / np.maximum(states.band.apply(states.tau, states.rate).std(axis=0), 1e-300)
        message = (
            f"{states.name}: {seconds:.1f} s of standstill, and 1/cutoff beside it and at the ends, are not scored, "
            f"for friction at rest is not a function of the state; with them the error is {share.min():.1f} to "
            f"{share.max():.1f} % of the torque's standard deviation"
        )
        found.append(Finding("standstill", "info", message, file=states.name, value=seconds, unit="s"))
    return found


def plain(value: Any) -> Any:
    """Arrays to lists, numpy scalars to Python's, for JSON."""
    if isinstance(value, dict):
        return {key: plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [plain(entry) for entry in value]
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    return value
