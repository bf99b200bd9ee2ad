"""What may have changed in a robot since a trusted model was made, and the model that says so."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.base.wording import is_friction
from dynid_rs.model.assembly import evaluate, with_changes
from dynid_rs.model.gain import gained_coefficients, gained_third_loop
from dynid_rs.model.placement import gravity_steps, tilt_of, tilted_gravity
from dynid_rs.model.units import filled
from dynid_rs.reference.plausible import Plausible, plausible_phi
from dynid_rs.reference.unseen import unseen_directions
from dynid_rs.runs.preprocessing import States

FloatArray = NDArray[np.float64]

PAYLOAD, TILT, GAIN, FRICTION, OFFSET = "payload", "gravity_tilt", "torque_gain", "friction", "torque_offset"
DAILY = 4
"""Columns per joint that differ from day to day: offset, friction's factor, Coulomb, viscous."""
PARTS = {
    "friction": (("coulomb_pos", "coulomb_neg"), ("viscous1_pos", "viscous1_neg")),
    "smooth_friction": (("coulomb",), ("viscous",)),
}
"""Kinds of declared friction: names of what acts in both directions, Coulomb's and the viscous part.

Its factor is that of all friction that the model has, of what remembers its way too.
"""
LEAST_SIGNAL = 2.0
"""What a tilt brings to light counts above this, in standard deviations of the noise over all independent rows."""
N_SAMPLES = 150
"""States of the runs on which that is looked for."""
WORTH = 0.2
"""Independent samples that a row is taken for in that."""


@dataclass(frozen=True, eq=False)
class Believed:
    """A trusted model and what has changed against it.

    Parameters
    ----------
    reference : TorqueModel
        The trusted model.
    robot : RobotModel
        Its robot, under gravity as it is now.
    plausible : Plausible
        The reference's inertial parameters as a full set, and what it does not know of them.
    unseen : ndarray (10 n_links,)
        What a tilt has brought to light of the latter.
    payload : ndarray (10,)
        Added to the last link.
    gain, offset : ndarray (n_joints,)
        The torque channel shows (1 + gain) times the torque, and an offset [torque unit] more.
    friction : ndarray (n_joints, 3)
        Factor by which all of the reference's friction has grown, Coulomb [torque unit] and viscous friction
        [torque unit * s/rad] that have been added to it.
    """

    reference: _core.TorqueModel
    robot: _core.RobotModel
    plausible: Plausible
    unseen: FloatArray
    payload: FloatArray
    gain: FloatArray
    offset: FloatArray
    friction: FloatArray

    @staticmethod
    def unchanged(reference: _core.TorqueModel, declared: FloatArray) -> Believed:
        """Nothing has changed; `declared` (10 n_links,) inertials of the robot file, zeros where it has none."""
        robot = reference.robot
        n = robot.n_joints
        base = robot.base_parameters()
        phi_base = base.project(reference.phi)
        held = np.zeros((len(phi_base), len(phi_base)))
        ampere = reference.torque_unit == "A"
        plausible = plausible_phi(robot, phi_base, held, declared=declared, unknown_gain=ampere)
        zero = np.zeros(n)
        return Believed(reference, robot, plausible, np.zeros(10 * n), np.zeros(10), zero, zero, np.zeros((n, 3)))

    @property
    def tilt(self) -> tuple[float, float]:
        """Roll and pitch [rad] against the reference."""
        return tilt_of(self.reference.robot, self.robot)

    @property
    def phi(self) -> FloatArray:
        """Inertial parameters of all links, payload included."""
        # The reference's own numbers where its own gravity acts: exact to the last bit.
        phi = np.array(self.plausible.phi + self.unseen if any(self.tilt) else self.reference.phi)
        phi[-10:] += self.payload
        return phi

    def model(self) -> _core.TorqueModel:
        """Return the reference with everything that has changed."""
        like, factor = self.reference, 1 + self.gain
        effects = []
        for effect, coefficients in like.effects:
            changed = np.array(coefficients)
            names = effect.coefficient_names
            if is_friction(effect.kind):
                changed *= 1 + self.friction[:, :1]
            if effect.kind in PARTS:
                for column, part in enumerate(PARTS[effect.kind], start=1):
                    for name in part:
                        changed[:, names.index(name)] += self.friction[:, column]
            changed = gained_coefficients(effect, changed, factor)
            if effect.kind == OFFSET:
                changed[:, 0] += self.offset
            effects.append((effect, changed))
        scale, third_loop = (like.torque_scale * factor).tolist(), gained_third_loop(like, factor)
        model = with_changes(like, robot=self.robot, phi=self.phi, effects=effects, torque_scale=scale, **third_loop)
        return self._with_physical(model)

    def _with_physical(self, model: _core.TorqueModel) -> _core.TorqueModel:
        """`model` with the reference's physical set, if nothing but the payload has changed and it is a body."""
        like = self.reference.physical
        if like is None or any(self.tilt) or self.gain.any() or self.friction.any() or np.ptp(like.drive_gain) > 0:
            return model
        phi = np.array(like.phi)
        phi[-10:] += self.payload * like.drive_gain[0]
        try:
            physical = _core.PhysicalSet(
                phi, like.rotor_inertia, damping=like.damping, friction=like.friction, drive_gain=like.drive_gain
            )
        except ValueError:  # not a body
            return model
        return model.with_physical(physical)


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """One possible change: `places` of its columns among those of `change_columns`, and the names of those named.

    `added` puts their coefficients into what is believed; `names` and `units` are of the first ones.
    """

    kind: str
    joints: tuple[int, ...]
    places: NDArray[np.intp]
    names: tuple[str, ...]
    units: tuple[str, ...]

    @property
    def place(self) -> tuple[str, tuple[int, ...]]:
        """Kind and joints."""
        return self.kind, self.joints

    def value(self, believed: Believed) -> FloatArray:
        """Return what it amounts to so far, one number per name."""
        if self.kind == PAYLOAD:
            return believed.payload
        if self.kind == TILT:
            return np.array(believed.tilt)
        j = self.joints[0]
        if self.kind == FRICTION:
            return np.array(believed.friction[j])
        return np.array([{GAIN: believed.gain, OFFSET: believed.offset}[self.kind][j]])

    def added(self, believed: Believed, x: FloatArray, columns: ChangeColumns) -> Believed:
        """Return what is believed with coefficients `x` of its columns added."""
        if self.kind == PAYLOAD:
            return replace(believed, payload=believed.payload + x)
        if self.kind == TILT:
            roll, pitch = believed.tilt
            gravity = tilted_gravity(believed.reference.robot.gravity, roll + x[0], pitch + x[1])
            unseen = believed.unseen + (columns.unseen @ x[2:] if columns.unseen.size else 0.0)
            return replace(believed, robot=believed.robot.with_gravity(gravity.tolist()), unseen=unseen)
        name = {GAIN: "gain", FRICTION: "friction", OFFSET: "offset"}[self.kind]
        values = getattr(believed, name).copy()
        if self.kind == GAIN:
            x = x * (1 + values[self.joints[0]])
        values[self.joints[0]] += x if values.ndim == 2 else x[0]
        return replace(believed, **{name: values})


