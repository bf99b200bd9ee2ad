"""Files in, recordings out: the same numbers, or one sentence that says what is wrong and where."""

# ruff: noqa: E501 - the tables of faults have one case a line

import contextlib
import os
import time
import zipfile
import zlib
from datetime import datetime, timedelta

import numpy as np
import pytest
from helpers.run_files import (
    JOINTS,
    RATE,
    WRITERS,
    csv_text,
    folder_of_another_user,
    motion,
    renamed,
    valid_columns,
    write,
    write_csv,
    write_npz,
    write_parquet,
)
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dynid_rs.base.errors import DataError
from dynid_rs.runs.cells import ABSURD
from dynid_rs.runs.readers import Config, PartsWarning, open_run, read_config, read_recording, read_run

SUFFIXES = list(WRITERS)


class Robot:
    """What a reader needs of a robot model."""

    joint_names = JOINTS
    joint_kinds = ("revolute", "prismatic", "revolute")


def refused(path, match, *, code=None, robot=JOINTS, config=None, row=None, column=None):
    with pytest.raises(DataError, match=match) as caught:
        read_recording(path, robot, config)
    error = caught.value
    assert type(error) is DataError
    assert "\n" not in str(error)
    assert len(str(error)) < 600
    assert path.name in str(error) or (config is not None and config.source in str(error))
    if code is not None:
        assert error.code == code
    if row is not None:
        assert error.row == row
    if column is not None:
        assert error.column == column
    return error


# ---------------------------------------------------------------- valid files


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_every_format_gives_the_same_bits(tmp_path, suffix):
    columns = valid_columns()
    run = read_run(write(tmp_path / f"run{suffix}", columns), JOINTS)
    rec = run.recording
    assert rec.name == f"run{suffix}"
    assert rec.joints == JOINTS
    assert rec.torque_unit == "N*m"
    assert rec.ddq is None
    assert not rec.has_motor_encoder
    np.testing.assert_array_equal(rec.t, columns["t"])
    for signal in ("q", "dq", "tau"):
        for joint in range(3):
            np.testing.assert_array_equal(getattr(rec, signal)[:, joint], columns[f"{signal}_{joint}"])
    assert run.columns.ignored == ()


NAMES = {
    "kuka": dict(t="time", q="q", dq="qd"),
    "effort": dict(t="timestamp", tau="effort", dq="qd"),
    "current": dict(tau="current"),
}


@pytest.mark.parametrize("names", NAMES.values(), ids=NAMES)
def test_other_names_of_the_signals(tmp_path, names):
    columns = renamed(valid_columns(), **names)
    rec = read_recording(write_parquet(tmp_path / "run.parquet", columns), JOINTS)
    assert rec.dq is not None
    assert rec.torque_unit == ("A" if names.get("tau") == "current" else "N*m")


def test_joints_by_name_in_any_order(tmp_path):
    columns = valid_columns()
    by_name = {"t": columns["t"]}
    for j in (2, 0, 1):
        by_name |= {f"{s}_{JOINTS[j]}": columns[f"{s}_{j}"] for s in ("tau", "q")}
    rec = read_recording(write_csv(tmp_path / "run.csv", by_name), JOINTS)
    np.testing.assert_array_equal(rec.q[:, 1], columns["q_1"])
    np.testing.assert_array_equal(rec.tau[:, 2], columns["tau_2"])
    assert read_recording(tmp_path / "run.csv").joints == ("wrist", "shoulder", "elbow")


def test_joints_are_counted_without_a_robot(tmp_path):
    path = write_npz(tmp_path / "run.npz", valid_columns(n_joints=5))
    assert read_recording(path).n_joints == 5


def test_all_signals(tmp_path):
    columns = valid_columns()
    for alias in ("qm", "qmd", "qdd", "temp"):
        columns |= {f"{alias}_{j}": columns[f"q_{j}"] + 30.0 for j in range(3)}
    rec = read_recording(write_parquet(tmp_path / "run.parquet", columns), JOINTS)
    for values in (rec.q_motor, rec.dq_motor, rec.ddq, rec.temperature):
        np.testing.assert_array_equal(values, rec.q + 30.0)


def test_unknown_columns_are_listed_and_never_parsed(tmp_path):
    columns = valid_columns()
    lines = csv_text(columns).splitlines()
    extra = "current_target_0,qref_0,tau_motor_0,tau_target_0,q_target_0,note"
    lines = [lines[0] + "," + extra, *(line + ',1,,abc,nan,inf,"a, b"' for line in lines[1:])]
    (tmp_path / "run.csv").write_text("\n".join(lines))
    run = read_run(tmp_path / "run.csv", JOINTS)
    assert run.columns.ignored == tuple(extra.split(","))
    np.testing.assert_array_equal(run.recording.q[:, 0], columns["q_0"])


def test_torque_wins_over_current_and_says_so(tmp_path):
    columns = valid_columns()
    columns |= {f"current_{j}": columns[f"tau_{j}"] * 2 for j in range(3)}
    path = write_parquet(tmp_path / "run.parquet", columns)
    run = read_run(path, JOINTS)
    assert run.recording.torque_unit == "N*m"
    assert "current is ignored" in run.columns.notes[0]
    rec = read_recording(path, JOINTS, Config(columns={"tau": None}))
    assert rec.torque_unit == "A"
    np.testing.assert_array_equal(rec.tau[:, 0], columns["current_0"])


