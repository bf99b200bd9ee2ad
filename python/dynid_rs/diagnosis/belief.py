"""What is believed so far: the setup, its fit, and why each name is there."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.estimator import Estimator
from dynid_rs.diagnosis.beside import Beside, places_of
from dynid_rs.diagnosis.hypotheses import Catalogue, Hypothesis
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.shaped import Place, Shaped, shaped_as
from dynid_rs.diagnosis.structural import KINDS, REFITTED, structural_hypotheses, undone, value_of
from dynid_rs.identification.smooth_friction import Shapes, SmoothFrictionIdentifier, sign_shape
from dynid_rs.identification.three_loops import ThreeLoopIdentifier
from dynid_rs.model.placed import CATALOGUE, HeldEffect, PlacedEffect, own_columns, shapes_of_sign
from dynid_rs.regression.linear_model import Columns
from dynid_rs.runs.recording import Recording

FloatArray = NDArray[np.float64]

SETTLING = 3
"""Refits in which geometry, clocks, encoders and signs that were accepted settle; each brings them ten times closer."""
SETTLED = 0.1
"""Change over its standard deviation at which they have, and that of a sign's width over itself."""


@dataclass(frozen=True, eq=False)
class Named:
    """A hypothesis that passed: its logarithmic odds, and others that explain the same, as well or worse.

    `same` are the ties that no motion would tell: beside the declared model their torque is the same.
    `another_function`: logarithmic odds of a function of the same angle in its place, where the data speak against
    neither, or what they show of the law is any curve's too (`misfit.py`).
    """

    hypothesis: Hypothesis
    log_odds: float
    ties: tuple[tuple[Place, float], ...] = ()
    same: tuple[Place, ...] = ()
    refuted: tuple[tuple[Place, float], ...] = ()
    another_function: float | None = None


@dataclass(frozen=True, eq=False)
class Kept:
    """What was believed at some time: parts of a `Belief`."""

    setup: Setup
    fit: ThreeLoopIdentifier
    catalogue: Catalogue
    named: dict[Place, Named]
    steps: list[tuple[str, Place, FloatArray]]


