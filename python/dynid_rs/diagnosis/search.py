"""The search: forward one effect at a time, everything fitted again, earlier ones dropped where they are needless."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.beside import Beside, independent_rows
from dynid_rs.diagnosis.candidate import Candidate, joined, stacked
from dynid_rs.diagnosis.choice import Weighed, falls_by, tested, weigh
from dynid_rs.diagnosis.dropping import FAMILY_WISE, drop_doubtful_gains, drop_needless
from dynid_rs.diagnosis.hypothesis import Hypothesis, at_a_bound, bounds_of, has_no_end
from dynid_rs.diagnosis.kinds import Kinds
from dynid_rs.diagnosis.null import effective_tests
from dynid_rs.diagnosis.one_cylinder import PATCHES, named_by_task, without_patches
from dynid_rs.diagnosis.rotor_share import with_rotors
from dynid_rs.diagnosis.settling import refit, settle
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.state import EVEN, Choice, Search, Step, fitted, hypothesis_of, rms, worth
from dynid_rs.diagnosis.structural import structural_candidates
from dynid_rs.diagnosis.valleys import best_shape, pulls
from dynid_rs.diagnosis.warmth import on_one_clock, takes_too_much, warm_arm
from dynid_rs.recording import Recording

FloatArray = NDArray[np.float64]
Item = TypeVar("Item")

SHORTLIST = 7
"""Places whose shapes are refined and that are tested in a step."""
CONTENDER = 0.2
"""A place whose evidence in the scan is below this part of the best one's cannot win by a better shape."""
SLACK = 10.0
"""However small the evidence, places within this of the best one are looked at."""
LEAST_GAIN = 0.005
"""Part of the left-out error that an effect has to take off, of some joint on the whole or of its joints in most runs
and on average over them: less is of no use, however certain."""
LONE_GAIN, LONE_PAYS = 0.05, 1.0
"""The same where there is one run, and by how many standard errors the power on its left-out thirds has to fall."""
MOST_STEPS = 12
"""Steps of the search; each may add several effects."""
SIMPLER = {"counterbalance": "joint_spring"}
"""A kind that another one contains; it is always weighed beside that one."""
RIVAL = 0.5
"""Two candidates of which one takes more than this part of the other's gain are names of one thing."""
TIE = 2.33
"""Two candidates whose errors differ by fewer standard errors are a tie (one in a hundred)."""


def search(
    setup: Setup,
    train: Sequence[Recording],
    *,
    on_progress: Callable[[str], None] = lambda step: None,
) -> Search:
    """Find what the model lacks on training runs.

    Parameters
    ----------
    setup : Setup
        What is believed at the beginning.
    train : sequence of Recording
        Training runs, on one clock.
    """
    from threadpoolctl import threadpool_limits

    # Small matrices by the thousand: BLAS threads spin on each other and cost more than they give.
    with threadpool_limits(limits=1, user_api="blas"):
        fit = fitted(setup, train)
        state = Search(setup, fit, Kinds(fit))
        for step in range(MOST_STEPS):
            on_progress(f"step {step + 1}: {len(state.steps)} effects so far" if state.steps else "looking for effects")
            further = [
                *structural_candidates(state.fit, state.setup),
                *warm_arm(state.kinds, state.setup),
                *on_one_clock(state.kinds, state.setup),
            ]
            found = good_candidates(state, further)
            if not found:
                break
            was, done = state.setup, len(state.steps)
            for choice in found:
                state.setup = choice.weighed.candidate.accept(state.setup, choice.weighed.gain.coefficients)
            refit(state, train, new=len(state.setup.effects) - len(was.effects))
            rotors = with_rotors(state)
            if rotors is not state.setup:
                state.setup = rotors
                refit(state, train, new=len(state.setup.effects))
            state.steps += [Step("added", choice, rms(state.fit)) for choice in found]
            drop_needless(state, train)
            if _in_vain(was, state, state.steps[done:]):
                break
        # Shapes once more, now that everything is there; friction's and an effect's settle in turn.
        settle(state, train, range(len(state.setup.effects)))
        simpler = without_patches(state)
        if simpler is not state.setup:
            places = {(effect.kind, effect.joints) for effect in simpler.effects}
            state.setup = simpler
            refit(state, train, new=len(simpler.effects))
            gone = [s for s in state.steps if s.action == "added" and _is_gone(s.choice, places)]
            state.steps += [Step("dropped", step.choice, rms(state.fit)) for step in gone]
            drop_needless(state, train)
        drop_doubtful_gains(state, train)
    return state


