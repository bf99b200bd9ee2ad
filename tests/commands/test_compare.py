"""`dynid compare`: two models on the same runs, in the same band."""

import json

import numpy as np
import pytest
from helpers.link_models import bare_model
from helpers.run_files import write
from helpers.small_arm import JOINTS, as_current, dynid, refusal, run, study
from helpers.tolerances import EXACT
from numpy.testing import assert_allclose

from dynid_rs import RobotModel, TorqueModel, read_recording
from dynid_rs.base.wording import NO_INTERVAL
from dynid_rs.commands.compare import _show
from dynid_rs.identification.told_again import compared_in_band
from dynid_rs.identification.two_models import compare_models
from dynid_rs.regression.evaluation import band_rmse


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    """The small arm once more, without friction's curves: a result to hold against the usual one."""
    folder = tmp_path_factory.mktemp("plain") / "out"
    runs = study().runs
    printed = dynid(
        *("identify", study().robot, *runs[:2], "--test", runs[2], "-o", folder),
        *("--friction-law", "coulomb_viscous", "--residual", "none"),
    )
    assert printed.exit_code in (0, 1), printed.output
    return folder


def compared(*arguments):
    printed = dynid("compare", *arguments, "--json")
    assert printed.exit_code == 0, printed.output
    return json.loads(printed.stdout)


def test_two_models_on_a_run_have_the_errors_that_each_has_alone(plain):
    answer = compared(study().model, plain / "model.json", study().runs[2])
    assert (answer["format"], answer["joints"]) == ("dynid-comparison", list(JOINTS))
    one, two = (TorqueModel.load(path) for path in (study().model, plain / "model.json"))
    recording = read_recording(study().runs[2], one.robot)
    errors = answer["rmse"]
    assert errors["cutoff"] == min(one.band[0], two.band[0])
    for name, model in (("a", one), ("b", two)):
        if model.band[0] == errors["cutoff"]:
            assert_allclose(errors[name], band_rmse([compared_in_band(model, recording)]), rtol=0.02)
    for change, a, b in zip(errors["change_interval"], errors["a"], errors["b"], strict=True):
        assert change is None or change[0] <= b / a - 1 <= change[1]
    swapped = compared(plain / "model.json", study().model, study().runs[2])["rmse"]
    assert_allclose(swapped["a"], errors["b"], **EXACT)


def test_a_model_against_itself_changes_nothing():
    answer = compared(study().output, study().output, study().runs[2])
    assert answer["rmse"]["change_interval"] == [[0.0, 0.0]] * 3
    assert answer["terms"]["a"] == answer["terms"]["b"] == []


def test_a_dash_in_the_place_of_an_interval_is_explained(capsys):
    answer = compared(study().output, study().output, study().runs[2])
    intervals = answer["rmse"]["a_interval"], answer["rmse"]["b_interval"]
    for pairs in intervals:
        pairs[:] = [[0.1, 0.2]] * 3
    _show(answer)
    assert NO_INTERVAL not in " ".join(capsys.readouterr().out.split())
    intervals[1][2] = None
    _show(answer)
    assert f"-: {NO_INTERVAL}" in " ".join(capsys.readouterr().out.split())


def test_two_results_are_compared_by_their_own_test_runs(plain):
    answer = compared(study().output, plain)
    told = json.loads((plain / "result.json").read_text())
    assert answer["rmse"]["b"] == told["rmse"]["test"]["after"]
    assert answer["rmse"]["runs"] == ["run_2.parquet"]
    printed = dynid("compare", study().output, plain, study().runs[2])
    assert printed.exit_code == 0
    for joint in JOINTS:
        assert joint in printed.stdout


def test_a_worse_model_ends_with_0_too(tmp_path):
    """As the help says: the command was asked for a comparison, not for an improvement."""
    good = TorqueModel.load(study().model)
    bare_model(good.robot, good.phi).save(tmp_path / "bad.json")
    run = study().runs[2]
    for pair in ((study().model, tmp_path / "bad.json"), (tmp_path / "bad.json", study().model)):
        assert dynid("compare", *pair, run).exit_code == 0


def test_a_worse_model_is_seen_to_be_worse():
    good = TorqueModel.load(study().model)
    bad = bare_model(good.robot, good.phi)
    recording = read_recording(study().runs[2], good.robot)
    errors = compare_models(bad, good, [recording])
    assert np.all(np.array(errors["b"]) < errors["a"])
    assert all(change is None or change[1] < 0 for change in errors["change_interval"])


def test_what_cannot_be_compared_is_refused_in_a_sentence(plain, tmp_path):
    model = study().model
    assert "tells no errors; name runs" in refusal(dynid("compare", model, plain))
    assert "none is given" in refusal(dynid("compare", study().output, plain, "--cutoff", "5"))
    currents = write(tmp_path / "currents.parquet", as_current(run(0)))
    assert "holds torque in A, the models give N*m" in refusal(dynid("compare", model, model, currents))
    two_joints = RobotModel.from_urdf(study().robot, tip="fore")
    bare_model(two_joints, two_joints.phi).save(tmp_path / "other.json")
    assert "different arms" in refusal(dynid("compare", model, tmp_path / "other.json", study().runs[2]))
    done = dynid("identify", study().robot, *study().runs[:2], "-o", tmp_path / "out", "--residual", "none")
    assert done.exit_code in (0, 1)
    assert "was tested on run_1.parquet" in refusal(dynid("compare", study().output, tmp_path / "out"))


def test_a_run_counts_once():
    said = refusal(dynid("compare", study().model, study().model, study().runs[2], study().runs[2]))
    assert "run_2.parquet is given twice to test on; name it once" in said
