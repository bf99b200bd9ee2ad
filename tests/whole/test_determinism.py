"""The same question has the same answer: in another process, in any order, on another processor's kernels."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from helpers.processes import DYNID, ENVIRONMENT
from helpers.small_arm import JOINTS, dynid, study

NAMES = ("model.json", "residuals.parquet", "result.json")
TORQUES, COEFFICIENTS = 1e-12, 1e-10
"""Of the largest beside it: what sums in another order leave. Torques reach 5e-14. Coefficients of friction and offset
reach 3e-11: terms that the runs hardly tell apart share a torque, and roundings move it from one to the other."""
ORDER = 1e-12
"""Of errors, with the runs in another order, which are merged in a tree of their own; coefficients reach 8e-12."""
KERNELS = ("Prescott", "Nehalem", "Sandybridge", "Haswell")


def arguments(output: Path, order: tuple[int, ...] = (0, 1)) -> tuple[object, ...]:
    case = study()
    return ("identify", case.robot, *(case.runs[k] for k in order), "--test", case.runs[2], "-o", output)


def elsewhere(output: Path, **environment: str) -> None:
    """Identify in a process of its own."""
    command = [*DYNID, *map(str, arguments(output))]
    done = subprocess.run(command, env=ENVIRONMENT | environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def numbers(value: Any, place: str = "") -> dict[str, np.ndarray[Any, Any]]:
    """Numbers of a JSON value, lists of them together."""
    if isinstance(value, dict):
        return {k: v for name, part in value.items() for k, v in numbers(part, f"{place}.{name}").items()}
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        parts = value if isinstance(value, list) else []
        return {k: v for n, part in enumerate(parts) for k, v in numbers(part, f"{place}[{n}]").items()}
    return {place: array}


def furthest(one: Path, other: Path) -> float:
    """Largest difference of two models' numbers, relative to the largest one beside it."""
    a, b = (numbers(json.loads((folder / "model.json").read_text())) for folder in (one, other))
    assert a.keys() == b.keys()
    sizes = {place: max(float(np.abs(a[place]).max(initial=0)), 1e-300) for place in a}
    return max(float(np.abs(a[place] - b[place]).max(initial=0)) / sizes[place] for place in a)


def test_two_calls_in_one_process_give_the_same_bytes(tmp_path):
    """The first one was `study`'s: nothing of it is left that would change a second."""
    assert dynid(*arguments(tmp_path / "out")).exit_code == 0
    for name in NAMES:
        assert (tmp_path / "out" / name).read_bytes() == (study().output / name).read_bytes()


def test_another_process_with_another_hash_seed_and_more_threads_gives_the_same_bytes(tmp_path):
    elsewhere(tmp_path / "out", PYTHONHASHSEED="77", RAYON_NUM_THREADS="3", OPENBLAS_NUM_THREADS="3")
    for name in NAMES:
        assert (tmp_path / "out" / name).read_bytes() == (study().output / name).read_bytes()


def test_the_order_of_the_runs_changes_roundings_only(tmp_path):
    assert dynid(*arguments(tmp_path / "out", (1, 0))).exit_code == 0
    assert furthest(study().output, tmp_path / "out") < COEFFICIENTS
    one, other = (json.loads((path / "result.json").read_text()) for path in (study().output, tmp_path / "out"))
    np.testing.assert_allclose(one["rmse"]["test"]["after"], other["rmse"]["test"]["after"], rtol=ORDER)


@pytest.mark.parametrize("kernel", KERNELS)
def test_kernels_of_an_older_processor_change_roundings_only(kernel, tmp_path):
    elsewhere(tmp_path / "out", OPENBLAS_CORETYPE=kernel)
    assert furthest(study().output, tmp_path / "out") < COEFFICIENTS
    one, other = (pq.read_table(path / "residuals.parquet") for path in (study().output, tmp_path / "out"))
    for joint in range(len(JOINTS)):
        tau, again = (np.asarray(table[f"predicted_{joint}"]) for table in (one, other))
        assert np.abs(tau - again).max() < TORQUES * np.abs(tau).max()