@dataclass(eq=False)
class Belief:
    """The setup with all that was named, fitted to training runs.

    Parameters
    ----------
    declared : Setup
        As it was at the beginning; a name that goes leaves what was declared.
    train : sequence of Recording
        Training runs.
    setup, fit, catalogue
        What is believed now, its fit, and hypotheses beside it.
    first : ThreeLoopIdentifier
        The fit at the beginning, which tells friction's shapes on joints that no name reaches.
    named : dict
        Place to its name.
    mounting : Place, optional
        Of a mounting that the search began with: it is not taken back.
    only : frozenset of Place, optional
        All that is asked, where an earlier diagnosis has settled the rest; `n_places`: of how many it was.
    steps : list
        History: what was done, where, and what the fit left then.
    """

    declared: Setup
    train: Sequence[Recording]
    setup: Setup
    first: ThreeLoopIdentifier
    fit: ThreeLoopIdentifier
    catalogue: Catalogue
    named: dict[Place, Named] = field(default_factory=dict)
    mounting: Place | None = None
    only: frozenset[Place] | None = None
    n_places: int = 0
    steps: list[tuple[str, Place, FloatArray]] = field(default_factory=list)
    _beside: tuple[ThreeLoopIdentifier, Beside] | None = None

    @staticmethod
    def in_declared(setup: Setup, train: Sequence[Recording], fit: ThreeLoopIdentifier | None = None) -> Belief:
        """Believe the declared model alone; `fit` of it to these runs, where there is one already."""
        fit = fitted(setup, train) if fit is None else fit
        return Belief(setup, train, setup, fit, fit, Catalogue(fit))

    @cached_property
    def at_first(self) -> Beside:
        """The fit at the beginning as a linear model."""
        return Beside.of(self.first)

    @property
    def beside(self) -> Beside:
        """The fit as a linear model; made once for each fit."""
        if self.fit is self.first:
            return self.at_first
        if self._beside is None or self._beside[0] is not self.fit:
            self._beside = self.fit, Beside.of(self.fit)
        return self._beside[1]

    @property
    def left(self) -> FloatArray:
        """RMS that the fit leaves on its training rows, (n_joints,)."""
        covariance: FloatArray = np.sqrt(np.diag(self.fit.links_.covariance_))
        return covariance

    @property
    def phase(self) -> NDArray[np.int64]:
        """Phase of the motion at every row of the fit, (n_rows,)."""
        return self.first.observations_.phase

    @property
    def run_lengths(self) -> list[int]:
        """Rows of every run of the fit."""
        return [len(states.rows) for states in self.fit.runs_]

    def hypotheses(self) -> list[Hypothesis]:
        """Everything that is sought, of the catalogue and of the structure."""
        if self.only is None:
            return [*self.catalogue.hypotheses(), *structural_hypotheses(self.fit, self.setup)]
        grid = [s for s in self.catalogue.grid if (s.kind, s.joints) in self.only]
        kinds = [kind for kind in KINDS if any(kind == asked for asked, _ in self.only)]
        structural = structural_hypotheses(self.fit, self.setup, kinds)
        return [*self.catalogue.of(grid), *(h for h in structural if h.place in self.only)]

    def n_sought(self, open_: Sequence[Hypothesis]) -> int:
        """How many kinds at places a name of `open_` has to be more probable than: those, or as many as once."""
        return max(len(places_of(open_)), self.n_places, 1)

    def structure(self) -> list[Hypothesis]:
        """Further changes of the structure that was named, the mounting included."""
        kinds = sorted({kind for kind, _ in self.named if kind in REFITTED})
        return [h for h in structural_hypotheses(self.fit, self.setup, kinds) if h.place in self.named]

    def moved(self, place: Place) -> FloatArray:
        """How far a change of structure is from what was declared, (k,)."""
        now, then = (replace(setup, declared=self.declared.robot) for setup in (self.setup, self.declared))
        moved: FloatArray = value_of(now, *place) - value_of(then, *place)
        return moved

    def reach(self, hypothesis: Hypothesis) -> list[int]:
        """Joints whose torque a hypothesis changes: its own, or all where it changes the links that they share."""
        return list(range(self.setup.robot.n_joints)) if hypothesis.kind in KINDS else sorted(hypothesis.columns)

    @property
    def reached(self) -> list[int]:
        """Joints whose torque some name changes; friction on the others is as it was declared."""
        return sorted({j for named in self.named.values() for j in self.reach(named.hypothesis)})

    def places(self) -> list[list[tuple[int, int]]]:
        """Joint and place among the fit's unknowns of every coefficient of every torque term of the setup."""
        if not self.setup.effects:
            return []
        plan, columns = self.fit.observations_.plan, own_columns(self.setup.effects, 0)
        first = plan.friction[1].start - 1 - max(column for places in columns for _, column in places)
        return [[(j, plan.n_base + j * plan.n_own + first + column) for j, column in places] for places in columns]

    def by_place(self) -> dict[Place, list[tuple[int, int]]]:
        """The same by the kind and joints of the torques."""
        return dict(zip([(e.kind, e.joints) for e in self.setup.effects], self.places(), strict=True))

    def without(self, found: Collection[Place]) -> tuple[Setup, ThreeLoopIdentifier]:
        """Setup with torques at places that were `found` silent, and its fit, whose unknowns have the same places."""
        effects = [replace(e, silent=e.joints) if (e.kind, e.joints) in found else e for e in self.setup.effects]
        without = copy(self)
        without.setup = replace(self.setup, effects=tuple(effects))
        without.named = {place: named for place, named in self.named.items() if place not in found}
        return without.setup, without._refitted()

    def hold(self, held: Sequence[HeldEffect]) -> None:
        """Put torques that were fitted at full rate into the setup, besides the declared ones, and fit all again."""
        self.setup = replace(self.setup, held=(*self.declared.held, *held))
        self.refit()

    def believe_mounting(self, odds: float) -> None:
        """Name the mounting that the search begins with, and turn it to where it is likeliest."""
        (h,) = structural_hypotheses(self.fit, self.setup, ["gravity_tilt"])
        self.named[h.place] = Named(h, odds)
        self.mounting = h.place
        self.refit()

    def adopt(self, setup: Setup, odds: Mapping[Place, float]) -> None:
        """Believe what an earlier diagnosis named, each with its logarithmic odds, and fit everything again."""
        self.setup = setup
        self.fit = self._refitted()
        self.catalogue = Catalogue(self.fit, self.catalogue)
        own = {h.place: h for h in structural_hypotheses(self.first, self.declared)}  # a gain that is free is none now
        own |= {h.place: h for h in structural_hypotheses(self.fit, setup)}
        own |= {h.place: h for h in self.catalogue.of([shaped_as(effect) for effect in setup.effects])}
        self.named = {place: Named(own[place], value) for place, value in odds.items() if place in own}
        self.refit()

    def accept(self, found: Sequence[Named]) -> None:
        """Put names into the setup, fit everything again, shapes and structure included."""
        beside, accepted = self.beside, []
        for named in found:
            h = named.hypothesis
            columns = beside.evidence_for(h)[1]
            beside = beside.with_columns(columns)
            setup = h.accept(self.setup, coefficients(h, columns, beside))
            if setup is self.setup:
                continue  # gains of all joints but one tell all that gains can
            self.setup, self.named[h.place] = setup, named
            accepted.append(h.place)
        self.refit()
        self.steps += [("added", place, self.left) for place in accepted]

    def remove(self, place: Place) -> None:
        """Take a name out of the setup and fit again; a change of structure goes back to where it was declared."""
        kind, joints = place
        self.setup = replace(self.setup, effects=tuple(e for e in self.setup.effects if (e.kind, e.joints) != place))
        if kind in KINDS:
            self.setup = undone(self.setup, self.declared, kind, joints)
        self.named.pop(place, None)
        self.refit()
        self.steps.append(("dropped", place, self.left))

    def merge(self, places: Sequence[Place], h: Hypothesis, log_odds: float) -> None:
        """Put one torque in the place of several, and fit everything again."""
        kept = [e for e in self.setup.effects if (e.kind, e.joints) not in places]
        self.setup = replace(self.setup, effects=(*kept, Shaped(h.kind, h.joints, h.shape).placed()))
        for place in places:
            self.named.pop(place)
        self.named[h.place] = Named(h, log_odds)
        self.refit()
        self.steps += [("dropped", place, self.left) for place in places] + [("added", h.place, self.left)]

    @property
    def kept(self) -> Kept:
        """What `restore` takes."""
        return Kept(self.setup, self.fit, self.catalogue, dict(self.named), list(self.steps))

    def restore(self, kept: Kept) -> None:
        """Believe again what was believed then."""
        self.setup, self.fit, self.catalogue = kept.setup, kept.fit, kept.catalogue
        self.named, self.steps = dict(kept.named), list(kept.steps)

    def reshape(self, effects: Sequence[PlacedEffect], friction: tuple[FloatArray, FloatArray] | None = None) -> None:
        """Give effects, and friction's sign (widths and sharpnesses), other shapes, and fit everything again."""
        if friction is not None:
            effects = following(effects, friction)
        self.setup = replace(self.setup, effects=tuple(effects))
        for h in self.catalogue.of([shaped_as(effect) for effect in effects]):
            if h.place in self.named:  # what was believed from the beginning has no name
                self.named[h.place] = replace(self.named[h.place], hypothesis=h)
        self.refit(friction)

    def is_likelier_than(self, kept: Kept) -> bool:
        """Whether the data are more probable than they were.

        Samples are worth what they are in the better model (`Beside.evidence_for`): what was large and missing
        remembers itself, and a hundredth of the noise would be no gain.
        """
        posteriors = [fit.links_.posterior_ for fit in (kept.fit, self.fit)]
        worth = np.max([posterior.n_effective for posterior in posteriors if posterior is not None], axis=0)
        before, now = (shaped_evidence(fit, worth) for fit in (kept.fit, self.fit))
        return now > before

    def refit(self, friction: tuple[FloatArray, FloatArray] | None = None) -> None:
        """Fit everything again; geometry, clocks, encoders and signs that were accepted move to where they belong."""
        self.fit = self._refitted(friction)
        for _ in range(SETTLING):
            moved = self._follow_friction()
            setup, beside = self.setup, None  # it takes a while: only made where there is structure
            for h in self.structure():
                beside = (self.beside if beside is None else beside).with_columns(h.columns)
                x = coefficients(h, h.columns, beside)
                std = np.sqrt(np.diag(beside.best.covariance)[-len(h.unit) :]) * h.unit
                moved = moved or bool(np.any(np.abs(x) > SETTLED * std))
                setup = h.accept(setup, x)
            if not moved:
                break
            self.setup = setup
            self.fit = self._refitted(friction)
        self.catalogue = Catalogue(self.fit, self.catalogue)

    def _follow_friction(self) -> bool:
        """Let the signs of all effects turn round with the fitted friction's; whether one was clearly elsewhere.

        A peak of friction that had no name makes the fitted sign steeper, and named with that sign the peak is another.
        """
        followed = following(self.setup.effects, sign_shape(self.fit.observations_.plan.friction[0]))
        pairs = zip(self.setup.effects, followed, strict=True)
        moved = any(_apart(shaped_as(old), shaped_as(new)) > SETTLED for old, new in pairs)
        if moved:
            self.setup = replace(self.setup, effects=followed)
        return moved

    def _refitted(self, friction: tuple[FloatArray, FloatArray] | None = None) -> ThreeLoopIdentifier:
        """Fit of the setup now; friction's shapes are those given, or stay near those of the fit so far.

        With given ones the prior and what samples are worth stay too: shapes are compared by nothing else.

        Where no name reaches they are those of the first fit: what little tells them would only be read otherwise.
        """
        if friction is not None:
            return fitted(self.setup, self.train, self.fit, friction=SmoothFrictionIdentifier(friction, held=True))
        so_far, first = self.fit.friction_, self.first.friction_
        held = ~np.isin(np.arange(self.setup.robot.n_joints), self.reached)
        shapes = (
            np.where(held, first.transition_width_, so_far.transition_width_),
            np.where(held, first.sharpness_, so_far.sharpness_),
        )
        return fitted(self.setup, self.train, friction=SmoothFrictionIdentifier(shapes, held=held))