def good_candidates(state: Search, further: Sequence[Candidate]) -> list[Choice]:
    """The candidate that explains most, and others that explain something else; none if none is good enough."""
    beside = Beside(state.fit)
    ranked, tests = scan(beside, state, further)
    if not ranked:
        return []
    without = beside.left_out(None)
    if np.isnan(state.n_tests):
        state.n_tests = effective_tests(beside, tests)
    good: list[Choice] = []
    looked: list[Weighed] = []
    for candidate in shortlist(beside, state.kinds, ranked):
        weighed = weigh(beside, candidate)
        if weighed.gain.power <= 0:
            continue
        weighed = tested(beside, weighed, without)
        looked.append(weighed)
        p = min(1.0, weighed.p_value * state.n_tests)
        certain = p < FAMILY_WISE and outweighs_nothing(weighed, state.setup)
        certain = certain and carries_over(weighed, lone=beside.n_runs == 1)
        if certain and not takes_too_much(beside, state.kinds, weighed):
            good.append(Choice(weighed, p))
    # A shape without end may be what others leave: it waits until they are in.
    ended = [c for c in good if not has_no_end(c.weighed.candidate.kind, c.weighed.candidate.shape)]
    good = sorted(ended or good, key=lambda choice: -choice.weighed.evidence)
    chosen = [named_by_task(choice, state.kinds) for choice in _different(beside, good)]
    return [_told_apart(beside, choice, looked) for choice in chosen]


def shortlist(
    beside: Beside, kinds: Kinds, ranked: Sequence[tuple[float, Hypothesis | Candidate]]
) -> Iterator[Candidate]:
    """Candidates with their best shapes that may win; one whose shape has no end stands in nobody's way."""
    best = None
    listed: list[tuple[str, tuple[int, ...]]] = []
    places: set[Hashable] = set()  # a clock that another joint lends is no place of its own
    for value, item in ranked:
        places.add((item.kind, item.joints, isinstance(item, Candidate) or pulls(item)))
        if len(places) > SHORTLIST or (best is not None and value < min(CONTENDER * best, best - SLACK)):
            break
        candidate = item if isinstance(item, Candidate) else refined_candidate(beside, kinds, item)
        if candidate is not None:
            best = value if best is None else best
            listed.append(candidate.place)
            yield candidate
    # What is a straight line as far as the data go is the simpler of the two.
    simpler = [(SIMPLER[kind], joints) for kind, joints in listed if kind in SIMPLER]
    for _, item in ranked:
        if (
            isinstance(item, Hypothesis)
            and (item.kind, item.joints) in simpler
            and (item.kind, item.joints) not in listed
        ):
            candidate = refined_candidate(beside, kinds, item)
            if candidate is not None:
                listed.append(candidate.place)
                yield candidate


def carries_over(weighed: Weighed, *, lone: bool) -> bool:
    """Whether blocks that were left out are predicted better, on the whole or most of them and on average.

    One run that goes where the others have not been may lose more to every extrapolated parameter than all gain. The
    thirds of a lone run resemble each other, so there both are asked, and more of each.
    """
    if lone:
        return weighed.left_out_ratio < 1 - LONE_GAIN and weighed.pays > LONE_PAYS and weighed.mean_log_ratio < 0
    on_the_whole = weighed.left_out_ratio < 1 - LEAST_GAIN and weighed.pays > 0
    typical = max(weighed.mean_log_ratio, weighed.median_log_ratio)
    return on_the_whole or bool(typical < 2 * np.log(1 - LEAST_GAIN))


def outweighs_nothing(weighed: Weighed, setup: Setup) -> bool:
    """Whether the evidence is for a candidate; one more name on a joint that has one must not tie with none."""
    named = {j for effect in setup.effects for j in effect.joints}
    return weighed.evidence > (EVEN if named & set(weighed.candidate.joints) else 0.0)


def _different(beside: Beside, good: Sequence[Choice]) -> list[Choice]:
    """The best, its rivals as its ties, and of the others those that no better one would make needless."""
    chosen: list[Choice] = []
    for choice in good:
        rival = next(
            (k for k, better in enumerate(chosen) if overlap(beside, better.weighed, choice.weighed) > RIVAL), None
        )
        if rival is None:
            chosen.append(choice)
        elif chosen[rival].weighed.candidate.place == choice.weighed.candidate.place:
            continue
        elif _as_good(beside, choice.weighed, chosen[rival].weighed):
            chosen[rival] = replace(chosen[rival], ties=(*chosen[rival].ties, choice))
    return chosen


def _told_apart(beside: Beside, choice: Choice, looked: Sequence[Weighed]) -> Choice:
    """The choice with those that would explain the same, and explain less of it."""
    names = {other.weighed.candidate.place for other in (choice, *choice.ties)}
    rivals = [
        other
        for other in sorted(looked, key=lambda w: -w.evidence)
        if other.candidate.place not in names and overlap(beside, choice.weighed, other) > RIVAL
    ]
    return replace(choice, refuted=tuple(once_each(rivals, lambda other: other.candidate.place)))


