"""Torque ripple: sharp lines in the angle domain, sought at full rate, told as families of one gear or motor.

The residual's spectrum over angle, ``P(N) = |sum e exp(i N q)|^2``, is measured against its own background: the
median over neighbouring orders of what the line leaves, so that the residual's colour does not matter. (With the line
in it the background would be the line's own: over a part of a turn it spreads over its neighbours.) Noise gives
``z = P / background`` an exponential law; a line whose power beforehand is s times the background has
``ln BF = z s / (1 + s) - ln (1 + s)``, at its likeliest ``z - 1 - ln z``. Bursts are no noise of one strength: the same
is asked of the line's amplitudes in 16 parts of the data, whose own scatter is the noise,
``ln BF = 15 ln(1 + T / 15) - 1 - ln T``. The lesser counts, by the rule of the search: posterior odds of 19 to 1 over
all orders of all joints.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.odds import SURE, p_value
from dynid_rs.diagnosis.entries import unscored
from dynid_rs.diagnosis.hypotheses import CYCLES_SHOWN
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.identification.three_loops import ThreeLoopIdentifier
from dynid_rs.model.curves import binned
from dynid_rs.model.placed import HeldEffect, PlacedEffect
from dynid_rs.regression.uncertainty import NORMAL_95
from dynid_rs.runs.recording import Recording

FloatArray = NDArray[np.float64]

ORDERS = (3.5, 1000.0)
"""Cycles per turn that are sought: slower ones look like gravity, faster ones no encoder shows."""
LEAST_CYCLES = CYCLES_SHOWN["torque_ripple"][1]
"""Cycles that the joint has to go through: with fewer a line is a curve, which the band shows."""
BINS = 8
"""Bins of the angle per cycle of the greatest order."""
OVERSAMPLED = 4
"""Orders per resolution cell, one over the range of the angle."""
BACKGROUND = 25
"""Resolution cells on either side over which the background is measured."""
PARTS = 16
"""Parts of the data, in order of time, in which a line has one amplitude and phase."""
MOST_LINES = 12
"""Most lines of one joint."""
HARMONICS = 6
"""Harmonics of a line that belong to its family."""


@dataclass(frozen=True, eq=False)
class Family:
    """Lines of one gear or motor on joint `joint`: `orders` (n,) [1/turn], the lowest first, and their sizes.

    `coefficients` (n, 2) cosine and sine [torque unit] with standard errors `std` (n,) and those of the orders;
    `log_odds` of the strongest. `drawn`: what is left and the family itself over one cycle of the lowest order.
    """

    joint: int
    orders: FloatArray
    coefficients: FloatArray
    std: FloatArray
    order_std: FloatArray
    log_odds: float
    drawn: dict[str, list[float]]

    def held(self) -> list[HeldEffect]:
        """The family as effects of a model, each of which has an order and twice it."""
        left = list(range(len(self.orders)))
        effects = []
        while left:
            k = left.pop(0)
            twice = next((m for m in left if abs(self.orders[m] / self.orders[k] - 2) < 1e-9), None)
            second = self.coefficients[twice] if twice is not None else np.zeros(2)
            if twice is not None:
                left.remove(twice)
            effect = PlacedEffect.at("torque_ripple", self.joint, cycles=float(self.orders[k]))
            effects.append(HeldEffect(effect, (*self.coefficients[k].tolist(), *second.tolist())))
        return effects


@dataclass(frozen=True, eq=False)
class Line:
    """One order [1/turn], its logarithmic odds."""

    order: float
    log_odds: float


def find_ripple(setup: Setup, fit: ThreeLoopIdentifier, train: Sequence[Recording]) -> list[Family]:
    """Lines of every turning joint in what `fit` leaves of the training runs at full rate, as families."""
    n = setup.robot.n_joints
    return [family for j, q, e in _left(setup, fit, train) for family in _families(j, q, e, n)]


def measured_beside(
    families: Sequence[Family], setup: Setup, fit: ThreeLoopIdentifier, train: Sequence[Recording]
) -> list[Family]:
    """Measure families anew in what `fit`, which holds them, leaves: what a fit without them imitated is theirs."""
    measured = []
    for j, q, e in _left(setup, fit, train):
        for family in (one for one in families if one.joint == j):
            orders = family.orders.tolist()
            its = _columns(q, orders) @ family.coefficients.ravel()
            measured.append(_family(j, q, e + its, [Line(order, family.log_odds) for order in orders]))
    return measured


def _left(
    setup: Setup, fit: ThreeLoopIdentifier, train: Sequence[Recording]
) -> Iterator[tuple[int, FloatArray, FloatArray]]:
    """Every turning joint, its angle and what `fit` leaves of its torque while it moves, all runs after each other.

    Ripple that is held is taken off at the stamps: on the grid of a prediction its fast cycles are not what they are.
    """
    delay, bare = setup.delays, fit.without_held()
    residuals = [run.less_torque_delay(delay).tau - bare.predict(run, torque_delay=delay) for run in train]
    moving = [np.abs(np.gradient(_angle(run), run.t, axis=0)) for run in train]
    for j, kind in enumerate(setup.robot.joint_kinds):
        if kind != "revolute":
            continue
        parts = []
        for run, residual, speed in zip(train, residuals, moving, strict=True):
            used = speed[:, j] > 0.02 * speed[:, j].max()
            for start, end in setup.excluded.get(run.name, ()):
                used &= (run.t < start) | (run.t > end)
            parts.append((_angle(run)[used, j], residual[used, j]))
        parts = [part for part in parts if len(part[0])]
        if not parts:
            continue
        q = np.concatenate([part[0] for part in parts])
        e = np.concatenate([part[1] - part[1].mean() for part in parts]) - _held(setup, j, q)
        if len(q) and np.ptp(q) > 0:
            yield j, q, e


def _held(setup: Setup, joint: int, q: FloatArray) -> FloatArray:
    """Torque of the held ripple of a joint at its angles, (n,)."""
    torque = np.zeros(len(q))
    for one in setup.held:
        if one.effect.kind == "torque_ripple" and one.effect.joints == (joint,):
            cycles = one.effect.shape_at(joint)["cycles"]
            torque += _columns(q, [cycles, 2 * cycles]) @ np.array(one.coefficients)
    return torque


def _angle(run: Recording) -> FloatArray:
    return run.q if run.q_motor is None else run.q_motor


def _families(joint: int, q: FloatArray, e: FloatArray, n_joints: int) -> list[Family]:
    """Lines one after the other, each taken off before the next, then put together by their orders."""
    turns = np.ptp(q) / (2 * np.pi)
    lines: list[Line] = []
    left = e
    for _ in range(MOST_LINES):
        line = _strongest(q, left, turns, n_joints)
        if line is None or any(abs(line.order - other.order) * turns < 1.0 for other in lines):
            break
        lines.append(line)
        left = e - _columns(q, [each.order for each in lines]) @ _sizes(q, e, lines)[0]
    families: list[list[Line]] = []
    for line in sorted(lines, key=lambda each: each.order):
        home = next((f for f in families if _is_harmonic(line.order, f[0].order, turns)), None)
        if home is None:
            families.append([line])
        else:
            home.append(Line(round(line.order / home[0].order) * home[0].order, line.log_odds))
    return [_family(joint, q, e, members) for members in families]


def _is_harmonic(order: float, first: float, turns: float) -> bool:
    times = round(order / first)
    return 2 <= times <= HARMONICS and abs(order - times * first) * turns < 0.5 * times


def _strongest(q: FloatArray, e: FloatArray, turns: float, n_joints: int) -> Line | None:
    """The line that stands out most of its neighbourhood, if by the rule it stands out of what it leaves there."""
    from scipy.ndimage import median_filter

    lowest = max(ORDERS[0], LEAST_CYCLES / turns)
    power, orders, cell = _spectrum(q, e, turns)
    sought = (orders >= lowest) & (orders <= ORDERS[1])
    reach = BACKGROUND * cell
    if sought.sum() < 2 * (2 * reach + 1):
        return None
    background = median_filter(power, 2 * reach + 1, mode="nearest")
    best = int(np.argmax(np.where(sought, power / np.maximum(background, 1e-300), 0.0)))
    line = Line(_refined(q, e, float(orders[best]), 0.5 / turns), 0.0)
    if line.order < lowest:
        return None  # a slow curve, which leaks into the first orders that are sought
    left, _, _ = _spectrum(q, _sizes(q, e, [line])[1], turns)
    z = power[best] * np.log(2.0) / max(float(np.median(left[max(best - reach, 0) : best + reach + 1])), 1e-300)
    prior = float(np.log((ORDERS[1] - lowest) * turns * n_joints))
    odds = min(float(z - 1 - np.log(max(z, 1.0))), _in_parts(q, e, line.order)) - prior
    return Line(line.order, odds) if odds > SURE else None


def _spectrum(q: FloatArray, e: FloatArray, turns: float) -> tuple[FloatArray, FloatArray, int]:
    """Power over the angle [rad], the orders [1/turn] that it is at, and how many of them are a cell of resolution."""
    span = int(np.ceil(turns + 1)) * OVERSAMPLED
    at = np.floor((q - q.min()) / (2 * np.pi) * BINS * ORDERS[1]).astype(int)
    power = np.abs(np.fft.rfft(np.bincount(at, weights=e, minlength=span * int(BINS * ORDERS[1])))) ** 2
    return power, np.arange(len(power)) / span, max(1, round(span / turns / OVERSAMPLED))


def _refined(q: FloatArray, e: FloatArray, order: float, step: float, times: Sequence[int] = (1,)) -> float:
    """The order near `order` at which lines of it and of its `times` take most off `e`.

    Over a part of a turn the peak of the spectrum lies elsewhere: sine and cosine are not orthogonal there.
    """
    from scipy.optimize import minimize_scalar

    thin = slice(None, None, max(1, len(q) // 20000))
    angle, rest = q[thin], e[thin]

    def less(N: float) -> float:
        columns = _columns(angle, [N * n for n in times])
        moment = columns.T @ rest
        return -float(moment @ np.linalg.lstsq(columns.T @ columns, moment, rcond=None)[0])

    return float(minimize_scalar(less, bounds=(order - step, order + step), method="bounded").x)


def _in_parts(q: FloatArray, e: FloatArray, order: float) -> float:
    """Logarithm of the Bayes factor of a line by its amplitudes in parts of the data."""
    wave = np.exp(1j * order * q) * e
    amplitudes = np.array([part.mean() for part in np.array_split(wave, PARTS)])
    scatter = float(np.sum(np.abs(amplitudes - amplitudes.mean()) ** 2)) / (PARTS - 1)
    T = PARTS * float(np.abs(amplitudes.mean()) ** 2) / max(scatter, 1e-300)
    return float((PARTS - 1) * np.log1p(T / (PARTS - 1)) - 1 - np.log(max(T, 1.0)))


def _columns(q: FloatArray, orders: Sequence[float]) -> FloatArray:
    """Cosine and sine of every order, (n, 2 n_orders)."""
    return np.concatenate([np.stack([np.cos(N * q), np.sin(N * q)], axis=1) for N in orders], axis=1)


def _sizes(q: FloatArray, e: FloatArray, lines: Sequence[Line]) -> tuple[FloatArray, FloatArray]:
    """Least-squares coefficients (2 n_lines,) and what they leave (n,)."""
    columns = _columns(q, [line.order for line in lines])
    x = np.asarray(np.linalg.lstsq(columns, e, rcond=None)[0], dtype=np.float64)
    return x, e - columns @ x


def _family(joint: int, q: FloatArray, e: FloatArray, lines: Sequence[Line]) -> Family:
    """Order and sizes of a family's lines with their errors from the residual's background beside those orders."""
    turns = np.ptp(q) / (2 * np.pi)
    times = [round(line.order / lines[0].order) for line in lines]
    first = _refined(q, e, lines[0].order, 0.5 / turns / max(times), times)
    lines = [Line(first * n, line.log_odds) for n, line in zip(times, lines, strict=True)]
    x, left = _sizes(q, e, lines)
    coefficients = x.reshape(-1, 2)
    orders = np.array([line.order for line in lines])
    noise, beside = [], np.linspace(1.0, 3.0, 12)  # cells; nearer ones were fitted
    for order in orders:
        near = order + np.concatenate([-beside, beside]) / turns
        power = np.abs(np.exp(1j * np.outer(near, q)) @ left) ** 2
        noise.append(np.sqrt(2 * np.median(power) / np.log(2.0)) / len(q))
    std = np.array(noise)
    size = np.linalg.norm(coefficients, axis=1)
    turned = np.array(times) * max(float(q.std()), 1e-300)  # of the phase with the first order
    order_std = np.array(times) / max(float(np.linalg.norm(size * turned / np.maximum(std, 1e-300))), 1e-300)
    columns = _columns(q, orders.tolist())
    # Every sample is seen in the means; single ones are far larger than the wave that they hold.
    drawn = binned(np.mod(q, 2 * np.pi / orders[0]), left + columns @ x, columns, x, np.diag(np.repeat(std**2, 2)))
    drawn |= {"x": [], "partial": []}
    return Family(joint, orders, coefficients, std, order_std, max(line.log_odds for line in lines), drawn)


def ripple_entries(found: Sequence[Family], fit: ThreeLoopIdentifier) -> list[dict[str, Any]]:
    """One entry per family, the most certain first."""
    entries = []
    for family in sorted(found, key=lambda one: -one.log_odds):
        parameters: list[dict[str, Any]] = []
        for k, (order, pair) in enumerate(zip(family.orders, family.coefficients, strict=True)):
            name = "" if k == 0 else f"_{round(order / family.orders[0])}"
            size, half = float(np.linalg.norm(pair)), NORMAL_95 * float(family.std[k])
            reach = NORMAL_95 * float(family.order_std[k])
            amplitude = {"value": size, "unit": fit.torque_unit_, "interval": [max(size - half, 0.0), size + half]}
            parameters += [
                {"name": f"cycles{name}", "value": order, "unit": "1/turn", "interval": [order - reach, order + reach]},
                {"name": f"amplitude{name}", **amplitude},
            ]
        entries.append(
            {
                "kind": "torque_ripple",
                "joints": [fit.robot.joint_names[family.joint]],
                "parameters": parameters,
                **unscored(p_value(family.log_odds)),
                "evidence": family.log_odds,
                "above_band": True,
                "plot": {
                    "signal": f"angle_in_cycle_{fit.robot.joint_names[family.joint]}",
                    "quantity": "torque",
                    "unit": "rad",
                    "joint": fit.robot.joint_names[family.joint],
                    **family.drawn,
                },
                "note": "lines in the angle, found at full rate; most of it is above the band of the other errors",
            }
        )
    return entries
