"""What a motion that nobody has recorded yet would say: the columns of runs, at torques that the model predicts.

A fit is made that has the coefficients of the diagnosis and the motion as its only run; what makes columns from a fit
makes them along the motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.any_function import function_along
from dynid_rs.diagnosis.beside import SHAPE_SPREAD, other_roundings, other_time, yielding
from dynid_rs.diagnosis.candidates import Candidate, with_slopes
from dynid_rs.diagnosis.hypotheses import Catalogue, Hypothesis
from dynid_rs.diagnosis.open_questions import OpenQuestions
from dynid_rs.diagnosis.shaped import Shaped
from dynid_rs.diagnosis.structural import KINDS
from dynid_rs.diagnosis.structural.about import About
from dynid_rs.diagnosis.waves import UNKNOWN
from dynid_rs.identification.loads import with_load
from dynid_rs.identification.smooth_friction import shape_slopes
from dynid_rs.identification.three_loops import ThreeLoopIdentifier
from dynid_rs.model.assembly import declared_temperature
from dynid_rs.model.placed import CATALOGUE
from dynid_rs.regression.columns import observe
from dynid_rs.regression.linear_model import Columns
from dynid_rs.runs.preprocessing import Band, States, find_motion

FloatArray = NDArray[np.float64]
Motion = tuple[FloatArray, FloatArray, FloatArray]

RATE = 20.0
"""States of a motion at this multiple of the band's cutoff: half of what a fit to recorded runs takes, whose torque
turns round between two samples. It tells as many nats, within two percent."""

NEEDS_MORE = {
    "gear_hysteresis": "both encoders of a loaded gear",
    "temperature_friction": "a recorded temperature that changes",
    "thermal_friction": "half an hour from a cold start",
    "torque_delay": "nothing but sharp accelerations, which every motion has",
}
"""Kinds that no motion of some seconds is designed for, and what tells them."""


def is_designable(candidate: Candidate) -> bool:
    """Whether a motion of some seconds can tell a kind."""
    return candidate.kind not in NEEDS_MORE


@dataclass(frozen=True, eq=False)
class Told:
    """What rows say of the declared unknowns alone (m, m), and of all beside what else they may show (n, n)."""

    declared: FloatArray
    unknowns: FloatArray

    def __mul__(self, times: float) -> Told:
        return Told(self.declared * times, self.unknowns * times)

    @staticmethod
    def mean(all_of: Sequence[Told]) -> Told:
        """Of motions of the same length."""
        declared, unknowns = (np.mean([getattr(told, name) for told in all_of], axis=0) for name in Told.__match_args__)
        return Told(declared, unknowns)


@dataclass(eq=False)
class Along:
    """Rows of motions, for one set of open questions.

    Parameters
    ----------
    asked : OpenQuestions
        What is asked, and what is known.
    chosen : sequence of int
        Candidates whose columns are wanted.
    load : float
        Known mass at the origin of the last link [kg]: its torque is no unknown, what depends on the load sees it.
    """

    asked: OpenQuestions
    chosen: Sequence[int]
    load: float = 0.0
    joints: list[int] = field(init=False)

    def __post_init__(self) -> None:
        candidates = [self.asked.candidates[k] for k in self.chosen]
        self._links = copy(self.asked.links)
        self._links.phi_base_ = self._links.phi_base_ + self._loaded()
        self.joints = sorted({j for c in candidates for j in c.joints if c.kind in CATALOGUE})

    def _loaded(self) -> FloatArray:
        """What the load adds to the base parameters, (n_base,)."""
        robot = self.asked.plan.robot
        phi = np.zeros(10 * robot.n_joints)
        phi[-10] = self.load * self.asked.unit
        base = robot.base_parameters()
        added: FloatArray = phi[np.asarray(base.pivots)] + np.asarray(base.beta) @ phi[np.asarray(base.dependent)]
        return added

    @property
    def rate(self) -> float:
        """Samples per second of a motion's states [Hz]: friction's corners live above the band."""
        return RATE * self.asked.cutoff

    def information(self, motion: Motion) -> Told:
        """What a motion says of all unknowns of `asked.precision`.

        Shapes of friction on the joints in question, and gears that yield, which the motion shows too, take away what
        they can imitate.

        Parameters
        ----------
        motion : tuple of ndarray (n_samples, n_joints)
            q, dq, ddq [rad, m] at `rate`.
        """
        asked = self.asked
        fit = self._fit(motion)
        n = len(asked.precision)
        rows_of = fit.observations_.joint_rows()
        further = self._shapes(fit)
        width = sum(next(iter(c.values())).shape[1] for c in further)
        places = [asked.plan.unknowns(j) for j in range(asked.plan.robot.n_joints)]
        total = np.zeros((n + width, n + width))
        wanted = list(zip([asked.at(k) for k in self.chosen], self._columns(fit), strict=True))
        for j, (rows, at) in enumerate(zip(rows_of, places, strict=True)):
            parts, spots = [self._scaled(rows[:, :-1], j)], [at]
            for where, columns in wanted:
                if j in columns:
                    parts.append(columns[j])
                    spots.append(where)
            first = n
            for columns in further:
                k = next(iter(columns.values())).shape[1]
                if j in columns:
                    parts.append(columns[j])
                    spots.append(np.arange(first, first + k))
                first += k
            own, spot = asked.weights[j] * np.concatenate(parts, axis=1), np.concatenate(spots)
            total[np.ix_(spot, spot)] += own.T @ own
        declared = total[: asked.plan.n_columns, : asked.plan.n_columns]
        across = total[n:, :n]
        taken = across.T @ np.linalg.solve(total[n:, n:] + np.eye(width), across)
        return Told(declared, total[:n, :n] - taken)

    def squares(self, motion: Motion) -> FloatArray:
        """Mean square of a row of each joint over its noise, in the declared unknowns: (n_joints, m, m).

        Parameters
        ----------
        motion : tuple of ndarray (n_samples, n_joints)
            As of `information`.
        """
        plan = self.asked.plan
        squares = np.zeros((plan.robot.n_joints, plan.n_columns, plan.n_columns))
        for j, rows in enumerate(self._fit(motion).observations_.joint_rows()):
            own, at = self._scaled(rows[:, :-1], j) / self.asked.noise[j], plan.unknowns(j)
            squares[j][np.ix_(at, at)] = own.T @ own / len(own)
        return squares

    def _scaled(self, rows: FloatArray, j: int) -> FloatArray:
        """Rows of joint j as its channel shows them: links' columns by its gain."""
        units = np.ones(rows.shape[1])
        units[self.asked.plan.n_own :] = self.asked.links.torque_scale_[j]
        return rows * units

    def _fit(self, motion: Motion) -> ThreeLoopIdentifier:
        """A fit with the coefficients of the diagnosis and this motion as its only run.

        It is as warm as friction is declared at: a motion of seconds says nothing of what follows a temperature.
        """
        asked = self.asked
        q, dq, ddq = (np.ascontiguousarray(x) for x in motion)
        band = Band(asked.cutoff)
        moving, resting = find_motion(dq, self.rate, band)
        states = States(
            name="motion",
            t=np.arange(len(q)) / self.rate,
            q=q,
            dq=dq,
            ddq=ddq,
            q_motor=q,
            dq_motor=dq,
            ddq_motor=ddq,
            tau=np.zeros_like(q),
            rate=self.rate,
            band=band,
            moving=moving,
            resting=resting,
            two_encoders=False,
            temperature=declared_temperature(asked.plan.effects, q),
        )
        states = with_load(asked.plan, self._links, asked.links.own_)(states)
        fit = ThreeLoopIdentifier(asked.setup.robot)
        fit.links_, fit.runs_, fit.band_ = self._links, [states], band
        fit.torque_unit_, fit.rate_ = asked.torque_unit, asked.rate
        fit.observations_ = observe(asked.plan, [states], [_torque(states)])
        return fit

    def _columns(self, fit: ThreeLoopIdentifier) -> list[Columns]:
        """Columns of every chosen candidate, for coefficients over their units."""
        asked = self.asked
        candidates = [asked.candidates[k] for k in self.chosen]
        placed = [c for c in candidates if c.kind in CATALOGUE]
        functions = [c for c in candidates if c.kind == UNKNOWN]
        catalogue = Catalogue(fit) if placed or functions else None
        shaped = [Shaped(c.kind, c.joints, c.shape) for c in placed]
        found = {} if catalogue is None else dict(zip(placed, catalogue.of(shaped), strict=True))
        if catalogue is not None:
            found |= {c: function_along(catalogue, c) for c in functions}
        about = About(fit, asked.about.phi, asked.about.root)
        for kind in sorted({c.kind for c in candidates if is_designable(c)} & set(KINDS)):
            there = {h.place: h for h in KINDS[kind](about, asked.setup)}
            found |= {c: there[c.place] for c in candidates if c.place in there}
        columns = [_in_units(found[c], c) if c in found else {} for c in candidates]
        if catalogue is None:
            return columns
        return [
            with_slopes(catalogue, c, c.mean, own) if own else own for c, own in zip(candidates, columns, strict=True)
        ]

    def _shapes(self, fit: ThreeLoopIdentifier) -> list[Columns]:
        """Friction's other shapes on the joints in question, and gears that yield; coefficients are standard normal."""
        sooner = other_time(fit)
        about = About(fit, self.asked.about.phi, self.asked.about.root)
        return ([] if self.asked.two_encoders else yielding(fit, about)) + [
            {j: SHAPE_SPREAD * columns}
            for j in self.joints
            for columns in (
                shape_slopes(self.asked.plan, self.asked.links, fit.runs_, j),
                other_roundings(fit, j),
                sooner[j],
            )
        ]


def _torque(states: States) -> FloatArray:
    """Torque of the motors that the model predicts: usual sizes of columns are measured by it."""
    assert states.tau_motor is not None  # it was put there
    return states.tau_motor


def _in_units(h: Hypothesis, candidate: Candidate) -> Columns:
    """Columns of a hypothesis for the coefficients of a candidate, whose units were those of the runs."""
    factor = np.zeros(len(h.unit))
    width = min(len(h.unit), len(candidate.unit))  # of what a tilt brings out the motion may show fewer
    factor[:width] = candidate.unit[:width] / np.where(h.unit > 0, h.unit, np.inf)[:width]
    columns = {}
    for j, part in h.columns.items():
        own = np.zeros((len(part), len(candidate.unit)))
        own[:, :width] = (part * factor)[:, :width]
        columns[j] = own
    return columns