def once_each(items: Iterable[Item], place: Callable[[Item], object]) -> list[Item]:
    """The first item of every place: two shapes of one effect have one name."""
    first: dict[object, Item] = {}
    for item in items:
        first.setdefault(place(item), item)
    return list(first.values())


def _as_good(beside: Beside, first: Weighed, second: Weighed) -> bool:
    """Whether nothing tells which of two candidates it is: by the scatter of their difference, or by the odds."""
    odds = abs(first.evidence - second.evidence)
    return odds < EVEN or abs(falls_by(beside, first.after, second.after)) < TIE


def overlap(beside: Beside, first: Weighed, second: Weighed) -> float:
    """Part of the second's gain that the first takes away: 0 for different effects, 1 for two names of one."""
    columns = joined([stacked(first.candidate.columns), stacked(second.candidate.columns)])
    bounds = np.concatenate([first.candidate.bounds, second.candidate.bounds])
    together = beside.gains(columns, [slice(None)], [bounds])[0].power
    return 1.0 - max(together - first.gain.power, 0.0) / max(second.gain.power, 1e-300)


def scan(
    beside: Beside, state: Search, further: Sequence[Candidate]
) -> tuple[list[tuple[float, Hypothesis | Candidate]], list[tuple[dict[int, FloatArray], list[slice]]]]:
    """Best shape of every place, the most likely place first; and all columns, for the null."""
    hypotheses = [h for h in state.kinds.grid() if not _there(h, state.setup)]
    columns = state.kinds.columns(hypotheses)
    by_joints: dict[tuple[int, ...], list[int]] = {}
    for k, h in enumerate(hypotheses):
        by_joints.setdefault(h.joints, []).append(k)
    rows = float(np.mean(independent_rows(beside.residual, beside.blocks)))
    best: dict[tuple[Hashable, ...], tuple[float, Hypothesis | Candidate]] = {}
    tests: list[tuple[dict[int, FloatArray], list[slice]]] = []
    for joints, members in by_joints.items():
        parts = [stacked(columns[k]) for k in members]
        together = joined(parts)
        edges = np.cumsum([0, *(part[joints[0]].shape[1] for part in parts)])
        groups = [slice(int(a), int(b)) for a, b in pairwise(edges)]
        tests.append((together, groups))
        gains = beside.gains(together, groups, [bounds_of(hypotheses[k]) for k in members])
        for k, gain in zip(members, gains, strict=True):
            h = hypotheses[k]
            n_free = int(np.sum(gain.coefficients != 0))
            value = worth(gain.power, len(joints) * beside.n_rows, len(joints) * rows, n_free) - state.kinds.doubt(h)
            place = (h.kind, h.joints, pulls(h))
            if value > best.get(place, (-np.inf, h))[0]:
                best[place] = (value, h)
    for candidate in further:
        part = stacked(candidate.columns)
        gain = beside.gains(part, [slice(None)], [candidate.bounds])[0]
        tests.append((part, [slice(None)]))
        value = worth(gain.power, len(part) * beside.n_rows, len(part) * rows, len(candidate.bounds))
        best[(*candidate.place, candidate.shape)] = (value, candidate)
    return sorted(best.values(), key=lambda pair: -pair[0]), tests


def _there(h: Hypothesis, setup: Setup) -> bool:
    """Whether the setup has this kind at this place already; of periodic ones, with about this period."""
    for effect in setup.effects:
        if effect.kind == h.kind and set(effect.joints) == set(h.joints):
            cycles = dict(effect.shape).get("cycles")
            if cycles is None or abs(cycles[0] - dict(h.shape)["cycles"]) < 0.6:
                return True
    return False


def refined_candidate(beside: Beside, kinds: Kinds, hypothesis: Hypothesis) -> Candidate | None:
    """Candidate of the hypothesis with the best shape near its own; None where that stands at a bound."""
    refined = best_shape(beside, kinds, hypothesis)
    return None if at_a_bound(refined) else kinds.candidate(refined)


def _in_vain(was: Setup, state: Search, steps: Sequence[Step]) -> bool:
    """Whether all that was added was dropped again, and nothing else: the next step would only do the same."""
    places = [[s.choice.weighed.candidate.place for s in steps if s.action == a] for a in ("added", "dropped")]
    if sorted(places[0]) != sorted(places[1]) or len(was.held) != len(state.setup.held):
        return False
    return all(_there(hypothesis_of(effect, state.kinds), was) for effect in state.setup.effects)


def _is_gone(choice: Choice, places: set[tuple[str, tuple[int, ...]]]) -> bool:
    candidate = choice.weighed.candidate
    return candidate.kind in PATCHES and candidate.place not in places
