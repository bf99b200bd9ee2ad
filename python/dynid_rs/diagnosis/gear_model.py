"""The deflection of one gear as a linear model of its load: what stands beside everything, and what may be named."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.units import angle_units, torque_of
from dynid_rs.identification.loads import link_load
from dynid_rs.identification.three_loops import ThreeLoopIdentifier
from dynid_rs.model.assembly import evaluate
from dynid_rs.regression.linear_model import Choice, LinearModel
from dynid_rs.runs.preprocessing import States
from dynid_rs.runs.slope import slope

FloatArray = NDArray[np.float64]

DRIVEN = 2
"""Terms of a model that no link carries: the rigid body's own, which is the load, and the rotor's."""
TURNS = (0.02, 0.05, 0.1, 0.2)
"""Loads over which lost motion turns round, over the load's standard deviation."""
FIRST_WORTH, FIRST_LEFT, ROUNDING = 0.1, 0.3, 1e-6
"""Independent samples that a row counts as before there is a residual; what is left of the deflection then; what no
model can go below."""


@dataclass(frozen=True)
class Flat:
    """Prior of the columns that stand beside everything: standard normal in their own units."""

    size: int

    def rows(self, choice: Choice) -> tuple[FloatArray, float]:
        """Return rows of variance one, and ``ln det S``."""
        return np.eye(self.size, self.size + 1), 0.0


@dataclass(frozen=True, eq=False)
class GearHypothesis:
    """Columns whose coefficients are standard normal beforehand, names, units, signs."""

    kind: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    columns: FloatArray
    unit: FloatArray
    bounds: FloatArray


