"""A recording holds only what can be used."""

import json
import os

import numpy as np
import pytest
from helpers.run_files import folder_of_another_user, motion

import dynid_rs as dyn
from dynid_rs.base.errors import DataError
from dynid_rs.base.files import atomic_path, write_json, write_table
from dynid_rs.base.findings import Finding
from dynid_rs.runs.recording import Recording


def arrays(**changes):
    t, q, dq, ddq = motion()
    return {"t": t, "q": q, "tau": ddq + dq, "dq": dq, "ddq": ddq, "q_motor": q + 1e-3, **changes}


def test_valid_recording():
    rec = Recording(**arrays())
    assert (rec.n_samples, rec.n_joints) == rec.q.shape == (400, 3)
    assert rec.rate == pytest.approx(100.0)
    assert rec.duration == pytest.approx(3.99)
    assert rec.has_motor_encoder
    assert rec.joints == ("0", "1", "2")
    for values in (rec.t, rec.q, rec.tau, rec.dq, rec.ddq, rec.q_motor):
        assert values.dtype == np.float64
        assert values.flags.c_contiguous


def test_integers_float32_and_lists_become_float64():
    rec = Recording(t=list(range(30)), q=np.ones((30, 2), np.float32), tau=np.asfortranarray(np.ones((30, 2))))
    assert rec.t.dtype == rec.q.dtype == np.float64
    assert rec.tau.flags.c_contiguous


STEPS = 10 * np.arange(400).astype("timedelta64[ms]")


@pytest.mark.parametrize("t", [STEPS, np.datetime64("2024-05-01T12:00:00") + STEPS, list(STEPS.astype("m8[us]"))])
def test_moments_are_seconds_from_the_first_row_as_in_a_data_frame(t):
    """Their counts were taken for seconds: 2 s at 250 Hz were 1996 s at 0.25 Hz."""
    np.testing.assert_allclose(Recording(**arrays(t=t)).t, arrays()["t"], rtol=0, atol=1e-12)


def test_moments_that_are_missing_or_no_time_are_refused():
    lost = STEPS.copy()
    lost[7] = np.timedelta64("NaT")
    with pytest.raises(DataError, match=r"row 8, column t: nan is not a finite number"):
        Recording(**arrays(t=lost))
    with pytest.raises(ValueError, match=r"tau must be an array of numbers, got timedelta64\[ms\]"):
        Recording(**arrays(tau=np.stack([STEPS] * 3, axis=1)))


def test_what_a_mask_hides_is_missing():
    """The numbers behind the mask were taken for measured ones."""
    hidden = np.ma.array(arrays()["q"])
    hidden[7, 1] = np.ma.masked
    with pytest.raises(DataError, match=r"row 8, column q_1: nan is not a finite number"):
        Recording(**arrays(q=hidden))
    late = np.ma.array(STEPS)
    late[7] = np.ma.masked
    with pytest.raises(DataError, match=r"row 8, column t: nan is not a finite number"):
        Recording(**arrays(t=late))
    whole = np.ma.array(arrays()["q"])
    np.testing.assert_array_equal(Recording(**arrays(q=whole)).q, arrays()["q"])
    np.testing.assert_array_equal(np.isnan(dyn.rmse(hidden, whole)), [False, True, False])


def test_slice_and_without():
    rec = Recording(**arrays())
    part = rec.slice(100, -50)
    assert part.n_samples == 250
    np.testing.assert_array_equal(part.q, rec.q[100:-50])
    np.testing.assert_array_equal(part.q_motor, rec.q_motor[100:-50])
    assert part.joints == rec.joints
    bare = rec.without("dq", "ddq")
    assert bare.dq is None
    assert bare.ddq is None
    assert bare.q_motor is not None
    with pytest.raises(DataError, match="too few"):
        rec.slice(0, 10)
    with pytest.raises(ValueError, match=r"only .* can be left out"):
        rec.without("q")


def nan_at(name, row, joint, value=np.nan):
    values = arrays()[name].copy()
    values[row, joint] = value
    return {name: values}


def time(**changes):
    t = motion()[0].copy()
    for row, value in changes.values():
        t[row] = value
    return {"t": t}


def gap_after(row, steps):
    t = motion()[0].copy()
    t[row:] += (steps - 1) * 0.01
    return {"t": t}


SHAPES = [
    ({"t": np.zeros((400, 1))}, "t must be"),
    ({"t": np.arange(399) / 100}, "399 samples"),
    ({"q": np.zeros(400)}, "q must be"),
    ({"q": np.zeros((400, 0))}, "q must be"),
    ({"tau": np.zeros((400, 2))}, "tau must be"),
    ({"tau": None}, "tau must be an array of numbers"),
    ({"q": [["a"] * 3] * 400}, "q must be an array of numbers"),
    ({"dq": np.zeros((3, 400))}, "dq must be"),
    ({"joints": ("a", "b")}, "3 different names"),
    ({"joints": ("a", "b", "a")}, "3 different names"),
    ({"torque_unit": "Nm"}, "torque_unit"),
]


