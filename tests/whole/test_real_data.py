"""Measured robots: errors on runs that nothing was fitted to, against the figures others reached."""

from __future__ import annotations

import numpy as np
import pytest
from real_robots import CASES, identify, relative_errors


@pytest.fixture(scope="module")
def identified():
    """Each case is identified once."""
    done = {}

    def get(name):
        if name not in done:
            done[name] = identify(CASES[name])
        return done[name]

    return get


@pytest.mark.parametrize("name", [name for name, case in CASES.items() if case.bounds is not None])
def test_errors_on_unseen_runs_stay_below_the_published_baseline(identified, name):
    errors = relative_errors(identified(name)[1])
    assert np.all(errors <= CASES[name].bounds), errors.round(4)


# One of the five does not: the xMate's motor torque. README says so, and the test below holds the verdict to it.
@pytest.mark.parametrize("name", [name for name in CASES if name != "xMate3 Pro, motor torque"])
def test_the_model_beats_weighted_least_squares_on_average(identified, name):
    result = identified(name)[1]
    ratio = relative_errors(result) / relative_errors(result, "wls")
    assert np.exp(np.mean(np.log(ratio))) < 1


@pytest.mark.parametrize("name", CASES)
def test_the_verdict_names_exactly_the_joints_on_which_least_squares_is_better(identified, name):
    result = identified(name)[1]
    ratio = relative_errors(result) / relative_errors(result, "wls")
    named = [f"{joint} (+" in result["verdict"] for joint in result["joints"]]
    assert named == (ratio > 1.1).tolist()


def test_currents_are_said_in_ampere_with_gains_of_their_own(identified):
    identifier, result = identified("UR10e, currents")
    assert result["torque_unit"] == "A"
    scale = identifier.links_.torque_scale_
    assert scale[0] == 1
    assert np.all((scale > 0.5) & (scale < 2))


def test_the_delay_between_the_encoder_channels_is_found(identified):
    delay = identified("KUKA KR300, two encoders")[1]["encoder_delay"]
    assert delay["measured"] == [True] * 3 + [False] * 3
    assert np.all((np.array(delay["value"][:3]) >= 2.6e-3) & (np.array(delay["value"][:3]) <= 3.2e-3))
    assert delay["value"][3:] == [0, 0, 0]


def test_the_report_says_in_plain_words_whether_the_third_loop_paid(identified):
    residual = identified("KUKA KR300, two encoders")[1]["residual"]
    assert residual["inputs"] == "load_free_deflection"
    assert "did not pay" in residual["reason"] or "paid on" in residual["reason"]


def test_predictions_are_those_of_the_saved_model(identified, tmp_path):
    import dynid_rs as dyn
    from dynid_rs.model.assembly import evaluate

    identifier, _ = identified("UR10e, currents")
    identifier.model_.save(tmp_path / "model.json")
    states = identifier.runs_[0]
    again = dyn.TorqueModel.load(tmp_path / "model.json")
    np.testing.assert_array_equal(evaluate(again, states)[0], evaluate(identifier.model_, states)[0])
