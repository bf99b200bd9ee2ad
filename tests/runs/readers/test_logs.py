"""Any log: thirty variants, each from the file to `dynid identify`, by names alone or with what `dynid init` wrote."""

import numpy as np
import pytest
from helpers.log_files import VARIANTS, columns_of
from helpers.small_arm import dynid, refusal, write_robot

from dynid_rs import RobotModel
from dynid_rs.runs.readers import read_config, read_run

QUICK = ("--friction-law", "coulomb_viscous", "--residual", "none")
READ = [name for name, variant in VARIANTS.items() if variant.way != "refused"]


def test_there_are_thirty_and_twenty_eight_go_through():
    ways = [variant.way for variant in VARIANTS.values()]
    assert len(ways) == 30
    assert ways.count("refused") == 2


def rules_for(folder, robot, paths, variant):
    """Options for other commands; `dynid init` has said what the variant promises."""
    if variant.way == "plain":
        return [], ""
    result = dynid("init", robot, *paths, "-o", folder / "dynid.toml")
    assert result.exit_code == 0, result.output
    return ["--config", folder / "dynid.toml"], result.output


@pytest.mark.parametrize("name", READ)
def test_a_log_holds_what_was_measured(name, tmp_path):
    variant, robot = VARIANTS[name], write_robot(tmp_path)
    path = variant.write(tmp_path, 0)
    options, output = rules_for(tmp_path, robot, [path], variant)
    run = read_run(path, RobotModel.from_urdf(robot), read_config(options[1]) if options else None)
    t, q, _, tau = columns_of(0)
    coarse = 1e-6 if "lerobot" in name else 1e-9
    recorded = np.concatenate([part.q for part in run.parts])
    torque = np.concatenate([part.tau for part in run.parts])
    gain = 10.0 if run.parts[0].torque_unit == "A" else 1.0
    np.testing.assert_allclose(recorded, q, rtol=0, atol=coarse)
    np.testing.assert_allclose(torque * gain, tau, rtol=coarse, atol=10 * coarse)
    if len(run.parts) == 1:
        np.testing.assert_allclose(run.recording.t - run.recording.t[0], t - t[0], rtol=0, atol=2e-9)
    said = output + " ".join(finding.message for finding in run.findings())
    assert variant.said in said


@pytest.mark.parametrize("name", READ)
def test_a_log_goes_to_identify(name, tmp_path):
    variant, robot = VARIANTS[name], write_robot(tmp_path)
    paths = [variant.write(tmp_path, k) for k in range(2)]
    options, _ = rules_for(tmp_path, robot, paths, variant)
    result = dynid("identify", robot, paths[0], "--test", paths[1], *options, *QUICK, "-o", tmp_path / "out")
    assert result.exit_code == 0, result.output
    assert (tmp_path / "out" / "model.json").exists()


@pytest.mark.parametrize("name", [name for name in VARIANTS if name not in READ])
def test_a_log_is_refused_in_one_sentence(name, tmp_path):
    variant, robot = VARIANTS[name], write_robot(tmp_path)
    path = variant.write(tmp_path, 0)
    for command in ("init", "identify"):
        if command == "init" or "percent" not in name:
            out = tmp_path / ("dynid.toml" if command == "init" else "out")
            assert variant.said in refusal(dynid(command, robot, path, "-o", out))
            assert not out.exists()
