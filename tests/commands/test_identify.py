"""`dynid identify` on a small simulated arm: what it writes, how it keeps runs aside, when it says no."""

import json
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from helpers.result_files import FILES, validator
from helpers.run_files import motion, write
from helpers.small_arm import JOINTS, as_current, dynid, refusal, run, snapshot, study, write_robot, write_runs
from helpers.tolerances import ALGEBRAIC

import dynid_rs
from dynid_rs import ThreeLoopIdentifier, TorqueModel
from dynid_rs.base.errors import DataError
from dynid_rs.base.wording import _prior, _relative_errors, is_better, verdict
from dynid_rs.commands._identify_view import _milliseconds
from dynid_rs.runs.recording import Recording
from dynid_rs.runs.splitting import split_runs

QUICK = ("--residual", "none")


def identify(folder: Path, *arguments: object, robot: Path | None = None):
    """Identify into `folder`/out without the third loop; the printed answer and result.json."""
    robot = write_robot(folder) if robot is None else robot
    printed = dynid("identify", robot, *arguments, "-o", folder / "out", "--force", *QUICK)
    path = folder / "out" / "result.json"
    return printed, json.loads(path.read_text()) if path.is_file() else None


def assert_follows_joints(result, n):
    """Every array per joint has one entry per joint."""
    test, residual = result["rmse"]["test"], result["residual"]
    arrays = [
        *test.values(),
        *result["rmse"]["train"].values(),
    ]
    arrays += [residual[name] for name in ("rmse_test_without", "rmse_test_with", "n_components") if name in residual]
    arrays += [entry["rmse_train"] for entry in result["history"]]
    arrays += [result["parameters"]["friction_shape"], result["base_parameters"]["torque_scale"]]
    if result["encoder_delay"] is not None:
        arrays += [result["encoder_delay"][name] for name in ("value", "interval", "measured")]
    assert {len(array) for array in arrays} == {n}
    pairs = zip(test["after_interval"], test["after"], strict=True)
    assert all(pair is None or pair[0] <= value <= pair[1] for pair, value in pairs)
    entries = result["parameters"]["base"] + result["parameters"]["joint"]
    assert all(e["interval"][0] <= e["value"] <= e["interval"][1] for e in entries)
    assert len(result["parameters"]["base"]) == result["base_parameters"]["n_base"]
    assert {entry["joint"] for entry in result["parameters"]["joint"]} == set(JOINTS)


def test_four_files_and_a_table():
    done = study()
    assert done.printed.exit_code == 0, done.printed.output
    assert done.printed.stderr == ""
    assert sorted(path.name for path in done.output.iterdir()) == FILES
    for text in (*JOINTS, "weighted least squares", "three loops", "floor", done.result["verdict"][:40]):
        assert text in done.printed.stdout
    assert done.printed.stdout.endswith(f"report: {done.output / 'report.html'}\n")
    assert "\x1b" not in done.printed.stdout


def test_the_floor_is_that_of_the_test_run(tmp_path):
    """Noise in the training runs alone leaves it where it was; in the test run it lifts it."""
    done, noise = study(), np.random.default_rng(0)
    noisy = []
    for k in range(3):
        columns = run(k)
        for j in range(len(JOINTS)):
            columns[f"tau_{j}"] += 5 * noise.standard_normal(len(columns["t"]))
        noisy.append(write(tmp_path / f"noisy_{k}.parquet", columns))
    clean = identify(tmp_path, *done.runs[:2], "--test", done.runs[2])[1]
    taught = identify(tmp_path, *noisy[:2], "--test", done.runs[2])[1]
    tested = identify(tmp_path, *done.runs[:2], "--test", noisy[2])[1]
    floors = [np.array(result["rmse"]["test"]["floor"]) for result in (clean, taught, tested)]
    np.testing.assert_allclose(floors[1], floors[0], **ALGEBRAIC)
    assert np.all(floors[2] > 1.5 * floors[0])


