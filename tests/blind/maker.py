"""Makes a case: run files and the robot's file into one folder, the truth into another."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from arms import ROBOT_FILES, bare, typical
from cases import DURATION, N_TEST, N_TRAIN, RATE, RATIOS, Case, Put
from numpy.typing import NDArray
from strangers import STRANGERS, Stranger, build_stranger
from varied import varied

from dynid_rs.files import write_json, write_table
from dynid_rs.recording import Recording
from dynid_rs.simulation import (
    LabEffect,
    Simulation,
    Trajectory,
    Wish,
    build_effect,
    equip,
    simulate,
    unabsorbed,
)
from dynid_rs.simulation.effects.catalogue import BY_NAME
from dynid_rs.simulation.effects.columns import ColumnEffect
from dynid_rs.simulation.effects.gears import NonlinearElasticity
from dynid_rs.simulation.effects.outside import Contact
from dynid_rs.simulation.folder import run_columns
from dynid_rs.simulation.limits import plausible_effort

FloatArray = NDArray[np.float64]

LARGEST = {
    "torque_gain": 10.0,  # 50 %
    "torque_delay": 10.0,  # 50 ms
    "gravity_tilt": 15.0,  # 30 degrees
    "kinematic_error": 25.0,  # 75 mm, 9 degrees
    "encoder_eccentricity": 200.0,  # 0.2 rad
    "inertial_coupling": 3.3,
    "thermal_drift": 3.3,
    "thermal_friction": 3.3,
    "counterbalance": 4.0,
    "torque_saturation": 20.0,  # doubles the torque at the effort limit
}
"""Sizes beyond which an effect would be no machine any more; another joint is tried then."""
OWN_PLACE = ("torque_gain", "torque_delay", "encoder_eccentricity", "kinematic_error")
FELT = 0.5
"""Of an effect on several joints those must be named that feel at least this part of what the first one feels."""
BENDS = 0.01
"""Of a gear's wind-up its curved part has to be this much somewhere, or the gear is as good as straight."""
STEPS, TOLERANCE = 12, 0.01


class Impossible(ValueError):
    """An effect cannot be had at the wanted ratio on any joint of this arm."""


@dataclass(frozen=True, eq=False)
class Placed:
    """An effect of a case, and how much of it the declared model cannot absorb over the noise, (n_joints,)."""

    put: Put
    effect: LabEffect
    felt: FloatArray | None
    seen: tuple[int, ...] | None = None
    """Joints of an effect between two encoders at which its own part can be seen; None: at all."""

    @property
    def reached(self) -> float:
        """Ratio that it really has; NaN where it was not scaled."""
        return float("nan") if self.felt is None else float(self.felt.max())

    @property
    def required(self) -> tuple[int, ...]:
        """Joints that have to be named: all, less those of a pair or of the whole robot that hardly feel it."""
        joints = self.effect.joints
        if self.seen is not None:
            return self.seen
        if self.felt is None or len(joints) == 1 or self.effect.kind in OWN_PLACE:
            return joints
        most = max(self.felt[list(joints)])
        return tuple(j for j in joints if self.felt[j] >= FELT * most)


@dataclass(frozen=True, eq=False)
class Built:
    """A case with everything that is true of it."""

    case: Case
    placed: tuple[Placed, ...]
    simulation: Simulation
    reference: Simulation | None = None

    def shown(self, run: int) -> Recording:
        """What the examined program is given of a run."""
        return _with_encoders(self.simulation.recordings[run], self.case.encoders)


