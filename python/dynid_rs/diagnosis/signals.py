"""Signals that a leftover may depend on, and a few functions of each in the band: what any dependence is made of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.identification import ThreeLoopIdentifier
from dynid_rs.loops import link_torque
from dynid_rs.preprocessing import States

FloatArray = NDArray[np.float64]
Signal = tuple[str, int]
"""Name and joint; the joint of what belongs to the whole run is -1."""

STATE = ("q", "dq", "ddq", "tau_link")
"""Signals that a model can be given online; position and velocity are the motor side's, the load is predicted.
"reversal", the way since the joint last turned round, and "time" since the run began are named, but no inputs."""

HARMONICS = 4
"""Cycles per turn up to which a position's functions go: faster ones are ripple, which has a kind of its own."""
TEETH = 10
"""Waves per turn up to which the sum and the difference of two angles are looked at: what turns with both of them."""
BUMPS = 14
"""Bumps along a position that is looked at alone: springs with corners, stops and dead zones are made of them."""
ROUGH = 0.5
"""Expected size of such a wave or bump, as `Basis.weights`."""
PRESLIDING = (3e-3, 1e-2, 3e-2)
"""Ways [rad] over which friction may still turn round."""
FEW = {"q": 7, "dq": 3, "ddq": 2, "tau_link": 2}
"""How many of a signal's functions enter products of many."""
SLIDE_ANGLE = 1.5
"""A sliding joint's half range counts as this angle."""


@dataclass(frozen=True, eq=False)
class Basis:
    """Functions of one signal, (n,) -> (n, n_functions), each divided by its spread and times its weight.

    Parameters
    ----------
    signal : (str, int)
        What they are functions of.
    centre, spread : float
        Middle and half range of a position; 0 and RMS of everything else, in the signal's unit.
    width : float
        Of a velocity's change of sign [rad/s].
    turning : bool
        Whether a position is an angle.
    weights : ndarray (n_functions,)
        How large each is expected to be: less, the wilder it is.
    """

    signal: Signal
    centre: float
    spread: float
    width: float
    turning: bool

    def __call__(self, x: FloatArray) -> FloatArray:
        """Functions at `x` (n,), without weights."""
        z = (x - self.centre) / self.spread
        name = self.signal[0]
        if name == "q":
            angle = x if self.turning else SLIDE_ANGLE * z
            waves = [wave(n * angle) for n in range(1, HARMONICS + 1) for wave in (np.cos, np.sin)]
            return np.stack([z, z**2, z**3, *waves], axis=1)
        if name == "dq":
            return np.stack([direction(x, self.width), z, np.abs(z), z * np.abs(z), z**3], axis=1)
        if name == "ddq":
            return np.stack([z, np.abs(z), z * np.abs(z)], axis=1)
        if name == "tau_link":
            return np.stack([z, np.abs(z), z * np.abs(z), direction(z, 0.1)], axis=1)
        return np.stack([z, z**2], axis=1)

    @property
    def weights(self) -> FloatArray:
        """Expected size of each function, (n_functions,)."""
        waves = np.repeat(1 / np.arange(1.0, HARMONICS + 1), 2)
        return {
            "q": np.concatenate([[2.0, 1.5, 1.0], waves]),
            "dq": np.array([1.0, 1.0, 1.0, 0.7, 0.5]),
            "ddq": np.array([1.0, 1.0, 0.7]),
            "tau_link": np.array([1.0, 1.0, 0.7, 0.7]),
        }.get(self.signal[0], np.ones(2))


def direction(x: FloatArray, width: float) -> FloatArray:
    """Smoothed sign of `x` (n,), that of the core's effects: what friction is under a load of one."""
    effect = _core.Effect.of("load_dependent_friction", transition_width=[width])
    still, load = np.zeros((len(x), 1)), np.ones((len(x), 1))
    return np.asarray(_core.effect_columns(effect, still, x[:, None], still, tau_link=load)[:, 0, 0])


@dataclass(frozen=True, eq=False)
class Candidates:
    """Candidate signals of a fit's training rows.

    `signals` in order; `bases` of those of `STATE` and of time; `states` {signal: (n_samples,)} as they are at every
    sample of all runs; `values` {signal: (n_rows,)} in the band over all blocks; `functions`
    {signal: (n_rows, n_functions)} in the band, of unit spread times weight; `scales` what they were divided by;
    `further` {signals: ((n_rows, n_functions) in the band, scales)} of `further_functions`.
    """

    signals: tuple[Signal, ...]
    bases: dict[Signal, Basis]
    states: dict[Signal, FloatArray]
    values: dict[Signal, FloatArray]
    functions: dict[Signal, FloatArray]
    scales: dict[Signal, FloatArray]
    further: dict[tuple[Signal, ...], tuple[FloatArray, FloatArray]]

    def of_joint(self, j: int) -> tuple[Signal, ...]:
        """Those that joint j's leftover may depend on: its own way since reversal, nobody else's."""
        return tuple(signal for signal in self.signals if signal[0] != "reversal" or signal[1] == j)

    def few(self, signal: Signal) -> slice:
        """The tamest functions of a signal, for products of many."""
        return slice(FEW.get(signal[0], 1))


