"""A model whose torque channel is late or early: offline, state by state, in the file, and what is refused."""

import json
import runpy

import numpy as np
import pytest
from helpers.data import ROOT
from helpers.small_arm import dynid, study
from helpers.tolerances import ALGEBRAIC
from helpers.whole_model import RESIDUALS, SIGNALS, recorded_states, whole_model, write_again

from dynid_rs import FormatError, TorqueModel, _core, read_recording
from dynid_rs.model.assembly import evaluate
from dynid_rs.runs.preprocessing import Band, prepare
from dynid_rs.simulation import bundled_robot

SETTLING = 512


@pytest.fixture(scope="module")
def states():
    return {name: np.nan_to_num(values, nan=30.0) for name, values in recorded_states().items()}


@pytest.fixture(scope="module")
def model(states):
    """Everything that a model can hold, but what remembers."""
    robot = _core.RobotModel.from_urdf(bundled_robot())
    return whole_model(robot, states, None, seed=7)


def shifted(states, seconds, step):
    """Every signal as it was so many seconds before, linear between samples, the ends held; temperatures of now."""
    t = step * np.arange(len(states["q"]))
    return {
        name: x if name == "temperature" else np.stack([np.interp(t - seconds, t, c) for c in x.T], axis=1)
        for name, x in states.items()
    }


@pytest.mark.parametrize("delay", [0.0123, 0.004, -0.0123, -0.004, 1e-5])
def test_it_is_the_torque_of_the_state_of_then(model, states, delay):
    late = model.with_torque_delay(delay)
    np.testing.assert_array_equal(late.torque_delay, np.full(6, delay))
    total, terms, status = late.evaluate(**states)
    expected, expected_terms, _ = model.evaluate(**shifted(states, delay, model.step))
    held = (status & SETTLING) != 0
    n = int(np.ceil(abs(delay) / model.step))
    assert np.count_nonzero(held) == n
    assert held[:n].all() if delay > 0 else held[len(held) - n :].all()
    # What remembers goes on from the first state either way.
    size = np.abs(expected_terms).max()
    np.testing.assert_allclose(total, expected, atol=1e-9 * size, rtol=1e-9)
    np.testing.assert_allclose(terms.sum(axis=1), total, atol=1e-9 * size)
    np.testing.assert_allclose(expected_terms, terms, atol=1e-9 * size, rtol=1e-9)


@pytest.mark.parametrize(
    "delays",
    [[0.0, 0.0, 0.0123, 0.0, 0.004, 0.0], [0.004, 0.006, 0.004, 0.0042, 0.03, 0.004], [-0.004, 0.0123, 0, 0, 0, 0]],
)
def test_each_joint_is_late_by_its_own(model, states, delays):
    late = model.with_torque_delay(delays)
    np.testing.assert_array_equal(late.torque_delay, delays)
    total, terms, status = late.evaluate(**states)
    std = late.predicted_std(**{name: states[name] for name in SIGNALS if name != "temperature"})
    n = int(np.ceil(max(map(abs, delays)) / model.step)) + 1
    assert (status[:n] & SETTLING).any() or min(delays) < 0
    assert not (status[n:-n] & SETTLING).any()
    for j, delay in enumerate(delays):
        # Terms are on a straight line between steps where states are in `model.with_torque_delay(delay)`.
        expected, expected_terms, _ = model.with_torque_delay(delay).evaluate(**states)
        size = np.abs(expected_terms[:, :, j]).max()
        assert np.abs(total[n:-n, j] - expected[n:-n, j]).max() < 0.01 * size
        assert np.abs(terms[n:-n, :, j] - expected_terms[n:-n, :, j]).max() < 0.01 * size
        alone = model.with_torque_delay(delay).predicted_std(
            **{name: states[name] for name in SIGNALS if name != "temperature"}
        )
        np.testing.assert_allclose(std[n:-n, j], alone[n:-n, j], rtol=0.01)
    np.testing.assert_allclose(terms.sum(axis=1), total, rtol=1e-12, atol=1e-12)


def test_delays_are_one_number_or_one_per_joint(model):
    for delays in ([0.01], [0.01] * 7, "late", None):
        with pytest.raises((ValueError, TypeError)):
            model.with_torque_delay(delays)


