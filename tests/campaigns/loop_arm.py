"""An arm of the exam of which nothing is known yet, and an oracle of it that is told kinds and shapes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
from exam.declared import Band, Declared, declare
from exam.draw import Wish, draw, log_uniform, stream
from exam.hidden import hide, in_band, measured
from exam.sensors import noise_rows
from exam.world import States
from numpy.typing import NDArray

from campaigns.next_arm import KINDS, SECONDS, Arm, written

FloatArray = NDArray[np.float64]

SIZES = (0.3, 3.0)
"""What the declared model leaves of an effect in a minute of ordinary motion, over the noise; logarithmic."""
N_EFFECTS = (0.15, 0.35, 0.3, 0.2)
"""Shares of arms with none, one, two and three effects."""


def draw_unknown(seed: int, folder: Path) -> Arm:
    """Draw an arm, what is hidden in it, and the limits and the test run that ordinary motion gives it."""
    case, rng = draw(seed), stream(seed, 70)
    kinds = rng.choice(KINDS, rng.choice(len(N_EFFECTS), p=N_EFFECTS), replace=False)
    wishes = tuple(Wish(str(kind), float(log_uniform(rng, *SIZES))) for kind in kinds)
    case = replace(
        case, wishes=wishes, motion="fourier", n_train=2, durations=SECONDS, file_inertials="near", missing=0.0,
        temperature=False, elastic_gears=False,
    )  # fmt: skip
    return written(hide(case), folder)


N_OWN, TRUE = 13, (0, 1, 2, 3, 11, 12)
"""Columns of a joint's own terms in the exam's declared model, and those of them that its arms have."""


class Oracle:
    """Knows kinds, places and shapes; coefficients and everything else it fits to the runs that it is given.

    On rows in a low band it errs on the test run by the noise there, and by what the noise of its runs did to its
    coefficients.
    """

    def __init__(self, arm: Arm, played: Sequence[States]) -> None:
        exam, test = arm.exam, arm.exam.world.runs[-1]
        case, runs = exam.world.case, (*played, test)
        lengths = tuple(len(s.recorded.t) / case.rate for s in runs)
        world = replace(exam.world, case=replace(case, n_train=len(runs), durations=lengths), runs=runs)
        noise = noise_rows(world, exam.sensors)
        declared = declare(world, np.sqrt(np.mean(noise**2, axis=0)))
        told = [
            declared.weighted(measured(world, exam.sensors, declared, h.effect, h.size).rows)
            for h in exam.hidden
            if in_band(h.effect)
        ]
        columns = np.column_stack([_true_columns(declared, case.n_joints), *told])
        is_test = np.repeat(declared.groups == len(played), case.n_joints)
        scale = np.linalg.norm(columns[~is_test], axis=0)
        columns = columns / np.where(scale > 0, scale, 1.0)
        wrong = np.linalg.lstsq(columns[~is_test], declared.weighted(noise)[~is_test], rcond=1e-9)[0]
        left = declared.weighted(noise) - columns @ wrong
        self.counted = declared.weights[declared.groups == len(played)] > 0
        noise_over = declared.weighted(noise)[is_test].reshape(-1, case.n_joints)
        unit = np.sqrt(np.mean(noise**2, axis=0))
        self.noise = unit * self.rms(noise_over)
        self.error = unit * self.rms(left[is_test].reshape(-1, case.n_joints))

    def rms(self, rows: FloatArray) -> FloatArray:
        """Of rows (n_rows, n_joints) in which a joint moves, per joint."""
        return np.sqrt(np.sum(np.where(self.counted, rows, 0.0) ** 2, axis=0) / np.maximum(self.counted.sum(axis=0), 1))


def _true_columns(declared: Declared, n_joints: int) -> FloatArray:
    """Links, Coulomb's sign and the speed in both directions, rotors, offsets: what such an arm is made of.

    The exam's declared columns hold shapes of friction besides (powers of the speed, other laws, a wider sign), which
    nobody needs who is told the shape.
    """
    n_links = declared.columns.shape[1] - N_OWN * n_joints
    own = [n_links + j * N_OWN + k for j in range(n_joints) for k in TRUE]
    return declared.columns[:, [*range(n_links), *own]]


def error_of(arm: Arm, estimates: Path, oracle: Oracle) -> FloatArray:
    """RMS (n_joints,) [N m] of measured torque less estimated, on the rows of the test run that the oracle has."""
    world = arm.exam.world
    table, told = pq.read_table(arm.test), pq.read_table(estimates)
    name = "current" if world.case.current else "tau"
    t, at = np.asarray(table["t"]), np.asarray(told["t"])  # of runs that are recorded often every second one, say
    left = np.column_stack(
        [
            np.asarray(table[f"{name}_{j}"]) - np.interp(t, at, np.asarray(told[f"tau_{j}"]))
            for j in range(world.case.n_joints)
        ]
    )
    rows = Band(world.case.rate).rows(left / world.amperes)
    return oracle.rms(rows[: len(oracle.counted)])
