"""Sampling: rate, jitter, short gaps. Long gaps and backward time never become a recording."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dynid_rs.base.findings import Finding
from dynid_rs.runs.checks.clocks import MAX_RATE, MIN_RATE, Clock, clock_findings
from dynid_rs.runs.recording import GAP_STEPS, Recording, gaps

SLOW_RATE = 40.0
JITTER = 0.05
STRONG_JITTER = 0.5


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
    if jitter > JITTER:
        median = float(np.median(np.diff(rec.t)))
        bursts = median != rec.median_step
        yield Finding(
            "jitter",
            "warning" if jitter > STRONG_JITTER else "info",
            f"the steps of t vary by {100 * jitter:.0f} % of the usual step (95th percentile)"
            + (
                f", and come in bursts (a median step of {1e3 * median:.3g} ms, a mean of {1e3 * rec.median_step:.3g} "
                "ms): these are times of arrival; stamp samples where they are taken, or number them evenly"
                if bursts
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
