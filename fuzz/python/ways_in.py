"""Bytes of strangers into the readers in Python, one function per way in: a recording, rules, or a sentence.

`readers.py` has them tried by a fuzzer; `tests/runs/readers/test_kept_inputs.py` tries what is kept in `fuzz/corpus`.
"""

from __future__ import annotations

import tempfile
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np

from dynid_rs.base.errors import DataError
from dynid_rs.runs.readers import Config, PartsWarning, read_config, read_recordings

JOINTS = ("a", "b")
LONGEST = 1.0
"""Longest that an input may take, in time of the processor [s]."""
MOST_LETTERS = 1000
"""A refusal is one line of no more."""
BETWEEN = b"\0\0"
"""Ends the rules before a table: neither has it, in UTF-16 neither."""
_FOLDER = tempfile.TemporaryDirectory(prefix="fuzz-")


def table(contents: bytes) -> None:
    """Comma-separated values, with a `dynid.toml` before them or without."""
    _read(contents, "run.csv")


def json_lines(contents: bytes) -> None:
    """A JSON object per line, with a `dynid.toml` before them or without."""
    _read(contents, "run.jsonl")


def config(contents: bytes) -> None:
    """A `dynid.toml`."""
    _within_limits(lambda: _rules(contents))


WAYS_IN: dict[str, Callable[[bytes], None]] = {"table": table, "json_lines": json_lines, "config": config}


def _read(contents: bytes, name: str) -> None:
    rules, between, rows = contents.partition(BETWEEN)
    joints = JOINTS if len(contents) % 2 else None
    path = _written(name, rows if between else contents)
    warnings.simplefilter("ignore", PartsWarning)

    def read() -> None:
        for recording in read_recordings(path, joints, _rules(rules) if between else None):
            n = recording.n_samples
            assert n > 0
            for signal in (recording.t, recording.q, recording.tau):
                assert len(signal) == n
                assert np.isfinite(signal).all()

    _within_limits(read)


def _rules(contents: bytes) -> Config:
    return read_config(_written("dynid.toml", contents))


def _written(name: str, contents: bytes) -> Path:
    path = Path(_FOLDER.name) / name
    path.write_bytes(contents)
    return path


def _within_limits(work: Callable[[], object]) -> None:
    """Run `work` on one input; no error but a refusal, which is one line that a terminal shows whole."""
    start = time.thread_time()
    try:
        work()
    except DataError as error:
        sentence = str(error)
        assert 0 < len(sentence) <= MOST_LETTERS, sentence
        assert sentence.isprintable(), repr(sentence)
    taken = time.thread_time() - start
    assert taken < LONGEST, f"{taken:.1f} s of the processor for one input"
