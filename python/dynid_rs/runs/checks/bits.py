"""Bits that a channel has lost: low ones, so that it goes in steps, or one that hangs, so that it jumps to and fro."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.findings import Finding
from dynid_rs.runs.checks.motion import angle_unit, extent, label, moving_joints, torque_unit
from dynid_rs.runs.recording import FloatArray, Recording

IntArray = NDArray[np.int64]

COARSE_STEP = 1.5e-3
"""Step of a position [rad] that no encoder of a joint has: 4,200 to a turn, behind the gear."""
COARSE_FACTOR = 20.0
"""A joint's step over the median of the others': encoders of one arm differ by the ratios of their gears."""
FEW_LEVELS = 32
"""Different values over a moving joint's whole torque: five bits."""
MOST_LEVELS = 0.9
"""Different values over samples: nearly as many as there are samples repeat nothing."""
SEVERAL = 4
"""Multiples of its step that a coarse channel goes on by, none included."""
SAME = 0.1
"""Jumps of a bit that hangs are equal but for the motion in between: spread over size."""
LEAST_JUMPS = 4
JUMP = 8.0
"""Times the steps beside it, on both sides: motion does not jump there and go on as before."""
LEAST_GAPS = 8
"""Stretches of a joint's way that are never recorded, and lie a bit's size apart: few may be so by chance."""
MOST_WAY = 200.0 * np.pi
"""Of a joint [rad]: further than a hundred turns no place is passed often enough, and the bins would be without end."""
ON_ONE_HALF = 0.97
"""Least share of the places taken that lie where the bit is as it hangs: the rest is on the bins' edges."""


def check_bits(rec: Recording) -> Iterator[Finding]:
    """Positions and torques in steps that are too coarse; positions that jump to and fro by one size."""
    moves = moving_joints(rec)
    for signal in ("q", "q_motor", "tau"):
        values = getattr(rec, signal)
        if values is None:
            continue
        steps = np.array([lattice_step(values[:, j]) for j in range(rec.n_joints)])
        for j in np.flatnonzero(moves).tolist():
            found = extent(rec, signal)
            span = float(found.highest[j] - found.lowest[j])
            others = np.median(np.delete(steps, j)) if rec.n_joints > 1 else 0.0
            if signal == "tau":
                if 0 < span / max(steps[j], 1e-300) < FEW_LEVELS and steps[j] > 0:
                    yield _coarse(rec, signal, j, steps[j], torque_unit(rec, j))
            elif steps[j] > COARSE_STEP or steps[j] > COARSE_FACTOR * others > 0:
                yield _coarse(rec, signal, j, steps[j], angle_unit(rec, j))
            else:
                rows, size = _jumps(values[:, j]) or _gaps(values[:, j]) or (np.zeros(0, dtype=np.int64), 0.0)
                # Smaller ones do no more harm than a coarse encoder, and whole turns are `wrapped`.
                if COARSE_STEP < size < np.pi:
                    yield _hanging(rec, signal, j, rows, size)


def lattice_step(values: FloatArray) -> float:
    """Step of which all differences of a column (n,) are multiples; 0 where there is none to be seen.

    A step is one if the values are fewer than the samples and no difference of neighbours among them is off a whole
    number of the smallest. Where they are not far fewer, a motion at constant speed may have made them; one that goes
    in several multiples of the step is another.
    """
    levels = np.unique(values)
    if len(levels) < 2 or len(levels) > MOST_LEVELS * len(values):
        return 0.0
    gaps = np.diff(levels)
    rounding = 1e-9 * max(abs(levels[0]), abs(levels[-1]))
    gaps = gaps[gaps > rounding]
    if not len(gaps):
        return 0.0
    step = float(gaps.min())
    off = np.abs(gaps / step - np.round(gaps / step))
    if float(np.max(off)) >= 0.05:
        return 0.0
    multiples = np.unique(np.round(np.abs(np.diff(values)) / step))
    return step if 3 * len(levels) <= len(values) or len(multiples) > SEVERAL else 0.0


