"""Second pass: a run's rows at the shapes that the sample has decided, reduced to factors and products."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dynid_rs.archive.runs import RunSource, signals_of
from dynid_rs.archive.survey import Entry
from dynid_rs.archive.wide import FactorTree, cut_at_joints, observations_of, wide_factor
from dynid_rs.base.errors import DataError
from dynid_rs.identification.friction import friction_effect
from dynid_rs.identification.links import LinkDynamicsIdentifier
from dynid_rs.identification.loads import link_torque, with_load
from dynid_rs.identification.loops import FIRST_WIDTH, declared_plan
from dynid_rs.identification.residual import ResidualCompensator
from dynid_rs.identification.training import Excluded, prepare_training_run
from dynid_rs.model.known import KnownTerm, less_known
from dynid_rs.regression.columns import Observations, Plan, run_rows
from dynid_rs.regression.noise_spectrum import NoiseSpectrum, toeplitz_product
from dynid_rs.regression.uncertainty import noise_spectra, width_slope
from dynid_rs.runs.parts import is_part
from dynid_rs.runs.preprocessing import TOO_LITTLE, Band, States, is_of_load
from dynid_rs.runs.recording import Delay

if TYPE_CHECKING:
    from dynid_rs.identification.three_loops import ThreeLoopIdentifier

FloatArray = NDArray[np.float64]

PLANS = ("baseline", "two_loops", "model")
LEFT_OUT = "left_out"
"""Key of an entry of a part that nothing is learned from: why."""
_EXTREMES = ("q_low", "q_high", "dq_top", "ddq_top")


@dataclass(frozen=True, eq=False)
class Reduction:
    """What is done to every run.

    `plans`: columns of the baseline, of the two loops without a third where there is one, and of the model;
    `links, third, noise`: the sample's second and third loop and its residual's spectra, which give the load, what
    the third loop takes off, and the standard errors.
    """

    plans: dict[str, Plan]
    band: Band
    rate: float
    standstill: bool
    torque_delay: Delay
    excluded: Excluded
    encoder_delay: FloatArray
    encoder_error: FloatArray | None
    known: list[KnownTerm]
    links: LinkDynamicsIdentifier
    third: ResidualCompensator | None
    noise: list[NoiseSpectrum]

    @staticmethod
    def of(identifier: ThreeLoopIdentifier) -> Reduction:
        """Continue from loops that have run over the sample."""
        robot, in_memory, third = identifier.robot, identifier.in_memory_, identifier.residual_
        n = robot.n_joints
        kept = third is not None and bool(third.kept.any())
        plans = {"baseline": declared_plan(robot, friction_effect(np.zeros(n), np.full(n, FIRST_WIDTH)))}
        if kept:
            plans["two_loops"] = identifier.loops_.two_loops[0].plan
        plans["model"] = in_memory.observations.plan
        return Reduction(
            plans,
            identifier.band_,
            identifier.rate_,
            identifier.standstill,
            identifier.torque_delay,
            dict(identifier.excluded or {}),
            np.asarray(identifier.model_.encoder_delay),
            identifier.encoder_error,
            identifier.loops_.data.known,
            in_memory.links,
            third if kept else None,
            noise_spectra(in_memory.observations, in_memory.links, identifier.runs_, identifier.loops_.gains),
        )

    def widths(self, name: str) -> list[int]:
        """Columns of every joint in the factor `name`: those of its plan, the torque, of the model a slope as well."""
        plan = self.plans[name]
        return [len(plan.unknowns(j)) + 1 + (name == "model") for j in range(plan.robot.n_joints)]


@dataclass(frozen=True, eq=False)
class Reduced:
    """What is left of a run.

    `n_counted`: rows in which every joint moves, (n_joints,); `factors`: wide (`wide.py`), by plan; `products`
    (n_joints, k, k): ``C_j' Gamma_j C_j`` in the columns ``[own | base | width_slope]`` of the model, padded with
    zeros; `extremes`: of q, |dq|, |ddq|, (n_joints,) each.
    """

    n_rows: int
    n_counted: NDArray[np.int64]
    n_dropped: int
    factors: dict[str, FloatArray]
    products: FloatArray
    extremes: dict[str, FloatArray]

    def to_entry(self) -> Entry:
        """Plain data and arrays, of a factor the upper triangle."""
        plain = {"n_rows": self.n_rows, "n_dropped": self.n_dropped}
        upper = {f"factor_{name}": factor[np.triu_indices(len(factor))] for name, factor in self.factors.items()}
        return plain, upper | {"products": self.products, "n_counted": self.n_counted} | self.extremes

    @staticmethod
    def from_entry(entry: Entry) -> Reduced:
        """Inverse of `to_entry`."""
        plain, arrays = entry
        extremes = {name: arrays[name] for name in _EXTREMES}
        return Reduced(
            plain["n_rows"],
            arrays["n_counted"],
            plain["n_dropped"],
            {name: _triangle(arrays[f"factor_{name}"]) for name in PLANS if f"factor_{name}" in arrays},
            arrays["products"],
            extremes,
        )


def _triangle(upper: FloatArray) -> FloatArray:
    width = round((np.sqrt(8 * len(upper) + 1) - 1) / 2)
    factor = np.zeros((width, width))
    factor[np.triu_indices(width)] = upper
    return factor


def reduce_run(source: RunSource, reduction: Reduction) -> Entry:
    """Read one run again and reduce it: a unit of work. Of a part with too little motion only `LEFT_OUT` remains.

    Raises
    ------
    DataError, OSError
        It cannot be read, or holds too little motion and is no part.
    """
    recording = signals_of(source)
    windows = reduction.excluded.get(recording.name, ())
    try:
        states = prepare_training_run(
            recording,
            reduction.band,
            reduction.rate,
            windows,
            torque_delay=reduction.torque_delay,
            standstill=reduction.standstill,
        )
    except DataError as error:
        if error.code != TOO_LITTLE or not is_part(recording.name):
            raise
        return {LEFT_OUT: str(error)}, {}
    del recording  # nothing needs its full rate any more
    seen = _as_seen(states, reduction, reduction.encoder_delay)
    factors = {}
    for name, plan in reduction.plans.items():
        # The baseline comes before the delay is known.
        account = _as_seen(states, reduction, np.zeros_like(reduction.encoder_delay)) if name == "baseline" else seen
        if name != "model":
            factors[name] = wide_factor(run_rows(plan, _loaded(account, plan, reduction), account.tau))
    joints = _model_rows(seen, reduction)
    factors["model"] = wide_factor(joints)
    columns = [width - 1 for width in reduction.widths("model")]
    products = np.zeros((len(joints), max(columns), max(columns)))
    for j, (rows, width) in enumerate(zip(joints, columns, strict=True)):
        grid = np.zeros((len(seen.grid), width))
        grid[seen.moving[seen.grid]] = rows[:, :width]
        products[j, :width, :width] = toeplitz_product(grid, reduction.noise[j].spectrum)
    extremes = (states.q.min(axis=0), states.q.max(axis=0), *(np.abs(x).max(axis=0) for x in (states.dq, states.ddq)))
    return Reduced(
        len(states.rows),
        states.counted.sum(axis=0),
        int(np.sum(~states.moving)),
        factors,
        products,
        dict(zip(_EXTREMES, extremes, strict=True)),
    ).to_entry()


def _as_seen(states: States, reduction: Reduction, delay: FloatArray) -> States:
    return less_known(reduction.known, [states.aligned(delay, reduction.encoder_error)])[0]


def _loaded(states: States, plan: Plan, reduction: Reduction) -> States:
    """The run with the predicted torques, where an effect depends on it."""
    if not any(is_of_load(effect.signals) for effect in plan.effects):
        return states
    return with_load(reduction.plans["model"], reduction.links, reduction.links.own_)(states)


def _model_rows(states: States, reduction: Reduction) -> list[FloatArray]:
    """Rows ``[own | base | width_slope | torque less the third loop's]`` of every joint."""
    plan, links = reduction.plans["model"], reduction.links
    tau = states.tau
    if reduction.third is not None:
        tau = tau - reduction.third.torque(states, link_torque(plan, links, states))
    rows = run_rows(plan, _loaded(states, plan, reduction), tau)
    joints = []
    for j, joint in enumerate(rows):
        slope = width_slope(plan, states, j, links.own_[j, plan.friction[1]])
        joints.append(np.column_stack([joint[:, :-1], slope, joint[:, -1]]))
    return joints


class Totals:
    """Sum of all runs, added in their order; holds a handful of factors however many they are."""

    def __init__(self, reduction: Reduction) -> None:
        self.reduction = reduction
        self.n_rows, self.n_dropped = 0, 0
        self.n_counted = np.zeros(len(next(iter(reduction.plans.values())).own), dtype=np.int64)
        self.products: FloatArray | None = None
        self.extremes: dict[str, FloatArray] = {}
        self._trees = {name: FactorTree() for name in reduction.plans}

    def add(self, reduced: Reduced) -> None:
        """Take in the next run."""
        self.n_rows += reduced.n_rows
        self.n_counted = self.n_counted + reduced.n_counted
        self.n_dropped += reduced.n_dropped
        for name, tree in self._trees.items():
            tree.add(reduced.factors[name])
        self.products = reduced.products if self.products is None else self.products + reduced.products
        for name, values in reduced.extremes.items():
            pick = np.minimum if name == "q_low" else np.maximum
            self.extremes[name] = pick(self.extremes.get(name, values), values)

    def joints(self, name: str) -> list[FloatArray]:
        """Rows of every joint in place of all runs', in the columns of plan `name`, a slope and the torque behind."""
        return cut_at_joints(self._trees[name].total(), self.reduction.widths(name))

    def observations(self, name: str) -> Observations:
        """The same as observations of that plan."""
        joints = [np.delete(joint, -2, axis=1) if name == "model" else joint for joint in self.joints(name)]
        return observations_of(self.reduction.plans[name], joints, self.n_rows, self.n_counted)

    def noise_products(self) -> list[FloatArray]:
        """``C_j' Gamma_j C_j`` of every joint over all runs, without padding."""
        assert self.products is not None  # at least one run
        sizes = [width - 1 for width in self.reduction.widths("model")]
        return [self.products[j, :size, :size] for j, size in enumerate(sizes)]

    @property
    def domain(self) -> tuple[list[list[float]], list[float], list[float]]:
        """Extremes as a model holds them."""
        low, high, dq, ddq = (self.extremes[name] for name in _EXTREMES)
        return np.stack([low, high], axis=1).tolist(), dq.tolist(), ddq.tolist()
