"""`dynid estimate`: the same bits as the binary, runs with and without torque, and everything it refuses."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from helpers import online_answers
from helpers.online_answers import assert_same_answers, from_csv, table_of
from helpers.online_answers import run as answer_of
from helpers.result_files import validator
from helpers.robots import chain
from helpers.run_files import csv_text, folder_of_another_user, write
from helpers.small_arm import (
    JOINTS,
    URDF,
    as_current,
    dynid,
    refusal,
    run,
    snapshot,
    study,
    with_derivatives,
    write_robot,
)
from helpers.tolerances import ALGEBRAIC

from dynid_rs import TorqueModel
from dynid_rs.base.numbers import significant

N = len(JOINTS)
estimator = online_answers.estimator
"""The fixture that finds the binary."""


@pytest.mark.parametrize("suffix", [".parquet", ".csv", ".npz"])
@pytest.mark.parametrize("encoders", [1, 2])
def test_a_run_with_derivatives_gives_the_bits_of_the_binary(estimator, tmp_path, encoders, suffix):
    model, columns = study(encoders).model, with_derivatives(run(2, encoders=encoders))
    path = write(tmp_path / f"run{suffix}", columns)
    assert dynid("estimate", model, path, "-o", tmp_path / "out.parquet").exit_code == 0
    assert_same_answers(estimator, model, csv_text(columns), tmp_path / "out.parquet")


@pytest.mark.parametrize("encoders", [1, 2])
def test_a_run_without_derivatives_gives_the_bits_through_its_states(estimator, tmp_path, encoders):
    model, path = study(encoders).model, study(encoders).runs[2]
    out, states = tmp_path / "out.parquet", tmp_path / "states.csv"
    assert dynid("estimate", model, path, "-o", out, "--states", states).exit_code == 0
    assert_same_answers(estimator, model, states.read_text(), out)
    again = tmp_path / "again.parquet"
    assert dynid("estimate", model, states, "-o", again).exit_code == 0
    first, second = table_of(out), table_of(again)
    for name, values in second.items():
        np.testing.assert_array_equal(values, first[name])
    assert set(first) == set(second)  # the measured torque too


def header_of(states):
    return states.read_text().split("\n", 1)[0].split(",")


def test_states_hold_the_measured_torque_where_the_run_does(estimator, tmp_path):
    model, states = study().model, tmp_path / "states.csv"
    assert dynid("estimate", model, study().runs[2], "--states", states).exit_code == 0
    assert header_of(states)[-N:] == [f"tau_{j}" for j in range(N)]
    answer_of(estimator, model, states.read_text(), "--observe")
    path = write(tmp_path / "motion.csv", motion_only())
    assert dynid("estimate", model, path, "--states", states, "--force").exit_code == 0
    assert not any(name.startswith(("tau_", "current_")) for name in header_of(states))


def test_states_of_a_model_in_ampere_hold_currents(tmp_path):
    """They are read back in the model's unit."""
    paths = [write(tmp_path / f"run_{k}.parquet", as_current(run(k))) for k in range(2)]
    assert dynid("identify", write_robot(tmp_path), *paths, "-o", tmp_path / "result").exit_code == 0
    states, again = tmp_path / "states.csv", tmp_path / "again.csv"
    assert dynid("estimate", tmp_path / "result", paths[1], "--states", states).exit_code == 0
    assert header_of(states)[-N:] == [f"current_{j}" for j in range(N)]
    assert dynid("estimate", tmp_path / "result", states, "--states", again).exit_code == 0
    assert again.read_text() == states.read_text()


def test_output_and_answer(tmp_path):
    path = write(tmp_path / "run.parquet", with_derivatives(run(2)))
    result = dynid("estimate", study().model, path, "-o", tmp_path / "out.parquet", "--json")
    assert (result.exit_code, result.stderr) == (0, "")
    answer, table = json.loads(result.stdout), table_of(tmp_path / "out.parquet")
    names = TorqueModel.load(study().model).term_names
    expected = [f"{name}_{j}" for name in ("tau", *names, "measured") for j in range(N)]
    assert list(table) == ["t", *expected, "status"]
    assert answer["joints"] == list(JOINTS)
    assert answer["terms"] == names
    assert answer["torque_unit"] == "N*m"
    assert answer["n_samples"] == len(table["t"]) == 1601
    assert answer["n_unusual"] == np.count_nonzero(table["status"])
    assert answer["output"] == str(tmp_path / "out.parquet")
    for j in range(N):
        terms = sum(table[f"{name}_{j}"] for name in names)
        np.testing.assert_allclose(terms, table[f"tau_{j}"], **ALGEBRAIC)
        rmse = np.sqrt(np.mean((table[f"measured_{j}"] - table[f"tau_{j}"]) ** 2))
        np.testing.assert_allclose(answer["rmse"][j], rmse, **ALGEBRAIC)


