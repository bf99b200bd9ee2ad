"""Hostile files of every kind: each is judged right, with its place, on one line, in no time."""

from __future__ import annotations

import functools
import re
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.hostile_files import CONFIGS, ROBOTS, RUNS, Hostile, models
from helpers.small_arm import JOINTS, study

from dynid_rs import RobotModel, TorqueModel
from dynid_rs.runs.readers import read_config, read_recording

MOST_SECONDS = 0.05
"""Of the processor, per file; the best of a few tries, because a first one loads code."""
TRIES = 4


@functools.cache
def valid_model() -> str:
    return (study().output / "model.json").read_text()


def judged(read: Callable[[Path], Any], path: Path) -> tuple[str | None, float]:
    """What is said of a file, and the processor's time that it took."""
    start = time.process_time()
    try:
        read(path)
        said = None
    except (ValueError, OSError) as error:
        said = str(error)
    return said, time.process_time() - start


def check(read: Callable[[Path], Any], hostile: Hostile, folder: Path) -> None:
    path = folder / hostile.name
    path.write_bytes(hostile.content)
    tries = [judged(read, path) for _ in range(TRIES)]
    (said,) = {said for said, _ in tries}
    if hostile.sentence is None:
        assert said is None
    else:
        assert said is not None, "accepted"
        assert said.isprintable()
        assert len(said) < 600 + len(str(path)), said
        assert re.search(hostile.sentence, said), said
    assert min(seconds for _, seconds in tries) < MOST_SECONDS


def named(cases: tuple[Hostile, ...]) -> Any:
    return pytest.mark.parametrize("hostile", cases, ids=[case.name for case in cases])


@named(ROBOTS)
def test_robots(hostile: Hostile, tmp_path: Path) -> None:
    check(RobotModel.from_urdf, hostile, tmp_path)


@pytest.mark.parametrize("k", range(10))
def test_models(k: int, tmp_path: Path) -> None:
    check(TorqueModel.load, models(valid_model())[k], tmp_path)


@named(RUNS)
def test_runs(hostile: Hostile, tmp_path: Path) -> None:
    check(lambda path: read_recording(path, JOINTS), hostile, tmp_path)


@named(CONFIGS)
def test_configs(hostile: Hostile, tmp_path: Path) -> None:
    check(read_config, hostile, tmp_path)
