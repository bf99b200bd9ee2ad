"""Names that do not tell what they are named for: they leave another function of their angle, or their shape goes on.

A name says that a torque is one function, up to its coefficients and shape. Beside a right one no other function of
the same angle is more probable than none; beside a wrong one (a cable that is drawn tight, told as a cylinder) the
rest of the true function is. The same holds where a shape is at the end of what it may be and would go on. The torque
is kept, for it predicts, and its cause is called unknown.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dynid_rs.base.odds import SURE
from dynid_rs.diagnosis.belief import Belief
from dynid_rs.diagnosis.hypotheses import Place
from dynid_rs.diagnosis.shapes import searched
from dynid_rs.diagnosis.slopes import effect_slopes, is_logarithmic
from dynid_rs.diagnosis.standing import REFUTED
from dynid_rs.diagnosis.waves import Argument, of_signal, same_angles, waves
from dynid_rs.model.placed import CATALOGUE

AT_THE_END = 0.02
"""Logarithm of a shape over the end of its range within which it is at the end."""
ANGLES = ("q", "q_motor")
"""Signals that are a joint's own angle."""
SEEN_AS = {"q_motor": "q"}
"""Signals that are told by another name."""
LOOKED_AT = 2
"""Functions that are looked at closely; screening orders them."""


def nameless(belief: Belief) -> dict[Place, Argument]:
    """Places of names that leave a function of their own angle, and what that is a function of."""
    beside, n = belief.beside, belief.setup.robot.n_joints
    found = _at_an_end(belief)
    for kind, joints in [(effect.kind, effect.joints) for effect in belief.setup.effects]:
        arguments, turning = same_angles(kind, joints[0], n)
        functions = [waves(belief.catalogue, joints[0], [argument], turning=turning) for argument in arguments]
        scores = [score.value for score in beside.screened(functions)]
        for k in np.argsort(scores)[::-1][:LOOKED_AT].tolist():
            if beside.evidence_for(functions[k])[0] > SURE + float(np.log(len(functions))):
                found[kind, joints] = arguments[k]
                break
    return _parts_of(found, belief) | found


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


def _is_of_the_angle(kind: str) -> bool:
    """Whether a torque is a function of its joint's angle and of nothing else."""
    return set(CATALOGUE[kind]["signals"]) <= set(ANGLES) and not CATALOGUE[kind]["memory"]


def _at_an_end(belief: Belief) -> dict[Place, Argument]:
    """Places of names one of whose shapes is at an end of its range, and clearly beyond if it were free."""
    beside, slopes = belief.beside, effect_slopes(belief)
    model = beside.model.beside(*(slope.columns for slope in slopes))
    best = model.fit(beside.best.choice, beside.best.noise)
    first = len(best.x) - len(slopes)
    z = best.x[first:] / np.sqrt(np.diag(best.covariance)[first:])
    found: dict[Place, Argument] = {}
    for slope, outwards in zip(slopes, z.tolist(), strict=True):
        assert slope.effect is not None  # friction has no names
        kind, joints = slope.effect.kind, slope.effect.joints
        if not is_logarithmic(kind, slope.name):
            continue
        parameter = next(p for p in searched(kind) if p["name"] == slope.name)
        value = abs(slope.effect.shape_at(joints[0])[slope.name])
        low, high = (abs(np.log(value / parameter[end])) < AT_THE_END for end in ("lowest", "highest"))
        if (low and outwards < -REFUTED) or (high and outwards > REFUTED):
            found[kind, joints] = of_signal((SEEN_AS.get(s := CATALOGUE[kind]["signals"][0], s), joints[0]))
    return found