def build(case: Case) -> Built:
    """Simulate a case.

    Raises
    ------
    Impossible
        No joint of this arm can have it.
    """
    arm, rng = bare(case.arm), case.rng()
    # The ratio is a fact about these trajectories, so they are drawn first and then played.
    plans = simulate(arm, n_runs=N_TRAIN + N_TEST, duration=DURATION, rate=25.0, seed=case.motion).trajectories
    placed = tuple(_place(case, put, plans[:N_TRAIN], rng) for put in case.puts)
    equipped = equip(arm, [each.effect for each in placed])
    how = {"n_runs": N_TRAIN + N_TEST, "duration": DURATION, "rate": RATE}
    simulation = simulate(equipped, seed=case.motion, trajectories=plans, **how)  # type: ignore[arg-type]
    reference = simulate(arm, seed=10_000 + case.motion, **how) if case.group == "reference" else None  # type: ignore[arg-type]
    return Built(case, placed, simulation, reference)


def write_seen(built: Built, folder: Path) -> None:
    """Write what the examined program may see: `robot.urdf`, `run_0.parquet`, ...; `reference/` where there is one."""
    shutil.copy(ROBOT_FILES[built.case.arm], _made(folder) / "robot.urdf")
    for run, recording in enumerate(built.simulation.recordings):
        write_table(folder / recording.name, run_columns(built.shown(run)))
    if built.reference is not None:
        for recording in built.reference.recordings:
            shown = _with_encoders(recording, built.case.encoders)
            write_table(_made(folder / "reference") / recording.name, run_columns(shown))


def write_truth(truth: dict[str, Any], folder: Path) -> None:
    """Write what it may not see."""
    write_json(_made(folder) / "truth.json", truth)


def truth_of(built: Built) -> dict[str, Any]:
    """Return what is true of a case, as plain data."""
    names = list(bare(built.case.arm).robot.joint_names)
    return {
        "number": built.case.number,
        "group": built.case.group,
        "arm": built.case.arm,
        "encoders": built.case.encoders,
        "joints": names,
        "rate": RATE,
        "train": [recording.name for recording in built.simulation.recordings[:N_TRAIN]],
        "noise_std": bare(built.case.arm).noise_std.tolist(),
        "effects": [_told(each, names) for each in built.placed if not isinstance(each.effect, Stranger | Contact)],
        "strangers": [_told(each, names) for each in built.placed if isinstance(each.effect, Stranger)],
        "contacts": _windows(built.simulation),
    }


def _told(placed: Placed, names: list[str]) -> dict[str, Any]:
    effect = placed.effect
    told = effect.to_json(names) | {
        "required": [names[j] for j in placed.required],
        "ratio": placed.put.ratio,
        "reached": None if placed.felt is None else placed.reached,
        "felt": None if placed.felt is None else placed.felt.tolist(),
    }
    if isinstance(effect, Stranger):
        told |= {"pushed": [names[j] for j in effect.joints_pushed], "depends_on": effect.depends_on(names)}
    return told


def _windows(simulation: Simulation) -> dict[str, list[list[float]]]:
    """Pushes [s] of every run by the run's file name; empty without contacts."""
    return {
        recording.name: [[push.start, push.end] for push in effect.pushes]
        for recording, arm in zip(simulation.recordings, simulation.arms, strict=True)
        for effect in arm.effects
        if isinstance(effect, Contact)
    }


def _bending(case: Case, effect: LabEffect, trajectories: Sequence[Trajectory]) -> tuple[int, ...] | None:
    """Joints whose gears are loaded enough to show that they bend; the most loaded one at least."""
    if not isinstance(effect, NonlinearElasticity):
        return None
    arm = bare(case.arm)
    most = np.zeros(arm.robot.n_joints)
    for trajectory in trajectories:
        motion = trajectory.evaluate(np.arange(0.0, trajectory.duration, 1 / 25))
        most = np.maximum(most, np.abs(arm.robot.inverse_dynamics(*motion, arm.phi)).max(axis=0))
    bend = np.abs(effect.cubic) * most**2 * effect.gears.stiffness
    joints = list(effect.joints)
    seen = tuple(j for j in joints if bend[j] >= BENDS)
    return seen or (max(joints, key=lambda j: bend[j]),)


NOT_AT_THE_BASE = ("kinematic_error", "counterbalance")
"""A first frame that is turned is a tilted base, and so, to the cosine, is a cylinder that pulls at an upright axis,
where there is nothing to balance: other kinds, by any measurement."""


