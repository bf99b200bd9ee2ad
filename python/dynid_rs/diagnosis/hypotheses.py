"""Hypotheses: every kind of the catalogue at every place with every shape of its grid, as columns beside the model."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations, pairwise, product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.shaped import Place, Shape, Shaped, is_valid
from dynid_rs.identification.loads import with_load
from dynid_rs.identification.smooth_friction import in_paper_terms, sign_shape
from dynid_rs.identification.three_loops import ThreeLoopIdentifier
from dynid_rs.model.placed import CATALOGUE, FRICTION_SIGN, shapes_of_sign
from dynid_rs.regression.linear_model import Columns
from dynid_rs.runs.preprocessing import States, is_of_load, top_speed

FloatArray = NDArray[np.float64]

USUAL = 0.1
"""Torque of an effect's column over its joint's own that is usual beforehand (`priors.py`)."""
CYCLES_SHOWN = {"torque_ripple": (1.0, 4.0)}
"""Cycles on the joint's way between which the band shows a kind: with less than one nothing returns, and any curve is a
part of it; with more there is little in the band, and `ripple.py` seeks it in the angle."""
ROUNDING = 1e-9
"""Relative change of a torque's size that is none."""
CHUNK = 48
"""Effects whose columns are built in one pass over a run; more would only take more memory."""

MOST_WANTED = 0.5
"""Part of all joints on which an effect's columns have to be wanted for a pass over all to be worth it."""


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """An effect at a place with a shape, as columns beside the model.

    Parameters
    ----------
    kind : str
        Name in the catalogue of effects.
    joints : tuple of int
        Where it acts, as a person would say it; its columns may reach other joints.
    names, units : tuple of str
        Of the coefficients.
    columns : dict
        Joint to (n_rows, k), all runs under each other, for coefficients that are standard normal beforehand.
    unit : ndarray (k,)
        Standard deviation of the coefficients beforehand, in their own units.
    bounds : ndarray (k, 2)
        What physics allows of them.
    accept : callable
        (setup, coefficients) to the setup with this effect in it.
    shape : tuple of (str, float)
        Shape parameters.
    sizes : tuple of float
        Multiples of `unit` that are as likely beforehand.
    """

    kind: str
    joints: tuple[int, ...]
    names: tuple[str, ...]
    units: tuple[str, ...]
    columns: Columns
    unit: FloatArray
    bounds: FloatArray
    accept: Callable[[Setup, FloatArray], Setup]
    shape: Shape = ()
    sizes: tuple[float, ...] = (1.0, 10.0)

    @property
    def place(self) -> Place:
        """Kind and joints: what a report names."""
        return self.kind, self.joints


def standardised(columns: Columns, unit: FloatArray) -> Columns:
    """Columns for coefficients that are standard normal beforehand."""
    return {j: part * unit for j, part in columns.items()}