def test_float32_and_integer_columns(tmp_path):
    columns = {name: v.astype(np.float32) if name != "t" else v for name, v in valid_columns().items()}
    columns["tau_0"] = np.arange(400, dtype=np.int16)
    for suffix in (".parquet", ".npz"):
        rec = read_recording(write(tmp_path / f"run{suffix}", columns), JOINTS)
        assert rec.q.dtype == np.float64
        np.testing.assert_array_equal(rec.q[:, 1], columns["q_1"].astype(float))
        np.testing.assert_array_equal(rec.tau[:, 0], np.arange(400))


def test_npz_matrices(tmp_path):
    t, q, dq, ddq = motion()
    np.savez_compressed(tmp_path / "run.npz", t=t, q=q, dq=np.asfortranarray(dq), tau=ddq, gain=np.float64(3.0))
    rec = read_recording(tmp_path / "run.npz", JOINTS)
    np.testing.assert_array_equal(rec.dq, dq)
    np.testing.assert_array_equal(rec.tau, ddq)


def test_absolute_nanoseconds_keep_their_resolution(tmp_path):
    import pyarrow as pa

    ticks = 1_700_000_000_000_000_000 + np.arange(400) * 10_000_000 + np.arange(400) % 7
    expected = (np.arange(400) * 10_000_000 + np.arange(400) % 7) * 1e-9
    columns = valid_columns() | {"t": ticks}
    config = Config(units={"time": "ns"})
    for suffix in (".parquet", ".npz"):
        rec = read_recording(write(tmp_path / f"run{suffix}", columns), JOINTS, config)
        np.testing.assert_allclose(rec.t, expected, rtol=0, atol=1e-15)
    stamps = pa.array(ticks, type=pa.timestamp("ns", tz="UTC"))
    rec = read_recording(write_parquet(tmp_path / "stamps.parquet", columns | {"t": stamps}), JOINTS)
    np.testing.assert_allclose(rec.t, expected, rtol=0, atol=1e-15)


# ---------------------------------------------------------------- CSV in the wild


def csv_variants():
    text = csv_text(valid_columns())
    head, body = text.split("\n", 1)
    yield "crlf", text.replace("\n", "\r\n").encode()
    yield "carriage_return", text.replace("\n", "\r").encode()
    yield "bom", b"\xef\xbb\xbf" + text.encode()
    yield "semicolon", text.replace(",", ";").encode()
    yield "tab", text.replace(",", "\t").encode()
    yield "spaces", text.replace(",", " , ").encode()
    yield "no_last_newline", text.rstrip().encode()
    yield "blank_lines", ("\n\n" + head + "\n\n" + body.replace("\n", "\n\n", 3) + "\n\n").encode()
    yield "savetxt", ("# " + text).encode()
    yield "savetxt_two", ("# robot 7\n# " + text).encode()
    yield "comment", ("# robot 7\n" + text).encode()
    yield "quoted", (",".join(f'"{name}"' for name in head.split(",")) + "\n" + body).encode()
    yield "trailing_comma", text.replace("\n", ",\n").encode()


CSV_VARIANTS = dict(csv_variants())


@pytest.mark.parametrize("data", CSV_VARIANTS.values(), ids=CSV_VARIANTS)
def test_csv_variants_read_alike(tmp_path, data):
    (tmp_path / "run.csv").write_bytes(data)
    rec = read_recording(tmp_path / "run.csv", JOINTS)
    for joint in range(3):
        np.testing.assert_array_equal(rec.q[:, joint], valid_columns()[f"q_{joint}"])


finite = st.floats(min_value=-ABSURD, max_value=ABSURD)


