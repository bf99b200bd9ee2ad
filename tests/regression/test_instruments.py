"""Instrumental variables under feedback, and the size and power of the Durbin-Wu-Hausman test."""

from dataclasses import replace

import numpy as np
import pytest
from helpers import closed_loop
from helpers.run_files import valid_columns, write
from helpers.tolerances import ALGEBRAIC
from numpy.testing import assert_allclose
from scipy.signal import lfilter

from dynid_rs import InstrumentalVariables, LinkDynamicsIdentifier, Recording, _core, read_recording
from dynid_rs.base.wording import verdict
from dynid_rs.regression import instruments as instruments_module
from dynid_rs.regression.columns import make_plan, observe
from dynid_rs.regression.instruments import choose_source, endogeneity, instrument_states
from dynid_rs.runs import motion_band
from dynid_rs.runs.preprocessing import Band, prepare

ENCODER_NOISE = 2e-3
"""Noise of the encoders [rad]: coarse, so that 16 seconds show what an hour would show with a fine one."""
N_SIGMA = 4
"""Standard errors within which the estimate has to be; seeded."""
SOURCES = ("reference", "smooth")


@pytest.fixture(scope="module")
def plan():
    robot = closed_loop.robot()
    friction = _core.Effect.friction([0.0] * 3, [closed_loop.WIDTH] * 3)
    return make_plan(robot, [_core.Effect.rotor_inertia(), _core.Effect.torque_offset(), friction])


def fitted(plan, states, source="auto"):
    observations = observe(plan, [states])
    links = LinkDynamicsIdentifier(prior=None).fit(observations)
    return links, InstrumentalVariables(source).fit(observations, links, [states])


def truth(plan):
    x = np.zeros(plan.n_columns)
    x[: plan.n_base] = plan.robot.base_parameters().project(plan.robot.phi)
    names = [name for effect in plan.effects for name in effect.coefficient_names]
    for j in range(3):
        for name, values in (("coulomb", closed_loop.COULOMB), ("viscous1", closed_loop.VISCOUS)):
            for side in ("pos", "neg"):
                x[plan.n_base + j * plan.n_own + names.index(f"{name}_{side}")] = values[j]
    return x


@pytest.mark.parametrize("source", SOURCES)
def test_least_squares_is_biased_under_feedback_and_instruments_are_not(plan, source):
    """By noise in the band of the motion, which nothing tells from it."""
    recording = closed_loop.run(ENCODER_NOISE, memory=0.8).recording(torque_noise=0.2)
    links, instruments = fitted(plan, prepare(recording, Band(10.0), closed_loop.RATE), source)
    base = slice(0, plan.n_base)
    error = {"ls": links.x_ - truth(plan), "iv": instruments.x_ - truth(plan)}
    score = {name: np.abs(e[base]) / instruments.std_error_[base] for name, e in error.items()}
    assert score["iv"].max() < N_SIGMA
    assert np.sort(score["ls"])[-2:].min() > N_SIGMA  # two base parameters at least
    assert instruments.p_value_ < 1e-6
    assert np.abs(instruments.shift_).max() > 3
    said = endogeneity(instruments, [f"x{k}" for k in range(plan.n_columns)])
    assert said["biased"]
    assert said["instruments"] == source


def test_noise_above_the_motion_does_no_harm(plan, monkeypatch):
    """Positions are low-passed where their motion ends: as they were filtered, two base parameters were far off."""
    recording = closed_loop.run(ENCODER_NOISE).recording(torque_noise=0.2)
    base, score = slice(0, plan.n_base), []
    for margin in (motion_band.MARGIN, 1e6):  # the second keeps all that the band's filter passes
        monkeypatch.setattr(motion_band, "MARGIN", margin)
        links, instruments = fitted(plan, prepare(recording, Band(10.0), closed_loop.RATE), "reference")
        score.append(np.sort(np.abs(links.x_ - truth(plan))[base] / instruments.std_error_[base]))
    assert score[0][-1] < N_SIGMA < score[1][-2]


def test_the_test_says_nothing_about_the_same_motion_measured_well(plan):
    """The loop of the test above, the encoder a hundred times finer: noise of the torque alone."""
    recording = closed_loop.run(ENCODER_NOISE / 100).recording(torque_noise=0.5)
    _, instruments = fitted(plan, prepare(recording, Band(10.0), closed_loop.RATE), "reference")
    assert not endogeneity(instruments, [""] * plan.n_columns)["biased"]


