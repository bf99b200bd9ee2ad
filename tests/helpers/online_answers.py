"""States into the online binary, and what it answers, as arrays."""

import json
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from dynid_rs import TorqueModel
from helpers.binaries import find_estimator

States = dict[str, np.ndarray]


@pytest.fixture(scope="session")
def estimator() -> Path:
    return find_estimator()


@dataclass(frozen=True)
class Answers:
    """What came out: t (n,) or None, total, std (n, n_joints), terms (n, n_terms, n_joints), status (n,)."""

    t: np.ndarray | None
    total: np.ndarray
    terms: np.ndarray
    std: np.ndarray
    status: np.ndarray


def run(estimator: Path, model: Path, text: str, *options: str) -> str:
    done = subprocess.run(
        [estimator, model, *options], input=text, capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def csv_text(states: States, joints: list[str] | None = None) -> str:
    """Columns by index, or by name where `joints` are given."""
    columns = {}
    for signal, values in states.items():
        if signal == "t":
            columns[signal] = values
            continue
        for j in range(values.shape[1]):
            columns[f"{signal}_{joints[j] if joints else j}"] = values[:, j]
    rows = zip(*(values.tolist() for values in columns.values()), strict=True)
    return "\n".join([",".join(columns), *(",".join(map(repr, row)) for row in rows)]) + "\n"


def json_text(states: States) -> str:
    lists = {signal: values.tolist() for signal, values in states.items()}
    n = len(lists["q"])
    return "".join(json.dumps({signal: lists[signal][k] for signal in lists}) + "\n" for k in range(n))


def from_csv(text: str, names: list[str], n: int) -> Answers:
    header, *lines = text.splitlines()
    columns = header.split(",")
    timed = columns[0] == "t"
    expected = [f"{name}_{j}" for name in ["tau", *names, "std"] for j in range(n)]
    assert columns == ["t"] * timed + expected + ["status"]
    rows = [line.split(",") for line in lines]
    numbers = np.array([[float(cell) for cell in row[timed:-1]] for row in rows]).reshape(len(rows), -1, n)
    t = np.array([float(row[0]) for row in rows]) if timed else None
    return Answers(t, numbers[:, 0], numbers[:, 1:-1], numbers[:, -1], np.array([int(row[-1]) for row in rows]))


def from_json(text: str, names: list[str], n: int) -> Answers:
    objects = [json.loads(line) for line in text.splitlines()]
    assert all(list(o["terms"]) == names for o in objects)
    timed = "t" in objects[0]
    return Answers(
        np.array([o["t"] for o in objects], dtype=float) if timed else None,
        np.array([o["tau"] for o in objects], dtype=float),
        np.array([list(o["terms"].values()) for o in objects], dtype=float),
        np.array([o["std"] for o in objects], dtype=float),
        np.array([o["status"] for o in objects]),
    )


def assert_same_bits(actual: np.ndarray, expected: np.ndarray) -> None:
    np.testing.assert_array_equal(actual.view(np.uint64), expected.view(np.uint64))


def table_of(path: Path) -> dict[str, np.ndarray]:
    table = pq.read_table(path)
    return {name: column.to_numpy() for name, column in zip(table.column_names, table.columns, strict=True)}


def assert_same_answers(binary: Path, model: Path, states: str, output: Path) -> None:
    """Everything the binary says about `states` stands bit for bit in `output`."""
    loaded = TorqueModel.load(model)
    names, n = loaded.term_names, loaded.robot.n_joints
    answers, table = from_csv(run(binary, model, states), names, n), table_of(output)
    assert answers.t is not None
    assert_same_bits(answers.t, table["t"])
    for j in range(n):
        assert_same_bits(answers.total[:, j].copy(), table[f"tau_{j}"])
        for k, name in enumerate(names):
            assert_same_bits(answers.terms[:, k, j].copy(), table[f"{name}_{j}"])
    np.testing.assert_array_equal(answers.status, table["status"])