@pytest.mark.parametrize(("change", "text"), SHAPES, ids=[text for _, text in SHAPES])
def test_wrong_shapes(change, text):
    with pytest.raises(ValueError, match=text):
        Recording(**arrays(**change))


CONTENT = [
    (nan_at("q", 17, 1), "not_finite", 17, "q_1", "row 18, column q_1: nan"),
    (nan_at("tau", 0, 2, np.inf), "not_finite", 0, "tau_2", "row 1, column tau_2: inf"),
    (nan_at("q_motor", 399, 0, -np.inf), "not_finite", 399, "q_motor_0", "row 400"),
    (nan_at("ddq", 5, 0), "not_finite", 5, "ddq_0", "row 6"),
    (time(a=(3, np.nan)), "not_finite", 3, "t", "row 4, column t"),
    (time(a=(10, 0.05)), "time_backwards", 10, "t", "row 11.*backwards.*split"),
    (time(a=(10, 0.09)), "time_stands_still", 10, "t", "row 11.*stands still.*repeated"),
    (
        {"t": motion()[0][::-1].copy()},
        "time_backwards",
        1,
        "t",
        "row 2.*reverse order, sort them by time",
    ),
    ({"t": 0.0 * motion()[0]}, "time_stands_still", 1, "t", "row 2.*no clock counts in this column, name another one"),
    (gap_after(200, 10.5), "long_gap", 200, "t", "row 201.*gap of 0.105 s.*split the run there"),
    (time(a=(399, 1e308)), "long_gap", 399, "t", "split"),
    ({"t": motion()[0] * 1e-9}, "time_step", None, "t", "unit of time"),
]


@pytest.mark.parametrize(("change", "code", "row", "column", "text"), CONTENT, ids=[c[1] + c[3] for c in CONTENT])
def test_unusable_content(change, code, row, column, text):
    with pytest.raises(DataError, match=text) as caught:
        Recording(**arrays(**change, name="run 7"))
    assert (caught.value.code, caught.value.row, caught.value.column) == (code, row, column)
    assert str(caught.value).startswith("run 7")


def test_gap_that_can_be_bridged_is_accepted():
    assert Recording(**arrays(**gap_after(200, 9.5))).n_samples == 400


def test_too_few_samples():
    short = {name: values[:19] for name, values in arrays().items()}
    with pytest.raises(DataError, match="19 samples are too few; at least 20"):
        Recording(**short)
    assert Recording(**{name: values[:20] for name, values in arrays().items()}).n_samples == 20


def test_finding_to_json_keeps_what_is_known():
    finding = Finding("gap", "warning", "A gap.", "a.csv", "t", (3, 5), 4.0, "steps")
    assert json.loads(json.dumps(finding.to_json()))["rows"] == [3, 5]
    assert Finding("x", "info", "X.").to_json() == {"code": "x", "severity": "info", "message": "X."}


def test_atomic_path_replaces_or_leaves(tmp_path):
    target = tmp_path / "out.json"
    target.write_text("old")

    def fail_half_way():
        with atomic_path(target) as temporary:
            temporary.write_text("half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail_half_way()
    assert target.read_text() == "old"
    with atomic_path(target) as temporary:
        assert temporary.suffix == ".json"
        temporary.write_text("new")
    assert target.read_text() == "new"
    assert os.listdir(tmp_path) == ["out.json"]


def test_unwritable_places_are_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"nowhere/out.json: the folder .*nowhere does not exist"):
        write_json(tmp_path / "nowhere" / "out.json", {})
    with pytest.raises(IsADirectoryError, match="this is a folder"):
        write_json(tmp_path, {})
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError, match="cannot write this file"):
        write_table(tmp_path / "file" / "out.parquet", {"t": np.zeros(3)})


def test_folder_without_rights():
    with folder_of_another_user(0o555) as folder:
        with pytest.raises(PermissionError, match="cannot write this file: permission is denied"):
            write_json(folder / "out.json", {})
        assert os.listdir(folder) == ["run.csv"]


def test_json_has_no_nan_and_knows_numpy(tmp_path):
    path = tmp_path / "out.json"
    write_json(path, {"a": np.float64(1.5), "b": np.arange(3), "c": np.int64(2)})
    assert json.loads(path.read_text()) == {"a": 1.5, "b": [0, 1, 2], "c": 2}
    with pytest.raises(ValueError, match=r"[Oo]ut of range"):
        write_json(path, {"a": float("nan")})
    with pytest.raises(TypeError, match="set cannot be written"):
        write_json(path, {"a": {1}})
    assert json.loads(path.read_text())["a"] == 1.5


def test_table_round_trip(tmp_path):
    import pyarrow.parquet as pq

    write_table(tmp_path / "a.parquet", {"t": np.arange(4.0), "set": np.array(["train"] * 4)})
    table = pq.read_table(tmp_path / "a.parquet")
    assert table.column("t").to_pylist() == [0.0, 1.0, 2.0, 3.0]
    assert table.column("set").to_pylist() == ["train"] * 4
    with pytest.raises(ValueError, match="one length"):
        write_table(tmp_path / "a.parquet", {"t": np.zeros(3), "q": np.zeros(4)})
