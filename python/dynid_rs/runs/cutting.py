"""Parts of a run by time or by row: what stands between the brackets of a recording."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from dynid_rs.base.errors import DataError
from dynid_rs.runs.cells import MIN_SAMPLES

if TYPE_CHECKING:
    from dynid_rs.runs.recording import Recording


def rows_of(recording: Recording, key: Any) -> tuple[int, int]:
    """Half-open rows of a slice: floats are seconds on the clock of `t`, whole numbers rows.

    Raises
    ------
    TypeError
        Not a slice, one with a step, or one whose ends are of two kinds.
    DataError
        Fewer samples lie there than a recording needs.
    """
    if not isinstance(key, slice):
        raise TypeError(
            f"a recording is cut by a slice, of seconds (recording[2.0:5.0]) or of rows (recording[200:500]), "
            f"not by {type(key).__name__}; its signals are recording.q, recording.tau, ..."
        )
    if key.step is not None:
        raise TypeError("a recording cannot be cut with a step: filters need every sample")
    ends = [end for end in (key.start, key.stop) if end is not None]
    if all(_is_row(end) for end in ends):
        start, stop, _ = key.indices(recording.n_samples)
        return _enough(recording, start, stop, by_row=bool(ends))
    if not all(isinstance(end, float | np.floating) for end in ends):
        kinds = " and ".join(type(end).__name__ for end in ends)
        raise TypeError(f"both ends of a slice are seconds (floats) or rows (whole numbers), got {kinds}")
    start = 0 if key.start is None else int(np.searchsorted(recording.t, key.start))
    stop = recording.n_samples if key.stop is None else int(np.searchsorted(recording.t, key.stop))
    return _enough(recording, start, stop, by_row=False)


def _is_row(end: object) -> bool:
    return isinstance(end, int | np.integer) and not isinstance(end, bool)


def _enough(recording: Recording, start: int, stop: int, *, by_row: bool) -> tuple[int, int]:
    n = max(0, stop - start)
    if n < MIN_SAMPLES:
        mend = (
            "whole numbers count rows; for seconds write floats, recording[2.0:5.0]"
            if by_row
            else f"its time goes from {recording.t[0]:.6g} s to {recording.t[-1]:.6g} s"
        )
        raise DataError(
            f"{recording.name}: {n} samples lie there, and at least {MIN_SAMPLES} are needed; {mend}",
            code="too_few_samples",
            file=recording.name,
        )
    return start, stop
