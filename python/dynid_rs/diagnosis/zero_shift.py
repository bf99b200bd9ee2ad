"""A torque channel whose zero moves from run to run: sensors are tared, drives warm up, a model was taken off.

One offset for all runs then averages over them, and every effect is fitted beside the difference. The runs' own
offsets are taken off the training runs; a run that nobody has seen keeps its own, which nothing can know.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.beside import Beside, independent_rows
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.findings import Finding, joint_words
from dynid_rs.identification import ThreeLoopIdentifier

FloatArray = NDArray[np.float64]

WORTH = 0.1
"""Zeros of their own are given to the runs where they take at least this part off a joint's training error,"""
CHANCE = 1e-3
"""and where chance gives as much less often than this."""


def zero_shifts(fit: ThreeLoopIdentifier, setup: Setup) -> tuple[Setup, list[Finding]]:
    """Return the setup with the zeros of the training runs, and a finding for every joint that has some.

    Parameters
    ----------
    fit : ThreeLoopIdentifier
        Of `setup`, without a third loop.
    setup : Setup
        What is believed.
    """
    names = [states.name for states in fit.runs_]
    if len(names) < 2:
        return setup, []
    beside = Beside(fit)
    apart = _contrasts([len(states.rows) for states in fit.runs_])
    zeros = np.zeros((len(names), setup.robot.n_joints))
    findings = []
    for j in range(setup.robot.n_joints):
        shift = _shift(beside, apart, j)
        if shift is None:
            continue
        zeros[:, j] = shift
        listed = ", ".join(f"{value:+.3g} in {name}" for name, value in zip(names, shift, strict=True))
        text = (
            f"the torque's zero of {joint_words(setup.robot.joint_names[j])} differs between the runs: {listed} "
            f"{fit.torque_unit_} from their mean; it was taken off, and a new run's own zero cannot be predicted"
        )
        findings.append(
            Finding(
                "torque_zero", "warning", text, column=f"tau_{j}", value=float(np.ptp(shift)), unit=fit.torque_unit_
            )
        )
    if not findings:
        return setup, []
    known = dict(setup.torque_zero)
    for name, zero in zip(names, zeros, strict=True):
        known[name] = known.get(name, np.zeros(setup.robot.n_joints)) + zero
    return replace(setup, torque_zero=known), findings


def _contrasts(lengths: Sequence[int]) -> FloatArray:
    """Columns (n_rows, n_runs - 1): one constant per run, all of them with the mean zero over all rows."""
    runs = np.repeat(np.arange(len(lengths)), lengths)
    constants = (runs[:, None] == np.arange(len(lengths) - 1)).astype(np.float64)
    apart: FloatArray = constants - constants.mean(axis=0)
    return apart


def _shift(beside: Beside, apart: FloatArray, j: int) -> FloatArray | None:
    """Zero of every run [torque unit], beside the whole model; None where it is no use or may be chance."""
    from scipy.stats import f

    width = apart.shape[1]
    unbounded = np.tile([-np.inf, np.inf], (width, 1))
    gain = beside.gains({j: apart}, [slice(None)], [unbounded])[0]
    before = beside.residual[:, j]
    after = beside.with_columns({j: apart}, gain.coefficients)[:, j]
    ratio = float(np.mean(after**2) / np.mean(before**2))
    if ratio > (1 - WORTH) ** 2:
        return None
    free = float(independent_rows(after[:, None], beside.blocks)[0]) - width - 1
    if free < 1 or f.sf((1 / ratio - 1) * free / width, width, free) > CHANCE:
        return None
    constants = np.append(gain.coefficients, 0.0)
    levels = apart @ gain.coefficients
    zero: FloatArray = constants + (levels[-1] - constants[-1])  # of the last run's rows, which have no column
    return zero
