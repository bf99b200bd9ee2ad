"""Arrow's columns by their memory are those that pyarrow makes itself, and pandas stays out."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pyarrow as pa
import pytest

from dynid_rs.base.arrow_arrays import to_array, to_numpy

VALUES = {
    "float64": np.array([1.5, np.nan, -np.inf]),
    "float32": np.arange(3, dtype=np.float32),
    "int16": np.arange(3, dtype=np.int16),
    "reversed": np.arange(6.0)[::-2],
    "bool": np.array([True, False, True, True, False, False, True, False, True]),
    "text": np.array(["ä", "", "three"]),
    "objects": np.array(["a", "a", "b"], dtype=object),
    "empty": np.empty(0),
    "no text": np.array([], dtype=str),
    "with nothing": np.array(["a", None], dtype=object),
    "swapped": np.arange(3.0).astype(">f8").astype("=f8"),
}


@pytest.mark.parametrize("name", VALUES)
def test_arrays_are_those_of_pyarrow(name):
    ours, theirs = to_array(VALUES[name]), pa.array(VALUES[name])
    ours.validate(full=True)
    assert ours.type == theirs.type
    assert str(ours) == str(theirs)  # no number is its own not-a-number


COLUMNS = {
    "chunks": pa.chunked_array([[1.0, 2.0], [], [3.0]]),
    "cut": pa.chunked_array([pa.array([1, 2, 3], pa.int32())[1:]]),
    "missing": pa.chunked_array([pa.array([1.0, None, 3.0])]),
    "missing whole ones": pa.chunked_array([pa.array([1, None], pa.int64())]),
    "missing short ones": pa.chunked_array([pa.array([1.0, None], pa.float32())]),
    "empty": pa.chunked_array([], pa.float64()),
    "text": pa.chunked_array([["a", "b"]]),
    "bool": pa.chunked_array([[True, False]]),
}


@pytest.mark.parametrize("name", COLUMNS)
def test_columns_are_those_of_pyarrow(name):
    ours, theirs = to_numpy(COLUMNS[name]), COLUMNS[name].to_numpy()
    assert ours.dtype == theirs.dtype
    np.testing.assert_array_equal(ours, theirs)


def test_a_run_and_a_table_need_no_pandas(tmp_path):
    code = (
        "import sys, numpy as np\n"
        "from dynid_rs.base.files import write_table\n"
        "from dynid_rs import read_recording\n"
        f"path = {str(tmp_path / 'run.parquet')!r}\n"
        "t = np.arange(100) / 100\n"
        "write_table(path, {'t': t, 'q_0': np.sin(t), 'tau_0': np.cos(t)})\n"
        "assert read_recording(path).n_samples == 100\n"
        "assert 'pandas' not in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