@dataclass(frozen=True, eq=False)
class ChangeColumns:
    """Columns of all possible changes: per run (n_rows, n_joints, n_columns), offset and friction of joint 0 first.

    `unseen` (10 n_links, k): what the last columns of a tilt add to the inertial parameters; empty without tilt.
    """

    rows: list[FloatArray]
    unseen: FloatArray
    n_tilt: int


def change_columns(believed: Believed, runs: list[States], weights: FloatArray) -> ChangeColumns:
    """Torque per unit of every change, in the band at the rows of the runs.

    Places: ``4 j + (0, 1, 2, 3)`` offset, friction's factor, Coulomb, viscous of joint j; then ten of the payload,
    roll, pitch, the gains of all joints, and what a tilt brings to light.
    """
    model, robot = believed.model(), believed.robot
    n = robot.n_joints
    scale = np.asarray(model.torque_scale)
    ungrown = replace(believed, friction=np.zeros_like(believed.friction)).model()
    grows = [1 + k for k, (effect, _) in enumerate(ungrown.effects) if is_friction(effect.kind)]
    friction = next(effect for effect, _ in ungrown.effects if effect.kind in PARTS)
    names = friction.coefficient_names
    parts = [[names.index(name) for name in part] for part in PARTS[friction.kind]]
    pulls = gravity_steps(believed.reference.robot, robot)
    phi = believed.plausible.phi + believed.unseen
    phi[-10:] += believed.payload
    shown, unseen = _tilt_extras(believed, runs, weights * scale, pulls)
    rows = []
    for states in runs:
        aligned = states.aligned(model.encoder_delay, model.encoder_error)
        motion = aligned.q, aligned.dq, aligned.ddq
        still = np.zeros_like(aligned.q)
        wide = np.zeros((len(states.t), n, DAILY * n))
        basis = _core.effect_columns(friction, *aligned.signals())
        whole = evaluate(ungrown, states)[1][:, grows].sum(axis=1)
        for j in range(n):
            wide[:, j, DAILY * j] = 1.0
            wide[:, j, DAILY * j + 1] = whole[:, j]
            for k, part in enumerate(parts):
                wide[:, j, DAILY * j + 2 + k] = (1 + believed.gain[j]) * basis[:, j, part].sum(axis=1)
        load = robot.joint_torque_regressor(*motion)[:, :, -10:] * scale[:, None]
        tilt = [robot.with_gravity(g.tolist()).inverse_dynamics(aligned.q, still, still, phi) for g in pulls]
        for pieces in shown:
            torques = [
                robot.with_gravity(g.tolist()).inverse_dynamics(aligned.q, *((still, still) if rest else motion[1:]), p)
                for g, p, rest in pieces
            ]
            tilt.append(np.sum(torques, axis=0))
        turned = np.stack(tilt, axis=2) * scale[:, None]
        gains = (evaluate(model, states)[0] - believed.offset)[:, :, None] * np.eye(n)
        rows.append(states.in_band(np.concatenate([wide, load, turned[:, :, :2], gains, turned[:, :, 2:]], axis=2)))
    return ChangeColumns(rows, unseen, len(shown))


