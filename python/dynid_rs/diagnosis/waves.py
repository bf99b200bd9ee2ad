"""Functions of one or two signals, without a name."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.diagnosis.beside import NEVER
from dynid_rs.diagnosis.hypotheses import USUAL, Catalogue, Hypothesis, standardised
from dynid_rs.identification.smooth_friction import sign_shape
from dynid_rs.model.placed import CATALOGUE
from dynid_rs.regression.kept_columns import kept
from dynid_rs.runs.preprocessing import States

FloatArray = NDArray[np.float64]
Signal = tuple[str, int]

UNKNOWN = "unknown"
"""Kind of a function without a name."""
ALONE, TOGETHER = 10, 5
"""Waves within a signal's range that a function of it is made of, and where there are two of them."""
FALLS, SMOOTHER = 2, (0, 1, 2)
"""Waves of a function that bends but does not jump fall with this power of their order; so do the coefficients'
priors. By so much more where the bend does not jump either, or what it bends by."""
SIZES = (0.1, 0.3, 1.0, 3.0, 10.0)
"""Sizes of a function that are as likely beforehand, over a tenth of the joint's torque."""
SIGNALS = ("q", "dq_motor", "ddq_motor", "tau_link")
"""Signals that a torque may depend on, of any joint."""


@dataclass(frozen=True)
class Argument:
    """What a function depends on: a signal, or a sum of such, ``sum_k factor_k signal_k``."""

    terms: tuple[tuple[float, Signal], ...]

    def values(self, states: States) -> FloatArray:
        """Along a run, (n,)."""
        parts = [factor * np.asarray(getattr(states, name))[:, j] for factor, (name, j) in self.terms]
        total: FloatArray = np.sum(parts, axis=0)
        return total


def of_signal(signal: Signal) -> Argument:
    """A signal alone."""
    return Argument(((1.0, signal),))


def signal_sets(n_joints: int, j: int) -> Iterator[tuple[Signal, ...]]:
    """Single signals of any joint, and pairs: of joint j's own, of it and another's position or load, of positions."""
    single = [(name, k) for name in SIGNALS for k in range(n_joints)]
    yield from ((signal,) for signal in single)
    for pair in combinations(single, 2):
        kinds, joints = {name for name, _ in pair}, [k for _, k in pair]
        crossed = ("dq_motor", j) in pair and bool(kinds & {"q", "tau_link"})
        if joints == [j, j] or crossed or (kinds == {"q"} and j in joints):
            yield pair


@dataclass(frozen=True)
class Window:
    """Values of an argument from `low` on, `span` of them, within which a function of it is made of `n` waves."""

    low: float
    span: float
    n: int


def waves(
    catalogue: Catalogue,
    j: int,
    arguments: Sequence[Argument],
    *,
    turning: bool = False,
    within: Window | None = None,
) -> Hypothesis:
    """Cosine series of an argument within its range, or of two and of their products, on joint j.

    `turning`: times the sign of joint j's speed. `within`: of one argument, a window in the place of its range.
    """
    runs, fit = catalogue.runs, catalogue.fit
    orders = _orders(len(arguments)) if within is None else [(m,) for m in range(1, within.n + 1)]
    series = _series(runs, arguments, orders, within)
    if turning:
        width, sharpness = (shape[j] for shape in sign_shape(fit.observations_.plan.friction[0]))
        signs = [_sign(states, j, width, sharpness) for states in runs]
        parts = [s.in_band(own * sign[:, None]) for s, own, sign in zip(runs, series(), signs, strict=True)]
    else:  # the same on every joint
        load = [states.digest("tau_link") for states in runs]
        key = ("waves", *arguments, within, *load, *(states.motion for states in runs))
        parts = kept(key, lambda: [states.in_band(own) for states, own in zip(runs, series(), strict=True)])
    moves = np.concatenate([states.counted[:, j] for states in runs])
    columns = np.concatenate(parts) * moves[:, None]
    torque = np.sqrt(np.mean(np.concatenate([block.rows[j][:, -1] for block in fit.observations_.blocks]) ** 2))
    size = np.sqrt(np.mean(columns**2, axis=0))
    falling = np.linalg.norm(orders, axis=1) ** -FALLS if len(arguments) == 1 else 1.0
    unit = USUAL * torque * falling / np.where(size > 0, size, 1.0)
    free = np.tile([-np.inf, np.inf], (len(orders), 1))
    return Hypothesis(
        UNKNOWN,
        (j,),
        tuple(f"wave_{k}" for k in range(len(orders))),
        ("1",) * len(orders),
        standardised({j: columns}, unit),
        unit,
        free,
        lambda setup, _: setup,
        sizes=SIZES if len(arguments) == 1 else (1.0, 10.0),
    )