def test_answer_for_people(tmp_path):
    result = dynid("estimate", study().model, study().runs[2], "-o", tmp_path / "out.parquet")
    assert (result.exit_code, result.stderr) == (0, "")
    for joint in JOINTS:
        assert f"{joint}: RMSE " in result.stdout
    assert result.stdout.endswith(f"torques: {tmp_path / 'out.parquet'}\n")


def test_a_joint_that_slides_has_a_force(tmp_path):
    (tmp_path / "robot.urdf").write_text(chain(["revolute", "prismatic"]))
    assert (
        dynid("simulate", tmp_path / "robot.urdf", "-o", tmp_path / "lab", "--runs", 3, "--duration", 8).exit_code == 0
    )
    runs = sorted((tmp_path / "lab").glob("run_*.parquet"))
    dynid("identify", tmp_path / "robot.urdf", *runs, "-o", tmp_path / "result")
    turns, slides = dynid("estimate", tmp_path / "result", runs[0]).stdout.splitlines()[:2]
    assert " N*m (as recorded" in turns
    assert " N (as recorded" in slides
    text = dynid("contact", tmp_path / "result", runs[0]).stdout
    assert re.search(r"by thresholds of \S+ N·m, \S+ N \(median\)", text), text
    heading = "[N*m, N where it slides]"
    assert heading in dynid("identify", tmp_path / "robot.urdf", *runs, "-o", tmp_path / "again").stdout
    assert heading in dynid("compare", tmp_path / "result", tmp_path / "again", runs[2]).stdout
    assert heading in dynid("compare", tmp_path / "result", tmp_path / "again").stdout
    result = json.loads((tmp_path / "result" / "result.json").read_text())
    validator().validate(result)
    assert result["torque_units"] == ["N*m", "N"]
    page = (tmp_path / "result" / "report.html").read_text()
    for j, unit in enumerate(("N·m", "N")):
        error = significant(result["rmse"]["test"]["after"][j])
        assert f"{error}\u00a0{unit}<" in page
        assert f"test error {error}\u00a0{unit} (" in page


def test_errors_as_large_as_the_torque_are_said(tmp_path):
    """A joint whose torque has the other sign: the model leaves twice what there is."""
    columns = run(2)
    columns["tau_1"] = -columns["tau_1"]
    path = write(tmp_path / "flipped.parquet", columns)
    result = dynid("estimate", study().model, path)
    assert result.exit_code == 1
    assert f"error: on joint {JOINTS[1]} the model leaves as much as the torque itself (" in result.stderr
    answer = dynid("estimate", study().model, path, "--json")
    assert answer.exit_code == 1
    (finding,) = json.loads(answer.stdout)["findings"]
    assert (finding["code"], finding["column"]) == ("residual_exceeds_torque", "tau_1")
    assert finding["value"] > 1


def motion_only(derivatives: bool = True):
    columns = with_derivatives(run(2)) if derivatives else run(2)
    return {name: values for name, values in columns.items() if not name.startswith("tau_")}


@pytest.mark.parametrize("derivatives", [True, False])
@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_motion_without_torque(tmp_path, derivatives, suffix):
    path = write(tmp_path / f"motion{suffix}", motion_only(derivatives))
    out = tmp_path / "out.parquet"
    result = dynid("estimate", study().model, path, "-o", out)
    assert (result.exit_code, result.stderr) == (0, "")
    assert "holds no torque; there is nothing to compare the estimate with" in result.stdout
    assert "RMSE" not in result.stdout
    assert not any(name.startswith("measured") for name in table_of(out))
    assert json.loads(dynid("estimate", study().model, path, "--json").stdout)["rmse"] is None
    for option, value in (("--test-from", 5), ("--exclude", "1:2")):
        said = refusal(dynid("estimate", study().model, path, option, value))
        assert said == f"{option}: {path.name} holds no torque to score; leave it out"
    whole = write(tmp_path / "whole.csv", with_derivatives(run(2)) if derivatives else run(2))
    assert dynid("estimate", study().model, whole, "-o", tmp_path / "whole.parquet").exit_code == 0
    np.testing.assert_array_equal(table_of(out)["tau_1"], table_of(tmp_path / "whole.parquet")["tau_1"])