def test_a_variance_that_rounds_below_nothing_is_nothing(plan, monkeypatch):
    """Of a joint whose noise is as good as none; the root of it went into `result.json` as NaN."""

    def below_nothing(observations, runs, residuals, columns, breads):
        halves = [part[0].shape[1] // 2 for part in columns]  # columns as they are, then as instruments show them
        return [np.diag([1.0] * half + [-1e-20] * half) for half in halves]

    monkeypatch.setattr(instruments_module, "noise_products", below_nothing)
    recording = closed_loop.run(ENCODER_NOISE).recording(torque_noise=0.2)
    _, instruments = fitted(plan, prepare(recording, Band(10.0), closed_loop.RATE), "smooth")
    assert np.all(instruments.std_error_ == 0)
    assert np.all(np.isfinite(instruments.shift_))


@pytest.mark.parametrize("untold", [1, None])
def test_what_short_runs_do_not_tell_is_not_compared(plan, monkeypatch, untold):
    """Shifts over a standard error of none were infinite, and no result was written: nine seconds, seven joints."""

    def nothing_left(observations, runs, residuals, columns, breads):
        halves = [part[0].shape[1] // 2 for part in columns]
        return [np.diag([-1e-20 if j < (untold or 3) else 1.0] * 2 * half) for j, half in enumerate(halves)]

    monkeypatch.setattr(instruments_module, "noise_products", nothing_left)
    recording = closed_loop.run(ENCODER_NOISE).recording(torque_noise=0.2)
    _, instruments = fitted(plan, prepare(recording, Band(10.0), closed_loop.RATE), "smooth")
    assert np.all(np.isfinite(instruments.shift_))
    own = slice(plan.n_base, plan.n_base + plan.n_own)  # of the joint whose noise is not told, apart from all links
    assert np.all(instruments.shift_[own] == 0) == (untold is None)
    if untold is None:
        assert (instruments.dof_, instruments.p_value_) == (0, 1.0)
        assert not endogeneity(instruments, [""] * plan.n_columns)["biased"]
    else:
        assert instruments.dof_ > 0


@pytest.mark.parametrize("memory", [0.0, 0.9])
def test_the_test_keeps_its_size_on_clean_data(plan, memory):
    """Of 100 draws of torque noise, white and with memory, about five fall below five percent: 0 to 11 (99.5 %)."""
    t = np.arange(16 * 200) / 200
    q, dq, ddq = closed_loop.fourier(t, np.random.default_rng(5))
    speed = 2 * np.pi * np.array([1.1, 1.7, 2.3])  # where the arm leaves its reference
    angle = np.outer(t, speed)
    asked, q, dq = q, q + 0.01 * np.sin(angle), dq + 0.01 * speed * np.cos(angle)
    ddq = ddq - 0.01 * speed**2 * np.sin(angle)
    tau = plan.robot.inverse_dynamics(q, dq, ddq) + closed_loop.friction(dq)
    states = prepare(Recording(t=t, q=q, dq=dq, ddq=ddq, tau=tau, q_reference=asked), Band(5.0), 200.0)
    rejected, statistics = 0, []
    for seed in range(100):
        white = 0.3 * np.random.default_rng(seed).standard_normal(tau.shape)
        noise = lfilter([1.0], [1.0, -memory], white, axis=0)
        _, instruments = fitted(plan, replace(states, tau=tau + noise), "reference")
        rejected += instruments.p_value_ < 0.05
        statistics.append(instruments.statistic_ / instruments.dof_)
    assert rejected <= 11
    assert_allclose(np.mean(statistics), 1.0, atol=0.1)  # neither anxious nor deaf


@pytest.mark.parametrize("gains", [(1.0, 1.0, 1.0), (1.0, 0.5, 3.0)])
def test_two_stages_are_the_textbook_estimate(plan, gains):
    """x = (W' P W)^-1 W' P tau with P the projection on all joints' instruments, on the full stacked matrices."""
    recording = closed_loop.run(ENCODER_NOISE).recording(torque_noise=0.2)
    states = prepare(recording, Band(5.0), closed_loop.RATE)
    observations = observe(plan, [states])
    links = LinkDynamicsIdentifier(None, prior=None).fit(observations)
    links.torque_scale_ = np.array(gains)  # as currents have them: what links make of a channel, and not a joint's own
    instruments = InstrumentalVariables("reference").fit(observations, links, [states])
    account = observe(plan, [instrument_states(states, "reference")])
    used = plan.estimable()

    def wide(made):
        rows = []
        for j in range(3):
            part = np.concatenate([block.rows[j] for block in made.blocks])
            full = np.zeros((len(part), plan.n_columns + 1))
            units = np.r_[np.ones(plan.n_own), np.full(part.shape[1] - 1 - plan.n_own, gains[j])]
            full[:, plan.unknowns(j)], full[:, -1] = part[:, :-1] * units, part[:, -1]
            rows.append(full)
        return rows

    blocks = [part[:, :-1][:, np.any(part[:, :-1] != 0, axis=0)] for part in wide(account)]
    m = len(blocks[0])
    Z = np.zeros((3 * m, sum(block.shape[1] for block in blocks)))
    first = 0
    for j, block in enumerate(blocks):
        Z[j * m : (j + 1) * m, first : first + block.shape[1]] = block
        first += block.shape[1]
    W = np.concatenate(wide(observations))
    basis, s, _ = np.linalg.svd(Z / np.linalg.norm(Z, axis=0), full_matrices=False)
    basis = basis[:, s > 1e-10 * s[0]]
    projected = basis @ (basis.T @ W[:, :-1][:, used])
    norms = np.linalg.norm(projected, axis=0)
    expected = np.linalg.lstsq(projected / norms, W[:, -1], rcond=1e-12)[0] / norms
    size = np.abs(expected) + 1e-3
    assert_allclose(instruments.x_[used] / size, expected / size, atol=1e-6)


def test_the_same_account_twice_is_no_evidence(plan):
    """Where instruments are the regressor itself both estimates agree, and nothing is tested."""
    recording = closed_loop.run(0.0).recording(torque_noise=0.2)
    states = prepare(recording, Band(10.0), closed_loop.RATE)
    states = replace(states, reference=states.signals()[:3])
    links, instruments = fitted(plan, states, "reference")
    assert instruments.p_value_ == 1.0
    assert instruments.dof_ == 0
    assert instruments.strength_ == pytest.approx(1.0)
    # The fit stopped one re-weighting earlier.
    assert np.all(np.abs(instruments.x_ - links.x_) <= 0.01 * instruments.std_error_)


def test_instruments_are_chosen_by_what_the_runs_hold():
    loop = closed_loop.run(ENCODER_NOISE)
    reference = prepare(loop.recording(), Band(10.0), closed_loop.RATE)
    plain = prepare(loop.recording(with_reference=False), Band(10.0), closed_loop.RATE)
    two = prepare(
        replace(loop.recording(with_reference=False), q_motor=loop.measured + 1e-3 * np.sin(loop.t)[:, None]),
        Band(10.0),
        closed_loop.RATE,
    )
    assert [choose_source([states]) for states in (reference, two, plain)] == ["reference", "second_encoder", "smooth"]
    assert choose_source([reference, plain]) == "smooth"
    swapped = instrument_states(two, "second_encoder")
    assert_allclose(swapped.q, two.q_motor, **ALGEBRAIC)
    assert_allclose(swapped.ddq_motor, two.ddq, **ALGEBRAIC)
    # A reference that the joints do not follow is none.
    wrong = prepare(replace(loop.recording(), q_reference=loop.q_reference[::-1]), Band(10.0), closed_loop.RATE)
    assert choose_source([wrong]) == "smooth"


@pytest.mark.parametrize(("source", "said"), [("reference", "reference position"), ("second_encoder", "two encoders")])
def test_instruments_that_are_not_there_are_refused(source, said):
    plain = prepare(closed_loop.run(0.0).recording(with_reference=False), Band(10.0), closed_loop.RATE)
    with pytest.raises(ValueError, match=said):
        choose_source([plain], source)
    with pytest.raises(ValueError, match="source must be"):
        choose_source([plain], "lagged")


@pytest.mark.parametrize("prefix", ["q_reference", "q_ref", "qref"])
def test_readers_know_the_reference(prefix, tmp_path):
    columns = valid_columns()
    columns |= {f"{prefix}_{j}": columns[f"q_{j}"] + 0.01 for j in range(3)}
    recording = read_recording(write(tmp_path / "run.parquet", columns), closed_loop.robot())
    assert_allclose(recording.q_reference, recording.q + 0.01, **ALGEBRAIC)
    assert recording.slice(0, 100).q_reference.shape == (100, 3)
    assert recording.without("q_reference").q_reference is None
    del columns[f"{prefix}_2"]  # of some joints only: nobody needs it, so it is no reason to refuse the run
    assert read_recording(write(tmp_path / "cut.parquet", columns), closed_loop.robot()).q_reference is None


def test_a_biased_fit_is_said_in_the_verdict():
    test = {"torque_std": [1.0], "wls": [0.1], "after": [0.1]}
    result = {"joints": ["a"], "rmse": {"test": test}, "residual": {"reason": "The third loop was switched off."}}
    found = {
        "instruments": "reference",
        "p_value": 1e-9,
        "largest_shift": {"parameter": "Izz[hand]", "standard_errors": 7.25},
        "biased": True,
    }
    assert "Least squares is biased: with instruments from the reference trajectory, Izz[hand] moves by 7.2" in verdict(
        result | {"endogeneity": found}
    )
    assert "biased" not in verdict(result | {"endogeneity": found | {"biased": False}})
    assert "biased" not in verdict(result)