def candidate_signals(fit: ThreeLoopIdentifier) -> Candidates:
    """Signals of the training runs of a fitted model."""
    runs: Sequence[States] = fit.runs_
    plan = fit.observations_.plan
    kinds, widths = fit.robot.joint_kinds, dict(plan.friction[0].shape)["transition_width"]
    load = [link_torque(plan, fit.links_, states) for states in runs]
    given: dict[Signal, list[FloatArray]] = {}
    for name, parts in zip(
        STATE, zip(*(state_signals(s, u) for s, u in zip(runs, load, strict=True)), strict=True), strict=True
    ):
        for j in range(fit.robot.n_joints):
            given[name, j] = [part[:, j] for part in parts]
    given["time", -1] = [states.t - states.t[0] for states in runs]
    bases, every, values, functions, scales = {}, {}, {}, {}, {}
    for signal, x in given.items():
        name, j = signal
        every[signal] = np.concatenate(x)
        basis = _basis(signal, every[signal], name == "q" and kinds[j] != "prismatic", widths[j])
        bases[signal] = basis
        values[signal] = np.concatenate([s.in_band(part) for s, part in zip(runs, x, strict=True)])
        columns = [s.in_band(basis(part)) for s, part in zip(runs, x, strict=True)]
        functions[signal], scales[signal] = _scaled(np.concatenate(columns), basis.weights)
    for j in range(fit.robot.n_joints):
        signal = ("reversal", j)
        ways = [(way_since_reversal(s.q_motor[:, j], s.dq_motor[:, j]), s.dq_motor[:, j]) for s in runs]
        values[signal] = np.concatenate([s.in_band(way) for s, (way, _) in zip(runs, ways, strict=True)])
        columns = [s.in_band(_memory(way, direction(dq, widths[j]))) for s, (way, dq) in zip(runs, ways, strict=True)]
        functions[signal], scales[signal] = _scaled(np.concatenate(columns), np.ones(len(PRESLIDING)))
    positions: list[tuple[Signal, ...]] = [(("q", j),) for j in range(fit.robot.n_joints)]
    turning: list[Signal] = [("q", j) for j in range(fit.robot.n_joints) if kinds[j] != "prismatic"]
    further: dict[tuple[Signal, ...], tuple[FloatArray, FloatArray]] = {}
    for chosen in (*positions, *combinations(turning, 2)):
        states = [np.stack([s.q_motor[:, j] for _, j in chosen], axis=1) for s in runs]
        columns = [s.in_band(further_functions(chosen, bases, u)) for s, u in zip(runs, states, strict=True)]
        rows = np.concatenate(columns)
        further[chosen] = _scaled(rows, np.full(rows.shape[1], ROUGH))
    return Candidates(tuple(values), bases, every, values, functions, scales, further)


def further_functions(signals: Sequence[Signal], bases: Mapping[Signal, Basis], u: FloatArray) -> FloatArray:
    """Bumps along one position, or waves of the sum and the difference of two angles; u (n, n_signals) to (n, k).

    A shaft behind a differential, as in many wrists, turns with both joints; products of each angle's own slow waves
    do not reach its teeth.
    """
    if len(signals) == 1:
        basis = bases[signals[0]]
        centres = basis.centre + basis.spread * np.linspace(-1.0, 1.0, BUMPS)
        return np.maximum(0.0, 1.0 - np.abs(u - centres) * (BUMPS - 1) / (2 * basis.spread))
    first, second = u.T
    turned = [n * angle for angle in (first + second, first - second) for n in range(1, TEETH + 1)]
    return np.stack([wave(angle) for angle in turned for wave in (np.cos, np.sin)], axis=1)


def state_signals(states: States, tau_link: FloatArray) -> tuple[FloatArray, ...]:
    """Signals of `STATE` in their order, (n, n_joints) each; `tau_link` (n, n_joints) the predicted load [N m]."""
    return states.q_motor, states.dq_motor, states.ddq_motor, tau_link


def way_since_reversal(q: FloatArray, dq: FloatArray) -> FloatArray:
    """Way [rad] since the velocity last changed its sign, (n,)."""
    turns = np.flatnonzero(np.diff(np.sign(dq)) != 0) + 1
    edges = np.concatenate([[0], turns])
    start = edges[np.searchsorted(edges, np.arange(len(q)), side="right") - 1]
    return np.asarray(np.abs(q - q[start]))


def _memory(way: FloatArray, sign: FloatArray) -> FloatArray:
    """What is left of the old direction after `way`, (n, n_functions)."""
    return np.stack([sign / (1 + way / distance) for distance in PRESLIDING], axis=1)


def _basis(signal: Signal, x: FloatArray, turning: bool, width: float) -> Basis:
    if signal[0] == "q":
        low, high = float(x.min()), float(x.max())
        return Basis(signal, (low + high) / 2, max((high - low) / 2, 1e-9), width, turning)
    centre = float(x.mean()) if signal[0] == "time" else 0.0
    return Basis(signal, centre, max(float(np.sqrt(np.mean((x - centre) ** 2))), 1e-12), width, turning)


def _scaled(columns: FloatArray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    spread = np.sqrt(np.mean(columns**2, axis=0))
    scale = np.where(spread > 0, spread, 1.0) / weights
    return columns / scale, scale
