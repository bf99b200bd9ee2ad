"""Names that do not tell what they are named for: any function of their angle does as well.

A name says that a torque is one function, up to its coefficients and shape. In the place of a right one a function
without a name, which pays for every wave, is far less probable, and beside it no more probable than none; in the place
of a wrong one (a cable drawn tight, told as a cylinder), or beside it, it is not. Ripple returns: where that was not
seen, it is any function too; a cylinder whose shape ends where the kind's do may be another one. The torque is kept,
for it predicts, and its cause is called unknown.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from dynid_rs.base.odds import SURE
from dynid_rs.diagnosis.belief import Belief
from dynid_rs.diagnosis.beside import Beside
from dynid_rs.diagnosis.hypotheses import Catalogue, Hypothesis
from dynid_rs.diagnosis.rivals import Contest, valued
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.shaped import Place, Shaped
from dynid_rs.diagnosis.shapes import is_at_an_end
from dynid_rs.diagnosis.waves import SMOOTHER, Argument, same_angles, smoother, waves
from dynid_rs.model.placed import CATALOGUE

ANGLES = ("q", "q_motor")
"""Signals that are a joint's own angle."""
SEEN_AGAIN = 2.0
"""Times that ripple has to go round on the joint's way: it is told by its return, and before that it is any curve."""
LOOKED_AT = 2
"""Functions that are looked at closely; screening orders them."""


def nameless(belief: Belief, contests: Mapping[Place, Contest]) -> dict[Place, Argument]:
    """Places of names that a function of their own angle does as well as, and what that is a function of.

    So does one in the place of ripple that was not seen again. Where the data refute neither the name nor a function of
    the joint's own angle, or what they show of a law is any curve's too (ripple not seen again, a shape at the end of
    what the kind may have), the name is one of two answers: the function is its tie (`Named.another_function`).
    Several names of functions of one angle are that only together, where all of them are open.

    `contests` (`settle_rivals`) hold the model without each torque, and what the torque is worth there.
    """
    n = belief.setup.robot.n_joints
    found: dict[Place, Argument] = {}
    undecided: dict[Place, float] = {}
    for place, against in contests.items():
        kind, joints = place
        arguments, turning = same_angles(kind, joints[0], n)
        if not arguments:
            continue  # it is no function of an angle
        functions = [waves(belief.catalogue, joints[0], [argument], turning=turning) for argument in arguments]
        beside, at = _likeliest(belief.beside, belief.catalogue, functions)
        if beside > SURE:
            found[place] = arguments[at]
        in_its_place, at = _likeliest(against.beside, belief.catalogue, functions)
        odds = in_its_place - against.own.value
        if odds > -SURE:
            found[place] = arguments[at]
        if place not in belief.named:
            continue  # believed from the beginning
        shaped = Shaped(kind, joints, against.own.hypothesis.shape)
        times = belief.catalogue.times_round(shaped)
        was_seen = times >= SEEN_AGAIN and not is_at_an_end(shaped)
        if times < SEEN_AGAIN:
            found.setdefault(place, arguments[0])
        if beside <= SURE and ((at == 0 and abs(odds) <= SURE) or (odds < -SURE and not was_seen)):
            undecided[place] = odds
    found = _parts_of(found, belief) | found
    for place, odds in undecided.items():
        here = [other for other in found if other[1][0] == place[1][0] and other in belief.named]
        if all(other in undecided for other in here):  # else they are parts of one
            belief.named[place] = replace(belief.named[place], another_function=odds)
    return found


def _likeliest(model: Beside, catalogue: Catalogue, functions: Sequence[Hypothesis]) -> tuple[float, int]:
    """The greatest evidence that a function has in a model, and which one it is.

    The joint's own angle, which comes first, is one place; all its sums with others are another.
    """
    scores = [score.value for score in model.screened(functions)]
    tries = [
        (_averaged(model, catalogue, functions[k]) - (float(np.log(len(functions) - 1)) if k else 0.0), k)
        for k in np.argsort(scores)[::-1][:LOOKED_AT].tolist()
    ]
    return max(tries)


def _averaged(model: Beside, catalogue: Catalogue, function: Hypothesis) -> float:
    """Evidence of a function, which is as smooth as any beforehand."""
    from scipy.special import logsumexp

    values = [valued(model, catalogue, smoother(function, more)).value for more in SMOOTHER]
    return float(logsumexp(values) - np.log(len(values)))


def _parts_of(found: dict[Place, Argument], belief: Belief) -> dict[Place, Argument]:
    """Places of all functions of an angle where one of them has no name: together they are what it is a part of."""
    by_joint = of_the_angle(found)
    return {
        (effect.kind, effect.joints): by_joint[effect.joints[0]]
        for effect in belief.setup.effects
        if effect.joints[0] in by_joint and _is_of_the_angle(effect.kind)
    }


def of_the_angle(found: Mapping[Place, Argument]) -> dict[int, Argument]:
    """Joints where what has no name is a function of the angle alone."""
    return {joints[0]: argument for (kind, joints), argument in found.items() if _is_of_the_angle(kind)}


def ended(setup: Setup, found: Collection[Place], angles: Sequence[Sequence[float]]) -> Setup:
    """Return the setup with functions of an angle at places that were `found` ending where they were learned.

    `angles` (n_joints, 2) of the training runs: beyond them such a function keeps its value, for it is no law that says
    more. A law says the same at every angle, whichever of two it is and however large: the links are fitted beside it,
    and what it has in common with gravity is in both of them, there as here.
    """
    nameless_of_angle = {place for place in found if _is_of_the_angle(place[0])}
    effects = [
        effect.held(angles[effect.joints[0]]) if (effect.kind, effect.joints) in nameless_of_angle else effect
        for effect in setup.effects
    ]
    return replace(setup, effects=tuple(effects))


def _is_of_the_angle(kind: str) -> bool:
    """Whether a torque is a function of its joint's angle and of nothing else."""
    return set(CATALOGUE[kind]["signals"]) <= set(ANGLES) and not CATALOGUE[kind]["memory"]
