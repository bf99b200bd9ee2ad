"""Candidates of the catalogue: every kind, joint, pair and shape as columns beside the model."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.diagnosis.availability import LEAST_WARMTH
from dynid_rs.diagnosis.candidate import Candidate, RunColumns, stacked
from dynid_rs.diagnosis.dead_point import KIND as CYLINDER
from dynid_rs.diagnosis.dead_point import built_for_weight
from dynid_rs.diagnosis.hypothesis import REFINED, Hypothesis, Shape, bounds_of, is_valid, of_partner
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.identification import ThreeLoopIdentifier
from dynid_rs.loops import link_load
from dynid_rs.placed import CATALOGUE
from dynid_rs.preprocessing import States

FloatArray = NDArray[np.float64]

RIPPLES = (4, 24)
"""Ripple orders that the band's scan tries: slower ones are not told from gravity, springs and cylinders, faster ones
are sought in the angle."""
LEAST_WAVES = 1.0
"""Waves of a ripple that a joint has to go through in one run before it is looked for."""
CHUNK = 48
"""Effects whose columns are built in one pass over a run; more would only take more memory."""
COARSE = {
    ("counterbalance", "b"): [0.2, 0.35, 0.6],
    ("counterbalance", "gas_length"): [0.75, 1.25, 10.0, -1.5],
    ("thermal_friction", "time_constant"): [10.0, 30.0, 100.0],
}
"""Grids of the scan where the catalogue's is finer than a search needs to begin with, or reaches beyond a run."""
WINDS = (0.03, 0.1, 0.3, 1.0)
"""Loads over which a gear's teeth turn round, over the load's standard deviation."""
CARRIED = 0.05
"""Load that slipping teeth carry, over the load's standard deviation, with which its search begins."""
UNSOUGHT = ("load_hysteresis",)
"""Kinds that can be declared and are not looked for: load with memory is what load-dependent friction and hysteresis
tell together, and those are two causes that a person can act on."""
NEIGHBOURS = ("coupled_friction",)
"""Kinds of two joints in one housing: only joints that follow each other share a gear."""
LEAST_LOAD = 0.05
"""Part of some joint's torque that weight has to be, or nothing is looked for that follows the load."""
N_PLACES = 50
"""Places of a run at which joint inertias are looked at."""