@pytest.mark.parametrize("encoders", [1, 2])
def test_result_follows_its_schema(encoders):
    result = study(encoders).result  # NaN and infinity fail here
    validator().validate(result)
    assert result["joints"] == list(JOINTS)
    assert_follows_joints(result, len(JOINTS))
    assert (result["encoder_delay"] is None) == (encoders == 1)
    assert result["residual"]["inputs"] == ("joint_state" if encoders == 1 else "load_free_deflection")
    assert result["data"]["train"] == ["run_0.parquet", "run_1.parquet"]
    assert result["data"]["test"] == ["run_2.parquet"]
    assert result["data"]["n_samples"] == {"train": 3202, "test": 1601}
    assert result["effects"] == []
    assert result["rmse"]["test"]["before"] == result["rmse"]["test"]["after"]


def test_the_model_explains_the_arm():
    """White noise of 0.5 % of the effort limit is all that is hidden in these runs beside friction."""
    test = study().result["rmse"]["test"]
    assert np.all(np.array(test["after"]) < 0.05 * np.array(test["torque_std"]))
    assert np.all(np.array(test["after"]) < test["wls"])


def test_delay_of_the_link_encoders_is_found():
    delay = study(2).result["encoder_delay"]
    measured = [value for value, known in zip(delay["value"], delay["measured"], strict=True) if known]
    assert measured
    assert all(2.3e-3 < value < 3.3e-3 for value in measured)  # 2.8 ms were put in


def test_residuals_add_up():
    table = pq.read_table(study().output / "residuals.parquet").to_pydict()
    names = TorqueModel.load(study().model).term_names
    result = study().result
    assert set(table["run"]) == {"run_0.parquet", "run_1.parquet", "run_2.parquet"}
    assert {r for r, s in zip(table["run"], table["set"], strict=True) if s == "test"} == {"run_2.parquet"}
    is_test = np.array(table["set"]) == "test"
    for j in range(len(JOINTS)):
        column = {name: np.array(table[f"{name}_{j}"]) for name in ("measured", "predicted", "residual")}
        np.testing.assert_array_equal(column["measured"] - column["predicted"], column["residual"])
        terms = sum(np.array(table[f"{'residual_term' if name == 'residual' else name}_{j}"]) for name in names)
        np.testing.assert_allclose(terms, column["predicted"], **ALGEBRAIC)
        scored = is_test & np.array(table[f"moves_{j}"])
        rmse = np.sqrt(np.mean(column["residual"][scored] ** 2))
        np.testing.assert_allclose(rmse, result["rmse"]["test"]["after"][j], **ALGEBRAIC)


def test_json_prints_the_same_object(tmp_path):
    robot, runs = write_robot(tmp_path), write_runs(tmp_path, n_runs=2)
    printed = dynid("identify", robot, *runs, "-o", tmp_path / "out", *QUICK, "--json")
    assert printed.exit_code == 0
    assert printed.stderr == ""
    assert json.loads(printed.stdout) == json.loads((tmp_path / "out" / "result.json").read_text())


def test_the_same_command_twice_gives_the_same_bytes(tmp_path):
    done = study()
    arguments = ("identify", done.robot, *done.runs[:2], "--test", done.runs[2])
    assert dynid(*arguments, "-o", tmp_path).exit_code == 0
    assert snapshot(tmp_path) == snapshot(done.output)


