"""Torque ripple: lines in the angle domain, at full rate, and what they are as effects of the catalogue."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.diagnosis.angle_data import AngleRun, FullRateRun, angle_runs, full_rate_runs
from dynid_rs.diagnosis.candidate import Candidate
from dynid_rs.diagnosis.ripple_fit import LineFit, Order, line_columns
from dynid_rs.diagnosis.ripple_search import search_lines
from dynid_rs.diagnosis.ripple_size import sized
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.identification import ThreeLoopIdentifier
from dynid_rs.placed import CATALOGUE, HeldEffect, PlacedEffect
from dynid_rs.recording import Recording
from dynid_rs.uncertainty import NORMAL_95

FloatArray = NDArray[np.float64]

HARMONIC = 0.5
"""Of a resolution cell: an order this near to twice another is its second harmonic."""
VISIBLE = 0.8
"""Ripple of which the band lets through more than this part of its power is fitted there, with everything else."""
KIND = "torque_ripple"
REVERSING = "position_dependent_friction"


@dataclass(frozen=True, eq=False)
class RippleLine:
    """A sharp line in the angle domain.

    Parameters
    ----------
    joint : int
        Where.
    order, order_interval : float, (float, float)
        Cycles per turn of the joint, 95 %.
    amplitude, amplitude_interval : float, (float, float)
        Root mean square of the amplitudes in the two directions of motion [torque unit], 95 %.
    phase : float
        Of ``amplitude * cos(order * q_motor - phase)`` in forward motion [rad].
    reversing : float
        Share of the power that changes its sign with the direction, as friction of the teeth does; 0 if one phase
        holds for both directions.
    p_value : float
        Corrected for all orders of the joint.
    coefficients : ndarray (4,)
        Cosine and sine [torque unit], and both once more with the sign of the motion.
    """

    joint: int
    order: float
    order_interval: tuple[float, float]
    amplitude: float
    amplitude_interval: tuple[float, float]
    phase: float
    reversing: float
    p_value: float
    coefficients: FloatArray


@dataclass(frozen=True, eq=False)
class RippleCandidate(Candidate):
    """Ripple of one order and twice that order, with the evidence that it has at full rate.

    Its columns in the band may be next to nothing; amplitudes are those of the full rate, and accepting it holds them.

    Parameters
    ----------
    lines : tuple of RippleLine
        One or two.
    p_value : float
        Of the stronger one, corrected for all orders of all joints.
    residual_rms : tuple of float
        Of the joint's full-rate residual in motion [torque unit], before and with these lines.
    """

    lines: tuple[RippleLine, ...] = ()
    p_value: float = 1.0
    residual_rms: tuple[float, float] = (np.nan, np.nan)


def ripple_orders(fit: ThreeLoopIdentifier, recordings: Sequence[Recording]) -> list[RippleLine]:
    """Lines of all joints, each joint's strongest first.

    Parameters
    ----------
    fit : ThreeLoopIdentifier
        Fitted; what it holds already is not found again.
    recordings : sequence of Recording
        At full rate: training runs, or others with the same robot, in which joints may rest.
    """
    runs = full_rate_runs(fit, recordings)
    return [line for j in range(fit.robot.n_joints) for line in _lines(runs, j)[0]]


def ripple_candidates(fit: ThreeLoopIdentifier, recordings: Sequence[Recording], setup: Setup) -> list[Candidate]:
    """Ripple of every joint by families: an order and twice it; a joint's strongest first.

    Parameters
    ----------
    fit : ThreeLoopIdentifier
        Of `setup`.
    recordings : sequence of Recording
        As recorded, at full rate.
    setup : Setup
        What is believed of the channels.
    """
    return list(_candidates(fit, recordings, setup))


def add_ripple(
    setup: Setup, fit: ThreeLoopIdentifier, recordings: Sequence[Recording]
) -> tuple[Setup, list[RippleCandidate]]:
    """Return the setup with all ripple that stands out at full rate, and the candidates that were accepted.

    Parameters as of `ripple_candidates`. Nothing is left to choose: lines are orthogonal to each other and to what the
    band holds, and each has passed its test against chance and its test on sweeps that were left out.
    """
    found = _candidates(fit, recordings, setup)
    for candidate in found:
        setup = candidate.accept(setup, np.zeros(len(candidate.bounds)))
    return setup, found


def _candidates(fit: ThreeLoopIdentifier, recordings: Sequence[Recording], setup: Setup) -> list[RippleCandidate]:
    runs = full_rate_runs(fit, [setup.corrected(recording) for recording in recordings])
    candidates = []
    for j in range(fit.robot.n_joints):
        lines, parts = _lines(runs, j)
        candidates += [_candidate(fit, j, family, parts) for family in _families(lines, parts)]
    return candidates


def _lines(runs: Sequence[FullRateRun], j: int) -> tuple[list[RippleLine], list[AngleRun]]:
    parts = angle_runs(runs, j)
    if not parts:
        return [], []
    found, log_p = search_lines(parts, runs[0].residual.shape[1])
    found = sized(parts, found)
    first = np.cumsum([0, *(order.n_columns for order in found.orders)])
    lines = [_line(found, j, k, int(first[k]), log_p[k]) for k in range(len(log_p))]
    return sorted(lines, key=lambda line: -line.amplitude), parts


def _line(found: LineFit, j: int, k: int, first: int, log_p: float) -> RippleLine:
    order, c = found.orders[k], found.coefficients[k]
    covariance = found.covariance[first : first + len(c), first : first + len(c)]
    whole = np.zeros(4)
    whole[: len(c)] = c
    amplitude = float(np.linalg.norm(c))
    spread = NORMAL_95 * float(np.sqrt(max(float(c @ covariance @ c), 0.0))) / amplitude
    forward = whole[:2] + whole[2:]
    half = NORMAL_95 * float(found.cycles_std[k])
    return RippleLine(
        joint=j,
        order=order.cycles,
        order_interval=(order.cycles - half, order.cycles + half),
        amplitude=amplitude,
        amplitude_interval=(max(0.0, amplitude - spread), amplitude + spread),
        phase=float(np.arctan2(forward[1], forward[0])),
        reversing=float(np.sum(whole[2:] ** 2)) / amplitude**2,
        p_value=float(np.power(np.e, log_p)),
        coefficients=whole,
    )


def _families(lines: Sequence[RippleLine], parts: Sequence[AngleRun]) -> list[list[RippleLine]]:
    """Lines by base order: a base and, where there is one, its second harmonic; the strongest family first."""
    if not lines:
        return []
    near = HARMONIC * 2 * np.pi / max(part.span for part in parts)
    left = sorted(lines, key=lambda line: line.order)
    families = []
    while left:
        base = left.pop(0)
        second = [line for line in left if abs(line.order - 2 * base.order) < near]
        family = [base, *second[:1]]
        left = [line for line in left if line not in family]
        families.append(family)
    return sorted(families, key=lambda family: -max(line.amplitude for line in family))


def _candidate(
    fit: ThreeLoopIdentifier, j: int, family: Sequence[RippleLine], parts: Sequence[AngleRun]
) -> RippleCandidate:
    held = held_effects(fit, family)
    ripple = held[0].effect
    entry = CATALOGUE[KIND]
    cycles = ripple.shape_at(j)["cycles"]
    before, after = _rms(parts, []), _rms(parts, family)
    in_band = _in_band(fit, ripple, j)
    visible = 2 * float(np.mean(np.concatenate(in_band)[:, :2] ** 2))  # a sine that the band lets through has a half

    def accept(setup: Setup, coefficients: FloatArray) -> Setup:
        del coefficients  # those of the band are fitted again, or say little beside those of the full rate
        if visible > VISIBLE:
            return replace(setup, effects=(*setup.effects, *(one.effect for one in held)))
        return replace(setup, held=(*setup.held, *held))

    return RippleCandidate(
        kind=KIND,
        joints=(j,),
        coefficient_names=tuple(c["name"] for c in entry["coefficients"]),
        units=(fit.torque_unit_,) * len(entry["coefficients"]),
        bounds=np.array([[c["lower"], c["upper"]] for c in entry["coefficients"]]),
        columns=[{j: columns} for columns in in_band],
        accept=accept,
        shape=(("cycles", cycles),),
        n_searched=1,
        lines=tuple(family),
        p_value=min(line.p_value for line in family),
        residual_rms=(before, after),
    )


def held_effects(fit: ThreeLoopIdentifier, family: Sequence[RippleLine]) -> list[HeldEffect]:
    """Effects of a base order and its second harmonic, with the coefficients of the full rate.

    The part with one sign is torque ripple; the part that follows the direction is friction that depends on position.
    """
    j, cycles = family[0].joint, _cycles(family)
    ripple = np.zeros(4)
    effects = []
    width = float(fit.friction_.transition_width_[j])
    for k, line in enumerate(family):
        ripple[2 * k : 2 * k + 2] = line.coefficients[:2]
        if line.reversing > 0:
            friction = PlacedEffect.at(REVERSING, j, cycles=(k + 1) * cycles, transition_width=width)
            effects.append(HeldEffect(friction, tuple(line.coefficients[2:])))
    return [HeldEffect(PlacedEffect.at(KIND, j, cycles=cycles), tuple(ripple)), *effects]


def _cycles(family: Sequence[RippleLine]) -> float:
    """Order of the base, from both lines by their precision."""
    orders = np.array([line.order / (k + 1) for k, line in enumerate(family)])
    widths = np.array([(line.order_interval[1] - line.order_interval[0]) / (k + 1) for k, line in enumerate(family)])
    return float(np.average(orders, weights=1 / np.maximum(widths, 1e-12) ** 2))


def _in_band(fit: ThreeLoopIdentifier, ripple: PlacedEffect, j: int) -> list[FloatArray]:
    cycles = np.full(fit.robot.n_joints, ripple.shape_at(j)["cycles"])
    effect = _core.Effect.of(KIND, cycles=cycles)
    return [s.in_band(_core.effect_columns(effect, *s.signals())[:, j]) for s in fit.runs_]


def _rms(parts: Sequence[AngleRun], lines: Sequence[RippleLine]) -> float:
    squares, count = 0.0, 0
    for part in parts:
        left = part.residual.copy()
        for line in lines:
            left -= line_columns(part, Order(line.order, True)) @ line.coefficients
        squares += float(np.sum(left[part.used] ** 2))
        count += int(part.used.sum())
    return float(np.sqrt(squares / max(count, 1)))
