"""What a name has to stand: evidence at the noise that it leaves, small parts and whole runs."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.diagnosed import ROBOT, measured, recorded, rigid
from scipy.stats import wilcoxon

from dynid_rs.diagnosis import beside, holding
from dynid_rs.diagnosis.belief import Belief
from dynid_rs.diagnosis.beside import Beside
from dynid_rs.diagnosis.search import forward
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.shaped import Shaped
from dynid_rs.diagnosis.shapes import polished
from dynid_rs.diagnosis.trials import (
    N_SMALL,
    blocks,
    chance_of,
    evidence,
    shows_everywhere,
    whole_runs,
    worse,
)
from dynid_rs.model.placed import CATALOGUE
from dynid_rs.regression.linear_model import Score


@pytest.mark.parametrize(("wish", "hidden"), [("position_dependent_friction:elbow:5", True), (None, False)])
def test_a_large_effect_does_not_hide_behind_its_own_memory(monkeypatch, wish, hidden):
    """Without it in the model the residual is as slow as the effect; what it leaves is noise."""
    belief = Belief.in_declared(Setup(ROBOT), measured(*[wish] if wish else [], duration=8.0, n_runs=1))
    of_kind = [h for h in belief.hypotheses() if h.place == ("position_dependent_friction", (1,))]
    best = of_kind[int(np.argmax([score.value for score in belief.beside.screened(of_kind)]))]
    value = belief.beside.evidence_for(best)[0]
    monkeypatch.setattr(beside, "FORGETS", np.inf)
    by_its_own = belief.beside.evidence_for(best)[0]
    if hidden:
        assert value > 1.5 * by_its_own > 0
    else:
        assert value < 0
        assert by_its_own < 0


def test_many_comparisons_are_each_less_likely_to_be_chance():
    """Of fourteen at one in six, one nearly always says so where nothing is."""
    rng = np.random.default_rng(1)
    lost = rng.normal(size=(8, 4000, 14))
    assert np.mean(np.any(worse(lost), axis=-1)) > 0.8
    assert abs(np.mean(np.any(worse(lost, 14), axis=-1)) - 0.15) < 0.02


def test_whole_runs_are_left_out_and_the_thirds_of_a_lone_one():
    thirds = whole_runs(np.arange(6), [6])
    np.testing.assert_array_equal(np.array(thirds), np.repeat(np.eye(3, dtype=bool), 2, axis=1))
    first, second = whole_runs(np.arange(5), [2, 3])
    np.testing.assert_array_equal(first, [True, True, False, False, False])
    np.testing.assert_array_equal(second, ~first)


def test_what_returns_is_left_out_together():
    phase = np.array([0, 1, 2, 3, 4, 5, 0, 1, 2, 3, 4, 5])
    for parts in (whole_runs(phase, [12]), whole_runs(phase, [6, 6]), blocks(phase, 3)):
        np.testing.assert_array_equal(parts, [phase // 2 == part for part in range(3)])
    # The first and the third run show the same, and the fourth what both show.
    shown = np.array([0, 1, 10, 11, 1, 2, 2, 3])
    first, second = whole_runs(shown, [2, 2, 2, 2])
    np.testing.assert_array_equal(first, shown < 10)
    np.testing.assert_array_equal(second, shown >= 10)


def test_worse_is_worse_than_one_chance_in_six():
    """Student's t over the parts: two have to agree better than many of the same mean and scatter."""
    lost = np.array([[1.0, 1.0, -1.0], [1.0, -0.9, -1.0]])
    np.testing.assert_array_equal(worse(lost), [True, False, False])
    scattered = np.array([[2.0], [0.4]])
    assert not worse(scattered)
    assert worse(np.tile(scattered, (4, 1)))
    rng = np.random.default_rng(0)
    for n_parts in (2, 3, 8):
        assert abs(np.mean(worse(rng.normal(size=(n_parts, 20_000)))) - 0.16) < 0.01


def predicting(lost):
    """A model that loses so much in parts, (n_parts, n_joints)."""
    best = SimpleNamespace(weights=np.ones(lost.shape[1]))
    return SimpleNamespace(best=best, model=SimpleNamespace(left_out=lambda fit, parts: lost))