def hypotheses(believed: Believed, columns: ChangeColumns) -> list[Hypothesis]:
    """Return every change that is looked for."""
    n = believed.robot.n_joints
    everything = tuple(range(n))
    torque_unit = believed.reference.torque_unit
    per = "" if torque_unit == "N*m" else "*A/(N*m)"
    moments = ["kg"] + ["kg*m"] * 3 + ["kg*m^2"] * 6
    first = DAILY * n
    found = [
        Hypothesis(
            PAYLOAD,
            everything,
            np.arange(first, first + 10),
            ("mass", *_core.LINK_PARAMETER_NAMES[1:]),
            tuple(moment + per for moment in moments),
        )
    ]
    if np.any(believed.robot.gravity):
        extra = np.arange(first + 12 + n, first + 12 + n + columns.n_tilt)
        places = np.concatenate([first + 10 + np.arange(2), extra])
        found.append(Hypothesis(TILT, everything, places, ("roll", "pitch"), ("rad", "rad")))
    for j in range(n):
        found.append(Hypothesis(GAIN, (j,), np.array([first + 12 + j]), ("gain",), ("1",)))
        kind = believed.robot.joint_kinds[j]
        unit, viscous = (filled(one, torque_unit, kind) for one in ("{torque}", "{torque}*s/{angle}"))
        found.append(
            Hypothesis(
                FRICTION,
                (j,),
                DAILY * j + np.arange(1, 4),
                ("growth", "coulomb", "viscous"),
                ("1", unit, viscous),
            )
        )
        found.append(Hypothesis(OFFSET, (j,), np.array([DAILY * j]), ("offset",), (unit,)))
    return found


def _tilt_extras(
    believed: Believed, runs: list[States], weights: FloatArray, pulls: list[FloatArray]
) -> tuple[list[list[tuple[FloatArray, FloatArray, bool]]], FloatArray]:
    """Torques that a tilt adds through parameters which level gravity hides: gravity, phi and whether at rest.

    On level ground a guess of what any tilt may do, which is not part of the model; once tilted, the parameters.
    """
    n_rows = sum(len(states.rows) for states in runs)
    level = believed.reference.robot
    if not any(believed.tilt):
        guess = unseen_directions(level, runs, weights, n_rows, pulls, believed.plausible)
        return [[(g, phi, True) for g, phi in pair] for pair in guess], np.zeros((len(level.phi), 0))
    q, dq, ddq = (
        np.concatenate([getattr(s, name)[s.rows][:: max(1, n_rows // N_SAMPLES)] for s in runs])
        for name in ("q", "dq", "ddq")
    )
    regressor = weights[:, None] * believed.robot.joint_torque_regressor(q, dq, ddq)
    shown = regressor.reshape(-1, regressor.shape[2]) @ believed.plausible.root
    _, s, vt = np.linalg.svd(shown, full_matrices=False)
    seen = believed.plausible.root @ vt[s * np.sqrt(WORTH * n_rows / len(q)) > LEAST_SIGNAL].T
    return [[(believed.robot.gravity, phi, False)] for phi in seen.T], seen
