"""Names that do not tell what they are named for: what they leave is one more function of their own angle.

A name says that a torque is one function, up to its coefficients and shape. Beside a right one no other function of
the same angle is more probable than none; beside a wrong one (a cable that is drawn tight, told as a cylinder) the
rest of the true function is. Its torque is kept, for it predicts, and its cause is called unknown.
"""

from __future__ import annotations

import numpy as np

from dynid_rs.base.odds import SURE
from dynid_rs.diagnosis.belief import Belief
from dynid_rs.diagnosis.hypotheses import Place
from dynid_rs.diagnosis.waves import Argument, same_angles, waves

LOOKED_AT = 2
"""Functions that are looked at closely; screening orders them."""


def nameless(belief: Belief) -> dict[Place, Argument]:
    """Places of names that leave a function of their own angle, and what that is a function of."""
    beside, n = belief.beside, belief.setup.robot.n_joints
    found: dict[Place, Argument] = {}
    for kind, joints in [(effect.kind, effect.joints) for effect in belief.setup.effects]:
        arguments, turning = same_angles(kind, joints[0], n)
        functions = [waves(belief.catalogue, joints[0], [argument], turning=turning) for argument in arguments]
        scores = [score.value for score in beside.screened(functions)]
        for k in np.argsort(scores)[::-1][:LOOKED_AT].tolist():
            if beside.evidence_for(functions[k])[0] > SURE + float(np.log(len(functions))):
                found[kind, joints] = arguments[k]
                break
    return found