def test_a_name_shows_in_small_parts_everywhere_and_not_in_a_few():
    without = predicting(np.ones((N_SMALL, 2)))
    noise = 0.1 * np.random.default_rng(2).normal(size=(N_SMALL, 2))
    everywhere = predicting(0.9 + noise)
    unevenly = predicting(1.0 - np.geomspace(0.01, 100.0, N_SMALL)[:, None] * np.ones(2))
    places = predicting(1.0 - 5.0 * np.isin(np.arange(N_SMALL), [3, 20])[:, None] + noise)
    one_joint = predicting(np.array([0.8, 1.2]) + noise)
    assert shows_everywhere(without, everywhere, [0, 1], [])
    assert shows_everywhere(without, unevenly, [0, 1], [])
    assert not shows_everywhere(without, without, [0, 1], [])
    assert not shows_everywhere(without, places, [0, 1], [])
    assert [shows_everywhere(without, one_joint, [j], []) for j in (0, 1)] == [True, False]


def test_the_chance_of_gains_is_that_of_their_signed_ranks():
    rng = np.random.default_rng(4)
    for mean in (-1.0, 0.0, 0.5, 2.0):
        gain = rng.standard_t(2, N_SMALL) + mean
        told = wilcoxon(gain, alternative="greater", method="asymptotic", correction=False)
        assert chance_of(gain) == pytest.approx(told.pvalue)
    assert chance_of(np.zeros(N_SMALL)) == 0.5


def test_of_names_that_are_none_one_in_six_shows():
    rng, without = np.random.default_rng(3), predicting(np.ones((N_SMALL, 1)))
    tries = [predicting(1.0 + rng.standard_t(2, size=(N_SMALL, 1))) for _ in range(2000)]
    shown = np.mean([shows_everywhere(without, name, [0], []) for name in tries])
    assert 0.13 < shown < 0.19


def test_a_joint_whose_noise_has_fallen_waits_for_the_fit():
    """Beside a hysteresis that friction's shapes do not know of yet, what is left looks like the next effect."""
    belief = Belief.in_declared(Setup(ROBOT), measured("friction_hysteresis:wrist:3"))
    found, _ = forward(belief)
    assert [named.hypothesis.place for named in found] == [("friction_hysteresis", (2,))]


def test_a_delay_of_a_part_of_a_sample_is_told():
    """Nobody is handed out a clock that is off by a twentieth of a sample, so nothing stands beside it."""
    arm = replace(rigid(), noise_std=rigid().noise_std / 5)
    runs = recorded(arm, duration=12.0, n_runs=2, rate=50.0)
    late = [replace(run, tau=np.stack([np.interp(run.t - 0.001, run.t, x) for x in run.tau.T], axis=1)) for run in runs]
    belief = Belief.in_declared(Setup(ROBOT), late)
    ((named,), _) = forward(belief)
    assert named.hypothesis.kind == "torque_delay"


def test_what_is_no_more_probable_than_nothing_is_not_looked_at(monkeypatch):
    belief = Belief.in_declared(Setup(ROBOT), measured(duration=8.0, n_runs=1))
    hypotheses = belief.hypotheses()
    seen = hypotheses[0].place
    scores = [Score(1.0 if h.place == seen else -0.1, 1.0) for h in hypotheses]
    monkeypatch.setattr(Beside, "screened_and_hoped_for", lambda *_: (scores, [score.value for score in scores]))
    values, kept = evidence(belief.beside, hypotheses)
    assert set(values) == {seen}
    assert kept == hypotheses


@pytest.mark.parametrize("cycles", [5.0, 10.0])
def test_a_ripple_is_told_by_its_first_harmonic(cycles):
    """Five cycles with a second harmonic alone are ten."""
    runs = measured(duration=12.0, n_runs=2)
    rippled = [replace(run, tau=run.tau + [0, 1, 0] * np.cos(cycles * run.q)) for run in runs]
    belief = Belief.in_declared(Setup(ROBOT), rippled)
    (five,) = belief.catalogue.of([Shaped("torque_ripple", (1,), (("cycles", 5.0),))])
    found = polished(belief.beside, belief.catalogue, five)
    assert dict(found.shape)["cycles"] == pytest.approx(cycles, rel=0.02)


def test_what_goes_round_does_so_on_the_joint_s_way(monkeypatch):
    """With less than a cycle on it any curve is a part of the wave, and the likeliest order is none."""
    belief = Belief.in_declared(Setup(ROBOT), measured(duration=8.0, n_runs=1))
    monkeypatch.setattr(belief.catalogue, "_turns", np.full(3, 0.15))
    start = next(s for s in belief.catalogue.grid if (s.kind, s.joints) == ("torque_ripple", (1,)))

    def slower_is_better(self, tried):
        return [Score(-dict(h.shape)["cycles"], 1.0) for h in tried]

    monkeypatch.setattr(Beside, "screened", slower_is_better)
    (ripple,) = belief.catalogue.of([start])
    found = dict(polished(belief.beside, belief.catalogue, ripple).shape)["cycles"]
    assert 1.0 <= found * 0.15 < 1.2


