"""Cells that hold lists, as pandas writes them into CSV files."""

import numpy as np
import pandas as pd
import pytest
from helpers.run_files import valid_columns
from helpers.small_arm import JOINTS, dynid, refusal, write_robot

from dynid_rs import DataError
from dynid_rs.runs.readers import read_recording
from dynid_rs.runs.readers.text_layout import _is_list

COLUMNS = valid_columns()
Q, TAU = (np.column_stack([COLUMNS[f"{signal}_{j}"] for j in range(3)]) for signal in ("q", "tau"))
KINDS = {"lists": lambda rows: rows.tolist(), "tuples": lambda rows: list(map(tuple, rows.tolist())), "arrays": list}


def frame(kind="lists", **more):
    return pd.DataFrame({"t": COLUMNS["t"], "q": KINDS[kind](Q), "tau": KINDS[kind](TAU)}).assign(**more)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("options", [{}, {"sep": ";"}, {"index": False}])
@pytest.mark.parametrize("joints", [None, JOINTS])
def test_the_mend_is_named(kind, options, joints, tmp_path):
    frame(kind).to_csv(tmp_path / "run.csv", **options)
    with pytest.raises(DataError) as caught:
        read_recording(tmp_path / "run.csv", joints)
    assert str(caught.value) == (
        "run.csv: the cells of q, tau hold lists, expected one number in each; write one column per joint "
        "(q_0, q_1, ...), or Parquet, which keeps lists (pandas: DataFrame.to_parquet)"
    )
    assert (caught.value.code, caught.value.column) == ("list_cells", "q")


def test_the_mend_mends(tmp_path):
    frame().to_parquet(tmp_path / "run.parquet")
    np.testing.assert_array_equal(read_recording(tmp_path / "run.parquet", JOINTS).q, Q)


def test_init_says_the_same(tmp_path):
    frame().rename(columns={"q": "position", "tau": "effort"}).to_csv(tmp_path / "run.csv", index=False)
    said = refusal(dynid("init", write_robot(tmp_path), tmp_path / "run.csv", "--yes"))
    assert "the cells of position, effort hold lists" in said
    assert said.endswith("DataFrame.to_parquet)")


def test_lists_beside_the_signals_are_nobodys_concern(tmp_path):
    """A pose in every row: the signals are read, and where they have other names those are what is said."""
    table = pd.DataFrame(COLUMNS).assign(pose=Q.tolist())
    table.to_csv(tmp_path / "run.csv", index=False)
    np.testing.assert_array_equal(read_recording(tmp_path / "run.csv", JOINTS).q, Q)
    named = {f"q_{j}": f"actual_position_{j}" for j in range(3)}
    table.rename(columns=named).to_csv(tmp_path / "named.csv", index=False)
    with pytest.raises(DataError, match="column q_0 or q_shoulder is missing"):
        read_recording(tmp_path / "named.csv", JOINTS)


@pytest.mark.parametrize(
    ("cell", "is_list"),
    [("[1, 2.5]", True), ("(1 2)", True), ("[-1e3]", True), ("[1, up]", False), ("[]", False), ("[1, 2)", False)],
)
def test_a_list_holds_numbers_and_nothing_else(cell, is_list):
    assert _is_list(cell) is is_list
