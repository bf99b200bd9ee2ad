"""What was found earlier goes again where later findings leave it nothing to say."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dynid_rs.diagnosis.beside import Beside
from dynid_rs.diagnosis.choice import Weighed, tested, weigh
from dynid_rs.diagnosis.hypothesis import at_a_bound
from dynid_rs.diagnosis.settling import refit
from dynid_rs.diagnosis.state import Choice, Search, Step, columns_in, hypothesis_of, rms
from dynid_rs.diagnosis.structural import structural_parameters
from dynid_rs.diagnosis.structural.torque_gain import KIND as GAIN
from dynid_rs.diagnosis.warmth import WARMTH, sharing_clocks
from dynid_rs.recording import Recording

FAMILY_WISE = 0.01
"""Probability that anything at all is found where nothing is."""
CLEAR = 20.0
"""An effect with more evidence than this beside all others needs no further test to stay."""


def drop_needless(state: Search, train: Sequence[Recording]) -> None:
    """Take out effects that later findings have made needless."""
    while state.setup.effects:
        # An arm that warms up does so as a whole.
        alone = [k for k, effect in enumerate(state.setup.effects) if effect.kind != WARMTH]
        if not alone:
            return
        weighed, k = min((standing(state, k) for k in alone), key=lambda item: item[0].evidence)
        if weighed.evidence > CLEAR:
            return
        beside = Beside(state.fit, columns_in(state)[k])
        weighed = tested(beside, weighed, beside.left_out(None))
        # A shape that has come to a bound beside the others means another kind, or nothing.
        lost = at_a_bound(hypothesis_of(state.setup.effects[k], state.kinds))
        if not lost and weighed.p_value * len(state.setup.effects) < FAMILY_WISE:
            return
        effects = state.setup.effects[:k] + state.setup.effects[k + 1 :]
        state.setup = replace(state.setup, effects=effects)
        refit(state, train)
        state.steps.append(Step("dropped", Choice(weighed, weighed.p_value), rms(state.fit)))


def drop_doubtful_gains(state: Search, train: Sequence[Recording]) -> None:
    """Take out gains that do not stand out beside everything that was found after them, the least sure first."""
    from scipy.stats import norm

    while state.setup.gain_joints:
        gains = [p for p in structural_parameters(state.fit, state.setup) if p.kind == GAIN]
        if not gains:
            return
        p_values = [2 * float(norm.sf(abs(p.value[0]) / max(p.std_error[0], 1e-300))) for p in gains]
        worst = int(np.argmax(p_values))
        if p_values[worst] * max(state.n_tests, 1.0) < FAMILY_WISE:
            return
        place = (GAIN, gains[worst].joints)
        kept = tuple(j for j in state.setup.gain_joints if j not in gains[worst].joints)
        state.setup = replace(state.setup, gain_joints=kept)
        refit(state, train)
        added = [s for s in state.steps if s.action == "added" and s.choice.weighed.candidate.place == place]
        state.steps += [Step("dropped", replace(s.choice, p_value=p_values[worst]), rms(state.fit)) for s in added]


def standing(state: Search, k: int) -> tuple[Weighed, int]:
    """What still speaks for effect k beside all others, and k; a clock that joints share counts for the first."""
    beside = Beside(state.fit, columns_in(state)[k])
    candidate = state.kinds.candidate(hypothesis_of(state.setup.effects[k], state.kinds))
    if any(k in group[1:] for group in sharing_clocks(state.setup.effects)):
        candidate = replace(candidate, n_searched=0)
    return weigh(beside, candidate), k