def _jumps(values: FloatArray) -> tuple[IntArray, float] | None:
    """Rows and size of jumps to and fro by one size: wherever a slow position passes a multiple of the bit."""
    d, jumps, padded = _beside(values)
    noise = 1.4826 * float(np.median(np.abs(jumps)))
    smallest = np.min(np.abs(d[d != 0])) if np.any(d) else 0.0
    reach = np.max(np.stack([np.abs(padded[k : k + len(d)]) for k in (0, 1, 3, 4)]), axis=0)
    rows = np.flatnonzero(np.abs(jumps) > JUMP * np.maximum(reach, max(noise, 2 * smallest)))
    rows = rows[np.abs(jumps[rows]) > 0.3 * np.max(np.abs(jumps[rows]), initial=0.0)]
    sizes = np.abs(jumps[rows])
    if len(rows) < LEAST_JUMPS or not _both_ways(jumps[rows]) or np.std(sizes) > SAME * np.median(sizes):
        return None
    return rows, float(np.median(sizes))


def _gaps(values: FloatArray) -> tuple[IntArray, float] | None:
    """Rows and size of a bit that a fast position passes within a few rows, or at each.

    No step stands out there. But every other stretch of the way, a bit long, is never recorded: the places that are
    taken have a strong wave in their spectrum, and lie on one half of its circle. A joint that passes once at constant
    speed leaves such a pattern as well; it does not jump.
    """
    width = COARSE_STEP / 2
    lowest, way = float(values.min()), float(np.ptp(values))
    if not 8 * LEAST_GAPS * width <= way <= MOST_WAY:
        return None
    bins = ((values - lowest) / width).astype(np.int64)
    span = int(bins.max()) + 1
    taken = np.zeros(span)
    taken[bins] = 1.0
    places = np.flatnonzero(taken)
    n = 1 << (4 * span - 1).bit_length()  # four points of the spectrum to a gap more or less, at least
    spectrum = np.abs(np.fft.rfft(taken, n))
    spectrum[: n // span * LEAST_GAPS] = 0.0
    spectrum[n // 4 + 1 :] = 0.0  # periods of at least four bins
    period = n / int(np.argmax(spectrum))
    phases = np.sort(places / period % 1.0)
    around = np.concatenate([phases, phases + 1.0])
    on_one_half = np.max(np.searchsorted(around, phases + 0.5 + 1.0 / period) - np.arange(len(phases)))
    if on_one_half < ON_ONE_HALF * len(places):
        return None
    size = width * period / 2
    jumps = _beside(values)[1]
    rows = np.flatnonzero(np.abs(jumps) > size / 2)
    return (rows, size) if len(rows) >= LEAST_GAPS and _both_ways(jumps[rows]) else None


def _beside(values: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Steps (n - 1,), what they have beyond the median of two on each side, and the steps with two more at each end."""
    d = np.diff(values)
    padded = np.concatenate([d[2:0:-1], d, d[-2:-4:-1]])
    return d, d - np.median(np.stack([padded[k : k + len(d)] for k in (0, 1, 3, 4)]), axis=0), padded


def _both_ways(jumps: FloatArray) -> bool:
    return bool(np.any(jumps > 0) and np.any(jumps < 0))


def _hanging(rec: Recording, signal: str, joint: int, rows: IntArray, size: float) -> Finding:
    unit = angle_unit(rec, joint)
    return Finding(
        "lost_bits",
        "error",
        f"{label(rec, signal, joint)} jumps to and fro by {size:.3g} {unit} {len(rows)} times, first at "
        f"row {rows[0] + 2}: a bit of the encoder hangs; mend the encoder or its cable and record again",
        rec.name,
        f"{signal}_{joint}",
        (int(rows[0]), int(rows[-1]) + 2),
        size,
        unit,
    )


def _coarse(rec: Recording, signal: str, joint: int, step: float, unit: str) -> Finding:
    return Finding(
        "lost_bits",
        "warning",
        f"{label(rec, signal, joint)} goes in steps of {step:.3g} {unit}, too coarse for a fit: low bits are lost on "
        "the way; record it with all its digits",
        rec.name,
        f"{signal}_{joint}",
        (0, rec.n_samples),
        float(step),
        unit,
    )
