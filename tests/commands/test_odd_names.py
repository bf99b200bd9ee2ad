"""Names of files whose bytes are no UTF-8, as on the disk of an old machine: no work is lost for them."""

import json
import os
import sys

import numpy as np
import pyarrow.parquet as pq
import pytest
from helpers.log_files import VARIANTS
from helpers.processes import process
from helpers.run_files import write
from helpers.small_arm import run, write_robot, write_runs

from dynid_rs.base.quoting import as_json, as_text, shown
from dynid_rs.runs.readers import open_run, read_recording

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="no other system has such names")

ODD = os.fsdecode(b"l\xe4t")
QUICK = ("--friction-law", "coulomb_viscous", "--residual", "none")


def odd(path):
    return path.rename(path.with_name(ODD + path.name))


def succeeded(*arguments, **environment):
    done = process(*arguments, **environment)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize(("name", "text"), [("ü", "ü"), (ODD, "l\\xe4t"), ("\ud83d", "\\ud83d"), ("a\\xe4", "a\\xe4")])
def test_a_name_as_text(name, text):
    assert as_text(name) == text
    assert shown(ODD + "ü") == "l\\xe4tü"


def test_names_in_json_are_what_everybody_s_parser_takes():
    said = {"odd": ODD, "smile": "\U0001f600", "written": "\\udce4", "both": "\\" + ODD}
    assert json.loads(as_json(said)) == said | {"odd": "l\\xe4t", "both": "\\l\\xe4t"}
    assert "\\ud83d\\ude00" in as_json(said)


FORMATS = ("parquet, lists and timestamps", "feather", "csv.zst, ISO 8601", "hdf5, groups", "matlab 5, structure")


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_is_read_under_such_a_name(name, tmp_path):
    """A whole Parquet file was called damaged."""
    path = VARIANTS[name].write(tmp_path, 0)
    before = read_recording(path)
    after = read_recording(odd(path))
    np.testing.assert_array_equal(after.q, before.q)
    assert after.name == "l\\xe4t" + before.name


def test_a_workbook_is_opened_and_a_bag_that_cannot_be_says_why(tmp_path):
    assert open_run(odd(VARIANTS["workbook, second sheet"].write(tmp_path, 0))).names
    with pytest.raises(ValueError, match="is no UTF-8, and a library that it is for takes no other; rename it"):
        open_run(odd(VARIANTS["ros 2 bag, sqlite3, shuffled"].write(tmp_path, 0)))


def test_identify_keeps_its_work(tmp_path):
    """After the work nothing was written: surrogates not allowed."""
    robot, runs = write_robot(tmp_path), write_runs(tmp_path, n_runs=2)
    runs[1] = odd(runs[1])
    output = tmp_path / ODD
    assert "l\\xe4t/report.html" in succeeded("identify", robot, *runs, *QUICK, "-o", output)
    result = (output / "result.json").read_text(encoding="utf-8")
    assert "\\ud" not in result
    assert json.loads(result)["data"]["test"] == ["l\\xe4trun_1.parquet"]
    with (output / "residuals.parquet").open("rb") as file:
        assert "l\\xe4trun_1.parquet" in pq.read_table(file).column("run").to_pylist()
    succeeded("report", output)
    succeeded("estimate", output, runs[1], "-o", output / "torques.parquet")


def test_the_c_locale_reads_names_of_others(tmp_path):
    path = write(tmp_path / "Läufe.parquet", run(0))
    said = succeeded("inspect", path, LC_ALL="C", PYTHONUTF8="0")
    assert said.startswith("L\\xe4ufe.parquet")
