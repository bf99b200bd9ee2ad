"""Candidates of the catalogue: every kind, joint, pair and shape as columns beside the model; shapes refined."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.diagnosis.availability import LEAST_WARMTH
from dynid_rs.diagnosis.candidate import Candidate, RunColumns
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.identification import ThreeLoopIdentifier
from dynid_rs.loops import link_load
from dynid_rs.placed import CATALOGUE, PlacedEffect
from dynid_rs.preprocessing import States

FloatArray = NDArray[np.float64]
Shape = tuple[tuple[str, float], ...]

RIPPLES = (4, 24)
"""Ripple orders that the band's scan tries: slower ones are not told from gravity, springs and cylinders, faster ones
are sought in the angle."""
CHUNK = 48
"""Effects whose columns are built in one pass over a run; more would only take more memory."""
REFINED: dict[str, dict[str, tuple[str, float, float]]] = {
    "stribeck": {"stribeck_velocity": ("log", 1e-3, 10.0), "exponent": ("log", 0.5, 4.0)},
    "friction_hysteresis": {"presliding_distance": ("log", 1e-5, 0.3)},
    "load_hysteresis": {"presliding_distance": ("log", 1e-5, 0.3)},
    "gear_hysteresis": {"hysteresis_load": ("log", 1e-4, 1e5), "carried_load": ("log", 1e-4, 1e5)},
    "coupled_friction": {"ratio": ("linear", -5.0, 5.0)},
    "torque_ripple": {"cycles": ("linear", 3.0, 1e4)},
    "counterbalance": {
        "b": ("log", 0.02, 0.95),
        "phase": ("linear", -4.0, 4.0),
        "gas_length": ("log", 0.05, 100.0),
    },
    "thermal_friction": {"time_constant": ("log", 3.0, 300.0)},
}
"""Shape parameters that are searched between the grid's values: how, and within which bounds."""
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
FREE_ENDS = ("b", "carried_load")
"""Shape parameters that may be as small as their search goes: a lever as short as can be is a cylinder all the same,
one that pulls like a weight, and teeth may carry nothing."""
UNSOUGHT = ("load_hysteresis",)
"""Kinds that can be declared and are not looked for: load with memory is what load-dependent friction and hysteresis
tell together, and those are two causes that a person can act on."""
NEIGHBOURS = ("coupled_friction",)
"""Kinds of two joints in one housing: only joints that follow each other share a gear."""
LEAST_LOAD = 0.05
"""Part of some joint's torque that weight has to be, or nothing is looked for that follows the load."""
AT_BOUND = 0.01
"""A shape parameter this near to a bound, relatively, stands at it."""
STARTS = {"stribeck": ("exponent", (1.0, 2.0))}
"""Shape parameters whose search has several valleys, and where it begins besides."""
N_PLACES = 50
"""Places of a run at which joint inertias are looked at."""
OCTAVE = 0.02
"""Part of what a ripple takes off that its first harmonic has to be: less is the chance of two more coefficients."""
SEARCH_STEPS = 40
"""Most evaluations of one search, for each parameter."""
NEAR, ALIKE = 3e-3, 1e-2
"""Where a search ends: shapes this near (octaves), and weighted residual powers this near (chance alone moves them by
about 1)."""


@dataclass(frozen=True)
class Hypothesis:
    """A kind at a place with a shape (of the first joint, where a pair shares one)."""

    kind: str
    joints: tuple[int, ...]
    shape: Shape

    def with_shape(self, name: str, value: float) -> Hypothesis:
        """Return it with one shape parameter at `value`."""
        return replace(self, shape=tuple((n, value if n == name else v) for n, v in self.shape))

    def placed(self) -> PlacedEffect:
        """Return it as an effect of a model."""
        names = [name for name, _ in self.shape]
        rows = [dict(_of_partner(self, at)) for at in range(len(self.joints))]
        return PlacedEffect(self.kind, self.joints, tuple((name, tuple(row[name] for row in rows)) for name in names))