def test_what_leaves_nothing_to_score_is_named():
    printed = dynid("estimate", study().model, study().runs[2], "--exclude", "0:100").stdout
    said = "no error in the band of result.json: --exclude leaves hardly any motion of the run; leave less out"
    assert said in printed.splitlines()


def test_far_away_is_said(tmp_path):
    columns = with_derivatives(run(2))
    columns["q_1"][:100] += 100.0
    result = dynid("estimate", study().model, write(tmp_path / "far.csv", columns))
    assert result.exit_code == 1  # a jump of a hundred turns is damage, and said too
    assert " of 1601 samples lie outside of what the model was trained on" in result.stdout


def test_beyond_the_limits_is_counted_and_estimated_at_them(estimator, tmp_path):
    """A speed that no arm has gives no torque that no arm has, offline and online to the same bits."""
    columns = with_derivatives(run(2))
    path = tmp_path / "wild.parquet"
    write(tmp_path / "plain.parquet", columns)
    columns["dq_1"][5:9] = [1e6, -1e6, 9e6, 4000.0]
    columns["ddq_2"][9] = -9e6
    write(path, columns)
    for name in ("plain", "wild"):
        done = dynid("estimate", study().model, tmp_path / f"{name}.parquet", "-o", tmp_path / f"{name}_out.parquet")
        assert done.exit_code == (name == "wild"), done.output  # a damaged run is said to be
    calm, wild = table_of(tmp_path / "plain_out.parquet"), table_of(tmp_path / "wild_out.parquet")
    assert np.flatnonzero(wild["status"] & 4096).tolist() == [5, 6, 7, 8, 9]
    assert np.all(wild["status"][5:10] & 2)
    for j in range(N):
        assert np.abs(wild[f"tau_{j}"]).max() < 100 * np.abs(calm[f"tau_{j}"]).max()
        np.testing.assert_array_equal(
            np.delete(wild[f"tau_{j}"], range(5, 10)), np.delete(calm[f"tau_{j}"], range(5, 10))
        )
    assert_same_answers(estimator, study().model, csv_text(columns), tmp_path / "wild_out.parquet")
    said = dynid("estimate", study().model, path)
    assert "5 of 1601 samples lie beyond the model's limits, and were estimated at them" in said.stdout
    assert json.loads(dynid("estimate", study().model, path, "--json").stdout)["n_beyond_limits"] == 5
    unlimited = answer_of(estimator, study().model, csv_text(columns), "--unlimited")
    answers = from_csv(unlimited, TorqueModel.load(study().model).term_names, N)
    assert np.abs(answers.total[5]).max() > 1e5
    np.testing.assert_array_equal(answers.status & 4096, wild["status"] & 4096)


def test_a_band_of_ones_own_is_used(tmp_path):
    path = write(tmp_path / "run.csv", run(2))
    for cutoff, name in (("0.5", "a"), ("8", "b")):
        out = tmp_path / f"{name}.parquet"
        assert dynid("estimate", study().model, path, "--cutoff", cutoff, "-o", out).exit_code == 0
    a, b = table_of(tmp_path / "a.parquet"), table_of(tmp_path / "b.parquet")
    assert not np.array_equal(np.interp(b["t"], a["t"], a["tau_1"]), b["tau_1"])


def test_outputs_that_are_there_are_replaced_with_force_only(tmp_path):
    model, path = study().model, write(tmp_path / "run.csv", run(2))
    for option, name in (("-o", "out.parquet"), ("--states", "states.csv")):
        (tmp_path / name).write_text("mine")
        words = ("estimate", model, path, option, tmp_path / name)
        assert f"{name}: there is one already" in refusal(dynid(*words))
        assert (tmp_path / name).read_text() == "mine"
        assert dynid(*words, "--force").exit_code == 0
        assert (tmp_path / name).read_bytes() != b"mine"


@pytest.fixture
def folder(tmp_path):
    """A model, a run, and older outputs."""
    (tmp_path / "model.json").write_bytes(study().model.read_bytes())
    write(tmp_path / "run.csv", with_derivatives(run(2)))
    for name in ("out.parquet", "states.csv"):
        (tmp_path / name).write_text("old")
    return tmp_path