def test_totals_alone_and_deviations_come_late_too(model, states):
    late = model.with_torque_delay(0.0123)
    motion = {name: states[name] for name in SIGNALS if name != "temperature"}
    then = shifted(motion, 0.0123, model.step)
    np.testing.assert_allclose(late.predicted_std(**motion), model.predicted_std(**then), rtol=1e-9)
    without = whole_model(model.robot, states, "deflection", seed=7, effects=[])
    late = without.with_torque_delay(0.0123)
    np.testing.assert_array_equal(late.torque(**motion), late.evaluate(**motion)[0])


def test_another_step_is_another_number_of_states(model, states):
    late = model.with_torque_delay(0.012)
    _, _, status = late.evaluate(**states, step=0.006)
    assert np.count_nonzero(status & SETTLING) == 2
    with pytest.raises(ValueError, match="step is outside its range"):
        late.evaluate(**states, step=1e-7)
    # What lies between an early and a late channel is kept whole: 8000 steps.
    apart = model.with_torque_delay([-0.4, 0.4, 0.0, 0.0, 0.0, 0.0])
    with pytest.raises(ValueError, match="step is outside its range"):
        apart.evaluate(**states, step=1e-4)


@pytest.mark.parametrize("delay", [0.5000001, -0.6, np.nan, np.inf])
def test_what_is_no_delay(model, delay):
    with pytest.raises(ValueError, match=r"torque_delay|NaN or infinite"):
        model.with_torque_delay(delay)


@pytest.mark.parametrize("delay", [0.03, -0.03, [0.03, 0.0, 0.01, 0.0, 0.0, 0.0]])
def test_feed_forward_of_the_tutorial_is_the_torque_of_the_plan_and_not_of_a_channel(
    tmp_path, monkeypatch, capsys, states, delay
):
    robot = _core.RobotModel.from_urdf(bundled_robot())
    rigid = whole_model(robot, states, None, effects=[])
    (tmp_path / "found").mkdir()
    rigid.with_torque_delay(delay).save(tmp_path / "found" / "model.json")
    monkeypatch.chdir(tmp_path)
    done = runpy.run_path(str(ROOT / "docs/tutorial/feed_forward.py"))
    expected, _, _ = rigid.evaluate(done["q"], done["dq"], done["ddq"], step=0.001)
    np.testing.assert_array_equal(done["total"], expected)
    assert "current at its largest" in capsys.readouterr().out


def test_a_delay_needs_a_step(model):
    plain = TorqueModel(model.robot, model.phi, [], encoder_delay=[0.0] * 6, noise_std=[1.0] * 6, domain=model.domain)
    with pytest.raises(ValueError, match="torque_delay changes with time: the model needs the step"):
        plain.with_torque_delay(0.01)


def test_the_file_holds_it(tmp_path, model, states):
    late = model.with_torque_delay(-0.0123)
    late.save(tmp_path / "model.json")
    again = TorqueModel.load(tmp_path / "model.json")
    np.testing.assert_array_equal(again.torque_delay, np.full(6, -0.0123))
    np.testing.assert_array_equal(again.evaluate(**states)[0], late.evaluate(**states)[0])
    assert json.loads((tmp_path / "model.json").read_text())["version"] == 6  # a sign has a sharpness
    whole_model(model.robot, states, None, seed=7, effects=[]).with_torque_delay(0.01).save(tmp_path / "model.json")
    assert json.loads((tmp_path / "model.json").read_text())["version"] == 2
    assert "torque_delay" not in (tmp_path / "model.json").read_text().replace("torque_delay", "", 1)


def test_the_file_holds_one_per_joint(tmp_path, model, states):
    delays = [0.0, 0.0, 0.0123, 0.0, -0.004, 0.0]
    late, path = model.with_torque_delay(delays), tmp_path / "model.json"
    late.save(path)
    again = TorqueModel.load(path)
    np.testing.assert_array_equal(again.torque_delay, delays)
    np.testing.assert_array_equal(again.evaluate(**states)[0], late.evaluate(**states)[0])
    content = json.loads(path.read_text())
    assert content["version"] == 6  # a sign has a sharpness
    with pytest.raises(FormatError, match="a file of version 4 has one torque_delay for all joints"):
        write_again(content | {"version": 4}, path)
    whole_model(model.robot, states, None, seed=7, effects=[]).with_torque_delay(delays).save(path)
    assert json.loads(path.read_text())["version"] == 5
    with pytest.raises(FormatError, match="torque_delay has 5 values, expected 6"):
        write_again(content | {"torque_delay": delays[1:]}, path)