def _of_partner(hypothesis: Hypothesis, at: int) -> Shape:
    """Shape on joint `at` of the hypothesis: partners see each other, with the inverse ratio."""
    if len(hypothesis.joints) == 1:
        return hypothesis.shape
    shape = dict(hypothesis.shape)
    shape["partner"] = float(hypothesis.joints[1 - at])
    if at == 1 and "ratio" in shape:
        shape["ratio"] = 1 / shape["ratio"]
        shape["transition_width"] = shape["transition_width"] * abs(shape["ratio"])
    return tuple(shape.items())


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
        self._carries_weight = bool(np.any(weight.std(axis=0) > LEAST_LOAD * tau.std(axis=0)))
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
                if kind in BENDING and not all(map(self._bends, place)):
                    continue
                out += [Hypothesis(kind, place, shape) for shape in self._shapes(kind, place[0])]
        return out

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
                pack[j] = (h, _of_partner(h, at))
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
        )

    def refined(
        self, hypothesis: Hypothesis, power: Any, *, with_friction: bool = False, own_order: bool = False
    ) -> Hypothesis:
        """Hypothesis with the shape near its own that takes off most; `power` of columns {joint: (n_rows, k)}.

        `with_friction`: the width of friction's transition is searched too, and friction's columns with it stand
        behind the hypothesis' own in what `power` is given. `own_order`: a ripple may turn out to have twice its order.
        """
        name, starts = STARTS.get(hypothesis.kind, ("", ()))
        tried = [self._refined(hypothesis, power, with_friction)]
        for start in starts if with_friction else ():
            tried.append(self._refined(hypothesis.with_shape(name, start), power, with_friction))
        if own_order and hypothesis.kind == "torque_ripple":
            return self._fundamental(*tried[0], power)
        return max(tried, key=lambda pair: pair[0])[1]

    def _fundamental(self, taken: float, ripple: Hypothesis, power: Any) -> Hypothesis:
        """The ripple at twice its order where that takes off as much: its second harmonic was the line."""
        low, high = REFINED[ripple.kind]["cycles"][1:]
        double = 2 * dict(ripple.shape)["cycles"]
        if not low <= double <= high:
            return ripple
        found, other = self._refined(ripple.with_shape("cycles", double), power, False)
        return other if found > (1 - OCTAVE) * taken else ripple

    def _refined(self, hypothesis: Hypothesis, power: Any, with_friction: bool) -> tuple[float, Hypothesis]:
        """Power and hypothesis of one search from the hypothesis' own shape."""
        from scipy.optimize import minimize

        searched = dict(REFINED.get(hypothesis.kind, {}))
        shape = dict(hypothesis.shape)
        if with_friction:
            searched["transition_width"] = ("log", 1e-4, 1.0)
            shape.setdefault("transition_width", float(self.widths[hypothesis.joints[0]]))
        if not searched:
            return 0.0, hypothesis

        def at(x: FloatArray) -> tuple[Hypothesis, dict[str, float]]:
            moved = dict(shape)
            for (name, (how, low, high)), value in zip(searched.items(), x, strict=True):
                sign = -1.0 if how == "log" and shape[name] < 0 else 1.0
                real = sign * float(np.exp2(value)) if how == "log" else float(value)
                moved[name] = sign * min(max(abs(real), low), high) if how == "log" else min(max(real, low), high)
            return replace(hypothesis, shape=tuple((name, moved[name]) for name, _ in hypothesis.shape)), moved

        def cost(x: FloatArray) -> float:
            h, moved = at(x)
            if not is_valid(h.kind, h.shape):
                return 0.0
            columns = self.once(h)
            if with_friction:
                columns = joined([columns, self.friction(h.joints[0], moved["transition_width"])])
            return -float(power(columns))

        start = np.array(
            [
                np.log2(min(max(abs(shape[name]), low), high)) if how == "log" else shape[name]
                for name, (how, low, high) in searched.items()
            ]
        )
        spans = [0.5 if how == "log" else _span(name) for name, (how, *_) in searched.items()]
        simplex = np.vstack([start, *(start + span * row for span, row in zip(spans, np.eye(len(start)), strict=True))])
        options: Any = {
            "initial_simplex": simplex,
            "maxfev": SEARCH_STEPS * len(start),
            "xatol": NEAR,
            "fatol": ALIKE,
        }
        found = minimize(cost, start, method="Nelder-Mead", options=options)
        return (-float(found.fun), at(found.x)[0]) if found.fun < cost(start) else (-cost(start), hypothesis)

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
        pack = {j: (h, _of_partner(h, at)) for at, j in enumerate(h.joints)}
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


def at_a_bound(hypothesis: Hypothesis) -> bool:
    """Whether a searched shape ended where its search had to stop: another kind is meant, or nothing.

    A pre-sliding way of nothing is Coulomb friction. A time constant beyond the run is friction that goes on changing.
    """
    shape = dict(hypothesis.shape)
    for name, (how, low, high) in REFINED.get(hypothesis.kind, {}).items():
        if how != "log" or name == "gas_length":
            continue  # an angle, a ratio or an order may be any; a gas column without end is a plain spring
        if has_no_end(hypothesis.kind, hypothesis.shape):
            continue
        value = abs(shape[name])
        too_low = value <= low * (1 + AT_BOUND) and name not in FREE_ENDS
        if too_low or value >= high * (1 - AT_BOUND):
            return True
    return False


def has_no_end(kind: str, shape: Shape) -> bool:
    """Whether a shape ended where the data cannot follow: warming up that goes on beyond the runs."""
    _, _, high = REFINED["thermal_friction"]["time_constant"]
    return kind == "thermal_friction" and dict(shape)["time_constant"] >= high * (1 - AT_BOUND)


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


def stacked(columns: Sequence[RunColumns]) -> RunColumns:
    """Columns of all runs under each other."""
    return {j: np.concatenate([run[j] for run in columns]) for j in columns[0]}


def joined(parts: Sequence[RunColumns]) -> RunColumns:
    """Columns side by side; joints that one of them does not reach get zeros there."""
    joints = sorted({j for part in parts for j in part})
    widths = [next(iter(part.values())).shape[1] for part in parts]
    n_rows = len(next(iter(parts[0].values())))
    return {
        j: np.concatenate(
            [part.get(j, np.zeros((n_rows, width))) for part, width in zip(parts, widths, strict=True)], axis=1
        )
        for j in joints
    }


def bounds_of(hypothesis: Hypothesis) -> FloatArray:
    """What physics allows of the coefficients, (k, 2)."""
    entry = CATALOGUE[hypothesis.kind]
    bounds = [(c["lower"], c["upper"]) for c in entry["coefficients"]]
    return np.array(bounds * len(hypothesis.joints), dtype=np.float64)


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


def is_valid(kind: str, shape: Shape) -> bool:
    """Whether there is an effect of this shape."""
    try:
        _core.Effect.of(kind, **{name: [value] for name, value in shape})
    except ValueError:
        return False
    return True


def _span(name: str) -> float:
    return {"phase": 0.3, "ratio": 0.2, "cycles": 0.2}[name]
