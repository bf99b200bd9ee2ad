"""A fleet: arms pooled type by type, the odd ones named with their causes, better estimates of all of them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.base.estimator import Estimator
from dynid_rs.model.assembly import with_changes
from dynid_rs.pooling.arm import ArmEstimate
from dynid_rs.pooling.causes import Cause, causes
from dynid_rs.pooling.hierarchy import least_arms
from dynid_rs.pooling.type_pool import TypePool, pool
from dynid_rs.pooling.words import sentence_of
from dynid_rs.regression.is_fitted import check_is_fitted

FloatArray = NDArray[np.float64]

FEWEST = 3
"""Arms with which a deviation can be estimated without one of them."""


@dataclass(frozen=True)
class ArmVerdict:
    """What the fleet says of one arm.

    Parameters
    ----------
    name, type : str
        Of the arm, and of what it is pooled with.
    odd : bool or None
        None where nothing can be said.
    causes : tuple of Cause
        Why it is odd, the one that explains most first.
    why : tuple of str
        The same in words; or why nothing can be said.
    deviations : float or None
        Greatest distance of its quantities from the type, in deviations.
    p_value : float or None
        Of that distance: of its own test, times the tests of the whole fleet, at most 1.
    """

    name: str
    type: str
    odd: bool | None
    causes: tuple[Cause, ...]
    why: tuple[str, ...]
    deviations: float | None
    p_value: float | None


class Fleet(Estimator):
    """Arms of one type share a mean, each of them deviates; those that deviate more than their like are odd.

    Parameters
    ----------
    false_alarms : float
        Probability that any arm of a fleet without odd arms is called odd, over all arms and all quantities
        (Bonferroni: every one of the m tests has ``false_alarms / m``, however they depend on each other).

    Attributes
    ----------
    types_ : list of TypePool
        Arms type by type, in the order of their first arms.
    verdicts_ : dict of str to ArmVerdict
        Of every arm, in their order.
    n_tests_ : int
        Arms times quantities, of types that are judged.
    limit_ : float
        Probability below which a test names an arm.
    least_arms_ : int
        Arms that a type needs to have an odd one named.
    """

    def __init__(self, false_alarms: float = 0.05) -> None:
        self.false_alarms = false_alarms

    def fit(self, arms: Iterable[ArmEstimate]) -> Fleet:
        """Pool the arms.

        Raises
        ------
        ValueError
            `false_alarms` is no probability, there is no arm, or a name is there twice.
        """
        if not (isinstance(self.false_alarms, int | float) and 0 < self.false_alarms < 1):
            raise ValueError(f"false_alarms must be a probability between 0 and 1, found {self.false_alarms!r}")
        given = list(arms)
        if not given:
            raise ValueError("there is no arm to pool")
        names = [arm.name for arm in given]
        twice = next((name for name in names if names.count(name) > 1), None) if len(set(names)) < len(names) else None
        if twice is not None:
            raise ValueError(f"the arm {twice!r} is there twice; every arm has its own name")
        groups, alone = _grouped(given)
        self.types_ = [pool(name, group) for name, group in groups.items()]
        # Types that are too small are not tested, and take no part of the rate: the smallest size that the rate allows.
        sizes = sorted({one.n_arms for one in self.types_})
        for smaller, size in zip((0, *sizes), sizes, strict=False):
            self.n_tests_ = sum(one.n_arms * len(one.quantities) for one in self.types_ if one.n_arms >= size)
            self.limit_ = self.false_alarms / max(self.n_tests_, 1)
            self.least_arms_ = max(FEWEST, least_arms(self.limit_), smaller + 1)
            if self.least_arms_ <= size:
                break
        found = {arm.name: self._alone(arm, reason) for arm, reason in alone}
        for one in self.types_:
            for i, arm in enumerate(one.arms):
                found[arm.name] = self._judged(one, i)
        self.verdicts_ = {name: found[name] for name in names}
        return self

    def shrunken(self, name: str) -> tuple[FloatArray, FloatArray]:
        """Unknowns of an arm with what its type says of them: values (p,), covariance (p, p); see `TypePool.shrunken`.

        An odd arm keeps its own estimates: a type that it is not like says nothing of it.

        Raises
        ------
        KeyError
            There is no such arm among those that are pooled.
        """
        one, i = self._place(name)
        if self.verdicts_[name].odd:
            return one.arms[i].x, one.arms[i].covariance
        return one.shrunken(i)

    def model(self, name: str, model: _core.TorqueModel) -> _core.TorqueModel:
        """Return an arm's model with the estimates of `shrunken`; everything else stays.

        Raises
        ------
        KeyError
            There is no such arm among those that are pooled.
        ValueError
            The model is another arm's: it has other coefficients.
        """
        one, i = self._place(name)
        arm, (x, _) = one.arms[i], self.shrunken(name)
        phi = np.zeros(10 * model.robot.n_joints)
        base, own, scale = arm.split(x)
        phi[np.asarray(model.robot.base_parameters().pivots)] = base
        effects, first = [], 0
        for effect, coefficients in model.effects:
            last = first + effect.n_columns
            if tuple(effect.coefficient_names) == arm.own_names[first:last]:
                coefficients, first = own[:, first:last], last
            effects.append((effect, coefficients))
        if first != len(arm.own_names):
            raise ValueError(f"the model does not have the coefficients of {name!r}; is it another arm's?")
        channels = {} if scale is None else {"torque_scale": scale.tolist()}
        return with_changes(model, phi=phi, effects=effects, **channels)

    def odd(self) -> list[ArmVerdict]:
        """Odd arms, the farthest first."""
        check_is_fitted(self, "verdicts_")
        odd = [verdict for verdict in self.verdicts_.values() if verdict.odd]
        return sorted(odd, key=lambda verdict: -(verdict.deviations or 0.0))

    def _place(self, name: str) -> tuple[TypePool, int]:
        check_is_fitted(self, "types_")
        for one in self.types_:
            for i, arm in enumerate(one.arms):
                if arm.name == name:
                    return one, i
        raise KeyError(name)

    def _judged(self, one: TypePool, i: int) -> ArmVerdict:
        arm = one.arms[i]
        if one.n_arms < self.least_arms_:
            few = f"too few arms of this type to say: {one.n_arms}, and {self.least_arms_} are needed"
            return ArmVerdict(arm.name, one.name, None, (), (few,), None, None)
        found = tuple(causes(one, i, self.limit_))
        q = min(range(len(one.judged)), key=lambda k: one.judged[k].p_value[i])
        judged = one.judged[q]
        why = tuple(sentence_of(cause) for cause in found)
        chance = min(1.0, float(judged.p_value[i]) * self.n_tests_)
        return ArmVerdict(arm.name, one.name, bool(found), found, why, abs(float(judged.deviations[i])), chance)

    @staticmethod
    def _alone(arm: ArmEstimate, reason: str) -> ArmVerdict:
        return ArmVerdict(arm.name, arm.type, None, (), (reason,), None, None)


def _grouped(arms: Sequence[ArmEstimate]) -> tuple[dict[str, list[ArmEstimate]], list[tuple[ArmEstimate, str]]]:
    """Arms of every type that have one form, the form of most of them; and the others, with the reason.

    Of forms that as many have, which one it is does not depend on the order of the arms.
    """
    marks: dict[str, list[str]] = {}
    for arm in arms:
        known = marks.setdefault(arm.type, [])
        if arm.kinematics not in known:
            known.append(arm.kinematics)
    types: dict[str, list[ArmEstimate]] = {}
    for arm in arms:
        # Robots of one name that are not alike are numbered.
        number = marks[arm.type].index(arm.kinematics)
        name = arm.type if number == 0 else f"{arm.type} ({number + 1})"
        types.setdefault(name, []).append(arm)
    groups: dict[str, list[ArmEstimate]] = {}
    alone: list[tuple[ArmEstimate, str]] = []
    for name, members in types.items():
        forms = [arm.form for arm in members]
        usual = max(forms, key=lambda form: (forms.count(form), repr(form))) if len(set(forms)) > 1 else forms[0]
        groups[name] = [arm for arm, form in zip(members, forms, strict=True) if form == usual]
        another = "other joints, parameters, units or another law of friction"
        reason = f"not pooled: it has {another} than most arms of the type {name}"
        alone += [(arm, reason) for arm, form in zip(members, forms, strict=True) if form != usual]
    return groups, alone