class Kinds:
    """Columns of hypotheses along the training runs of a fit, computed once each.

    Parameters
    ----------
    fit : ThreeLoopIdentifier
        Gives the runs, the load and friction's transition widths.
    before : Kinds, optional
        Of an earlier fit to the same runs: columns that do not depend on the load are taken over.
    """

    def __init__(self, fit: ThreeLoopIdentifier, before: Kinds | None = None) -> None:
        self._robot = fit.robot
        load = link_load(fit.observations_.plan, fit.links_)
        self.runs: list[States] = [replace(states, tau_link=load(states)) for states in fit.runs_]
        # A rotor without weight has a load of its own acceleration alone, and that is mostly the encoder's noise.
        still = [replace(states, dq=0 * states.dq, ddq=0 * states.ddq) for states in fit.runs_]
        weight = np.concatenate([load(states) for states in still])
        self._load_scatter = np.concatenate([states.tau_link for states in self.runs]).std(axis=0)
        tau = np.concatenate([states.tau for states in fit.runs_])
        self.weight = weight.std(axis=0)
        self._carries_weight = bool(np.any(self.weight > LEAST_LOAD * tau.std(axis=0)))
        self._turns = np.max([np.ptp(states.q, axis=0) for states in self.runs], axis=0) / (2 * np.pi)
        q = np.concatenate([states.q for states in self.runs])
        self.belief = built_for_weight(fit.robot, q) if fit.links_.prior == "robot" else None
        self.hidden_rotor = np.where(fit.observations_.plan.own[:, 0], 0.0, _inertias(fit))
        friction, _ = fit.observations_.plan.friction
        self.widths = np.asarray(dict(friction.shape)["transition_width"])
        self.thresholds = np.asarray(dict(friction.shape)["velocity_threshold"])
        self._friction = fit.links_.own_[:, fit.observations_.plan.friction[1]]
        self._cache: dict[Hypothesis, list[RunColumns]] = {}
        if before is not None and _same_motion(before.runs, self.runs):
            self._cache = {
                h: columns for h, columns in before._cache.items() if "tau_link" not in CATALOGUE[h.kind]["signals"]
            }

    def grid(self, kinds: Sequence[str] | None = None) -> list[Hypothesis]:
        """Every kind at every place with every shape of its grid."""
        n = self._robot.n_joints
        wanted = [k for k, e in CATALOGUE.items() if not e["declared"]]
        wanted = [k for k in wanted if (k not in UNSOUGHT if kinds is None else k in kinds)]
        out: list[Hypothesis] = []
        for kind in wanted:
            if any(rule == "partner" for rule in _rules(kind)):
                reach = 1 if kind in NEIGHBOURS else n
                places: list[tuple[int, ...]] = [(j, k) for j in range(n) for k in range(j + 1, min(j + reach + 1, n))]
            else:
                places = [(j,) for j in range(n)]
            for place in places:
                if "tau_link" in CATALOGUE[kind]["signals"] and not self._carries_weight:
                    continue
                if kind in TURNING and any(self._robot.joint_kinds[j] != "revolute" for j in place):
                    continue
                if "temperature" in CATALOGUE[kind]["signals"] and not all(map(self._warms, place)):
                    continue
                if kind == CYLINDER and self.belief is not None and not self.belief.allows(place[0]):
                    continue
                if kind in BENDING and not all(map(self._bends, place)):
                    continue
                shapes = self._shapes(kind, place[0])
                out += [Hypothesis(kind, place, shape) for shape in shapes if self._seen_whole(kind, place[0], shape)]
        return out

    def _seen_whole(self, kind: str, j: int, shape: Shape) -> bool:
        """Whether joint j went through a wave of the ripple: part of a wave is any curve, and says nothing beyond."""
        return kind != "torque_ripple" or dict(shape)["cycles"] * self._turns[j] >= LEAST_WAVES

    def _warms(self, j: int) -> bool:
        """Whether the temperature of joint j is measured, and changes enough to tell anything."""
        shown = [states.temperature[:, j] for states in self.runs if states.temperature is not None]
        return len(shown) == len(self.runs) and float(np.ptp(np.concatenate(shown))) > LEAST_WARMTH

    def _bends(self, j: int) -> bool:
        """Whether all runs have two encoders, and those of joint j ever show a deflection."""
        both = all(states.two_encoders for states in self.runs)
        return both and any(np.ptp(states.q_motor[:, j] - states.q[:, j]) > 0 for states in self.runs)

    def _shapes(self, kind: str, j: int) -> Iterator[Shape]:
        parameters = CATALOGUE[kind]["shape"]
        values: list[list[float]] = []
        for parameter in parameters:
            name = parameter["name"]
            if name == "transition_width":
                values.append([float(self.widths[j])])
            elif name == "partner":
                values.append([-1.0])
            elif name == "hysteresis_load":
                values.append([part * float(self._load_scatter[j]) for part in WINDS])
            elif name == "carried_load":
                values.append([CARRIED * float(self._load_scatter[j])])
            elif name in self.friction_of(j):
                values.append([self.friction_of(j)[name]])
            elif (kind, name) in COARSE:
                values.append(COARSE[kind, name])
            elif name == "cycles" and kind == "torque_ripple":
                values.append([float(k) for k in range(RIPPLES[0], RIPPLES[1] + 1)])
            else:
                values.append(list(parameter["grid"]))
        for combination in product(*values):
            shape = tuple(zip([p["name"] for p in parameters], combination, strict=True))
            if is_valid(kind, shape):
                yield shape

    def doubt(self, hypothesis: Hypothesis) -> float:
        """What is believed against the shape of a hypothesis: minus the logarithm of a probability, zero at best."""
        return 0.0 if self.belief is None else self.belief.doubt(hypothesis)

    def certainty(self, hypothesis: Hypothesis, name: str) -> float:
        """How well a shape parameter is believed to be known, as one over its variance; zero where nothing is."""
        return 0.0 if self.belief is None else self.belief.certainty(hypothesis, name)

    def columns(self, hypotheses: Sequence[Hypothesis]) -> list[list[RunColumns]]:
        """In-band columns per run of every hypothesis; data is read once for all that are new."""
        missing = list(dict.fromkeys(h for h in hypotheses if h not in self._cache))
        for kind in dict.fromkeys(h.kind for h in missing):
            self._build(kind, [h for h in missing if h.kind == kind])
        return [self._cache[h] for h in hypotheses]

    def _build(self, kind: str, hypotheses: Sequence[Hypothesis]) -> None:
        """Pack hypotheses on different joints into one effect each, and the effects into few passes over the runs."""
        packs: list[dict[int, tuple[Hypothesis, Shape]]] = []
        for h in hypotheses:
            for pack in packs:
                if not set(h.joints) & set(pack):
                    break
            else:
                packs.append(pack := {})
            for at, j in enumerate(h.joints):
                pack[j] = (h, of_partner(h, at))
        for h in hypotheses:
            self._cache[h] = [{} for _ in self.runs]
        for first in range(0, len(packs), CHUNK):
            part = packs[first : first + CHUNK]
            effects = [self._effect(kind, pack) for pack in part]
            for k, states in enumerate(self.runs):
                rows = self._rows(effects, states)
                width = effects[0].n_columns
                for p, pack in enumerate(part):
                    for j, (h, _) in pack.items():
                        self._cache[h][k][j] = _own_place(h, j, rows[j][:, p * width : (p + 1) * width])

    def _effect(self, kind: str, pack: dict[int, tuple[Hypothesis, Shape]]) -> _core.Effect:
        idle = dict(next(iter(pack.values()))[1])
        if "partner" in idle:
            idle["partner"] = -1.0
        shape = {name: np.full(self._robot.n_joints, value) for name, value in idle.items()}
        for j, (_, values) in pack.items():
            for name, value in values:
                shape[name][j] = value
        return _core.Effect.of(kind, **shape)

    def _rows(self, effects: Sequence[_core.Effect], states: States) -> list[FloatArray]:
        """In-band rows of effects alone: per joint (n_rows, columns of all effects + 1)."""
        return _core.observe(
            self._robot,
            list(effects),
            [],
            *states.signals(),
            np.zeros_like(states.tau),
            filter=states.filter,
            kept=states.kept,
            tau_link=states.tau_link,
            step=1 / states.rate,
            temperature=states.temperature,
        )

    def candidate(self, hypothesis: Hypothesis) -> Candidate:
        """The hypothesis with its columns, as the choice weighs it."""
        entry = CATALOGUE[hypothesis.kind]
        names = [c["name"] for c in entry["coefficients"]] * len(hypothesis.joints)
        placed = hypothesis.placed()

        def accept(setup: Setup, coefficients: FloatArray) -> Setup:
            return replace(setup, effects=(*setup.effects, placed))

        return Candidate(
            kind=hypothesis.kind,
            joints=hypothesis.joints,
            coefficient_names=tuple(names),
            units=tuple(c["unit"] for c in entry["coefficients"]) * len(hypothesis.joints),
            bounds=bounds_of(hypothesis),
            columns=self.columns([hypothesis])[0],
            accept=accept,
            shape=hypothesis.shape,
            n_searched=len(REFINED.get(hypothesis.kind, {})) + ("cycles" in dict(hypothesis.shape)),
            doubt=self.doubt(hypothesis) if self.belief is not None and hypothesis.kind == CYLINDER else None,
        )

    def friction_of(self, j: int) -> dict[str, float]:
        """Fitted coefficients of joint j's friction, by name."""
        names = [coefficient["name"] for coefficient in CATALOGUE["friction"]["coefficients"]]
        return dict(zip(names, self._friction[j].tolist(), strict=True))

    def friction(self, j: int, width: float) -> RunColumns:
        """Friction of joint j with another transition width, over all runs."""
        threshold = float(self.thresholds[j])
        parts = [
            _core.filtered_friction_basis(
                np.ascontiguousarray(states.dq_motor[:, j]), threshold, width, filter=states.filter, kept=states.kept
            )
            for states in self.runs
        ]
        return {j: np.concatenate(parts)}

    def with_rotor(self, j: int, inertia: float) -> Kinds:
        """Return the same with `inertia` of joint j in its rotor, whose torque the gear does not carry."""
        other = copy(self)
        other._cache = {}
        other.runs = [replace(states, tau_link=_less_rotor(states, j, inertia)) for states in self.runs]
        return other

    def once(self, h: Hypothesis) -> RunColumns:
        """Columns over all runs, not kept."""
        pack = {j: (h, of_partner(h, at)) for at, j in enumerate(h.joints)}
        effect = self._effect(h.kind, pack)
        parts: list[RunColumns] = []
        for states in self.runs:
            rows = _core.effect_columns(
                effect,
                *states.signals(),
                tau_link=states.tau_link,
                step=1 / states.rate,
                temperature=states.temperature,
                joints=list(h.joints),
                filter=states.filter,
                kept=states.kept,
            )
            parts.append({j: _own_place(h, j, rows[:, at]) for at, j in enumerate(h.joints)})
        return stacked(parts)


