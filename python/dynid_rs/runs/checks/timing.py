"""Sampling: rate, jitter, late stamps, short gaps. Long gaps and backward time never become a recording."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from dynid_rs.base.findings import Finding
from dynid_rs.runs.checks.clocks import MAX_RATE, MIN_RATE, Clock, clock_findings
from dynid_rs.runs.recording import Recording

SLOW_RATE = 40.0
JITTER = 0.05
STRONG_JITTER = 0.5
GAP_STEPS = 2.5
"""A step of more than this many usual steps is a gap: samples were lost, interpolation bridges it."""
MADE_UP = 0.5
"""Steps, in usual ones, below which rows make up for one that was stamped late."""
ARRIVAL = "these are times of arrival; stamp samples where they are taken, or number them evenly"


def check_timing(rec: Recording) -> Iterator[Finding]:
    """Rate that cannot be seconds, rate too slow for dynamics, jitter, gaps."""
    rate = rec.rate
    in_another_unit = clock_findings([Clock.of(rec)])
    if in_another_unit:
        yield from in_another_unit.values()
    elif not MIN_RATE <= rate <= MAX_RATE:
        yield Finding(
            "sampling_rate",
            "error",
            f"the median step of t is {rec.median_step:.4g} s ({rate:.3g} Hz), as no robot is recorded; t is "
            "not seconds then, or not the right column (dynid.toml: [units] time, [columns] t)",
            rec.name,
            "t",
            value=rate,
            unit="Hz",
        )
    elif rate < SLOW_RATE:
        yield Finding(
            "sampling_rate",
            "warning",
            f"{rate:.3g} Hz is slow for identification; 100 Hz or more separates inertia from friction better",
            rec.name,
            "t",
            value=rate,
            unit="Hz",
        )
    jitter = relative_jitter(rec)
    late = late_stamps(rec)
    if jitter > JITTER or late:
        median = float(np.median(np.diff(rec.t)))
        bursts = median != rec.median_step
        yield Finding(
            "jitter",
            "warning" if jitter > STRONG_JITTER or late else "info",
            f"the steps of t vary by {100 * jitter:.0f} % of the usual step (95th percentile)"
            + (
                f", and come in bursts (a median step of {1e3 * median:.3g} ms, a mean of {1e3 * rec.median_step:.3g} "
                f"ms): {ARRIVAL}"
                if bursts
                else f", and {_said(late)}: {ARRIVAL}"
                if late
                else "; the run is resampled on the stamps given"
            ),
            rec.name,
            "t",
            (0, rec.n_samples),
            jitter,
            "1",
        )
    found = gaps(rec)
    if found:
        row, steps = max(found, key=lambda gap: gap[1])
        yield Finding(
            "gap",
            "warning",
            f"{len(found)} gap{'s' if len(found) > 1 else ''} of more than "
            f"{GAP_STEPS:g} median steps, the longest "
            f"{(rec.t[row] - rec.t[row - 1]) * 1e3:.4g} ms before row {row + 1}; samples are interpolated there",
            rec.name,
            "t",
            (row - 1, row + 1),
            steps,
            "steps",
        )


def relative_jitter(rec: Recording) -> float:
    """95th percentile of the deviation from the median step, over the median step."""
    dt = np.diff(rec.t)
    return float(np.percentile(np.abs(dt - rec.median_step), 95) / rec.median_step)


def gaps(rec: Recording) -> Sequence[tuple[int, float]]:
    """Short gaps in time: (0-based row after the gap, length in usual steps) each.

    A long step that the rows behind it make up for is none: no sample is missing, one was stamped late.
    """
    steps = np.diff(rec.t) / rec.median_step
    late = {row for row, _ in late_stamps(rec)}
    return [(int(row) + 1, float(steps[row])) for row in np.flatnonzero(steps > GAP_STEPS) if row + 1 not in late]


def late_stamps(rec: Recording) -> Sequence[tuple[int, float]]:
    """Rows that were stamped when a program came to them: (0-based first row, how late it is [s]) each.

    After a long step, or at the start, rows follow each other faster than samples are taken, until they have caught up.
    """
    steps = np.diff(rec.t) / rec.median_step
    even = np.append(np.flatnonzero(steps >= MADE_UP), len(steps))
    long = np.flatnonzero(steps > GAP_STEPS)
    found = []
    for row, least in ((0, GAP_STEPS - 1.0), *((int(k) + 1, (float(steps[k]) - 1.0) / 2) for k in long)):
        made_up = float(np.sum(1.0 - steps[row : even[np.searchsorted(even, row)]]))
        if made_up > least:
            found.append((row, made_up * rec.median_step))
    return found


def _said(late: Sequence[tuple[int, float]]) -> str:
    row, most = max(late, key=lambda one: one[1])
    times = f"{len(late)} times" if len(late) > 1 else "once"
    return f"{times} a row is late and those behind it follow at once (by up to {1e3 * most:.3g} ms, at row {row + 1})"
