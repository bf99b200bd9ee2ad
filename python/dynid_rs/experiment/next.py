"""`next_experiment`: from a diagnosis to the motion that decides most of what it left open."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from dynid_rs.diagnosis.outcome import Diagnosis
from dynid_rs.excitation.fourier import FourierExcitation
from dynid_rs.excitation.limits import ExcitationLimits
from dynid_rs.experiment.designing import NextExperiment, check_length, design_next, least_duration, led_by

SHARES = (0.25, 0.5, 1.0)
"""Of a budget that are tried."""
ENOUGH = 0.95
"""Chance that every question is settled at which a longer motion is not asked for."""


def next_experiment(
    found: Diagnosis,
    limits: ExcitationLimits | None = None,
    *,
    budget: float | None = None,
    load: float = 0.0,
    max_iter: int = 100,
    time_limit: float | None = None,
    on_progress: Callable[[str], None] = lambda words: None,
    **options: Any,
) -> NextExperiment:
    """Design the motion that decides most of what a diagnosis left open.

    Parameters
    ----------
    found : Diagnosis
        Of runs of the arm that is moved.
    limits : ExcitationLimits, optional
        What the joints may do; the robot's own if left out.
    budget : float, optional
        The shortest motion that settles enough is designed, of at most so many seconds (and at least a quarter of it);
        `duration` by default.
    load : float
        Known mass at the origin of the last link during the motion [kg].
    max_iter : int
        Random steps of each of three walks.
    time_limit : float, optional
        Stop after this many seconds; the answer then depends on the machine.
    on_progress : callable
        Called with a few words.
    **options
        Of `FourierExcitation`: duration, n_harmonics, start, constraints, random_state, ...

    Returns
    -------
    NextExperiment
        The motion, the chance that it settles every open question, and the same of random and of exciting motion.

    Raises
    ------
    ValueError
        Nothing was searched in the diagnosis (an error in the data ended it, or it was against a reference); as
        `FourierExcitation.fit`; too short for the band of the runs.
    RankDeficientError
        As `FourierExcitation.fit`.
    """
    if found.asked is None:
        raise ValueError(
            "this diagnosis has not searched for effects (an error in the data ended it, or it was against a "
            "reference), so nothing is known to be open; mend the data and diagnose once more"
        )
    asked, robot = found.asked, found.asked.setup.declared

    def designed(seconds: float | None) -> NextExperiment:
        length: dict[str, Any] = {} if seconds is None else {"duration": seconds}
        if seconds is not None and options.get("state_file") is not None:
            length["state_file"] = state_of(Path(options["state_file"]), seconds)
        design = FourierExcitation(**{**options, **length})
        check_length(asked, design.duration, "duration" if budget is None else "budget")
        design.fit(robot, limits)
        return design_next(asked, design, load=load, max_iter=max_iter, time_limit=time_limit, on_progress=on_progress)

    return designed(None) if budget is None else shortest(designed, budget, least_duration(asked))


def state_of(state_file: Path, seconds: float) -> Path:
    """Where the finished searches of one length of a budget are kept: another length is another problem."""
    return state_file.with_name(f"{state_file.stem}_{seconds:g}s{state_file.suffix}")


def shortest(designed: Callable[[float], NextExperiment], budget: float, least: float) -> NextExperiment:
    """The first of motions of a quarter, half and all of the budget [s] that settles enough; else the longest.

    None but the last is shorter than `least` [s]. Enough is what the whole budget could not better: every question that
    the search looks at (`led_by`) is settled with a chance of 95 %.
    """
    for length in (share * budget for share in SHARES if share == SHARES[-1] or share * budget >= least):
        found = designed(length)
        leading = led_by(found.questions)
        chances = zip(found.questions, found.expected.chances, strict=True)
        if all(chance.right >= ENOUGH for question, chance in chances if question in leading):
            break
    return found
