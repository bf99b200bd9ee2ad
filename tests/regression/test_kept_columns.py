"""Columns that are kept within a diagnosis: the very bits of new ones, and built only where something is new."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.made_runs import MadeRun, arm
from numpy.testing import assert_array_equal

from dynid_rs import _core
from dynid_rs.diagnosis.hypotheses import Catalogue
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.waves import of_signal, waves
from dynid_rs.identification.links import LinkDynamicsIdentifier
from dynid_rs.identification.loops import declared_plan
from dynid_rs.identification.smooth_friction import SmoothFrictionIdentifier, smooth
from dynid_rs.identification.three_loops import ThreeLoopIdentifier
from dynid_rs.model.placed import CATALOGUE
from dynid_rs.regression import kept_columns
from dynid_rs.regression.columns import run_rows
from dynid_rs.regression.kept_columns import effect_key, effect_rows, keeping_columns
from dynid_rs.runs.preprocessing import Band, prepare

N = 6


@pytest.fixture(scope="module")
def states():
    run = prepare(MadeRun(0, duration=6.0, rate=200.0).read()[0], Band(5.0), 200.0)
    return replace(run, tau_link=np.cos(run.q))


def friction(width=0.01):
    return smooth(np.full(N, width), np.full(N, 2.5))


def of_load():
    shape = {p["name"]: np.full(N, p["grid"][0]) for p in CATALOGUE["load_dependent_friction"]["shape"]}
    return _core.Effect.of("load_dependent_friction", **shape)


@pytest.fixture
def built(monkeypatch):
    """What is asked of the compiled module: kinds of effects, and whether links are among the columns."""
    asked, build = [], kept_columns._observe

    def told(robot, effects, pivots, states, tau):
        asked.append(([effect.kind for effect in effects], bool(pivots)))
        return build(robot, effects, pivots, states, tau)

    monkeypatch.setattr(kept_columns, "_observe", told)
    return asked


def test_only_what_is_new_is_built_and_every_bit_is_that_of_new_columns(states, built):
    first, other = declared_plan(arm(), friction()), declared_plan(arm(), friction(0.02), [of_load()])
    moved = replace(states, tau_link=2 * states.tau_link)
    turned = replace(states, ddq=states.ddq[::-1].copy())
    asked = [(first, states), (first, states), (other, states), (other, moved), (first, turned)]
    with keeping_columns():
        found = [run_rows(plan, run, run.tau * (k + 1)) for k, (plan, run) in enumerate(asked)]
    declared = ["rotor_inertia", "torque_offset"]
    assert built == [
        ([*declared, "smooth_friction"], True),
        ([], False),
        (["load_dependent_friction", "smooth_friction"], False),
        (["load_dependent_friction"], False),
        ([*declared, "smooth_friction"], True),
    ]
    for k, ((plan, run), rows) in enumerate(zip(asked, found, strict=True)):
        for one, new in zip(rows, run_rows(plan, run, run.tau * (k + 1)), strict=True):
            assert_array_equal(one, new)


def test_an_effect_alone_is_the_same_and_is_kept_for_every_joint(states):
    alone = [effect_rows(friction(), states, j) for j in range(N)]
    with keeping_columns():
        again = [effect_rows(friction(), states, j) for j in range(N)]
        assert effect_rows(friction(), states, 2) is again[2]
    for one, other in zip(alone, again, strict=True):
        assert_array_equal(one, other)
    assert effect_key(friction(), states) != effect_key(friction(0.02), states)


def test_columns_of_the_motors_torque_are_kept_as_long_as_it_stays(states):
    saturation, run = _core.Effect.of("torque_saturation"), replace(states, tau_motor=np.sin(states.q))
    friction_moved, load_moved = replace(run, tau_motor=2 * run.tau_motor), replace(run, tau_link=2 * run.tau_link)
    with keeping_columns():
        first = effect_rows(saturation, run, 1)
        assert effect_rows(saturation, load_moved, 1) is first
        assert_array_equal(effect_rows(saturation, friction_moved, 1), 8 * first)


def test_what_was_used_longest_ago_goes_first(states, monkeypatch):
    size = sum(part.nbytes for part in run_rows(declared_plan(arm(), friction()), states, states.tau))
    monkeypatch.setattr(kept_columns, "MOST_BYTES", size // 4)
    kept = kept_columns.KeptColumns()
    part = [np.zeros(size // 80)]  # a tenth of the size
    for key in ("one", "two"):
        kept.put((key,), part)
    assert kept.get(("one",)) is part
    kept.put(("three",), part)
    assert kept.get(("two",)) is None
    assert kept.get(("one",)) is part
    assert kept.get(("three",)) is part


def test_nothing_is_kept_outside(states, built):
    plan = declared_plan(arm(), friction())
    for _ in range(2):
        run_rows(plan, states, states.tau)
    assert len(built) == 2
    assert all(links for _, links in built)


def test_shapes_that_are_held_are_fitted_to_once(monkeypatch):
    """Links that have been fitted to the same rows afresh are not fitted to them afresh again."""
    fits, fit = [], LinkDynamicsIdentifier.fit

    def counted(self, observations, **options):
        fits.append((id(observations), options.get("again")))
        return fit(self, observations, **options)

    monkeypatch.setattr(LinkDynamicsIdentifier, "fit", counted)
    held = SmoothFrictionIdentifier((np.full(N, 0.01), np.full(N, 2.5)), held=True)
    runs = [MadeRun(k, duration=6.0, rate=200.0, two_encoders=False).read()[0] for k in range(2)]
    found = Setup(arm()).identifier(residual=None, friction=held).fit(runs)
    fresh = [rows for rows, again in fits if again is False]
    assert len(fresh) == len(set(fresh)) == 1
    assert_array_equal(found.friction_.transition_width_, 0.01)


def test_waves_are_those_of_products_of_cosines():
    """Columns of two signals, by another road; with and without what is kept."""
    runs = [MadeRun(k, duration=6.0, rate=200.0, two_encoders=False).read()[0] for k in range(2)]
    catalogue = Catalogue(Setup(arm()).identifier(residual=None).fit(runs))
    pair = [of_signal(("q", 1)), of_signal(("tau_link", 2))]
    with keeping_columns():
        kept = [waves(catalogue, j, pair) for j in (0, 3)]
    ends = [np.concatenate([argument.values(s) for s in catalogue.runs]) for argument in pair]
    for j, h in zip((0, 3), kept, strict=True):
        angles = [
            [np.pi * (argument.values(s) - end.min()) / np.ptp(end) for argument, end in zip(pair, ends, strict=True)]
            for s in catalogue.runs
        ]
        raw = np.concatenate([s.in_band(np.cos(2 * u) * np.cos(v)) * s.counted[:, j] for s, (u, v) in
                              zip(catalogue.runs, angles, strict=True)])  # fmt: skip
        at = [k for k in range(len(h.names)) if np.corrcoef(raw, h.columns[j][:, k])[0, 1] > 1 - 1e-9]
        assert len(at) == 1
        assert_array_equal(h.columns[j], waves(catalogue, j, pair).columns[j])


def test_warmth_at_chosen_samples_has_been_gathered_at_the_runs_own_rate(states):
    """The slower the recording, the longer a sample: half the rate gathers twice the warmth in as many samples."""
    shape = {p["name"]: np.full(N, p["grid"][0]) for p in CATALOGUE["thermal_friction"]["shape"]}
    plan = declared_plan(arm(), friction(), [_core.Effect.of("thermal_friction", **shape)])
    at = [200, 500, len(states.t) - 200]
    chosen = run_rows(plan, states, states.tau, kept=at)
    slower = run_rows(plan, replace(states, rate=states.rate / 2), states.tau, kept=at)
    warm = [k for k, effect in enumerate(plan.effects) if effect.kind == "thermal_friction"]
    assert warm
    first = sum(effect.n_columns for effect in plan.effects[: warm[0]])
    for one, other in zip(chosen, slower, strict=True):
        assert (np.abs(other[1:, first]) > 1.2 * np.abs(one[1:, first])).all()


def test_an_effect_is_built_on_the_joints_that_it_acts_on(states, built):
    """There its very bits, elsewhere zeros; beside all others as without keeping."""
    plan = declared_plan(arm(), friction(), [of_load()])
    at, own = slice(2, 2 + of_load().n_columns), plan.own.copy()
    own[:, at] = np.arange(N)[:, None] == 2
    lone = replace(plan, own=own)
    with keeping_columns():
        rows = run_rows(lone, states, states.tau)
        again = run_rows(lone, states, states.tau)
    assert built == [(["rotor_inertia", "torque_offset", "smooth_friction"], True), ([], False)]
    for j, (some, same, every) in enumerate(zip(rows, again, run_rows(plan, states, states.tau), strict=True)):
        assert_array_equal(some, same)
        assert_array_equal(some[:, at], every[:, at] * (j == 2))
        assert_array_equal(np.delete(some, at, axis=1), np.delete(every, at, axis=1))


def test_a_fit_builds_the_links_columns_of_a_motion_once(built):
    runs = [MadeRun(seed, duration=6.0, rate=200.0).read()[0] for seed in (0, 1)]
    ThreeLoopIdentifier(arm(), residual=None).fit(runs)
    # As it was recorded, and less its encoders' delay.
    assert sum(links for _, links in built) == 2 * len(runs) < len(built)


def test_what_is_kept_inside_is_kept_outside(states, built):
    plan = declared_plan(arm(), friction())
    with keeping_columns():
        for _ in range(2):
            with keeping_columns():
                run_rows(plan, states, states.tau)
        run_rows(plan, states, states.tau)
    assert [links for _, links in built] == [True, False, False]