def test_what_a_run_has_had_taken_out_is_not_predicted(states):
    """`States.torque_delay`: the prediction is on the clock of the run's torque."""
    model = TorqueModel.load(study().model)
    recording = read_recording(study().runs[2], model.robot)
    step = 1 / recording.rate
    late = TorqueModel(
        model.robot,
        model.phi,
        model.effects,
        encoder_delay=[0.0] * 3,
        noise_std=[1.0] * 3,
        domain=model.domain,
        step=step,
    ).with_torque_delay(0.02)
    run = prepare(recording, Band(5.0), recording.rate)
    plain = evaluate(late.with_torque_delay(0.0), run)[0]
    np.testing.assert_allclose(evaluate(late, run.less_delay(0.02))[0], plain, **ALGEBRAIC)
    assert np.abs(evaluate(late, run)[0] - plain).max() > 0.01


@pytest.mark.parametrize("value", [1e308, 0.51, -0.51, "late", [0.01], [0.0, 0.51, 0, 0, 0, 0], ["late"] * 6, True])
def test_a_hostile_delay_is_refused(tmp_path, model, value):
    path = tmp_path / "model.json"
    model.with_torque_delay(0.0123).save(path)
    with pytest.raises(FormatError, match=r"model\.json: .*; save the model again"):
        write_again(json.loads(path.read_text()) | {"torque_delay": value}, path)


@pytest.mark.parametrize(
    "band",
    [
        {"cutoff": 0.0, "rate": 200.0, "standstill": False},
        {"cutoff": 5.0, "rate": 1e7, "standstill": False},
        {"cutoff": 5.0, "rate": -1.0, "standstill": False},
        {"cutoff": 5.0, "rate": 200.0},
        {"cutoff": 5.0, "rate": 200.0, "standstill": False, "more": 1},
        5.0,
    ],
)
def test_a_hostile_band_is_refused(tmp_path, band):
    path = tmp_path / "model.json"
    with pytest.raises(FormatError, match=r"model\.json: .*; save the model again"):
        write_again(json.loads(study().model.read_text()) | {"band": band}, path)


def test_a_grid_that_would_fill_the_memory_is_not_made(tmp_path):
    path = tmp_path / "model.json"
    fine = json.loads(study().model.read_text())
    write_again(fine | {"band": fine["band"] | {"rate": 1e6}}, path)
    said = dynid("estimate", path, study().runs[2]).stdout
    assert "no error in the band of result.json: the model's errors are told at 1e+06 samples per second" in said


def test_version_1_holds_neither(tmp_path):
    content = json.loads(study().model.read_text()) | {"version": 1}
    with pytest.raises(FormatError, match="a file of version 1 has no band"):
        write_again(content, tmp_path / "model.json")


@pytest.mark.parametrize("inputs", [None, *RESIDUALS])
def test_files_follow_their_schema(tmp_path, states, inputs):
    import jsonschema

    schema = json.loads((ROOT / "docs" / "reference" / "model.schema.json").read_text())
    jsonschema.Draft202012Validator.check_schema(schema)
    validator = jsonschema.Draft202012Validator(schema)
    robot = _core.RobotModel.from_urdf(bundled_robot())
    whole_model(robot, states, inputs).with_torque_delay(0.0123).save(tmp_path / "model.json")
    for path in (tmp_path / "model.json", study().model, study(2).model):
        validator.validate(json.loads(path.read_text()))
    old = ROOT / "rust" / "dynid-io" / "src" / "model_file" / "old_model.json"
    validator.validate(json.loads(old.read_text()))
    late = json.loads((tmp_path / "model.json").read_text()) | {"torque_delay": 0.51}
    assert not validator.is_valid(late)