def _inertias(fit: ThreeLoopIdentifier) -> FloatArray:
    """What every joint turns about its axis (n_joints,) [N m s^2/rad], on average along the training runs."""
    robot = fit.robot.with_gravity([0.0, 0.0, 0.0])
    q = np.concatenate([states.q[:: max(1, len(states.q) // N_PLACES)] for states in fit.runs_])
    still = np.zeros_like(q)
    each = np.eye(robot.n_joints)
    turned = [robot.inverse_dynamics(q, still, still + row, fit.model_.phi)[:, j] for j, row in enumerate(each)]
    return np.asarray(np.mean(turned, axis=1))


def _same_motion(first: Sequence[States], second: Sequence[States]) -> bool:
    """Whether the states are the same, so that columns of them are: encoders may have been corrected."""
    pairs = zip(first, second, strict=True)
    return all(
        np.array_equal(a.q, b.q) and np.array_equal(a.q_motor, b.q_motor) and np.array_equal(a.rows, b.rows)
        for a, b in pairs
    )


TURNING = {"counterbalance", "position_dependent_friction", "torque_ripple"}
"""Kinds that go round with the joint."""
BENDING = {"gear_hysteresis"}
"""Kinds of gears that yield, which two encoders show."""


def _less_rotor(states: States, j: int, inertia: float) -> FloatArray:
    assert states.tau_link is not None  # `Kinds` puts it in
    load = states.tau_link.copy()
    load[:, j] -= inertia * states.ddq_motor[:, j]
    return load


def _own_place(h: Hypothesis, j: int, columns: FloatArray) -> FloatArray:
    """Coefficients of a pair's second joint stand behind those of its first."""
    if len(h.joints) == 1:
        return np.ascontiguousarray(columns)
    width = columns.shape[1]
    wide = np.zeros((len(columns), 2 * width))
    at = h.joints.index(j)
    wide[:, at * width : (at + 1) * width] = columns
    return wide


def _rules(kind: str) -> list[str]:
    return [parameter["name"] for parameter in CATALOGUE[kind]["shape"]]
