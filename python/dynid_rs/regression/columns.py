"""Columns of the declared model, run by run: filtered rows and triangular factors, one set per joint.

Rows of joint j are ``[own columns | base columns of the links it moves | torque]`` (Eq. 2, one joint). Own columns are
those of the effects: rotor inertia, torque offset, friction (Eqs. 9-11, or the smooth law), and whatever was added.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise, product

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.base.threads import side_by_side
from dynid_rs.regression.kept_columns import observed
from dynid_rs.runs.preprocessing import States
from dynid_rs.runs.returns import phases

FloatArray = NDArray[np.float64]


FRICTION = ("friction", "smooth_friction")
"""Kinds that every declared model has one of."""


@dataclass(frozen=True, eq=False)
class Plan:
    """Which columns a fit has.

    `effects` with their shapes; `pivots` (n_base,) indices of the base columns in phi; `own` (n_joints, n_own) which
    of a joint's own columns can be told apart from the rest; `absorbed` {(joint, own column): (n_base,)} how much of
    one that cannot is in each base parameter, where base parameters alone hold it.
    """

    robot: _core.RobotModel
    effects: tuple[_core.Effect, ...]
    pivots: NDArray[np.int64]
    own: NDArray[np.bool_]
    absorbed: dict[tuple[int, int], FloatArray] = field(default_factory=dict)

    @property
    def n_base(self) -> int:
        """Number of base columns."""
        return len(self.pivots)

    @property
    def n_own(self) -> int:
        """Own columns of one joint, those included that cannot be told apart."""
        return int(self.own.shape[1])

    @cached_property
    def places(self) -> list[tuple[_core.Effect, slice]]:
        """Every effect and its places among the own columns."""
        edges = np.cumsum([0, *(effect.n_columns for effect in self.effects)]).tolist()
        return [(effect, slice(*at)) for effect, at in zip(self.effects, pairwise(edges), strict=True)]

    @property
    def friction(self) -> tuple[_core.Effect, slice]:
        """The law of friction among the effects, and its places among the own columns."""
        return next((effect, at) for effect, at in self.places if effect.kind in FRICTION)

    def terms(self, own: FloatArray) -> list[tuple[_core.Effect, FloatArray]]:
        """Return effects with their coefficients (n_joints, n_columns) among `own` (n_joints, n_own)."""
        return [(effect, own[:, at]) for effect, at in self.places]

    @property
    def n_columns(self) -> int:
        """Unknowns of the whole fit: base parameters, then own coefficients joint by joint."""
        return self.n_base + self.own.size

    def unknowns(self, j: int) -> NDArray[np.intp]:
        """Places of joint j's columns ``[own | base]`` among all unknowns."""
        return self._unknowns[j]

    @cached_property
    def _unknowns(self) -> list[NDArray[np.intp]]:
        own = self.n_base + np.arange(self.n_own)
        base = [np.flatnonzero(self.pivots >= 10 * j) for j in range(len(self.own))]
        return [np.concatenate([own + j * self.n_own, links]) for j, links in enumerate(base)]

    @cached_property
    def acting(self) -> NDArray[np.bool_]:
        """(n_joints, n_effects) where each effect acts: a declared one on every joint."""
        used = [self.own[:, at].any(axis=1) for _, at in self.places]
        return np.stack(used, axis=1) | [effect.is_declared for effect in self.effects]

    def estimable(self) -> NDArray[np.bool_]:
        """(n_columns,) false for own columns that repeat others."""
        return np.concatenate([np.ones(self.n_base, dtype=bool), self.own.ravel()])


