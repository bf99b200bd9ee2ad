"""Design of the band's low-pass, and spectra: what little a fit needs of scipy.signal.

Importing that takes a second and forty megabytes, with the statistics that it brings along. The tests hold these
against it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def butterworth(order: int, cutoff: float) -> FloatArray:
    """Second-order sections ``b0 b1 b2 1 a1 a2`` of a digital Butterworth low-pass, (order / 2, 6).

    Parameters
    ----------
    order : int
        Even.
    cutoff : float
        Over half the sampling rate, between 0 and 1; the gain there is ``1 / sqrt(2)``.
    """
    # The analogue filter's poles lie on a half circle; bilinear transform, warped so that the cutoff stays.
    angles = np.pi * (1 + (2 * np.arange(order // 2) + 1) / order) / 2
    poles = np.tan(np.pi * cutoff / 2) * np.exp(1j * angles)
    poles = (1 + poles) / (1 - poles)
    poles = poles[np.argsort(np.abs(poles))]  # what rings longest comes last
    a = np.stack([np.ones(len(poles)), -2 * poles.real, np.abs(poles) ** 2], axis=1)
    b = np.tile([1.0, 2.0, 1.0], (len(poles), 1))
    b[0] *= np.prod(a.sum(axis=1) / 4)  # a gain of one for what is steady
    return np.concatenate([b, a], axis=1)


def steady_state(sections: FloatArray) -> FloatArray:
    """What sections (n, 6) remember of an input that has been one for ever, (n, 2); direct form II transposed."""
    b, a = sections[:, :3], sections[:, 3:]
    gain = b.sum(axis=1) / a.sum(axis=1)
    last = b[:, 2] - a[:, 2] * gain
    remembered = np.stack([b[:, 1] - a[:, 1] * gain + last, last], axis=1)
    steady: FloatArray = remembered * np.concatenate([[1.0], np.cumprod(gain)[:-1]])[:, None]
    return steady


def gain_at(sections: FloatArray, frequency: FloatArray) -> FloatArray:
    """Gain (k,) of sections (n, 6) at frequencies (k,) over the sampling rate."""
    turns = np.exp(-2j * np.pi * np.outer(np.arange(3), frequency))
    gain: FloatArray = np.abs(np.prod((sections[:, :3] @ turns) / (sections[:, 3:] @ turns), axis=0))
    return gain


def power_density(x: FloatArray, rate: float, length: int) -> tuple[FloatArray, FloatArray]:
    """Frequencies (length // 2 + 1,) [Hz] and one-sided power density (the same, k) of x (n, k) sampled at `rate` [Hz].

    Mean over stretches of `length` samples that overlap by half, each less its mean, under a Hann window (Welch 1967,
    IEEE Transactions on Audio and Electroacoustics 15).
    """
    step = length - length // 2
    parts = np.stack([x[first : first + length] for first in range(0, len(x) - length + 1, step)])
    window = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(length) / length)
    spectra = np.fft.rfft((parts - parts.mean(axis=1, keepdims=True)) * window[:, None], axis=1)
    density = np.mean(np.abs(spectra) ** 2, axis=0) / (rate * np.sum(window**2))
    density[1 : -1 if length % 2 == 0 else None] *= 2
    return np.asarray(np.fft.rfftfreq(length, 1 / rate), dtype=np.float64), density
