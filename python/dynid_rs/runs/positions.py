"""Positions of links and motors without what is only the noise of their encoders."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dynid_rs.runs.motion_band import motion_band

if TYPE_CHECKING:
    from dynid_rs.runs.preprocessing import Band

FloatArray = NDArray[np.float64]

STATE_BAND = 2.0
"""Positions are kept up to this multiple of the band's cutoff at most, and one over it at least."""


@dataclass(frozen=True, eq=False)
class Shown:
    """Positions (n, n_joints) of links and motors less what is noise.

    `cutoff` (n_joints,) is the frequency [Hz] below which the motion of a joint was kept.
    """

    q: FloatArray
    q_motor: FloatArray
    cutoff: FloatArray


def shown_positions(q: FloatArray, q_motor: FloatArray | None, band: Band, rate: float) -> Shown:
    """Positions, low-passed where their motion ends (`motion_band.py`).

    Of two encoders on a joint the finer one shows the motion, and the other one what lies between them: gears yield
    slowly, and a coarse encoder needs no other band for the motion that the fine one shows. A joint at rest keeps its
    noise: what is slow of it is no motion either, but would have the sign of friction.

    Parameters
    ----------
    q, q_motor : ndarray (n, n_joints)
        Positions [rad, m], evenly sampled at `rate` [Hz]; the second is None with one encoder.
    band : Band
        Where torques are compared.
    """
    least, most = band.cutoff / STATE_BAND, STATE_BAND * band.cutoff
    link = motion_band(q, rate, least, most)
    of_link = np.where(link.rests, most, link.cutoff)
    if q_motor is None:
        shown = passed_on(q, of_link, band, rate)
        return Shown(shown, shown, of_link)
    motor, between = motion_band(q_motor, rate, least, most), motion_band(q_motor - q, rate, least, most)
    of_motor = np.where(motor.rests, most, motor.cutoff)
    finer = motor.noise < link.noise
    of_fine = np.where(finer, of_motor, of_link)
    fine = passed_on(np.where(finer, q_motor, q), of_fine, band, rate)
    yields = passed_on(q_motor - q, between.cutoff, band, rate)
    return Shown(np.where(finer, fine - yields, fine), np.where(finer, fine, fine + yields), of_fine)


def passed_on(x: FloatArray, cutoff: float | FloatArray, band: Band, rate: float) -> FloatArray:
    """Every column of x (n, k) below its own frequency [Hz], with ends that go on as x does."""
    passed, cutoff = np.empty_like(x), np.broadcast_to(cutoff, x.shape[1])
    for own in np.unique(cutoff):
        alike = cutoff == own
        ends = through_ends(x[:, alike], rate, 1 / own)
        passed[:, alike] = ends + band.apply(x[:, alike] - ends, rate, float(own))
    return passed


def through_ends(x: FloatArray, rate: float, window: float) -> FloatArray:
    """Polynomials of order five with the positions, speeds and accelerations that x (n, ...) has at its ends.

    What remains of x begins and ends at rest: a filter, which goes on beyond the ends, knows what is there.
    Those of x are a cubic's through its first and last `window` seconds, `rate` [Hz].
    """
    n = min(max(int(window * rate), 8), len(x))
    inward = np.arange(n) / (len(x) - 1)  # of the whole length
    cubic = np.linalg.pinv(np.vander(inward, 4, increasing=True))[:3]
    first, x = x[0], x - x[0]  # what stands still stays where it is, to the last digit
    (a, b, c), (a1, b1, c1) = cubic @ x[:n], cubic @ x[::-1][:n]
    b1 = -b1  # time runs outward there
    # The remaining three coefficients from value, slope and curvature at 1.
    wanted = np.array([a1 - (a + b + c), b1 - (b + 2 * c), 2 * c1 - 2 * c])
    last = np.linalg.solve(np.array([[1.0, 1.0, 1.0], [3.0, 4.0, 5.0], [6.0, 12.0, 20.0]]), wanted)
    time = np.linspace(0, 1, len(x)).reshape(-1, *(1,) * (x.ndim - 1))
    polynomial: FloatArray = np.broadcast_to(last[2], x.shape).copy()
    for coefficient in (last[1], last[0], c, b, a + first):  # no product of matrices, whose roundings differ by machine
        polynomial *= time
        polynomial += coefficient
    return polynomial
