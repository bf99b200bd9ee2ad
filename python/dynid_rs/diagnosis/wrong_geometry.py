"""A joint's frame that is far from its place, told from the many small things that it looks like.

Columns of a displacement are its derivatives, and beside base parameters that a wrong geometry has spoilt they explain
next to nothing, while springs, couplings and encoders each take off a little. So where much is left on several joints,
every frame is moved by itself, the model fitted again after every step, before the small things are believed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.beside import Beside, Gain, independent_rows
from dynid_rs.diagnosis.candidate import Candidate
from dynid_rs.diagnosis.choice import Weighed
from dynid_rs.diagnosis.search import search
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.state import Choice, Search, Step, fitted, rms
from dynid_rs.diagnosis.structural import displacement, refine
from dynid_rs.diagnosis.structural.frames import moved_joints
from dynid_rs.diagnosis.structural.kinematic_error import KIND, moved
from dynid_rs.evaluation import noise_floor
from dynid_rs.identification import ThreeLoopIdentifier
from dynid_rs.recording import Recording

FloatArray = NDArray[np.float64]

GROSS = 1.5
"""What is left over the torque channel's noise, from which on a joint is looked at again."""
FEWEST = 2
"""A wrong frame shows on this many joints at least."""
N_STEPS = 4
"""Gauss-Newton steps on a frame after the first, a fit after each."""
WORTH_A_STEP = 0.1
"""Logarithm of what the first step on the best frame has to take off for more of them."""
TOUCH = 1e-7
"""Displacement [m] with which the steps begin."""
N_PARTS = 6
"""Of a displacement: three offsets, three turns."""


@dataclass(frozen=True, eq=False)
class _Trial:
    joint: int
    setup: Setup
    fit: ThreeLoopIdentifier


def with_other_geometry(
    found: Search,
    setup: Setup,
    train: Sequence[Recording],
    *,
    on_progress: Callable[[str], None] = lambda step: None,
) -> Search:
    """Return the search from the best displaced frame where it explains more than `found`, else `found` itself.

    Parameters
    ----------
    found : Search
        From the robot as it is declared.
    setup : Setup
        What `found` began with.
    train : sequence of Recording
        Training runs, on one clock.
    """
    if not _much_is_left(found) or moved_joints(setup.declared, found.setup.robot):
        return found
    on_progress("the same with one joint's frame elsewhere")
    plain = fitted(setup, train)
    trials = [_first_step(setup, plain, joint, train) for joint in range(1, setup.robot.n_joints)]
    best = min(trials, key=lambda trial: _left(trial.fit))
    if _left(best.fit) > _left(plain) - WORTH_A_STEP:
        return found
    best = _further(best, train)
    step, gained = _as_step(plain, best)
    if gained <= 0 or _left(best.fit) >= _left(found.fit):
        return found
    other = search(best.setup, train, on_progress=on_progress)
    if _left(other.fit) >= _left(found.fit):
        return found
    other.steps.insert(0, step)
    return other


def _much_is_left(found: Search) -> bool:
    left = rms(found.fit) > GROSS * noise_floor(found.fit.runs_)
    return int(np.count_nonzero(left)) >= FEWEST


def _first_step(setup: Setup, plain: ThreeLoopIdentifier, joint: int, train: Sequence[Recording]) -> _Trial:
    # So small a touch that the fit without it will do; it only says which frame may move.
    there = refine(moved(setup, joint, TOUCH * np.eye(N_PARTS)[0]), plain)
    return _Trial(joint, there, fitted(there, train))


def _further(trial: _Trial, train: Sequence[Recording]) -> _Trial:
    there, fit = trial.setup, trial.fit
    for _ in range(N_STEPS):
        refined = refine(there, fit)
        if refined is there:
            break
        there, fit = refined, fitted(refined, train)
    return _Trial(trial.joint, there, fit)


def _left(fit: ThreeLoopIdentifier) -> float:
    """Mean over joints of the logarithm of what a fit leaves."""
    return float(np.log(rms(fit)).mean())


def _as_step(plain: ThreeLoopIdentifier, trial: _Trial) -> tuple[Step, float]:
    """The displacement as a step of the search, and the logarithm of its evidence against the declared geometry."""
    from scipy.stats import chi2

    beside = Beside(trial.fit)
    rows = independent_rows(beside.residual, beside.blocks)
    gain = float(rows @ np.log(rms(plain) / rms(trial.fit)))
    evidence = gain - 0.5 * N_PARTS * np.log(max(float(np.mean(rows)), 2.0))
    change = displacement(trial.setup.declared, trial.setup.robot, trial.joint)
    candidate = Candidate(
        kind=KIND,
        joints=(trial.joint,),
        coefficient_names=("offset_x", "offset_y", "offset_z", "rotation_x", "rotation_y", "rotation_z"),
        units=("m",) * 3 + ("rad",) * 3,
        bounds=np.tile([-np.inf, np.inf], (N_PARTS, 1)),
        columns=[],
        accept=lambda setup, x: replace(setup, robot=moved(setup, trial.joint, x).robot),
    )
    n_trials = trial.setup.robot.n_joints - 1
    p_value = min(1.0, n_trials * float(chi2.sf(2 * gain, N_PARTS)))
    weighed = Weighed(candidate, Gain(2 * gain, change, gain, np.zeros(N_PARTS, dtype=bool)), evidence, beside.residual)
    return Step("added", Choice(weighed, p_value), rms(trial.fit)), evidence