@dataclass(eq=False)
class Catalogue:
    """Hypotheses of the catalogue along the training runs of a fit; columns are computed once each.

    `before`: of an earlier fit to the same runs, whose columns stay where they do not depend on fitted torques.
    """

    fit: ThreeLoopIdentifier
    before: Catalogue | None = None
    runs: list[States] = field(init=False)
    _columns: dict[Shaped, Columns] = field(init=False, default_factory=dict)
    _units: dict[Shaped, FloatArray] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        fit = self.fit
        loaded = with_load(fit.observations_.plan, fit.links_, fit.links_.own_)
        self.runs = [loaded(states) for states in fit.runs_]
        self._load = np.concatenate([states.tau_link for states in self.runs if states.tau_link is not None]).std(
            axis=0
        )
        self._turns = np.ptp(np.concatenate([states.q for states in self.runs]), axis=0) / (2 * np.pi)
        self._speed = top_speed(self.runs)
        factors, n_rows = fit.observations_.factors(), fit.observations_.n_rows
        self._torque = np.array([np.linalg.norm(R[:, -1]) for R in factors]) / np.sqrt(n_rows)
        self._sign = sign_shape(fit.observations_.plan.friction[0])
        before, self.before = self.before, None
        if before is not None and _same_motion(before.runs, self.runs):
            alike = np.array_equal(before.fit.links_.torque_scale_, fit.links_.torque_scale_)
            same = np.abs(self._torque / before._torque - 1) < ROUNDING
            for s in filter(self._still_sought, before._columns):
                if len(s.joints) > 1 and not alike:  # what one joint says of the other is another current now
                    continue
                self._columns[s], self._units[s] = before._columns[s], before._units[s]
                if not all(same[list(s.joints)]):
                    again = self._usual(self._columns[s])
                    self._columns[s], self._units[s] = standardised(self._columns[s], again), again * self._units[s]

    def _still_sought(self, s: Shaped) -> bool:
        """Whether columns of an earlier fit are the same beside this one, and its sign is still that of friction."""
        shape, signs = dict(s.shape), shapes_of_sign(s.kind)
        same = (shape[name] == self._sign[k][s.joints[0]] for name, k in signs.items())
        return not is_of_load(CATALOGUE[s.kind]["signals"]) and all(same)

    def hypotheses(self) -> list[Hypothesis]:
        """Every kind that is sought, at every place, with every shape of its grid."""
        return self.of(self.grid)

    @cached_property
    def n_places(self) -> int:
        """How many kinds at how many places are sought."""
        return len({(s.kind, s.joints) for s in self.grid})

    def of(self, shaped: Sequence[Shaped]) -> list[Hypothesis]:
        """Hypotheses of these shapes, their columns built in few passes over the runs."""
        missing = list(dict.fromkeys(s for s in shaped if s not in self._columns))
        for kind in dict.fromkeys(s.kind for s in missing):
            self._build(kind, [s for s in missing if s.kind == kind])
        return [self._hypothesis(s) for s in shaped]

    @cached_property
    def grid(self) -> list[Shaped]:
        """Every shape of every kind at every place that the signals allow."""
        return list(self._grid())

    def _grid(self) -> Iterator[Shaped]:
        n = self.fit.robot.n_joints
        for kind, entry in CATALOGUE.items():
            if entry["declared"] or not entry["sought"]:
                continue
            places: list[tuple[int, ...]] = [(j,) for j in range(n)]
            if entry["places"] != "joint":
                places = list(combinations(range(n), 2)) if entry["places"] == "pair" else list(pairwise(range(n)))
            for joints in places:
                if all(self._allows(entry, j) for j in joints):
                    yield from (Shaped(kind, joints, shape) for shape in self._shapes(kind, joints[0]))

    def _allows(self, entry: dict[str, Any], j: int) -> bool:
        """Whether joint j and the runs have what the kind requires."""
        said = {
            "two_encoders": lambda: any(np.ptp(s.q_motor[:, j] - s.q[:, j]) > 0 for s in self.runs),
            "revolute": lambda: self.fit.robot.joint_kinds[j] == "revolute",
            "temperature": lambda: all(
                s.temperature is not None and np.ptp(s.temperature[:, j]) > 0 for s in self.runs
            ),
            "load": lambda: bool(self._load[j] > 0),
        }
        return all(said[need]() for need in entry["requires"])

    def _shapes(self, kind: str, j: int) -> Iterator[Shape]:
        parameters = CATALOGUE[kind]["shape"]
        names = [parameter["name"] for parameter in parameters]
        _, most = CYCLES_SHOWN.get(kind, (0.0, np.inf))
        for values in product(*(self._values(parameter, j) for parameter in parameters)):
            shape = tuple(zip(names, values, strict=True))
            few = dict(shape).get("cycles", 0.0) * self._turns[j] <= most
            if few and is_valid(kind, shape) and self.returns(Shaped(kind, (j,), shape)):
                yield shape

    def returns(self, s: Shaped) -> bool:
        """Whether ripple goes round at least once on the joint's way; true of all other kinds."""
        least, _ = CYCLES_SHOWN.get(s.kind, (0.0, np.inf))
        return self.times_round(s) >= least

    def times_round(self, s: Shaped) -> float:
        """How often ripple goes round on the joint's way; without end of all other kinds."""
        return float(dict(s.shape)["cycles"] * self._turns[s.joints[0]]) if s.kind in CYCLES_SHOWN else np.inf

    def _values(self, parameter: dict[str, Any], j: int) -> list[float]:
        """Values of a shape parameter on joint j in its own unit."""
        if (k := FRICTION_SIGN.get(parameter["relative_to"])) is not None:
            return [float(self._sign[k][j])]
        if parameter["name"] == "partner":
            return [-1.0]
        if parameter["name"] in self._friction(j):
            return [self._friction(j)[parameter["name"]]]
        if parameter["relative_to"] == "chain":
            return [float(side) for side in parameter["grid"] if self._carries(j + int(side))]
        unit = {"load": self._load[j], "speed": self._speed[j]}.get(parameter["relative_to"] or "", 1.0)
        return [float(value * unit) for value in parameter["grid"]]

    def _carries(self, j: int) -> bool:
        """Whether there is such a joint, which turns and has a load: what the one beside it may rub under."""
        robot = self.fit.robot
        return 0 <= j < robot.n_joints and robot.joint_kinds[j] == "revolute" and bool(self._load[j] > 0)

    def _friction(self, j: int) -> dict[str, float]:
        """Fitted coefficients of joint j's friction, by name: what a measured temperature scales."""
        friction, places = self.fit.observations_.plan.friction
        return in_paper_terms(
            dict(zip(friction.coefficient_names, self.fit.links_.own_[j, places].tolist(), strict=True))
        )

    def _build(self, kind: str, shaped: Sequence[Shaped]) -> None:
        """Pack shapes on different joints into one effect each, and the effects into few passes over the runs."""
        packs: list[dict[int, tuple[Shaped, Shape]]] = []
        for s in shaped:
            pack = next((pack for pack in packs if not set(s.joints) & set(pack)), None)
            if pack is None:
                packs.append(pack := {})
            pack |= {j: (s, s.at(place)) for place, j in enumerate(s.joints)}
        width = len(CATALOGUE[kind]["coefficients"])
        parts: dict[Shaped, list[Columns]] = {s: [] for s in shaped}
        for first in range(0, len(packs), CHUNK):
            part = packs[first : first + CHUNK]
            effects = [self._effect(kind, pack) for pack in part]
            # A pass over all joints is for many of them; the slopes of one shape are wanted on one.
            few = sum(map(len, part)) < MOST_WANTED * len(part) * self.fit.robot.n_joints
            for states in self.runs:
                if few:
                    rows = [self._few(effect, states, list(pack)) for effect, pack in zip(effects, part, strict=True)]
                else:
                    whole = self._rows(effects, states)
                    rows = [
                        {j: own[:, p * width : (p + 1) * width] for j, own in whole.items()} for p in range(len(part))
                    ]
                for built, pack in zip(rows, part, strict=True):
                    for s in dict.fromkeys(s for s, _ in pack.values()):
                        parts[s].append({j: built[j] for j in s.joints})
        for s, runs in parts.items():
            columns = {j: np.concatenate([run[j] for run in runs]) for j in s.joints}
            for place, j in enumerate(s.joints[1:], 1):
                columns[j] *= self._share(s, place)
            runs.clear()
            self._columns[s], self._units[s] = columns, self._usual(columns)
            for own in columns.values():
                own *= self._units[s]  # in place: all shapes together are most of what a diagnosis holds

    def _share(self, s: Shaped, place: int) -> FloatArray:
        """Coefficients (k,) on joint number `place` over those on the first, as the joints' channels show them."""
        scale = self.fit.links_.torque_scale_
        share: FloatArray = s.reaction(place) * scale[s.joints[place]] / scale[s.joints[0]]
        return share

    def torque(self, s: Shaped, own: FloatArray) -> Columns:
        """Torque (n_rows,) on each joint with the coefficients `own` (k n_joints,), joint by joint."""
        (h,) = self.of([s])
        unit = np.where(h.unit > 0, h.unit, 1.0)
        parts = enumerate(np.split(own, len(s.joints)))
        return {s.joints[p]: h.columns[s.joints[p]] @ (part / (unit * self._share(s, p))) for p, part in parts}

    def _usual(self, columns: Columns) -> FloatArray:
        """Coefficients (k,) that are usual for columns beforehand."""
        size = np.max([np.sqrt(np.mean(part**2, axis=0)) / self._torque[j] for j, part in columns.items()], axis=0)
        usual: FloatArray = np.where(size > 0, USUAL / np.where(size > 0, size, 1.0), 0.0)
        return usual

    def _effect(self, kind: str, pack: dict[int, tuple[Shaped, Shape]]) -> _core.Effect:
        idle = dict(next(iter(pack.values()))[1])
        if "partner" in idle:
            idle["partner"] = -1.0
        shape = {name: np.full(self.fit.robot.n_joints, value) for name, value in idle.items()}
        for j, (_, values) in pack.items():
            for name, value in values:
                shape[name][j] = value
        return _core.Effect.of(kind, **shape)

    def _rows(self, effects: Sequence[_core.Effect], states: States) -> dict[int, FloatArray]:
        """In-band rows of effects alone: per joint (n_rows, columns of all effects + 1)."""
        rows = _core.observe(
            self.fit.robot,
            list(effects),
            [],
            *states.signals(),
            np.zeros_like(states.tau),
            filter=states.filter,
            kept=states.kept,
            tau_link=states.tau_link,
            tau_motor=states.tau_motor,
            step=1 / states.rate,
            temperature=states.temperature,
        )
        return dict(enumerate(rows))

    def _few(self, effect: _core.Effect, states: States, joints: list[int]) -> dict[int, FloatArray]:
        """The same of one effect on some joints."""
        columns = _core.effect_columns(
            effect,
            *states.signals(),
            tau_link=states.tau_link,
            tau_motor=states.tau_motor,
            step=1 / states.rate,
            temperature=states.temperature,
            joints=joints,
            filter=states.filter,
            kept=states.kept,
        )
        return {j: columns[:, at] for at, j in enumerate(joints)}

    def _hypothesis(self, s: Shaped) -> Hypothesis:
        placed = s.placed()
        coefficients = CATALOGUE[s.kind]["coefficients"]
        return Hypothesis(
            s.kind,
            s.joints,
            tuple(c["name"] for c in coefficients),
            tuple(c["unit"] for c in coefficients),
            self._columns[s],
            self._units[s],
            np.array([(c["lower"], c["upper"]) for c in coefficients], dtype=np.float64),
            lambda setup, x: replace(setup, effects=(*setup.effects, placed)),
            s.shape,
        )


def _same_motion(first: Sequence[States], second: Sequence[States]) -> bool:
    """Whether the states are the same, so that columns of them are: encoders may have been corrected."""
    return all(
        all(np.array_equal(a, b) for a, b in zip(one.signals(), other.signals(), strict=True))
        and np.array_equal(one.rows, other.rows)
        for one, other in zip(first, second, strict=True)
    )