@settings(max_examples=50, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(values=st.lists(finite, min_size=20, max_size=40), form=st.sampled_from(["r", ".17g", ".17e", "+.17g"]))
def test_csv_round_trip_is_exact(tmp_path, values, form):
    words = [repr(v) if form == "r" else format(v, form) for v in values]
    lines = ["t,q_0,tau_0", *(f"{k},{word},{k % 3}" for k, word in enumerate(words))]
    (tmp_path / "run.csv").write_text("\n".join(lines))
    rec = read_recording(tmp_path / "run.csv", ["a"])
    np.testing.assert_array_equal(rec.q[:, 0].view(np.int64), np.array(values).view(np.int64))


def test_both_roads_of_the_csv_reader_give_the_same_bits(tmp_path, monkeypatch):
    from dynid_rs.runs.readers import csv

    path = write_csv(tmp_path / "run.csv", valid_columns())
    fast = read_recording(path, JOINTS)
    monkeypatch.setattr(csv, "_load_fast", lambda layout, wanted: None)
    slow = read_recording(path, JOINTS)
    for name in ("t", "q", "dq", "tau"):
        np.testing.assert_array_equal(getattr(fast, name), getattr(slow, name))


@pytest.mark.parametrize("form", ["plain", "spaces", "packed", "utf-16"])
def test_no_thread_asks_python_for_the_cells_of_a_csv_file(tmp_path, monkeypatch, form):
    """One that read ahead did while the interpreter ended: every tenth short file aborted the process."""
    import gzip

    import pyarrow
    import pyarrow.csv

    asked, read = [], pyarrow.csv.read_csv
    monkeypatch.setattr(pyarrow.csv, "read_csv", lambda file, **rules: asked.append(file) or read(file, **rules))
    text = csv_text(valid_columns())
    text = text.replace(",", "  ") if form == "spaces" else text
    path = tmp_path / ("run.csv.gz" if form == "packed" else "run.csv")
    written = text.encode("utf-16" if form == "utf-16" else "utf-8")
    path.write_bytes(gzip.compress(written) if form == "packed" else written)
    assert read_recording(path).n_samples > 20
    (file,) = asked
    assert isinstance(file, pyarrow.NativeFile)
    assert not isinstance(file, pyarrow.PythonFile)


def test_csv_speed(tmp_path):
    n_rows, n_columns = 100_000, 40
    block = np.random.default_rng(0).standard_normal((1000, n_columns - 1))
    tails = [",".join(map(repr, row)) for row in block.tolist()]
    names = [f"{signal}_{j}" for signal in ("q", "dq", "ddq", "tau", "x", "y") for j in range(7)][: n_columns - 1]
    lines = [",".join(["t", *names]), *(f"{k * 1e-3!r},{tails[k % 1000]}" for k in range(n_rows))]
    (tmp_path / "run.csv").write_text("\n".join(lines))
    start = time.process_time()
    rec = read_recording(tmp_path / "run.csv")
    assert time.process_time() - start < 4.0  # 0.5 s of one core
    assert rec.n_samples == n_rows


def spoil_line(line, change):
    lines = csv_text(valid_columns()).splitlines()
    lines[line - 1] = change(lines[line - 1])
    return "\n".join(lines) + "\n"


def cell(position, text):
    def change(line):
        cells = line.split(",")
        cells[position] = text
        return ",".join(cells)

    return change


# text of the file, message, code, 0-based row, column
CSV_FAULTS = {
    "word": (spoil_line(12, cell(2, "abc")), r"row 11 \(line 12\), column q_1: 'abc' is not a number", "bad_cell", 10, "q_1"),
    "empty_cell": (spoil_line(3, cell(4, "")), r"row 2 \(line 3\), column dq_0: the cell is empty", "bad_cell", 1, "dq_0"),
    "blank_cell": (spoil_line(3, cell(4, "  ")), r"line 3.*column dq_0: the cell is empty", "bad_cell", 1, "dq_0"),
    "nan": (spoil_line(30, cell(9, "nan")), r"row 29 \(line 30\), column tau_2: nan", "not_finite", 28, "tau_2"),
    "inf": (spoil_line(2, cell(1, "-inf")), r"row 1 \(line 2\), column q_0: -inf", "not_finite", 0, "q_0"),
    "too_large": (spoil_line(2, cell(1, "1e999")), r"row 1 \(line 2\), column q_0: inf", "not_finite", 0, "q_0"),
    "nan_time": (spoil_line(5, cell(0, "nan")), r"row 4 \(line 5\), column t", "not_finite", 3, "t"),
    "hex": (spoil_line(7, cell(1, "0x1F")), r"line 7.*column q_0: '0x1F'", "bad_cell", 5, "q_0"),
    "underscore": (spoil_line(7, cell(1, "1_000")), r"line 7.*column q_0", "bad_cell", 5, "q_0"),
    "unicode_digit": (spoil_line(7, cell(1, "\u0663")), r"line 7.*column q_0", "bad_cell", 5, "q_0"),
    "control": (spoil_line(7, cell(1, "\x1b[31m")), r"line 7.*column q_0: '\\\\?x1b", "bad_cell", 5, "q_0"),
    "missing_cell": (spoil_line(9, lambda line: line.rsplit(",", 1)[0]), r"row 8 \(line 9\): has 9 cells.*header has 10", "bad_row", 7, None),
    "extra_cell": (spoil_line(9, lambda line: line + ",1"), r"row 8 \(line 9\): has 11 cells", "bad_row", 7, None),
    "cut_off": (csv_text(valid_columns())[:-60], r"row 400 \(line 401\).*cut off here: take the row out", "bad_row", 399, None),
    "open_quote": (spoil_line(9, cell(1, '"1')), r"line 9", "bad_row", 7, None),
    "two_runs": (csv_text(valid_columns()) * 2, r"row 401 \(line 402\): the header appears a second time", "bad_row", 400, None),
    "decimal_comma": (csv_text(valid_columns()).replace(".", ","), r"row 1 \(line 2\): has 20 cells.*decimal commas\? Write points", "bad_row", 0, None),
    "one_comma": (spoil_line(4, cell(1, "0;5")).replace(",", ";"), r"row 3 \(line 4\): has 11 cells", "bad_row", 2, None),
    "blank_then_word": ("\n" + spoil_line(2, lambda line: "\n\n" + cell(2, "x")(line)), r"row 1 \(line 5\), column q_1", "bad_cell", 0, "q_1"),
    "no_header": (csv_text(valid_columns()).split("\n", 1)[1], r"line 1: expected a header", "no_header", None, None),
    "messages_without_header": ("1714560000,0,,elbow,0.0,0.0,0.5\n1714560000,5,,elbow,0.0,0.0,0.5\n", r"line 1: expected a header", "no_header", None, None),
    "only_header": (csv_text(valid_columns()).split("\n", 1)[0] + "\n", r": no rows, only the names of the columns", "no_rows", None, None),
    "only_blank": ("\n\n \n", r"expected a header", "no_header", None, None),
    "few_rows": ("\n".join(csv_text(valid_columns()).split("\n")[:11]), r"10 samples are too few", "too_few_samples", None, None),
    "twice": (csv_text(valid_columns()).replace("q_1", "q_0", 1), r"column q_0 appears 2 times", "duplicate_column", None, "q_0"),
    "unknown_twice": ("x,x," + csv_text(valid_columns()).replace("\n", "\n1,2,"), r"column x appears 2 times", "duplicate_column", None, "x"),
    "names_with_spaces": (csv_text(valid_columns()).replace(",", " ").replace("q_0", "axis 0", 1), r"line 1: the cells seem to be separated by spaces", "no_delimiter", None, None),
    "still": (spoil_line(50, cell(0, "0.47")), r"row 49 \(line 50\), column t: time stands still", "time_stands_still", 48, "t"),
    "long_header": ("q" * (1 << 21), r"line 1: is longer than", "long_line", None, None),
    "long_line": (spoil_line(9, lambda line: line + "x" * (1 << 21)), r"line 9: is longer than", "long_line", None, None),
    "long_cell": (spoil_line(9, lambda line: line + "x" * 200_000), r"line 9", None, None, None),
}  # fmt: skip


@pytest.mark.parametrize(("text", "match", "code", "row", "column"), CSV_FAULTS.values(), ids=CSV_FAULTS)
def test_broken_csv(tmp_path, text, match, code, row, column):
    (tmp_path / "run.csv").write_text(text, encoding="utf-8")
    refused(tmp_path / "run.csv", match, code=code, row=row, column=column)


# ---------------------------------------------------------------- columns


def without(*names):
    return lambda c: {k: v for k, v in c.items() if k not in names}


def plus(**more):
    return lambda c: c | {name: c[source] for name, source in more.items()}


def joints_only(n):
    return lambda c: {k: v for k, v in c.items() if k == "t" or int(k[-1]) < n}


def from_one(c):
    return {"t" if k == "t" else f"{k[:-1]}{int(k[-1]) + 1}": v for k, v in c.items()}


COLUMN_FAULTS = {
    "no_time": (
        without("t"),
        "time column is missing, expected t or time or timestamp.*q_0",
        "missing_column",
    ),
    "two_times": (
        plus(time="t"),
        r"columns t and time both give the time.*\[columns\] t =",
        "ambiguous_column",
    ),
    "missing_q": (without("q_1"), "column q_1 or q_elbow is missing.*q for 2 of 3 joints", "missing_column"),
    "missing_tau": (without("tau_2"), "column tau_2 or tau_wrist .*tau for 2 of 3 joints", "missing_column"),
    "no_tau": (
        without("tau_0", "tau_1", "tau_2"),
        r"column tau_0.*or current_0.*the file has t, q_0",
        "missing_column",
    ),
    "no_q": (
        without("q_0", "q_1", "q_2"),
        r"column q_0.*\[columns\] q = \"actual_q_\{i\}\"",
        "missing_column",
    ),
    "partial_dq": (without("dq_1"), r"column dq_1.*leave dq out.*dq = false", "missing_column"),
    "alias_twice": (
        plus(qd_0="dq_0"),
        "columns dq_0 and qd_0 both give dq of joint shoulder",
        "ambiguous_column",
    ),
    "index_and_name": (plus(q_elbow="q_1"), "columns q_1 and q_elbow both give q", "ambiguous_column"),
    "tau_and_effort": (plus(effort_0="tau_0"), "columns tau_0 and effort_0 both", "ambiguous_column"),
    "fewer_joints": (joints_only(2), "column q_2.*q for 2 of 3 joints.*robot of this run", "missing_column"),
    "more_joints": (
        plus(q_3="q_0", tau_3="tau_0"),
        "column q_3 is there, but the robot has 3 joints",
        "too_many_joints",
    ),
    "more_torques": (plus(tau_3="tau_0"), "column tau_3 is there", "too_many_joints"),
    "from_one": (from_one, r"column q_0.*counts from 1.*\[columns\] q = \"q_\{n\}\"", "missing_column"),
}


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize(("change", "match", "code"), COLUMN_FAULTS.values(), ids=COLUMN_FAULTS)
def test_wrong_columns(tmp_path, suffix, change, match, code):
    path = write(tmp_path / f"run{suffix}", change(valid_columns()))
    refused(path, match, code=code)


def test_parquet_column_twice(tmp_path):
    import pyarrow as pa
    import pyarrow.parquet as pq

    columns = valid_columns()
    names = ["q_0" if name == "q_1" else name for name in columns]
    pq.write_table(pa.table(list(columns.values()), names=names), tmp_path / "run.parquet")
    refused(tmp_path / "run.parquet", "column q_0 appears 2 times", code="duplicate_column")


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_npz_array_twice(tmp_path):
    path = write_npz(tmp_path / "run.npz", valid_columns())
    with zipfile.ZipFile(path) as archive:
        data = archive.read("q_0.npy")
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("q_0.npy", data)
    refused(path, "q_0.npy appears 2 times", code="duplicate_column")
    t, q, _, ddq = motion()
    np.savez(tmp_path / "both.npz", t=t, q=q, q_0=t, tau=ddq)
    refused(tmp_path / "both.npz", "q_0 appears 2 times", code="duplicate_column")


def test_joint_names_that_are_numbers(tmp_path):
    path = write_parquet(tmp_path / "run.parquet", valid_columns())
    refused(path, "q_1 can mean joint 1 or joint 2", code="ambiguous_column", robot=("1", "2", "3"))
    config = Config(columns={s: f"{s}_{{i}}" for s in ("q", "dq", "tau")})
    assert read_recording(path, ("1", "2", "3"), config).joints == ("1", "2", "3")
    assert read_recording(path, ("0", "1", "2")).n_joints == 3


def test_file_without_any_joint(tmp_path):
    path = write_csv(tmp_path / "run.csv", {"t": np.arange(30.0), "x": np.arange(30.0)})
    refused(path, "column q_0 is missing", robot=None, code="missing_column")


def test_robot_without_joints(tmp_path):
    path = write_csv(tmp_path / "run.csv", valid_columns())
    with pytest.raises(ValueError, match="at least one joint"):
        read_recording(path, [])


# ---------------------------------------------------------------- cells


@pytest.mark.parametrize("suffix", [".parquet", ".npz"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("column", ["t", "q_1", "dq_0", "tau_2"])
def test_cells_that_are_not_finite(tmp_path, suffix, value, column):
    columns = valid_columns()
    columns[column][37] = value
    path = write(tmp_path / f"run{suffix}", columns)
    refused(path, f"row 38, column {column}: ", code="not_finite", row=37, column=column)


def test_parquet_null(tmp_path):
    import pyarrow as pa

    cells = pa.array([None if k == 5 else float(k) for k in range(400)])
    path = write_parquet(tmp_path / "run.parquet", valid_columns() | {"tau_1": cells})
    refused(path, "row 6, column tau_1", code="not_finite", row=5)


NOT_NUMBERS = {
    "text": ["a"] * 400,
    "bool": [True] * 400,
    "list": [[1.0]] * 400,
    "struct": [{"a": 1.0}] * 400,
}


@pytest.mark.parametrize("cells", NOT_NUMBERS.values(), ids=NOT_NUMBERS)
def test_parquet_columns_of_another_type(tmp_path, cells):
    import pyarrow as pa

    columns = valid_columns()
    path = write_parquet(tmp_path / "run.parquet", columns | {"tau_1": pa.array(cells)})
    if not isinstance(cells[0], list):  # lists of numbers are columns
        refused(path, "column tau_1: holds .*, expected numbers", code="not_numbers", column="tau_1")
    path = write_parquet(tmp_path / "other.parquet", columns | {"note": pa.array(cells)})
    ignored = "note_0" if isinstance(cells[0], list) else "note"
    assert read_run(path, JOINTS).columns.ignored == (ignored,)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_twenty_rows_are_enough_and_nineteen_are_not(tmp_path, suffix):
    assert read_recording(write(tmp_path / f"a{suffix}", valid_columns(n_samples=20)), JOINTS).n_samples == 20
    refused(write(tmp_path / f"b{suffix}", valid_columns(n_samples=19)), "19 samples", code="too_few_samples")
    refused(write(tmp_path / f"c{suffix}", valid_columns(n_samples=0)), "no rows", code="no_rows")


# ---------------------------------------------------------------- files


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_file_that_is_not_there(tmp_path, suffix):
    with pytest.raises(FileNotFoundError, match="it does not exist; check the path") as caught:
        read_recording(tmp_path / f"run{suffix}", JOINTS)
    assert f"run{suffix}" in str(caught.value)
    assert "Errno" not in str(caught.value)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_folder_instead_of_file(tmp_path, suffix):
    (tmp_path / f"run{suffix}").mkdir()
    with pytest.raises(IsADirectoryError, match="it is a folder; name a file"):
        read_recording(tmp_path / f"run{suffix}", JOINTS)


def test_file_as_folder(tmp_path):
    write_csv(tmp_path / "run.csv", valid_columns())
    with pytest.raises(NotADirectoryError, match="not a folder"):
        read_recording(tmp_path / "run.csv" / "run.csv", JOINTS)


def test_path_with_a_zero_byte():
    with pytest.raises(FileNotFoundError, match="not a path"):
        read_recording("run\0.csv", JOINTS)


def test_path_that_is_too_long(tmp_path):
    with pytest.raises(OSError, match="cannot read this file: file name too long"):
        read_recording(tmp_path / ("a" * 300 + ".csv"), JOINTS)


def test_file_without_rights():
    with (
        folder_of_another_user(0o755) as folder,
        pytest.raises(PermissionError, match="cannot read this file: permission is denied"),
    ):
        read_recording(folder / "run.csv", JOINTS)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_pipe_instead_of_file(tmp_path, suffix):
    os.mkfifo(tmp_path / f"run{suffix}")
    refused(tmp_path / f"run{suffix}", "a device or a pipe", code="not_a_file")


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_empty_file(tmp_path, suffix):
    (tmp_path / f"run{suffix}").touch()
    refused(tmp_path / f"run{suffix}", "the file is empty", code="empty_file")


@pytest.mark.parametrize("name", ["run.doc", "run", "run.gz", "run.parquet.gz", "run.npy"])
def test_unknown_suffix(tmp_path, name):
    (tmp_path / name).write_text("t,q_0\n")
    refused(tmp_path / name, r"is not known; expected a run as \.parquet, \.csv, ", code="unknown_suffix")


def test_suffix_in_capitals(tmp_path):
    write_csv(tmp_path / "run.csv", valid_columns()).rename(tmp_path / "RUN.CSV")
    assert read_recording(tmp_path / "RUN.CSV", JOINTS).n_samples == 400


RUBBISH = {
    "random": np.random.default_rng(1).bytes(4096),
    "zeros": bytes(4096),
    "utf16_without_mark": csv_text(valid_columns()).encode("utf-16-le"),
    "utf32": csv_text(valid_columns()).encode("utf-32"),
    "latin1": b"t,q_0,Gel\xe4nder\n1,2,3\n",
    "hdf5": b"\x89HDF\r\n\x1a\n" + bytes(100),
    "gzip": b"\x1f\x8b\x08" + bytes(100),
    "npy": b"\x93NUMPY\x01\x00" + bytes(100),
    "escape": b"\x1b[31mred\x1b[0m,\x07bell\n1,2\n",
    "one_byte": b"x",
}


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("data", RUBBISH.values(), ids=RUBBISH)
def test_rubbish(tmp_path, suffix, data):
    (tmp_path / f"run{suffix}").write_bytes(data)
    error = refused(tmp_path / f"run{suffix}", "expected|damaged|missing|cut off")
    assert str(error).isprintable()


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("other", SUFFIXES)
def test_contents_of_another_format(tmp_path, suffix, other):
    if suffix == other:
        return
    path = write(tmp_path / f"run{other}", valid_columns()).rename(tmp_path / f"run{suffix}")
    guess = {".parquet": "it looks like Parquet", ".npz": "NPZ", ".csv": "starts with the text 't,q_0"}[other]
    refused(path, f"expected .*{guess}")


@pytest.mark.parametrize("suffix", [".parquet", ".npz"])
def test_truncation_anywhere(tmp_path, suffix):
    path = write(tmp_path / f"run{suffix}", valid_columns(n_samples=60))
    data = path.read_bytes()
    for length in range(1, len(data), 97):
        path.write_bytes(data[:length])
        refused(path, "cut off|damaged|expected", robot=JOINTS)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_flipped_bytes_anywhere(tmp_path, suffix):
    path = write(tmp_path / f"run{suffix}", valid_columns(n_samples=60))
    data = bytearray(path.read_bytes())
    rng = np.random.default_rng(3)
    for _ in range(400):
        spoiled = bytearray(data)
        for place in rng.integers(0, len(data), rng.integers(1, 4)):
            spoiled[place] ^= int(rng.integers(1, 256))
        path.write_bytes(spoiled)
        with contextlib.suppress(DataError, OSError, PartsWarning):  # anything else is a leak
            assert np.isfinite(read_recording(path, JOINTS).q).all()


# ---------------------------------------------------------------- NPZ as an attack


class Explosive:
    def __reduce__(self):
        return os.abort, ()


def npy(header, data=b""):
    text = header.encode()
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + data


def test_pickles_are_never_loaded(tmp_path):
    np.savez(tmp_path / "run.npz", **valid_columns(), bomb=np.array([Explosive()], dtype=object))
    refused(tmp_path / "run.npz", "bomb holds pickled Python objects, which are never read", code="pickled")


def test_zip_bomb_is_refused_before_it_grows(tmp_path):
    import tracemalloc

    rows = 2**31
    header = f"{{'descr': '<f8', 'fortran_order': False, 'shape': ({rows},), }}"
    with zipfile.ZipFile(tmp_path / "run.npz", "w") as archive:
        for name in ("t", "q_0", "tau_0"):
            archive.writestr(f"{name}.npy", npy(header))
    data = bytearray((tmp_path / "run.npz").read_bytes())
    (tmp_path / "run.npz").write_bytes(data)
    tracemalloc.start()
    refused(tmp_path / "run.npz", "another size than its header", robot=["a"], code="damaged")
    assert tracemalloc.get_traced_memory()[1] < 10 * 2**20
    tracemalloc.stop()


def test_honest_but_huge_npz_is_refused(tmp_path, monkeypatch):
    from dynid_rs.runs.readers import table

    path = write_npz(tmp_path / "run.npz", valid_columns())
    monkeypatch.setattr(table, "MAX_BYTES", 10_000)
    refused(path, "declares .* GiB of data, more than", code="too_large")
    refused(write_parquet(tmp_path / "run.parquet", valid_columns()), "more than", code="too_large")
    refused(write_csv(tmp_path / "run.csv", valid_columns()), "more than", code="too_large")


def test_encrypted_npz(tmp_path):
    path = write_npz(tmp_path / "run.npz", valid_columns())
    data = bytearray(path.read_bytes())
    position = -1
    while (position := data.find(b"PK\x01\x02", position + 1)) >= 0:
        data[position + 8] |= 1
    path.write_bytes(data)
    refused(path, "t is encrypted", code="encrypted")


def test_zip_with_other_things(tmp_path):
    with zipfile.ZipFile(tmp_path / "run.npz", "w") as archive:
        archive.writestr("readme.txt", "hello")
    refused(tmp_path / "run.npz", "readme.txt is not a NumPy array", code="not_npz")
    with zipfile.ZipFile(tmp_path / "run.npz", "w"):
        pass
    refused(tmp_path / "run.npz", "no array with samples", code="empty_file")


HEADERS = {
    "code": "__import__('os').abort()",
    "negative": "{'descr': '<f8', 'fortran_order': False, 'shape': (-5,), }",
    "object": "{'descr': '|O', 'fortran_order': False, 'shape': (5,), }",
    "no_descr": "{'shape': (5,), }",
    "deep": "(" * 500 + ")" * 500,
    "huge": "{'descr': '<f8', 'fortran_order': False, 'shape': (99999999999999999999,), }",
    "long": " " * 60_000,
}


@pytest.mark.parametrize("header", HEADERS.values(), ids=HEADERS)
def test_hostile_npy_headers(tmp_path, header):
    with zipfile.ZipFile(tmp_path / "run.npz", "w") as archive:
        archive.writestr("t.npy", npy(header))
    refused(tmp_path / "run.npz", "damaged|pickled")


def test_npz_arrays_of_different_length(tmp_path):
    columns = valid_columns()
    columns["tau_1"] = columns["tau_1"][:-1]
    path = write_npz(tmp_path / "run.npz", columns)
    refused(path, "array tau_1 has 399 samples, but time has 400", code="length", column="tau_1")


def test_npz_with_wrong_checksum(tmp_path):
    path = write_npz(tmp_path / "run.npz", valid_columns())
    data = bytearray(path.read_bytes())
    crc = zlib.crc32(data).to_bytes(4, "little")
    data[data.find(b"PK\x01\x02") + 16 : data.find(b"PK\x01\x02") + 20] = crc
    path.write_bytes(data)
    refused(path, "damaged", code="damaged")


# ---------------------------------------------------------------- dynid.toml


def config_file(tmp_path, text):
    path = tmp_path / "dynid.toml"
    path.write_text(text)
    return path


def test_config_maps_and_converts(tmp_path):
    t, q, dq, ddq = motion()
    degrees = np.array([180 / np.pi, 1e3, 180 / np.pi])  # the second joint slides: mm
    columns = {"stamp": t * 1e3}
    for j in range(3):
        columns |= {
            f"actual_q_{j + 1}": q[:, j] * degrees[j],
            f"speed_{JOINTS[j]}": dq[:, j] * (30 / np.pi if j != 1 else 1e3),
            f"m{j}": q[:, j] * 50.0 * (j + 1) * degrees[j],
            f"i_{j}": -ddq[:, j] * 1e3,
        }
    path = write_parquet(tmp_path / "run.parquet", columns)
    config = read_config(
        config_file(
            tmp_path,
            """
            [columns]
            t = "stamp"
            q = "actual_q_{n}"
            dq = "speed_{joint}"
            q_motor = ["m0", "m1", "m2"]
            current = "i_{i}"
            [units]
            time = "ms"
            angle = "deg"
            length = "mm"
            velocity = "rpm"
            current = "mA"
            [drive]
            gain = [10, 20, 30.0]
            [gear]
            ratio = [50, 100, 150]
            [signs]
            tau = -1
            """,
        )
    )
    rec = read_recording(path, Robot(), config)
    assert rec.rate == pytest.approx(RATE)
    np.testing.assert_allclose(rec.q, q, rtol=1e-14)
    np.testing.assert_allclose(rec.dq, dq, rtol=1e-14)
    np.testing.assert_allclose(rec.q_motor, q, rtol=1e-14)
    np.testing.assert_allclose(rec.tau, ddq * [10, 20, 30], rtol=1e-14)
    assert rec.torque_unit == "N*m"


def test_config_motor_torque_and_signs(tmp_path):
    columns = valid_columns() | {f"tau_motor_{j}": valid_columns()[f"tau_{j}"] / 100 for j in range(3)}
    path = write_csv(tmp_path / "run.csv", columns)
    text = (
        '[columns]\ntau = "tau_motor_{i}"\ndq = false\n[gear]\nratio = 100\napply_to = ["tau"]\n[signs]\nq = [1, -1, 1]'
    )
    rec = read_recording(path, JOINTS, read_config(config_file(tmp_path, text)))
    np.testing.assert_allclose(rec.tau[:, 2], columns["tau_2"], rtol=1e-15)
    np.testing.assert_array_equal(rec.q[:, 1], -columns["q_1"])
    assert rec.dq is None


def test_config_of_the_motors_own_turns_where_their_encoder_is_the_only_one(tmp_path):
    columns = valid_columns()
    turns = {"t": columns["t"]}
    for j, ratio in enumerate((50, 100, 150)):
        turns |= {f"motor_{j}": ratio * columns[f"q_{j}"], f"tau_{j}": columns[f"tau_{j}"] / ratio}
    text = '[columns]\nq = "motor_{i}"\n[gear]\nratio = [50, 100, 150]\napply_to = ["q", "dq", "tau"]'
    path = write_csv(tmp_path / "run.csv", turns)
    rec = read_recording(path, JOINTS, read_config(config_file(tmp_path, text)))
    for j in range(3):
        np.testing.assert_allclose(rec.q[:, j], columns[f"q_{j}"], rtol=1e-14)
        np.testing.assert_allclose(rec.tau[:, j], columns[f"tau_{j}"], rtol=1e-14)
    assert rec.q_motor is None


def test_empty_config_changes_nothing(tmp_path):
    path = write_csv(tmp_path / "run.csv", valid_columns())
    rec = read_recording(path, JOINTS, read_config(config_file(tmp_path, "# nothing\n")))
    np.testing.assert_array_equal(rec.q, read_recording(path, JOINTS).q)


CONFIG_FAULTS = {
    "not_toml": ("[columns", "is not valid TOML: Expected"),
    "unknown_table": ("[colums]\n", r"\[colums\]: this key is not known; did you mean columns"),
    "unknown_top": ("gain = 3\n", r"gain: this key is not known"),
    "not_a_table": ("drive = 3\n", r"drive: must be a table, written as \[drive\]"),
    "unknown_signal": ('[columns]\nqq = "a_{i}"', r"\[columns\] qq: this key is not known"),
    "no_index": ('[columns]\nq = "angle"', r"\[columns\] q: one column per joint"),
    "other_field": ('[columns]\nq = "a_{k}"', r"only \{i\}, \{n\} and \{joint\}"),
    "attribute": ('[columns]\nq = "a_{i.__class__}"', r"only \{i\}"),
    "format_spec": ('[columns]\nq = "a_{i:>99999999}"', r"only \{i\}"),
    "open_brace": ('[columns]\nq = "a_{i"', r"\[columns\] q: 'a_\{i'"),
    "time_index": ('[columns]\nt = "t_{i}"', r"\[columns\] t: time is one column"),
    "time_list": ('[columns]\nt = ["t"]', r"\[columns\] t: must be a column name"),
    "no_q": ("[columns]\nq = false", r"\[columns\] q: cannot be left out"),
    "number": ("[columns]\nq = 3", r"\[columns\] q: must be a name"),
    "empty_list": ("[columns]\nq = []", r"\[columns\] q: must be"),
    "unit": ('[units]\nangle = "degrees"', r"\[units\] angle: must be one of rad, deg, mrad, rev, got 'degrees'"),
    "unit_type": ("[units]\nangle = 3", r"\[units\] angle"),
    "gain_text": ('[drive]\ngain = "3"', r"\[drive\] gain: must be a number"),
    "gain_bool": ("[drive]\ngain = true", r"\[drive\] gain: must be a number"),
    "gain_nan": ("[drive]\ngain = nan", r"\[drive\] gain"),
    "gain_huge": ("[drive]\ngain = 1" + "0" * 400, r"\[drive\] gain"),
    "gain_zero": ("[drive]\ngain = [1, 0]", r"\[drive\] gain: must be positive"),
    "ratio_negative": ("[gear]\nratio = -100", r"\[gear\] ratio: must be positive.*\[signs\]"),
    "apply_other": ('[gear]\nratio = 3\napply_to = ["current"]', r"\[gear\] apply_to: must be a list of"),
    "sign": ("[signs]\nq = [1, 2]", r"\[signs\] q: must be 1 or -1"),
    "deep": ("a = " + "[" * 5000 + "]" * 5000, "is not valid TOML|not known"),
}


@pytest.mark.parametrize(("text", "match"), CONFIG_FAULTS.values(), ids=CONFIG_FAULTS)
def test_wrong_config(tmp_path, text, match):
    with pytest.raises(DataError, match=match) as caught:
        read_config(config_file(tmp_path, text))
    assert str(caught.value).startswith("dynid.toml")
    assert len(str(caught.value)) < 400


def test_config_that_is_no_text(tmp_path):
    (tmp_path / "dynid.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(DataError, match="not UTF-8"):
        read_config(tmp_path / "dynid.toml")
    with pytest.raises(FileNotFoundError, match=r"nowhere\.toml"):
        read_config(tmp_path / "nowhere.toml")


CONFIG_MISFITS = {
    "gain": (dict(drive_gain=(1.0, 2.0)), r"\[drive\] gain: has 2 numbers, but the robot has 3 joints"),
    "list": (dict(columns={"q": ("q_0", "q_1")}), "lists 2 columns for q"),
    "list_twice": (dict(columns={"q": ("q_0", "q_0", "q_1")}), "lists a column of q twice"),
    "list_absent": (
        dict(columns={"q": ("q_0", "q_1", "x")}),
        "column x is missing, which dynid.toml names for q",
    ),
    "template_absent": (dict(columns={"q": "x_{i}"}), "column x_0 is missing"),
    "time_absent": (dict(columns={"t": "stamp"}), "expected stamp"),
    "two_signals": (dict(columns={"tau": "q_{i}"}), "column q_0 would be both q and tau; name another one"),
    "position_as_time": (dict(columns={"t": "q_1"}), "column q_1 would be both t and q"),
    "no_torque": (dict(columns={"tau": None}), "column tau_0"),
}


@pytest.mark.parametrize(("settings_", "match"), CONFIG_MISFITS.values(), ids=CONFIG_MISFITS)
def test_config_that_does_not_fit_the_run(tmp_path, settings_, match):
    path = write_csv(tmp_path / "run.csv", valid_columns())
    config = Config(**{"drive_gain": None, **settings_})
    if "drive_gain" in settings_:
        path = write_csv(tmp_path / "run.csv", renamed(valid_columns(), tau="current"))
    refused(path, match, config=config)


def test_open_run_reads_names_only(tmp_path):
    path = write_csv(tmp_path / "run.csv", valid_columns())
    assert open_run(path).names == tuple(valid_columns())


STAMPS = {
    "day_first": ("%d.%m.%Y %H:%M:%S.%f", 0.004),
    "iso": ("%Y-%m-%dT%H:%M:%S.%f", 0.004),
}


@pytest.mark.parametrize(("form", "step"), STAMPS.values(), ids=STAMPS)
def test_dates_with_the_day_first_are_read_as_iso_dates_are(tmp_path, form, step):
    rec = read_recording(stamped(tmp_path, form), None)
    np.testing.assert_allclose(rec.t - rec.t[0], step * np.arange(N_STAMPED), atol=1e-9)


def test_a_date_that_may_be_two_days_is_refused_with_the_ways_to_write_it(tmp_path):
    with pytest.raises(DataError, match=r"'05/01/2024 12:00:00.\d+' is a date whose order .* 2024-05-01T.*ISO 8601"):
        read_recording(stamped(tmp_path, "%m/%d/%Y %H:%M:%S.%f"), None)


def test_stamps_that_are_rounded_are_said_to_be(tmp_path):
    with pytest.raises(
        DataError, match=r"stamps are rounded to 0.01 s, which about 2.5 rows share; .* 0.004, .*250 Hz"
    ):
        read_recording(stamped(tmp_path, "%d.%m.%Y %H:%M:%S.%f", cut=-4), None)
    path = stamped(tmp_path, "%d.%m.%Y %H:%M:%S.%f")
    lines = path.read_text().splitlines()
    path.write_text("\n".join([*lines[:40], lines[39], *lines[40:]]) + "\n")
    with pytest.raises(DataError, match="time must strictly increase: remove the repeated rows"):
        read_recording(path, None)


N_STAMPED = 501


def stamped(folder, form, cut=None):
    """A run of one joint at 250 Hz from the first of May on, with stamps of this form."""
    start = datetime(2024, 5, 1, 12)
    lines = ["t,q_0,tau_0"]
    for k in range(N_STAMPED):
        stamp = (start + timedelta(seconds=0.004 * k)).strftime(form)[:cut]
        lines.append(f"{stamp},{np.sin(0.01 * k):.6f},{np.cos(0.01 * k):.6f}")
    path = folder / "stamped.csv"
    path.write_text("\n".join(lines) + "\n")
    return path
