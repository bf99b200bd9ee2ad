"""What one encoder's side of the gears shows: position, velocity and acceleration, recorded or differentiated."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from dynid_rs.runs.on_grid import linear, splined
from dynid_rs.runs.positions import STATE_BAND, passed_on
from dynid_rs.runs.recording import Recording
from dynid_rs.runs.slope import slope

if TYPE_CHECKING:
    from dynid_rs.runs.preprocessing import Band

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

LATEST_VELOCITY = 0.05
"""A recorded velocity that lags its position by more than this over the cutoff is differentiated instead."""
CLEARLY = 0.5
"""A recorded velocity is another encoder's if it is so much nearer, in power."""
EXACT = 1e-2
"""A recorded acceleration counts as the derivative of the recorded velocity below this relative difference."""


@dataclass(frozen=True, eq=False)
class Side:
    """Position, velocity and acceleration (n, n_joints) on a uniform grid.

    `exact`: they are as recorded; `derived` (n_joints,): joints whose velocity is the position's derivative; `notes`
    say what was recorded and not used.
    """

    q: FloatArray
    dq: FloatArray
    ddq: FloatArray
    exact: bool
    derived: BoolArray
    notes: tuple[str, ...] = ()

    @property
    def signals(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The three of them."""
        return self.q, self.dq, self.ddq


def side_of(
    recording: Recording,
    side: Literal["q", "q_motor", "q_reference"],
    grid: FloatArray,
    band: Band,
    rate: float,
    shown: FloatArray | None = None,
) -> Side:
    """Side of a recording at the times of a grid of `rate` [Hz].

    `shown` is the position less what is noise of its encoder, where that is known. Accelerations are recorded of links.
    """
    t, q = recording.t, getattr(recording, side)
    name = f"d{side}"
    dq: FloatArray | None = getattr(recording, name, None)
    ddq = recording.ddq if side == "q" else None
    if dq is not None and ddq is not None and grid is t and _belongs(q, dq, ddq, band, rate):
        return Side(q, dq, ddq, True, np.zeros(q.shape[1], dtype=bool))
    notes: list[str] = []
    if ddq is not None:
        notes.append(f"{recording.name}: the recorded ddq is not the derivative of dq; it was not used")
    cutoff = STATE_BAND * band.cutoff
    if dq is None:
        q_grid = passed_on(splined(t, q, grid), cutoff, band, rate) if shown is None else shown
        velocity = slope(q_grid, rate)
        return Side(q_grid, velocity, slope(velocity, rate), False, np.ones(q.shape[1], dtype=bool), tuple(notes))
    passed, recorded = (passed_on(x, cutoff, band, rate) for x in (splined(t, q, grid), linear(t, dq, grid)))
    other = None
    if side == "q" and recording.q_motor is not None:
        other = slope(band.apply(linear(t, recording.q_motor, grid), rate, cutoff), rate)
    lag, agrees = _velocity_lag(slope(passed, rate), recorded, other, band, rate)
    usable = agrees & (np.abs(lag) < LATEST_VELOCITY / band.cutoff)
    for j in np.flatnonzero(~usable):
        why = f"lags by {1e3 * lag[j]:.0f} ms" if agrees[j] else "is not the derivative of the position"
        notes.append(f"{recording.name}: the recorded {name}_{j} {why}; the position was differentiated instead")
    # A velocity that was recorded shows motion that the position does not, and its noise is not the position's.
    q_grid = np.where(usable, passed, passed if shown is None else shown)
    velocity = np.where(usable, recorded, slope(q_grid, rate))
    return Side(q_grid, velocity, slope(velocity, rate), False, ~usable, tuple(notes))


def _belongs(q: FloatArray, dq: FloatArray, ddq: FloatArray, band: Band, rate: float) -> bool:
    """True if dq is q's derivative and ddq is dq's, in the band."""
    for x, dx in ((q, dq), (dq, ddq)):
        derivative = band.apply(slope(x, rate), rate)
        filtered = band.apply(dx, rate)
        scale = np.sqrt(np.mean(filtered**2, axis=0))
        difference = np.sqrt(np.mean((derivative - filtered)[2:-2] ** 2, axis=0))
        if np.any(difference > EXACT * scale + 1e-12):
            return False
    return True


def _velocity_lag(
    derivative: FloatArray, recorded: FloatArray, other: FloatArray | None, band: Band, rate: float
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Lag of the recorded velocity behind the position's derivative [s], and whether it is that.

    It is not if it is of another size, nor if it is rather that of the `other` encoder: drives give their motors'
    speed, and what a gear yields lies between.
    """
    reference, filtered = band.apply(derivative, rate), band.apply(recorded, rate)
    change = slope(reference, rate)
    beside = band.apply(other - derivative, rate) if other is not None else np.zeros_like(reference)
    lag, agrees = np.zeros(reference.shape[1]), np.ones(reference.shape[1], dtype=bool)
    for j in range(reference.shape[1]):
        columns = np.stack([reference[:, j], change[:, j]], axis=1)
        if not np.any(columns[:, 0]):
            continue
        (gain, shift), left, *_ = np.linalg.lstsq(columns, filtered[:, j], rcond=None)
        agrees[j] = abs(gain - 1) < 0.1
        lag[j] = -shift / gain if agrees[j] else 0.0
        if abs(lag[j]) < LATEST_VELOCITY / band.cutoff:
            theirs = np.linalg.lstsq(columns, filtered[:, j] - beside[:, j], rcond=None)[1]
            agrees[j] &= not np.any(theirs < CLEARLY * left)  # no residuals where columns are dependent
    return lag, agrees
