"""What follows a gear's load tells how much of a joint's inertia is the rotor's, which no torque by itself does.

The rotor of a joint whose axis no other joint turns moves exactly as its link does: base parameters hold the sum. But
the gear carries the link alone, so friction under load, saturation and what teeth lose are those of a smaller load.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from dynid_rs.diagnosis.beside import Beside, independent_rows
from dynid_rs.diagnosis.candidate import RunColumns
from dynid_rs.diagnosis.hypothesis import Hypothesis, bounds_of
from dynid_rs.diagnosis.kinds import Kinds
from dynid_rs.diagnosis.peak import highest
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.shape_search import refined_shape
from dynid_rs.diagnosis.state import Search, columns_in, hypothesis_of, worth
from dynid_rs.placed import CATALOGUE, HeldEffect, PlacedEffect

KIND = "rotor_inertia"
SHARES = (0.0, 0.2, 0.4, 0.6, 0.8, 0.95)
"""Of a joint's whole inertia."""
REFINED = 6
"""Evaluations between the neighbours of the best one."""
CLEAR = 5.0
"""Logarithmic evidence from which a share is told."""


def with_rotors(state: Search) -> Setup:
    """Return the setup with the rotors that the effects' own load shows, each held; itself where none does.

    Parameters
    ----------
    state : Search
        Whose effects have just been fitted; torque in N m or N.
    """
    if state.fit.torque_unit_ != "N*m":
        return state.setup
    known = {held.effect.joints[0] for held in state.setup.held if held.effect.kind == KIND}
    held = list(state.setup.held)
    for k, effect in enumerate(state.setup.effects):
        j = effect.joints[0]
        follows = "tau_link" in CATALOGUE[effect.kind]["signals"] and len(effect.joints) == 1
        if not follows or j in known or state.kinds.hidden_rotor[j] <= 0:
            continue
        share = _share(Beside(state.fit, columns_in(state)[k]), state.kinds, hypothesis_of(effect, state.kinds))
        if share > 0:
            known.add(j)
            inertia = share * float(state.kinds.hidden_rotor[j])
            held.append(HeldEffect(PlacedEffect(KIND, (j,)), (inertia,)))
    return replace(state.setup, held=tuple(held)) if len(held) > len(state.setup.held) else state.setup


def _share(beside: Beside, kinds: Kinds, hypothesis: Hypothesis) -> float:
    """Part of the joint's inertia without which the effect's load explains most; 0 where that is not clear.

    An effect's shape was fitted with the whole inertia in its load, so near the best share it is fitted anew.
    """
    (j,) = hypothesis.joints
    whole, bounds = float(kinds.hidden_rotor[j]), bounds_of(hypothesis)

    def power(columns: RunColumns) -> float:
        return beside.gains(columns, [slice(None)], [bounds])[0].power

    def as_it_is(share: float) -> float:
        return power(kinds.with_rotor(j, share * whole).once(hypothesis))

    @cache
    def fitted_anew(share: float) -> float:
        other = kinds.with_rotor(j, share * whole)
        return power(other.once(refined_shape(other, hypothesis, power)))

    at = int(np.argmax([as_it_is(share) for share in SHARES]))
    ends = highest(fitted_anew, SHARES[max(at - 1, 0) : at + 2], REFINED)
    share, most = max(ends, key=lambda end: end[1])
    rows = float(independent_rows(beside.residual, beside.blocks)[j])
    return share if worth(most - fitted_anew(0.0), beside.n_rows, rows, 1) > CLEAR else 0.0