def make_plan(
    robot: _core.RobotModel,
    effects: Sequence[_core.Effect],
    *,
    acts_on: Mapping[int, Collection[int]] | None = None,
    apart: NDArray[np.bool_] | None = None,
    random_state: int = 0,
) -> Plan:
    """Base columns of the rigid body, and those of the effects that add something to them.

    A rotor's inertia is not told from the link's own where nothing but the joint's axis sees both (the first joint of
    most arms); a constant torque is not told from gravity on a vertical slide. The paper's friction is taken as it is:
    whether it can be told apart depends on the speeds of the run. So does what remembers: it is not probed.

    Parameters
    ----------
    robot : RobotModel
        Kinematics and gravity.
    effects : sequence of Effect
        With their shapes, summed in this order.
    acts_on : mapping, optional
        Place in `effects` to the joints that it acts on; their number is not limited by default.
    apart : ndarray (n_joints,), optional
        Joints whose motor and link move apart, so that a rotor is told from the link behind an elastic gear, however
        weakly: for fits that have a prior. None by default.
    random_state : int
        Seed of the states that are probed.
    """
    base = robot.base_parameters(random_state)
    pivots = np.asarray(base.pivots)
    n = robot.n_joints
    widths = [effect.n_columns for effect in effects]
    q, dq, ddq, tau_link, temperature = _probing_states(n, 40 + 2 * sum(widths), random_state)
    moved = np.zeros(n, dtype=bool) if apart is None else apart
    motor = _probing_states(n, len(q), random_state + 1)[:3]
    q_motor, dq_motor, ddq_motor = (
        np.where(moved, there, here) for there, here in zip(motor, (q, dq, ddq), strict=True)
    )
    rigid = base.reduce(robot.joint_torque_regressor(q, dq, ddq)).reshape(-1, base.n_base)
    known, _ = np.linalg.qr(rigid / np.linalg.norm(rigid, axis=0))
    own = np.ones((n, sum(widths)), dtype=bool)
    absorbed: dict[tuple[int, int], FloatArray] = {}
    for place, (effect, first) in enumerate(zip(effects, np.cumsum([0, *widths]), strict=False)):
        acting = range(n) if acts_on is None else acts_on.get(place, range(n))
        own[[j for j in range(n) if j not in acting], first : first + effect.n_columns] = False
        if effect.has_memory:
            continue
        motion = q, dq, ddq, q_motor, dq_motor, ddq_motor
        columns = _core.effect_columns(effect, *motion, tau_link, tau_motor=tau_link, temperature=temperature)
        for j, k in product(acting, range(effect.n_columns)):
            probe = np.zeros((len(q), n))
            probe[:, j] = columns[:, j, k]
            vector = probe.ravel()
            left = vector - known @ (known.T @ vector)
            left -= known @ (known.T @ left)
            if np.linalg.norm(left) > 1e-8 * np.linalg.norm(vector):
                known = np.column_stack([known, left / np.linalg.norm(left)])
            elif effect.kind not in FRICTION:
                own[j, first + k] = False
                share, *_ = np.linalg.lstsq(rigid, vector, rcond=None)
                if np.linalg.norm(vector - rigid @ share) < 1e-8 * np.linalg.norm(vector):
                    absorbed[j, int(first) + k] = np.asarray(share, dtype=np.float64)
    return Plan(robot, tuple(effects), pivots, own, absorbed)


def _probing_states(n: int, n_samples: int, random_state: int) -> list[FloatArray]:
    """Random q, dq, ddq, load, temperature (n_samples, n); every other speed is small, where friction turns."""
    rng = np.random.default_rng(random_state)
    q, dq, ddq, tau_link = rng.uniform(-3.0, 3.0, (4, n_samples, n))
    dq[::2] *= 10.0 ** rng.uniform(-4.0, 0.0, dq[::2].shape)
    return [q, dq, ddq, tau_link, rng.uniform(15.0, 60.0, q.shape)]


@dataclass(frozen=True, eq=False)
class Block:
    """A stretch of consecutive rows that is fitted or left out as a whole: a run, or a part of a lone one.

    `stands_for`: rows per joint that `rows` are a factor of (`archive/wide.py`), and in how many of them every joint
    moves, (n_joints,); None where they are the rows themselves.
    """

    run: int
    rows: list[FloatArray]
    factors: list[FloatArray]
    stands_for: tuple[int, NDArray[np.int64]] | None = None

    @property
    def n_rows(self) -> int:
        """Rows per joint."""
        return len(self.rows[0]) if self.stands_for is None else self.stands_for[0]

    @cached_property
    def counted(self) -> NDArray[np.bool_]:
        """Joints that move at the rows, (n_rows, n_joints): zeros say nothing."""
        counted: NDArray[np.bool_] = np.stack([part.any(axis=1) for part in self.rows], axis=1)
        return counted

    @property
    def n_counted(self) -> NDArray[np.int64]:
        """Rows of every joint in which it moves, (n_joints,)."""
        return self.counted.sum(axis=0) if self.stands_for is None else self.stands_for[1]


