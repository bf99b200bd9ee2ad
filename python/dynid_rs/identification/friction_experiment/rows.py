"""Pairs as rows of the fit: half the difference of two rows is odd in speed, half the sum is even (Eqs. 6-8).

Coriolis torque is even in speed (Eq. 3), so that it and gravity are in the even rows alone.

Rows, not torques, are subtracted: what differs between the two sides (speeds are never exact) stays in the equation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.identification.friction import SearchRun
from dynid_rs.identification.friction_experiment.pairs import Mirror, find_mirrors, in_motion, still_speed
from dynid_rs.identification.links import RowGroup
from dynid_rs.regression.columns import Plan, run_rows
from dynid_rs.runs.preprocessing import States

FloatArray = NDArray[np.float64]
Indices = NDArray[np.intp]

_SIGNALS = ("t", "q", "dq", "ddq", "q_motor", "dq_motor", "ddq_motor", "tau", "moving")


@dataclass(frozen=True, eq=False)
class PairWindow:
    """A mirror cut out of its run, with room for the filter on both sides.

    `after`, `before` (n_pairs,) samples of `states` that belong together; `used` (n_joints, n_pairs) where a joint is
    in motion on both sides. `every` (2, n) and `every_used` (n_joints, n) are the same before they are thinned out.
    """

    states: States
    after: Indices
    before: Indices
    used: NDArray[np.bool_]
    every: Indices
    every_used: NDArray[np.bool_]

    def of_joint(self, j: int) -> tuple[list[int], list[int]]:
        """Samples of joint j's pairs, after and before the mirror."""
        return self.after[self.used[j]].tolist(), self.before[self.used[j]].tolist()


@dataclass(frozen=True, eq=False)
class OddTorque:
    """Odd part of one joint's torque at its pairs, for the search of friction's shape.

    `runs` as `_core.FrictionSearch` takes them, `tau` (n_pairs,), `noise` of the velocity [rad/s]; `beside`
    (n_pairs, k) are columns of other odd effects, which are fitted too. `sides` (2, n) and `raw` (n,) are the speeds
    on both sides and the odd torque at every sample, not low-passed: a jump is placed best where nothing blurs it.
    """

    runs: list[SearchRun]
    tau: FloatArray
    noise: float
    beside: FloatArray
    sides: FloatArray
    raw: FloatArray


def pair_windows(runs: Sequence[States], mirrors: Sequence[Sequence[Mirror]] | None = None) -> list[PairWindow]:
    """Cut the mirrors of friction runs out; `find_mirrors` finds them if they are not given."""
    windows = []
    for k, states in enumerate(runs):
        found = find_mirrors(states) if mirrors is None else mirrors[k]
        limit = still_speed(states)
        moving = np.array([in_motion(states, j, limit[j]) for j in range(len(limit))])
        windows += [window for mirror in found if (window := _window(mirror, moving)) is not None]
    return windows


def _window(mirror: Mirror, moving: NDArray[np.bool_]) -> PairWindow | None:
    states = mirror.states
    places, images = mirror.samples()
    every = np.stack([places, np.round(images).astype(np.intp)])
    every_used = moving[:, every[0]] & moving[:, every[1]] & mirror.moves[:, None]
    (after, before), used = every[:, :: states.step], every_used[:, :: states.step]
    wanted = used.any(axis=0)
    if not wanted.any():
        return None
    after, before, used = after[wanted], before[wanted], used[:, wanted]
    pad = states.filter[2] + 1 if states.filter is not None else 0
    reached = every[:, every_used.any(axis=0)]  # more than the thinned samples: a short motion may fall between them
    start, end = max(0, int(reached.min()) - pad), min(len(states.t), int(reached.max()) + 1 + pad)
    names = [*_SIGNALS, *(name for name in ("tau_link", "tau_motor") if getattr(states, name) is not None)]
    signals: dict[str, Any] = {name: np.ascontiguousarray(getattr(states, name)[start:end]) for name in names}
    cut = replace(states, **signals)
    return PairWindow(cut, after - np.intp(start), before - np.intp(start), used, every - np.intp(start), every_used)


def pair_rows(plan: Plan, windows: Sequence[PairWindow]) -> tuple[list[FloatArray], list[FloatArray]]:
    """Odd and even rows of every joint, (n_pairs, n_own + base columns + 1) each.

    Half the difference (Eq. 7) and half the sum of the two equations (Eq. 6) of a pair.
    """
    n = plan.robot.n_joints
    odd: list[list[FloatArray]] = [[] for _ in range(n)]
    even: list[list[FloatArray]] = [[] for _ in range(n)]
    for window in windows:
        kept = np.union1d(window.after, window.before)
        rows = run_rows(plan, window.states, window.states.tau, kept=kept.tolist())
        after, before = np.searchsorted(kept, window.after), np.searchsorted(kept, window.before)
        for j in range(n):
            first, second = rows[j][after[window.used[j]]], rows[j][before[window.used[j]]]
            odd[j].append((first - second) / 2)
            even[j].append((first + second) / 2)
    none = [np.zeros((0, len(plan.unknowns(j)) + 1)) for j in range(n)]
    return (
        [np.concatenate([none[j], *odd[j]]) for j in range(n)],
        [np.concatenate([none[j], *even[j]]) for j in range(n)],
    )


def row_groups(rows: Sequence[Sequence[FloatArray]]) -> list[RowGroup]:
    """Groups of rows that the second loop takes beside the training runs' own."""
    return [
        RowGroup([_core.triangular_factor(joint) for joint in part], np.array([len(joint) for joint in part]))
        for part in rows
    ]


def odd_torques(
    plan: Plan, windows: Sequence[PairWindow], odd: Sequence[FloatArray], phi_base: FloatArray, scale: FloatArray
) -> list[OddTorque | None]:
    """What the search for friction's shape sees of every joint; None where a joint has no pair.

    Sides that differ a little leave a little of the links' torque, which `phi_base` (n_base,) takes out.
    """
    kinds = [effect.kind for effect in plan.effects for _ in range(effect.n_columns)]
    odd_own = np.array([kind == "stribeck" for kind in kinds])
    torques: list[OddTorque | None] = []
    for j, rows in enumerate(odd):
        parts = [(window, *window.of_joint(j)) for window in windows if window.used[j].any()]
        if not parts:
            torques.append(None)
            continue
        base = phi_base[plan.pivots >= 10 * j]
        tau = rows[:, -1] - scale[j] * (rows[:, plan.n_own : -1] @ base)
        runs: list[SearchRun] = [
            (np.ascontiguousarray(window.states.dq_motor[:, j]), window.states.filter, after, before)
            for window, after, before in parts
        ]
        noise = max(window.states.velocity_noise(j) for window, _, _ in parts)
        beside = rows[:, : plan.n_own][:, odd_own & plan.own[j]]
        torques.append(OddTorque(runs, tau, noise, beside, *_every_sample(windows, j)))
    return torques


def _every_sample(windows: Sequence[PairWindow], j: int) -> tuple[FloatArray, FloatArray]:
    """Speeds of joint j on both sides (2, n) and its odd torque (n,) at every sample of its pairs."""
    sides, odd = [], []
    for window in windows:
        after, before = window.every[:, window.every_used[j]]
        speed, tau = window.states.dq_motor[:, j], window.states.tau[:, j]
        sides.append(np.stack([speed[after], speed[before]]))
        odd.append((tau[after] - tau[before]) / 2)
    return np.concatenate(sides, axis=1), np.concatenate(odd)
