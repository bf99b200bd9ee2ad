"""Runs as people give them: a recording, a data frame, or several of either."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.errors import DamageWarning
from dynid_rs.runs.checks import contradictions, refused_sources
from dynid_rs.runs.readers.config_file import Rules, as_config
from dynid_rs.runs.readers.frame import is_frame
from dynid_rs.runs.readers.reading import PartsWarning, Robot, read
from dynid_rs.runs.recording import Recording

FloatArray = NDArray[np.float64]
Runs = Any
"""A `Recording`, a data frame (pandas, polars, Arrow), or an iterable of them."""


_WITHOUT: WeakKeyDictionary[Recording, Recording | None] = WeakKeyDictionary()
"""Runs to what is used of them, None for all: the same object each time, as whatever remembers a run knows it by that.
A run that was its own value would never be let go."""


@dataclass(frozen=True, eq=False)
class Given:
    """One thing that was given, as recordings: `rows` (half-open) of it that each of them holds, `n_rows` in all."""

    recordings: tuple[Recording, ...]
    rows: tuple[tuple[int, int], ...]
    n_rows: int

    def filled(self, parts: list[FloatArray]) -> FloatArray:
        """One array along all rows; NaN where a row is in no recording."""
        if self.rows == ((0, self.n_rows),):
            return parts[0]
        whole = np.full((self.n_rows, parts[0].shape[1]), np.nan)
        for (start, stop), part in zip(self.rows, parts, strict=True):
            whole[start:stop] = part
        return whole


def as_recordings(
    runs: Runs, robot: Robot = None, config: Rules = None, *, as_recorded: bool = False
) -> list[Recording]:
    """Recordings of what is given; of a data frame that gaps split, all parts.

    Signals that contradict their position are left out, with a `DamageWarning`, unless asked for `as_recorded`.

    Parameters
    ----------
    runs : Recording, data frame, or iterable of them
        One row per sample in a frame; `config` says what its columns are.
    robot : robot model or sequence of str, optional
        Names and kinds of the joints.
    config : Config, path or mapping, optional
        As for `read_recording`.

    Raises
    ------
    ValueError
        Something else is given.
    DataError
        Anything about a frame's content.
    """
    given = as_given(runs, robot, config, as_recorded=as_recorded)
    return [recording for one in given for recording in one.recordings]


def as_given(
    runs: Runs, robot: Robot = None, config: Rules = None, *, require_torque: bool = True, as_recorded: bool = False
) -> list[Given]:
    """`as_recordings` thing by thing, in its arguments; torque that is not required is not looked at, and is zero."""
    given = _as_given(runs, robot, config, require_torque)
    return given if as_recorded else [replace(one, recordings=tuple(map(_believed, one.recordings))) for one in given]


def _believed(recording: Recording) -> Recording:
    """The run without signals that contradict their position, each of them said as every command says it."""
    if recording not in _WITHOUT:
        found = contradictions(recording)
        for finding in found:
            warnings.warn(f"{recording.name}: {finding.message}", DamageWarning, stacklevel=5)
        _WITHOUT[recording] = recording.without(*refused_sources(found)) if found else None
    used = _WITHOUT[recording]
    return recording if used is None else used


def _as_given(runs: Runs, robot: Robot, config: Rules, require_torque: bool) -> list[Given]:
    if is_one(runs):
        return [_one(runs, robot, config, "data frame", require_torque)]
    if isinstance(runs, str | Path | dict | np.ndarray) or not isinstance(runs, Iterable):
        raise ValueError(_expected(runs))
    listed = list(runs)
    for one in listed:
        if not is_one(one):
            raise ValueError(_expected(one))
    frames = sum(not isinstance(one, Recording) for one in listed)
    names = [f"data frame {k + 1}" if frames > 1 else "data frame" for k in range(len(listed))]
    return [_one(one, robot, config, name, require_torque) for one, name in zip(listed, names, strict=True)]


def is_one(runs: Runs) -> bool:
    """Whether it is one recording or data frame, not several."""
    return isinstance(runs, Recording) or is_frame(runs)


def _one(run: Any, robot: Robot, config: Rules, name: str, require_torque: bool) -> Given:
    if isinstance(run, Recording):
        return Given((run,), ((0, run.n_samples),), run.n_samples)
    rules = as_config(config)
    if not require_torque:  # nor looked at: whoever asks for a prediction may have nothing to compare with
        rules = replace(rules, columns={**rules.columns, "tau": None, "current": None})
    found = read(run, robot, rules, name=name, require_torque=require_torque)
    if found.split is not None:
        warnings.warn(f"{name}: {found.split.text}", PartsWarning, stacklevel=4)
    return Given(tuple(Recording(**part) for part in found.parts), found.rows, found.n_rows)


def _expected(found: object) -> str:
    mend = "; read a file with read_recording first" if isinstance(found, str | Path) else ""
    return f"expected a Recording, a data frame, or a list of them, got {type(found).__name__}{mend}"