def smoother(function: Hypothesis, more: int) -> Hypothesis:
    """A function of one argument whose waves fall with a power of their order that is greater by `more`."""
    falling = np.arange(1.0, len(function.unit) + 1) ** -more
    columns = {j: part * falling for j, part in function.columns.items()}
    return replace(function, columns=columns, unit=function.unit * falling)


def _series(
    runs: Sequence[States], arguments: Sequence[Argument], orders: Sequence[tuple[int, ...]], within: Window | None
) -> Callable[[], Iterator[FloatArray]]:
    """Waves (n, k) along every run."""

    def series() -> Iterator[FloatArray]:
        values = [[argument.values(states) for states in runs] for argument in arguments]
        low = [min(x.min() for x in own) for own in values]
        span = [max(max(x.max() for x in own) - first, 1e-300) for own, first in zip(values, low, strict=True)]
        if within is not None:
            low, span = [within.low], [within.span]
        highest = np.max(orders, axis=0)
        for k in range(len(runs)):
            u = [np.pi * (own[k] - first) / whole for own, first, whole in zip(values, low, span, strict=True)]
            single = [[np.cos(m * x) for m in range(most + 1)] for x, most in zip(u, highest.tolist(), strict=True)]
            products = [np.prod([own[m] for own, m in zip(single, order, strict=True)], axis=0) for order in orders]
            yield np.stack(products, axis=1)

    return series


def _sign(states: States, j: int, width: float, sharpness: float) -> FloatArray:
    """Rounded sign of joint j's speed at every sample, (n,)."""
    n = states.q.shape[1]
    shape = {"stribeck_velocity": NEVER, "exponent": 1.0, "transition_width": width, "sharpness": sharpness}
    effect = _core.Effect.of("stribeck", **{name: np.full(n, value) for name, value in shape.items()})
    sign: FloatArray = _core.effect_columns(effect, *states.signals(), joints=[j])[:, 0].sum(axis=1)
    return sign


def _orders(n_arguments: int) -> list[tuple[int, ...]]:
    """Orders of the waves in every argument: sums of orders up to a highest."""
    if n_arguments == 1:
        return [(m,) for m in range(1, ALONE + 1)]
    both = range(TOGETHER + 1)
    return [(m, k) for m in both for k in both if 0 < m + k <= TOGETHER + (m > 0 and k > 0)]


def same_angles(kind: str, j: int, n_joints: int) -> tuple[list[Argument], bool]:
    """Angles that a kind on joint j depends on, and whether it turns round with the speed; none where it has a memory.

    Of the speed declared friction may leave a function, of the load an error of the links: no name is to blame for
    those. An angle stands for its sums with the others' too: what is stretched over two joints.
    """
    entry = CATALOGUE[kind]
    signals = [name for name in entry["signals"] if name != "dq_motor"]
    if entry["memory"] or entry["places"] != "joint" or signals not in (["q"], ["q_motor"]):
        return [], False
    own, others = (1.0, ("q", j)), [k for k in range(n_joints) if k != j]
    arguments = [Argument((own,))]
    arguments += [Argument((own, (sign, ("q", k)))) for k in others for sign in (1.0, -1.0)]
    return arguments, len(entry["signals"]) > 1