@dataclass(frozen=True, eq=False)
class Gear:
    """Motor minus link position of joint `joint`, and the load that bends its gear, run by run.

    Rows are those in which the joint moves (where it rests its gear keeps what it had), less their mean over every
    run: encoders are set to zero between runs. `torques`: those of the fit's other terms, (n, k) per run, which may act
    on the motor or on the link.
    """

    fit: ThreeLoopIdentifier
    joint: int
    torques: Sequence[FloatArray]

    @staticmethod
    def all_of(fit: ThreeLoopIdentifier) -> list[Gear]:
        """Gears of the joints whose two encoders differ and whose load changes."""
        terms = [evaluate(fit.model_, states)[1][:, DRIVEN:] for states in fit.raw_runs_]
        gears = [Gear(fit, j, [torque[:, :, j] for torque in terms]) for j in range(fit.robot.n_joints)]
        return [gear for gear in gears if _changes(gear.deflection) and _changes(gear.load)]

    @property
    def shown(self) -> float:
        """What the joint's channel shows of one unit of the links' torque, where it shows no torque but a current."""
        return 1.0 if self.fit.torque_unit_ == "N*m" else float(self.fit.links_.torque_scale_[self.joint])

    @property
    def load_unit(self) -> str:
        """Unit of `load`: that of the joint's channel."""
        return torque_of(self.fit.torque_unit_, self.fit.robot.joint_kinds[self.joint])

    @property
    def angle_unit(self) -> str:
        """Unit of the joint's position."""
        return angle_units(self.fit.robot.joint_kinds)[self.joint]

    @property
    def load(self) -> list[FloatArray]:
        """Rigid-body torque that the fit predicts at every sample, in `load_unit`, (n,) per run."""
        load = link_load(self.fit.observations_.plan, self.fit.links_)
        return [self.shown * load(states)[:, self.joint] for states in self.fit.runs_]

    def rows(self, signals: Sequence[FloatArray]) -> list[FloatArray]:
        """Signals (n, ...) per run in the band, (n_rows, ...) per run."""
        parts = [s.in_band(x)[s.counted[:, self.joint]] for s, x in zip(self.fit.runs_, signals, strict=True)]
        return _centred(parts)

    @property
    def angle(self) -> list[FloatArray]:
        """Link position at the rows [rad], (n_rows,) per run."""
        return [s.q[s.rows, self.joint][s.counted[:, self.joint]] for s in self.fit.runs_]

    @property
    def phase(self) -> NDArray[np.int64]:
        """Phase of the motion at the rows, (n_rows of all runs,)."""
        counted = np.concatenate([s.counted[:, self.joint] for s in self.fit.runs_])
        phase: NDArray[np.int64] = self.fit.observations_.phase[counted]
        return phase

    @property
    def deflection(self) -> list[FloatArray]:
        """Motor minus link position as the encoders show them [rad], (n_rows,) per run."""
        shown = [
            (states.q_motor - states.q)[:, self.joint] - self._once_a_turn(states) @ self.taken_off
            for states in self.fit.runs_
        ]
        return self.rows(shown)

    @property
    def taken_off(self) -> FloatArray:
        """What the fit takes off the link encoder, cosine and sine part [rad]."""
        error = self.fit.encoder_error
        return np.zeros(2) if error is None else np.asarray(error)[self.joint]

    def _once_a_turn(self, states: States) -> FloatArray:
        q = states.q[:, self.joint]
        return np.stack([np.cos(q), np.sin(q)], axis=1)

    def model(self, covariance: FloatArray) -> tuple[LinearModel, FloatArray]:
        """Model without any hypothesis, and the noise to begin with, (1,).

        Beside everything stand speed and acceleration of the motor (what is left of the delay; a rotor that no motion
        tells from the link is in the predicted load, and the gear does not carry it), what is not known of the load
        (`covariance` is that of all unknowns of the fit), and torques that a gear carries only if they act on the link.
        """
        j, runs = self.joint, self.fit.runs_
        bent = np.concatenate(self.deflection)
        size = float(bent.std())
        motion = [np.concatenate(self.rows([x[:, j] for x in xs])) for xs in _motor_motion(runs)]
        beside = np.stack([size * x / max(float(x.std()), 1e-300) for x in motion], axis=1)
        load = np.concatenate(self.rows(self.load))
        compliance = float(bent @ load) / max(float(load @ load), 1e-300)
        unknown = np.concatenate([self._unknown_load(covariance), self._on_the_link()], axis=1)
        rows = np.concatenate([beside, compliance * unknown, bent[:, None]], axis=1)
        n = rows.shape[1] - 1
        worth, least = np.array([FIRST_WORTH * len(bent)]), np.array([ROUNDING * size])
        return LinearModel([rows], [np.arange(n)], Flat(n), worth, least, len(bent)), np.array([FIRST_LEFT * size])

    def _unknown_load(self, covariance: FloatArray) -> FloatArray:
        """What is not known of the load, one standard deviation a column, (n_rows, k)."""
        j, observations, plan = self.joint, self.fit.observations_, self.fit.observations_.plan
        base = plan.unknowns(j)[plan.n_own :]
        values, vectors = np.linalg.eigh(covariance[np.ix_(base, base)])
        root = vectors * np.sqrt(np.maximum(values, 0.0)) * self.shown
        runs = observations.by_run([block.rows[j][:, plan.n_own : -1] for block in observations.blocks])
        parts = [rows[s.counted[:, j]] @ root for s, rows in zip(self.fit.runs_, runs, strict=True)]
        return np.concatenate(_centred(parts))

    def _on_the_link(self) -> FloatArray:
        """Torques of the other terms, (n_rows, k); those that do not change are left out."""
        rows = np.concatenate(self.rows(self.torques)) * (self.shown / float(self.fit.links_.torque_scale_[self.joint]))
        return rows[:, np.ptp(rows, axis=0) > 0]

    def hypotheses(self) -> list[GearHypothesis]:
        """Compliance and damping, hardening, an encoder that is not centred, lost motion."""
        load, runs = self.load, self.fit.runs_
        # Whoever shows too much makes the difference smaller.
        turning = [-self._once_a_turn(states) for states in runs]
        rate = [slope(tau, states.rate) for tau, states in zip(load, runs, strict=True)]
        angle, unit = self.angle_unit, self.load_unit
        free, positive = (-np.inf, np.inf), (0.0, np.inf)
        found = [
            self._hypothesis(
                "joint_elasticity",
                {"compliance": (f"{angle}/({unit})", positive), "damping": (f"{angle}*s/({unit})", free)},
                [load, rate],
            ),
            self._hypothesis(
                "nonlinear_elasticity", {"cubic": (f"{angle}/({unit})^3", free)}, [[tau**3 for tau in load]]
            ),
        ]
        if self.fit.robot.joint_kinds[self.joint] == "revolute":
            once = {"cosine": ("rad", free), "sine": ("rad", free)}
            parts = [[both[:, k] for both in turning] for k in range(2)]
            found.append(self._hypothesis("encoder_eccentricity", once, parts))
        scatter = float(np.concatenate(load).std())
        widest = float(np.concatenate(self.deflection).std())
        for turn in TURNS:
            sign = [tau / np.hypot(tau, turn * scatter) for tau in load]
            # No play is wider than the encoders differ, however seldom the load turns round.
            found.append(self._hypothesis("backlash", {"half_gap": (angle, positive)}, [sign], most=widest))
        return found

    def _hypothesis(
        self,
        kind: str,
        coefficients: dict[str, tuple[str, tuple[float, float]]],
        signals: Sequence[Sequence[FloatArray]],
        most: float = np.inf,
    ) -> GearHypothesis:
        """Columns of the deflection's own size; coefficients are usually of at most `most`."""
        size = float(np.concatenate(self.deflection).std())
        rows = np.concatenate(self.rows([np.stack(parts, axis=1) for parts in zip(*signals, strict=True)]))
        norm = np.sqrt(np.mean(rows**2, axis=0))
        scale = np.minimum(size / np.where(norm > 0, norm, 1.0), most)
        units, bounds = zip(*coefficients.values(), strict=True)
        return GearHypothesis(kind, tuple(coefficients), units, rows * scale, scale, np.array(bounds))


def _changes(parts: Sequence[FloatArray]) -> bool:
    return any(np.ptp(part) > 0 for part in parts if len(part))


def _motor_motion(runs: Sequence[States]) -> list[list[FloatArray]]:
    return [[getattr(states, name) for states in runs] for name in ("dq_motor", "ddq_motor")]


def _centred(parts: Sequence[FloatArray]) -> list[FloatArray]:
    """Signals of every run less their mean: nothing that is constant over a run tells of a gear."""
    return [part - part.mean(axis=0) if len(part) else part for part in parts]
