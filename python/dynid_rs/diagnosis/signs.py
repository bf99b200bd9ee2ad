"""What a law says of the sign of its size holds in the fit that is reported too."""

from __future__ import annotations

from dataclasses import replace

from dynid_rs.diagnosis.belief import Belief
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.model.placed import CATALOGUE


def with_signs(found: Belief) -> Setup:
    """Return the setup with effects on two joints silent on the one where their size has the wrong sign in the fit.

    The search weighs sizes by the signs that they may have; the fit of all unknowns at once knows no bounds, and where
    a run hardly tells a joint's share it may come out as large as the torque, and negative. The least error within the
    bounds is then on them: at zero. An effect that no joint would have is left as it is.
    """
    x, effects = found.fit.links_.x_, []
    for effect, places in zip(found.setup.effects, found.places(), strict=True):
        entry = CATALOGUE[effect.kind]["coefficients"]
        sizes = x[[place for _, place in places[:: len(entry)]]]
        wrong = (sizes < entry[0]["lower"]) | (sizes > entry[0]["upper"])
        wrong |= [j in effect.silent for j in effect.joints]
        silent = tuple(j for j, is_wrong in zip(effect.joints, wrong, strict=True) if is_wrong)
        effects.append(effect if wrong.all() else replace(effect, silent=silent))
    return replace(found.setup, effects=tuple(effects))