def refused(folder: Path, *options: object, model: str = "model.json", name: str = "run.csv") -> str:
    """Estimate onto old outputs and onto new ones; the sentence. Nothing may change on the disk."""
    before = snapshot(folder)
    sentences = set()
    for prefix in ("", "new_"):
        outputs = ("-o", folder / f"{prefix}out.parquet", "--states", folder / f"{prefix}states.csv", "--force")
        sentences.add(refusal(dynid("estimate", folder / model, folder / name, *outputs, *options)))
        assert snapshot(folder) == before
    (sentence,) = sentences
    assert "Errno" not in sentence
    return sentence


@pytest.mark.parametrize("part", [0.0, 0.001, 0.01, 0.1, 0.3, 0.5, 0.7, 0.9, 0.99])
def test_model_cut_anywhere(folder, part):
    path = folder / "model.json"
    data = path.read_bytes()
    path.write_bytes(data[: int(part * len(data))])
    sentence = refused(folder)
    assert sentence.startswith(f"{path}: ")
    assert "cut" in sentence or "the file is empty" in sentence
    assert any(mend in sentence for mend in ("copy", "save it again", "save the model again"))


@pytest.mark.parametrize("cut", [1, 2, 3])
def test_model_without_its_last_bytes(folder, cut):
    path = folder / "model.json"
    path.write_bytes(path.read_bytes()[:-cut])
    assert refused(folder).startswith(f"{path}: ")


@pytest.mark.parametrize("seed", range(40))
def test_model_with_one_byte_changed(folder, seed):
    """Any byte, any other value: it is refused, whatever it would have meant."""
    rng = np.random.default_rng(seed)
    path = folder / "model.json"
    data = bytearray(path.read_bytes())
    place = rng.integers(len(data))
    data[place] ^= rng.integers(1, 256)
    path.write_bytes(bytes(data))
    assert refused(folder).startswith(f"{path}: ")


MODELS = {
    "missing": (None, "cannot read this file: it does not exist"),
    "empty": (b"", "the file is empty"),
    "a robot": (URDF.encode(), "not a readable model"),
    "another format": (b'{"format": "dynid-result", "version": 1}', "not a torque model"),
    "newer": (b'{"format": "dynid-model", "version": 99}', "update dynid-rs"),
    "binary": (b"PAR1\xff\xfe\x00" * 9, "give the model.json that"),
    "a digit": ("digit", "the checksum does not match"),
}


@pytest.mark.parametrize(("content", "words"), MODELS.values(), ids=MODELS)
def test_what_is_no_model(folder, content, words):
    path = folder / "model.json"
    if content is None:
        path.unlink()
    elif content == "digit":
        path.write_text(path.read_text().replace('"torque_unit": "N*m"', '"torque_unit": "N*n"'))
    else:
        path.write_bytes(content)
    sentence = refused(folder)
    assert sentence.startswith(f"{path}: ")
    assert words in sentence


def change(**columns):
    """Run 2 with derivatives and some columns replaced (None: left out)."""
    whole = with_derivatives(run(2)) | columns
    return {name: values for name, values in whole.items() if values is not None}


def spoiled(name: str, row: int, value: float):
    values = with_derivatives(run(2))[name]
    values[row] = value
    return change(**{name: values})


RUNS = {
    "nan": (lambda: spoiled("dq_1", 6, np.nan), "row 7 (line 8), column dq_1: nan is not a finite number"),
    "time stands still": (lambda: spoiled("t", 9, run(2)["t"][8]), "row 10 (line 11), column t: time stands still"),
    "half of the torques": (lambda: change(tau_1=None), "tau for 2 of 3 joints"),
    "half of the velocities": (lambda: change(dq_2=None), "column dq_2"),
    "no position": (lambda: change(q_0=None, q_1=None, q_2=None), "column q_0 or q_shoulder is missing"),
    "more joints": (lambda: change(q_3=run(2)["q_0"]), "column q_3 is there, but the robot has 3 joints"),
    "currents": (lambda: as_current(with_derivatives(run(2))), "run.csv: holds torque in A, the model gives N*m"),
    "too few": (lambda: {n: x[:19] for n, x in change().items()}, "19 samples are too few"),
}


@pytest.mark.parametrize(("columns", "words"), RUNS.values(), ids=RUNS)
def test_bad_run(folder, columns, words):
    write(folder / "run.csv", columns())
    sentence = refused(folder)
    assert sentence.startswith("run.csv")
    assert words in sentence


@pytest.mark.parametrize("cutoff", ["nan", "0", "-1", "inf", "100"])
def test_cutoff_that_is_none(folder, cutoff):
    assert refused(folder, "--cutoff", cutoff).startswith("--cutoff must ")