def test_the_number_of_threads_changes_nothing(tmp_path):
    """Every count of threads in a process of its own: pools are sized once."""
    done = study(2)
    for threads in ("1", "2"):
        arguments = ["identify", done.robot, *done.runs[:2], "--test", done.runs[2], "-o", tmp_path / threads]
        code = "from dynid_rs.cli import main; main()"
        pools = dict.fromkeys(("RAYON_NUM_THREADS", "OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), threads)
        path = {"PYTHONPATH": str(Path(dynid_rs.__file__).parents[1])}
        finished = subprocess.run(
            [sys.executable, "-c", code, *map(str, arguments)],
            env=os.environ | pools | path,
            capture_output=True,
            text=True,
            timeout=240,
            check=False,
        )
        assert finished.returncode == 0, finished.stderr
    first, second = snapshot(tmp_path / "1"), snapshot(tmp_path / "2")
    assert first["model.json"] == second["model.json"] == done.model.read_bytes()
    assert first["result.json"] == second["result.json"]


def test_one_run_keeps_its_last_third_aside(tmp_path):
    (path,) = write_runs(tmp_path, n_runs=1, duration=12.0)
    printed, result = identify(tmp_path, path)
    assert printed.exit_code in (0, 1)
    assert result["data"]["train"] == ["run_0.parquet (first 8 s)"]
    assert result["data"]["test"] == ["run_0.parquet (after 8 s)"]
    assert result["data"]["n_samples"] == {"train": 1600, "test": 801}
    assert [f["code"] for f in result["data"]["findings"]].count("test_part_chosen") == 1
    validator().validate(result)


def test_several_runs_keep_the_last_one_aside(tmp_path):
    printed, result = identify(tmp_path, *write_runs(tmp_path))
    assert printed.exit_code == 0
    assert result["data"]["train"] == ["run_0.parquet", "run_1.parquet"]
    assert result["data"]["test"] == ["run_2.parquet"]
    (chosen,) = [f for f in result["data"]["findings"] if f["code"] == "test_run_chosen"]
    assert (chosen["severity"], chosen["file"]) == ("info", "run_2.parquet")
    validator().validate(result)


def recording(name: str = "run", seed: int = 0, **changes) -> Recording:
    t, q, _, _ = motion(n_samples=300)
    tau = np.random.default_rng(seed).normal(size=q.shape)
    return Recording(**({"t": t, "q": q, "tau": tau, "name": name} | changes))


def test_nothing_to_learn_from_is_said():
    with pytest.raises(ValueError, match="no run is given to learn from; give at least one"):
        split_runs([], [])


def test_split():
    a, b, c = (recording(name, seed) for seed, name in enumerate("abc"))
    split = split_runs([a, b, c], [])
    assert ([r.name for r in split.train], [r.name for r in split.test]) == (["a", "b"], ["c"])
    split = split_runs([a, b], [c])
    assert ([r.name for r in split.train], [r.name for r in split.test]) == (["a", "b"], ["c"])
    assert split.finding is None
    split = split_runs([a], [], test_from=1.0)
    assert [split.train[0].n_samples, split.test[0].n_samples] == [100, 200]
    np.testing.assert_array_equal(np.concatenate([split.train[0].t, split.test[0].t]), a.t)
    split = split_runs([a], [])
    assert split.finding.code == "test_part_chosen"
    assert split.train[0].duration == pytest.approx(2 * split.test[0].duration, rel=0.02)


def test_a_lone_run_that_ends_at_rest_is_cut_in_its_motion():
    """Its last third holds nothing that could test a model."""
    run = recording()
    still = np.minimum(np.arange(run.n_samples), run.n_samples // 2)  # the second half stands where the first ends
    noise = 1e-6 * np.random.default_rng(3).normal(size=run.q.shape)
    split = split_runs([replace(run, q=run.q[still] + noise)], [])
    moved = run.duration / 2
    assert split.train[0].duration == pytest.approx(2 / 3 * moved, rel=0.1)
    assert split.test[0].duration > moved  # what is left of the motion, and the rest


@pytest.mark.parametrize("test_from", [0.0, -1.0, 2.99, 3.0, 1e9, np.nan, np.inf])
def test_split_outside_of_the_run(test_from):
    with pytest.raises(ValueError, match=r"^run: --test-from must lie inside the run \(0 to 2.99 s\)"):
        split_runs([recording()], [], test_from)


@pytest.mark.parametrize(("n_runs", "n_test"), [(2, 0), (1, 1)])
def test_split_with_nothing_to_cut(n_runs, n_test):
    runs = [recording(str(k), k) for k in range(n_runs + n_test)]
    with pytest.raises(ValueError, match=r"^--test-from cuts a lone run"):
        split_runs(runs[:n_runs], runs[n_runs:], 1.0)


def test_split_leaves_too_little():
    with pytest.raises(DataError, match=r"^run \(first 0\.1 s\), column t: 10 samples are too few"):
        split_runs([recording()], [], 0.1)


def test_split_refuses_the_same_samples_under_two_names():
    a, copy, b = recording("a"), recording("copy"), recording("b", 1)
    with pytest.raises(DataError, match=r"^copy \(a\) is both learned from and tested on; "):
        split_runs([a, b], [copy])
    with pytest.raises(DataError, match=r"^copy \(a\) is given twice to learn from; "):
        split_runs([a, copy], [])
    with pytest.raises(DataError, match=r"^a is given twice to test on; "):
        split_runs([b], [a, a])


def test_split_refuses_runs_of_another_kind():
    a = recording("a")
    ampere = recording("ampere", 1, torque_unit="A")
    double = recording("double", 1, q_motor=a.q)
    for runs, test in (([a], [ampere]), ([a, ampere], [])):
        with pytest.raises(DataError, match=r"^ampere holds torque in A and a in N\*m; "):
            split_runs(runs, test)
    with pytest.raises(DataError, match=r"^double holds motor and link positions and a only one of them; "):
        split_runs([a], [double])
    with pytest.raises(DataError, match=r"^double holds motor and link positions and a only one of them; "):
        split_runs([double], [a])


def test_error_in_the_data_ends_in_one_with_all_results(tmp_path):
    columns = run(0)
    columns["tau_1"] = np.clip(columns["tau_1"], -5, 5)
    path = write(tmp_path / "clipped.parquet", columns)
    printed, result = identify(tmp_path, path, *write_runs(tmp_path)[1:])
    assert printed.exit_code == 1
    assert "error: clipped.parquet: tau_1 sits on its " in " ".join(printed.stdout.split())
    errors = [f for f in result["data"]["findings"] if f["severity"] == "error"]
    assert {(f["file"], f["column"]) for f in errors} == {("clipped.parquet", "tau_1")}
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == FILES
    validator().validate(result)


def test_model_that_is_not_better_ends_in_one(tmp_path, monkeypatch):
    monkeypatch.setattr("dynid_rs.base.wording.is_better", lambda result: False)
    printed, _ = identify(tmp_path, *write_runs(tmp_path, n_runs=2))
    assert printed.exit_code == 1
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == FILES


def outcome(wls, after, std=(10.0, 10.0)):
    test = {"torque_std": list(std), "wls": list(wls), "after": list(after)}
    return {"joints": ["a", "b"], "rmse": {"test": test}, "residual": {"reason": "No third loop."}}


BETTER = {
    "better": ((1.0, 1.0), (0.5, 1.0), True, "29 % less than"),
    "the same": ((1.0, 1.0), (1.0, 1.0), True, "as much as"),
    "worse": ((1.0, 1.0), (1.1, 1.1), False, "10 % MORE than"),
    "one joint worse, the other better": ((1.0, 1.0), (1.5, 0.5), True, "13 % less than"),
    "nothing left in either": ((1e-9, 1e-9), (2e-9, 2e-9), True, "more than"),
    "exact": ((0.0, 0.0), (0.0, 0.0), True, "as much as"),
}


@pytest.mark.parametrize(("wls", "after", "better", "words"), BETTER.values(), ids=BETTER)
def test_better_or_not(wls, after, better, words):
    result = outcome(wls, after)
    assert is_better(result) == better
    assert words.lower() in verdict(result).lower()


def test_verdict_with_a_torque_that_never_changes():
    text = verdict(outcome((1.0, 1.0), (0.5, 0.5), std=(10.0, 0.0)))
    assert "leaves 5.0 % of the torque's standard deviation" in text
    assert "no scale" in verdict(outcome((1.0, 1.0), (0.5, 0.5), std=(0.0, 0.0)))


def test_runs_of_different_rates(tmp_path):
    runs = [write(tmp_path / f"run_{rate}.csv", run(k, rate=rate)) for k, rate in enumerate((200.0, 125.0))]
    printed, result = identify(tmp_path, *runs, "--test", write(tmp_path / "test.npz", run(2, rate=500.0)))
    assert printed.exit_code == 0
    assert result["data"]["rate_hz"] == 200.0
    validator().validate(result)
    test = result["rmse"]["test"]
    assert np.all(np.array(test["after"]) < 0.05 * np.array(test["torque_std"]))


def test_runs_of_one_name_are_told_apart(tmp_path):
    paths = []
    for k, name in enumerate(("monday", "tuesday", "wednesday")):
        (tmp_path / name).mkdir()
        paths.append(write(tmp_path / name / "run.parquet", run(k)))
    printed, result = identify(tmp_path, *paths)
    assert printed.exit_code == 0
    assert result["data"]["train"] == ["monday/run.parquet", "tuesday/run.parquet"]
    assert result["data"]["test"] == ["wednesday/run.parquet"]
    table = pq.read_table(tmp_path / "out" / "residuals.parquet")
    assert len(set(table["run"].to_pylist())) == 3


def test_currents_without_and_with_drive_gains(tmp_path):
    paths = [write(tmp_path / f"run_{k}.parquet", as_current(run(k))) for k in range(2)]
    printed, ampere = identify(tmp_path, *paths)
    assert printed.exit_code == 0
    assert ampere["torque_unit"] == "A"
    assert "[A]" in printed.stdout
    validator().validate(ampere)
    printed, newton = identify(tmp_path, *paths, "--drive-gain", "20,15,6")
    assert printed.exit_code == 0
    assert newton["torque_unit"] == "N*m"
    std = np.array(newton["rmse"]["test"]["torque_std"])
    np.testing.assert_allclose(std / ampere["rmse"]["test"]["torque_std"], [20, 15, 6], **ALGEBRAIC)
    _, same = identify(tmp_path, *paths, "--drive-gain", "20")
    std = np.array(same["rmse"]["test"]["torque_std"])
    np.testing.assert_allclose(std / ampere["rmse"]["test"]["torque_std"], [20, 20, 20], **ALGEBRAIC)


def test_full_covariance_and_a_band_of_ones_own(tmp_path):
    paths = write_runs(tmp_path, n_runs=2)
    printed, result = identify(tmp_path, *paths, "--weighting", "full_covariance", "--cutoff", "6.5")
    assert printed.exit_code == 0
    assert result["data"]["cutoff_hz"] == 6.5
    assert result["residual"]["switched_off"] is True
    validator().validate(result)


def test_gravity_may_point_anywhere(tmp_path):
    paths = write_runs(tmp_path, n_runs=2)
    _, result = identify(tmp_path, *paths, "--gravity", "-9.81,0,0")
    assert result is not None
    assert json.loads((tmp_path / "out" / "model.json").read_text())["robot"]["gravity"] == [-9.81, 0, 0]


def test_what_did_not_converge_is_a_finding(tmp_path, monkeypatch):
    from dynid_rs.identification.three_loops import NOT_SETTLED, ThreeLoopIdentifier

    fit, message = ThreeLoopIdentifier.fit, f"{NOT_SETTLED}; raise max_iter"

    def restless(self, *args, **kwargs):
        import warnings

        from sklearn.exceptions import ConvergenceWarning

        for _ in range(2):
            warnings.warn(message, ConvergenceWarning, stacklevel=1)
        return fit(self, *args, **kwargs)

    monkeypatch.setattr(ThreeLoopIdentifier, "fit", restless)
    printed, result = identify(tmp_path, *write_runs(tmp_path, n_runs=2))
    assert printed.stderr == ""
    messages = [f["message"] for f in result["data"]["findings"] if f["code"] == "not_converged"]
    assert messages == [message]


@pytest.mark.parametrize("error", [OSError("disk full"), KeyboardInterrupt(), KeyError("our own bug")])
def test_old_results_stay_when_writing_fails(tmp_path, monkeypatch, error):
    robot, runs = write_robot(tmp_path), write_runs(tmp_path, n_runs=2)
    old = tmp_path / "old"
    old.mkdir()
    for name in FILES:
        (old / name).write_text("old")
    before = snapshot(tmp_path)

    def fail(folder, source=None):
        raise error

    monkeypatch.setattr("dynid_rs.report.write_report", fail)
    for output in (old, tmp_path / "a" / "new"):
        arguments = ("identify", robot, *runs, "-o", output, "--force", *QUICK)
        if isinstance(error, KeyError):
            with pytest.raises(KeyError):
                dynid(*arguments)
        else:
            assert dynid(*arguments).exit_code == (2 if isinstance(error, OSError) else 130)
        assert snapshot(tmp_path) == before


def test_results_replace_older_ones_and_nothing_else(tmp_path):
    robot, runs = write_robot(tmp_path), write_runs(tmp_path, n_runs=2)
    output = tmp_path / "out"
    output.mkdir()
    (output / "notes.txt").write_text("mine")
    (output / "result.json").write_text("old")
    before = snapshot(tmp_path)
    arguments = ("-o", output, *QUICK)
    for command in ("identify", "diagnose"):
        sentence = refusal(dynid(command, robot, *runs, "-o", output))
        assert (
            "holds a finished result already (result.json); name another folder, or replace it with --force" in sentence
        )
        assert snapshot(tmp_path) == before
    assert dynid("identify", robot, *runs, *arguments, "--force").exit_code == 0
    assert sorted(path.name for path in output.iterdir()) == sorted([*FILES, "notes.txt"])
    assert (output / "notes.txt").read_text() == "mine"
    assert json.loads((output / "result.json").read_text())["format"] == "dynid-result"


def test_one_delay_reaches_the_user():
    result = study(2).result
    (finding,) = (f for f in result["data"]["findings"] if f["code"] == "encoder_delay")
    delay = result["encoder_delay"]
    measured = sorted(value for value, known in zip(delay["value"], delay["measured"], strict=True) if known)
    assert finding["value"] == np.median(measured)
    assert f"{1e3 * measured[0]:.2f}" in finding["message"]
    assert "fitted beside the gears' yielding" in finding["message"]


def test_a_delay_of_nothing_has_no_sign():
    assert _milliseconds({"value": [-7e-10, 2.8e-3, 0.0], "measured": [True, True, False]}) == "0.00, 2.80, -"


def test_of_one_joint_one_error_is_said():
    one, two = np.array([0.1]), np.array([0.1, 0.2])
    assert _relative_errors(one, 5 * one) == "20.0 % of the torque's standard deviation"
    assert _relative_errors(two, np.ones(2)).startswith("10.0 to 20.0 % of")
    prior = {"relative_uncertainty": {"links": 0.15, "rotors": None}, "n_directions": 1, "n_determined": 0.2}
    assert "Of 1 combination of them the runs determine 0." in _prior({"prior": prior})


def test_what_another_command_has_finished_meanwhile_stays(tmp_path, monkeypatch):
    """It was not there when this one began, and hours may lie between."""
    done, out = study(1), tmp_path / "out"
    fit = ThreeLoopIdentifier.fit

    def meanwhile(self, *args, **kwargs):
        shutil.copytree(done.output, out, dirs_exist_ok=True)
        return fit(self, *args, **kwargs)

    monkeypatch.setattr(ThreeLoopIdentifier, "fit", meanwhile)
    arguments = ("identify", done.robot, *done.runs, "-o", out, "--prior", "none")
    sentence = refusal(dynid(*arguments))
    assert "another command has finished its result here meanwhile (result.json), which stays" in sentence
    assert snapshot(out) == snapshot(done.output)
    assert dynid(*arguments, "--force").exit_code in (0, 1)
    assert snapshot(out) != snapshot(done.output)
