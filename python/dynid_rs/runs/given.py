"""Runs as people give them: a recording, a data frame, or several of either."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs.runs.readers.config_file import Rules, as_config
from dynid_rs.runs.readers.frame import is_frame
from dynid_rs.runs.readers.reading import PartsWarning, Robot, read
from dynid_rs.runs.recording import Recording

FloatArray = NDArray[np.float64]
Runs = Any
"""A `Recording`, a data frame (pandas, polars, Arrow), or an iterable of them."""


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


def as_recordings(runs: Runs, robot: Robot = None, config: Rules = None) -> list[Recording]:
    """Recordings of what is given; of a data frame that gaps split, all parts.

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
    return [recording for one in as_given(runs, robot, config) for recording in one.recordings]


def as_given(runs: Runs, robot: Robot = None, config: Rules = None, *, require_torque: bool = True) -> list[Given]:
    """`as_recordings` thing by thing; torque is not looked at where it is not required, and zero in the recordings."""
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