def test_run_too_short_to_differentiate(folder):
    columns = {name: values[300:340] for name, values in run(2).items()}
    write(folder / "run.csv", columns)
    assert refused(folder, "--cutoff", "5").startswith("run.csv: 0.2 s are too short for a band of 5 Hz")


def refused_output(folder: Path, *options: object) -> str:
    before = snapshot(folder)
    sentence = refusal(dynid("estimate", folder / "model.json", folder / "run.csv", *options))
    assert snapshot(folder) == before
    return sentence


@pytest.mark.parametrize("option", ["-o", "--states"])
def test_output_that_cannot_be_written(folder, option):
    (folder / "sub").mkdir()
    places = {
        folder / "none" / "x": f"the folder {folder}/none does not exist; create it first",
        folder / "sub": "this is a folder, where a file is to be written; name a file, or remove it",
        folder / "run.csv" / "x": "not a folder",
        folder / "run.csv": "is read here and would be replaced; name another file",
        folder / "model.json": "is read here and would be replaced; name another file",
        folder / ("x" * 300): "file name too long",
    }
    if Path("/proc/self").exists():
        places[Path("/proc/x.parquet")] = "the folder /proc cannot be written"
    other = () if option == "--states" else ("--states", folder / "new.csv")
    for place, words in places.items():
        sentence = refused_output(folder, option, place, *other)
        assert sentence.startswith(f"{place}: ")
        assert words in sentence


def test_two_outputs_in_one_file(folder):
    sentence = refused_output(folder, "-o", folder / "x", "--states", folder / "x")
    assert sentence.endswith("torques and states cannot go to the same file; name two")


@pytest.mark.parametrize(
    ("option", "name", "ending"),
    [("-o", "x.foo", ".parquet"), ("-o", "x", ".parquet"), ("-o", "x.csv", ".parquet"), ("--states", "x.txt", ".csv")],
)
def test_a_name_that_says_another_format_is_refused(folder, option, name, ending):
    sentence = refused_output(folder, option, folder / name)
    assert sentence.startswith(f"{folder / name}: is written as ")
    assert sentence.endswith(f"give it the ending {ending}")
    assert dynid("estimate", folder / "model.json", folder / "run.csv", option, folder / f"x{ending}").exit_code == 0


def test_folder_without_rights(folder):
    dynid("estimate", folder / "model.json", folder / "run.csv")  # all modules are loaded before the rights go
    with folder_of_another_user(0o555) as other:
        sentence = refusal(dynid("estimate", study().model, study().runs[0], "-o", other / "out.parquet"))
    place = f"{other}/out.parquet: the folder {other}"
    assert sentence == f"{place} cannot be written (permission denied); name another place"


def test_a_run_in_parts_is_estimated_along_the_longest_and_says_so(folder):
    columns = change()
    columns["t"][300:] += 60.0
    write(folder / "run.csv", columns)
    result = dynid("estimate", folder / "model.json", folder / "run.csv", "--json")
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["n_samples"] == len(columns["t"]) - 300
    assert "before row 301" in result.stderr
    assert "the longest part is estimated" in result.stderr


def test_gains_are_for_currents(tmp_path):
    """Those of dynid.toml had no effect, and nothing said so."""
    rules = tmp_path / "dynid.toml"
    rules.write_text("[drive]\ngain = 3\n", encoding="utf-8")
    for gain in (("--drive-gain", "3"), ("--config", rules)):
        assert refusal(dynid("estimate", study().model, study().runs[2], *gain)) == (
            "run_2.parquet: holds torque, and drive gains (--drive-gain, or [drive] gain in dynid.toml) are for "
            "currents; leave them out, or write `tau = false` under [columns] where currents stand beside it"
        )
    inspected = dynid("inspect", study().runs[2], "--config", rules)
    assert "drive gains are for currents, and torque is read: they are not used" in " ".join(inspected.stdout.split())


def test_the_folder_of_a_result_stands_for_its_model(tmp_path):
    done = study()
    tables = [tmp_path / f"{k}.parquet" for k in range(2)]
    for model, table in zip((done.model, done.model.parent), tables, strict=True):
        printed = dynid("estimate", model, done.runs[2], "-o", table)
        assert printed.exit_code == 0, printed.output
    assert tables[0].read_bytes() == tables[1].read_bytes()
    assert "holds no model.json" in refusal(dynid("estimate", tmp_path, done.runs[2], "-o", tmp_path / "none.parquet"))
