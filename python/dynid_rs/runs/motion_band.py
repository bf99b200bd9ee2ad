"""Below which frequency a position shows motion, and above it only the steps and the noise of its encoder.

A regressor of positions that are wrong is wrong by their noise: least squares takes the inertia for less than it is,
and what that leaves of a smooth motion looks like a spring or like friction. A position that is low-passed where its
motion ends is what is known of it, and a fit to that is not biased (regression calibration, Carroll et al., Measurement
Error in Nonlinear Models, chapter 4).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

LENGTH = 4.0
"""Stretches [s] whose spectra are compared: a motion that is there for a second is most of one."""
ABOVE = 20.0
"""Power over that of white noise, in one stretch, from which a frequency shows motion: of a million that are noise none
has it (e^-20)."""
RESTS = 4.0
"""Mean square of the speed over that of the noise below which a joint rests."""
MARGIN = 2.0
"""Positions are low-passed at this multiple of the last frequency that shows motion. Of that the filter (two passes of
order 4) takes .4 %, of half of it .002 %: less than the noise, whose acceleration falls by the power 5/2 of it."""
ENOUGH_RATE = 10.0
"""Means of as many samples as leave this multiple of the highest frequency: white noise stays white."""
HIGH = (1.2, 0.9)
"""Frequencies of the noise: from this multiple of what the filter passes anyway to this part of half the rate."""
FEWEST = 4
"""Frequencies of the noise below which nothing is known of it."""


@dataclass(frozen=True)
class MotionBand:
    """What positions show, (n_joints,) each.

    `noise` power density [rad^2/Hz]; `cutoff` the frequency [Hz] below which positions are kept; `rests` where there is
    none that noise does not hide.
    """

    noise: FloatArray
    cutoff: FloatArray
    rests: NDArray[np.bool_]


def motion_band(q: FloatArray, rate: float, least: float, most: float) -> MotionBand:
    """Band of the motion of positions.

    Parameters
    ----------
    q : ndarray (n, n_joints)
        Positions [rad, m], evenly sampled at `rate` [Hz].
    least, most : float
        Limits of the cutoffs [Hz]. Where the rate leaves no frequency that is noise alone, all are `most`.
    """
    n, together = q.shape[1], max(1, int(rate / (ENOUGH_RATE * most)))
    if together > 1:
        q = q[: len(q) // together * together].reshape(-1, together, n).mean(axis=1)
        rate /= together
    length = int(min(LENGTH * rate, len(q) - 2))
    frequency = np.fft.rfftfreq(max(length, 1), 1 / rate)[1:]
    noise_only = (frequency > HIGH[0] * most) & (frequency < HIGH[1] * rate / 2)
    if noise_only.sum() < FEWEST:
        return MotionBand(np.zeros(n), np.full(n, most), np.zeros(n, dtype=bool))
    # Of the second difference, under a window that falls with the fifth power: what is slow and large would leak into
    # all of the spectrum of the position itself.
    window = np.sin(np.pi * (np.arange(length) + 0.5) / length)[:, None] ** 4
    starts = range(0, len(q) - length - 1, length - length // 2)
    stretches = np.stack([np.diff(q[first : first + length + 2], 2, axis=0) for first in starts])
    scale = 2 / (rate * np.sum(window**2))
    gain = 4 * (1 - np.cos(2 * np.pi * frequency / rate)) ** 2
    power = scale * np.abs(np.fft.rfft(stretches * window, axis=1)[:, 1:]) ** 2 / gain[:, None]
    noise = np.median(power[:, noise_only], axis=(0, 1)) / np.log(2)  # the mean of what is exponential
    shown = power.max(axis=0) > ABOVE * noise
    passed = frequency < most
    last = np.array([frequency[passed & column].max(initial=0.0) for column in shown.T])
    speed, wrong = ((2 * np.pi * frequency[passed, None]) ** 2 * x for x in (power.mean(axis=0)[passed], noise))
    rests = speed.sum(axis=0) <= RESTS * wrong.sum(axis=0)
    return MotionBand(noise, np.clip(MARGIN * last, least, most), rests)