def test_where_every_multiple_does_as_well_one_is_enough(monkeypatch):
    belief = Belief.in_declared(Setup(ROBOT), measured(duration=8.0, n_runs=1))
    (five,) = belief.catalogue.of([Shaped("torque_ripple", (1,), (("cycles", 5.0),))])
    monkeypatch.setattr(Beside, "screened", lambda self, tried: [Score(100.0, 1.0)] * len(tried))
    assert dict(polished(belief.beside, belief.catalogue, five).shape)["cycles"] == 10.0


def test_what_is_screened_together_is_what_is_screened_alone():
    belief = Belief.in_declared(Setup(ROBOT), measured(duration=8.0, n_runs=1))
    hypotheses = belief.hypotheses()
    scores, hopes = belief.beside.screened_and_hoped_for(hypotheses)
    alone = belief.beside.screened(hypotheses)
    np.testing.assert_allclose([s.value for s in scores], [s.value for s in alone], atol=1e-9)
    assert [s.size for s in scores] == [s.size for s in alone]
    np.testing.assert_allclose(hopes, belief.beside.hoped_for(hypotheses), atol=1e-9)


@pytest.mark.parametrize("n_rows", [8, 83, 1000])
def test_every_row_is_left_out_once(n_rows):
    parts = blocks(np.arange(n_rows))
    np.testing.assert_array_equal(np.sum(parts, axis=0), np.ones(n_rows))
    sizes = [int(part.sum()) for part in parts]
    assert max(sizes) - min(sizes) <= 1


def test_a_place_that_its_memory_hides_is_looked_at(monkeypatch):
    """Were rows independent it would come first: it is weighed, and stays when the others are left alone."""
    belief = Belief.in_declared(Setup(ROBOT), measured(duration=8.0, n_runs=1))
    hypotheses = belief.hypotheses()
    hidden = hypotheses[0].place
    screened, hoped = {True: Score(-100.0, 1.0), False: Score(0.0, 1.0)}, {True: 50.0, False: -100.0}
    monkeypatch.setattr(Beside, "screened", lambda self, tried: [screened[h.place == hidden] for h in tried])

    def both(self, tried):
        return [screened[h.place == hidden] for h in tried], [hoped[h.place == hidden] for h in tried]

    monkeypatch.setattr(Beside, "screened_and_hoped_for", both)
    monkeypatch.setattr(Beside, "evidence_for", lambda self, h: (-50.0, {}))
    values, kept = evidence(belief.beside, hypotheses)
    assert hidden in values
    assert {h.place for h in kept} == {hidden}


def test_a_stage_s_ratio_stays_one_of_a_gear(monkeypatch):
    """Where the evidence rises with it without end, a joint's friction goes by another's speed, as no stage's does."""
    belief = Belief.in_declared(Setup(ROBOT), measured(duration=8.0, n_runs=1))
    shape = (("partner", -1.0), ("ratio", 1.0), ("transition_width", 0.02))
    (start,) = belief.catalogue.of([Shaped("coupled_friction", (1, 2), shape)])
    monkeypatch.setattr(Beside, "screened", lambda self, tried: [Score(dict(h.shape)["ratio"], 1.0) for h in tried])
    (ratio,) = [p for p in CATALOGUE["coupled_friction"]["shape"] if p["name"] == "ratio"]
    found = dict(polished(belief.beside, belief.catalogue, start).shape)["ratio"]
    assert 0.5 * ratio["highest"] < found < ratio["highest"]


@pytest.mark.parametrize(("kind", "by_time"), [("thermal_friction", True), ("stribeck", False)])
def test_what_changes_while_a_motion_returns_is_left_out_by_time(monkeypatch, kind, by_time):
    asked = []
    monkeypatch.setattr(holding, "helps", lambda *given: asked.extend(given[3:]))
    belief = SimpleNamespace(phase=np.tile(np.arange(24), 2), run_lengths=[48], reach=lambda _: [0])
    tried = SimpleNamespace(hypothesis=SimpleNamespace(kind=kind), columns={})
    assert not holding.holds(belief, SimpleNamespace(with_columns=lambda _: None), tried, [], 0.0)
    parts, thirds = asked
    for left_out in (*parts, *thirds):
        assert np.all(left_out[:24] == left_out[24:]) != by_time