def shaped_evidence(fit: ThreeLoopIdentifier, worth: FloatArray) -> float:
    """Logarithm of the evidence, friction's shapes as probable as they are, where rows are worth `worth` samples."""
    posterior, plan = fit.links_.posterior_, fit.observations_.plan
    assert posterior is not None  # every fit that is diagnosed has the weak prior
    model = posterior.model(plan, fit.observations_.joint_rows(), n_effective=worth)
    evidence: float = model.fit(posterior.choice, posterior.noise_std).evidence - fit.friction_.doubt(fit.runs_)
    return evidence


def following(effects: Sequence[PlacedEffect], sign: Shapes) -> tuple[PlacedEffect, ...]:
    """Return effects whose signs turn round as friction's, of width [rad/s] and sharpness (n_joints,) `sign`.

    What a search does not let fall below that width stays above it.
    """
    followed = []
    for effect in effects:
        own = shaped_as(effect)
        for name, k in shapes_of_sign(effect.kind).items():
            own = own.with_shape(name, float(sign[k][effect.joints[0]]))
        for parameter in CATALOGUE[effect.kind]["shape"]:
            if (other := parameter["not_below"]) is not None:
                least, value = dict(own.shape)[other], dict(own.shape)[parameter["name"]]
                own = own.with_shape(parameter["name"], max(least, value))
        followed.append(own.placed())
    return tuple(followed)


def _apart(one: Shaped, other: Shaped) -> float:
    """Greatest logarithm of a ratio between the shapes of two that are shaped alike but for scales; none is far off."""
    pairs = [(a, b) for (_, a), (_, b) in zip(one.shape, other.shape, strict=True) if a != b]
    return max((abs(float(np.log(b / a))) if a and b else np.inf for a, b in pairs), default=0.0)


def fitted(
    setup: Setup, train: Sequence[Recording], near: ThreeLoopIdentifier | None = None, **options: Estimator
) -> ThreeLoopIdentifier:
    """Fit declared model and what was found; without a third loop."""
    return setup.identifier(residual=None, **options).fit(list(train), near=near)


def coefficients(h: Hypothesis, columns: Columns, beside: Beside) -> FloatArray:
    """Coefficients of the last hypothesis in the model, in their own units."""
    j = next(iter(columns))
    size = np.linalg.norm(columns[j]) / max(float(np.linalg.norm(h.columns[j])), 1e-300)
    x: FloatArray = beside.best.x[-len(h.unit) :] * size * h.unit
    return x