@dataclass(frozen=True, eq=False)
class Observations:
    """Rows and factors of all training blocks.

    `runs`: where they are in memory.
    """

    plan: Plan
    blocks: list[Block]
    runs: tuple[States, ...] = ()

    @property
    def phase(self) -> NDArray[np.int64]:
        """Phase of the motion at every row of runs in memory, (n_rows,) (`runs/returns.py`)."""
        return phases(self.runs)

    @property
    def n_rows(self) -> int:
        """Rows per joint over all blocks."""
        return sum(block.n_rows for block in self.blocks)

    @cached_property
    def n_counted(self) -> NDArray[np.int64]:
        """Rows of every joint in which it moves, (n_joints,)."""
        total: NDArray[np.int64] = np.sum([block.n_counted for block in self.blocks], axis=0)
        return total

    def by_run(self, parts: Sequence[FloatArray]) -> list[FloatArray]:
        """Put together what belongs to one run from one array per block."""
        runs = [block.run for block in self.blocks]
        return [
            np.concatenate([part for part, run in zip(parts, runs, strict=True) if run == k]) for k in sorted(set(runs))
        ]

    def joint_rows(self) -> list[FloatArray]:
        """Rows of every joint, all blocks under each other, (n_rows, k + 1) each."""
        return [np.concatenate(parts) for parts in zip(*(block.rows for block in self.blocks), strict=True)]

    def rows_with(self, torque: Sequence[FloatArray]) -> list[list[FloatArray]]:
        """Rows of every run and joint with another torque, (n_rows, n_joints) each, in the last column."""
        joints = [self.by_run([block.rows[j] for block in self.blocks]) for j in range(len(self.blocks[0].rows))]
        return [
            [np.column_stack([rows[k][:, :-1], tau[:, j] * rows[k].any(axis=1)]) for j, rows in enumerate(joints)]
            for k, tau in enumerate(torque)
        ]

    def factors(self, leave_out: int | None = None) -> list[FloatArray]:
        """Merged factor of every joint, without block `leave_out` if given. Never reads the data again."""
        kept = [block for k, block in enumerate(self.blocks) if k != leave_out]
        return [_core.merge_factors([block.factors[j] for block in kept]) for j in range(len(kept[0].factors))]


def observe(
    plan: Plan,
    runs: Sequence[States],
    tau: Sequence[FloatArray] | None = None,
) -> Observations:
    """Rows and factors of `runs`; `tau` (n, n_joints) each replaces the measured torque, e.g. less the third loop's.

    A lone run is cut in three blocks, so that something can always be left out.
    """

    def blocks(k: int) -> list[Block]:
        states = runs[k]
        rows = run_rows(plan, states, states.tau if tau is None else tau[k])
        parts = [slice(None)] if len(runs) > 1 else _thirds(len(states.rows))
        cuts = [[joint[part] for joint in rows] for part in parts]
        return [Block(k, cut, [_core.triangular_factor(joint) for joint in cut]) for cut in cuts]

    return Observations(plan, [block for own in side_by_side(blocks, range(len(runs))) for block in own], tuple(runs))


def run_rows(
    plan: Plan,
    states: States,
    tau: FloatArray,
    *,
    kept: list[int] | None = None,
) -> list[FloatArray]:
    """Filtered, decimated rows of one run: per joint (n_rows, n_own + base columns + 1), at samples `kept` if given.

    Where a joint rests while others move its rows are zero: they say nothing. At samples that are `kept` on purpose
    all is told.
    """
    if kept is None:
        acts_on = [np.flatnonzero(joints).tolist() for joints in plan.acting.T]
        rows = observed(plan.robot, list(plan.effects), acts_on, plan.pivots.tolist(), states, tau)
        return counted_rows(rows, states.counted)
    return _core.observe(
        plan.robot,
        list(plan.effects),
        plan.pivots.tolist(),
        *states.signals(),
        tau,
        filter=states.filter,
        kept=kept,
        tau_link=states.tau_link,
        tau_motor=states.tau_motor,
        step=1 / states.rate,
        temperature=states.temperature,
    )


def counted_rows(rows: Sequence[FloatArray], counted: NDArray[np.bool_]) -> list[FloatArray]:
    """Rows of every joint, zero where it does not count, (n_rows, n_joints)."""
    return [
        part if moves.all() else np.where(moves[:, None], part, 0.0)
        for part, moves in zip(rows, counted.T, strict=True)
    ]


def _thirds(n: int) -> list[slice]:
    edges = np.linspace(0, n, 4).astype(int)
    return [slice(first, last) for first, last in pairwise(edges)]