def _place(case: Case, put: Put, trajectories: Sequence[Trajectory], rng: np.random.Generator) -> Placed:
    """Try the joints in a drawn order; where none can have the ratio, the one that comes nearest gets its most."""
    seed, whole = int(rng.integers(2**31)), put.kind in BY_NAME and BY_NAME[put.kind].where == "robot"
    joints = rng.permutation(bare(case.arm).robot.n_joints).tolist()
    if put.kind in NOT_AT_THE_BASE:
        joints.remove(0)
    tried: list[Placed] = []
    reason = ""
    for joint in joints[:1] if whole or put.everywhere else joints:
        make = _builder(case, put, joint, seed)
        try:
            if put.ratio is None:
                effect = make(put.size if put.size is not None else 1.0)
                return Placed(put, effect, None, _bending(case, effect, trajectories))
            placed = Placed(put, *scaled(make, case.arm, put.ratio, trajectories, LARGEST.get(put.kind, np.inf)))
        except ValueError as error:
            reason = str(error)
            continue
        if placed.reached >= (1 - 2 * TOLERANCE) * put.ratio:
            return placed
        tried.append(placed)
    best = max(tried, key=lambda placed: placed.reached, default=None)
    # Below the next ratio it would be another case.
    if best is None or best.reached <= max((r for r in RATIOS if r < (put.ratio or 0.0)), default=0.0):
        reached = "" if best is None else f"at most {best.reached:.3g} is possible; "
        raise Impossible(f"{put.kind} at {put.ratio} in {case.arm}: {reached}{reason}")
    return best


def _builder(case: Case, put: Put, joint: int, seed: int) -> Callable[[float], LabEffect]:
    """(size) -> effect at a joint, with shapes and sign drawn from `seed`."""
    arm, n = typical(case.arm), typical(case.arm).robot.n_joints
    rng = np.random.default_rng(seed)
    if put.kind in STRANGERS:
        other = joint - 1 if joint else 1
        effort, sign = plausible_effort(arm.robot), float(rng.choice([-1.0, 1.0]))
        return lambda size: build_stranger(put.kind, joint, other, effort, sign * size)
    kind = BY_NAME[put.kind]
    at = None if kind.where == "robot" or put.everywhere else str(joint)
    sign = float(rng.choice([-1.0, 1.0])) if kind.either_sign and put.ratio is not None else 1.0
    one = build_effect(Wish(put.kind, at, sign), arm)
    if not isinstance(one, ColumnEffect):
        return lambda size: build_effect(Wish(put.kind, at, sign * size), arm)
    drawn = varied(one, n, rng)

    def of_size(size: float) -> LabEffect:
        build_effect(Wish(put.kind, at, sign * size), arm)  # refuses what is no machine
        return drawn(size)

    return of_size


def scaled(
    make: Callable[[float], LabEffect], arm: str, ratio: float, trajectories: Sequence[Trajectory], largest: float
) -> tuple[LabEffect, FloatArray]:
    """Effect that leaves `ratio` times the noise on the joint where it leaves most, and what it leaves (n_joints,).

    As `dynid_rs.simulation.scale_to`, for effects that are no wishes; an effect of the `largest` size may leave less.
    """
    size = min(1.0, largest)
    for _ in range(STEPS):
        effect = make(size)
        felt = unabsorbed(bare(arm), [effect], trajectories) / bare(arm).noise_std
        reached = float(felt.max())
        if abs(reached - ratio) <= TOLERANCE * ratio or (size == largest and reached < ratio):
            return effect, felt
        if reached < 1e-6:
            break
        size = min(size * ratio / reached, largest)
    raise ValueError(f"at size {size:.3g} the declared model leaves {reached:.3g}")


def _with_encoders(recording: Recording, encoders: int) -> Recording:
    return recording if encoders == 2 else replace(recording, q_motor=None, dq_motor=None)


def _made(folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    return folder
