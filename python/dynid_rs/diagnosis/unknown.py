"""What is left when nothing in the catalogue explains it: where, on which signals, and a torque that takes it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.data_term import DataTerm, fit_data_term
from dynid_rs.diagnosis.dependence import dependence
from dynid_rs.diagnosis.floor import SIGNIFICANT, Floor, nothing_left
from dynid_rs.diagnosis.leftovers import Leftover, Leftovers, run_residuals, search_leftovers
from dynid_rs.diagnosis.picture import Picture, picture_of
from dynid_rs.diagnosis.products import LeftOutRows
from dynid_rs.diagnosis.signals import Candidates, Signal
from dynid_rs.identification import ThreeLoopIdentifier

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Unexplained:
    """Structure that a joint's residual still holds.

    Parameters
    ----------
    joint : int
        Where.
    share : float
        Part of the residual's power above the floor.
    p_value : float
        Chance of so much dependence on any signals, or of so large a residual where no signals are named, if there
        were none.
    depends_on : tuple of (Signal, float)
        Signals and their strengths, strongest first: the part of what all of them explain that is lost without it.
        Empty where something is left that no few signals explain.
    ties : tuple of tuple of Signal
        Other sets of signals that predict rows left out as well.
    explained : float
        Part of the power that the signals predict on rows left out.
    picture : Picture or None
        Partial residual against the strongest one or two signals.
    term : DataTerm or None
        Torque on these signals; None where they are no inputs of a model.
    """

    joint: int
    share: float
    p_value: float
    depends_on: tuple[tuple[Signal, float], ...]
    ties: tuple[tuple[Signal, ...], ...]
    explained: float
    picture: Picture | None
    term: DataTerm | None


def find_unknown(fit: ThreeLoopIdentifier, floor: Floor, leftovers: Leftovers | None = None) -> list[Unexplained]:
    """Look for structure in what a fitted model leaves of its training runs, the largest share first.

    A joint at its floor is not looked at. On the others all single signals and pairs have been compared on rows left
    out and against phase-randomised copies of the residual; a third signal is tried where pairs are not enough.

    Parameters
    ----------
    fit : ThreeLoopIdentifier
        Without a third loop.
    floor : Floor
        Of its residuals.
    leftovers : Leftovers, optional
        Of the fit, where it was searched already.
    """
    from threadpoolctl import threadpool_limits

    leftovers = leftovers or search_leftovers(fit)
    at_floor, n = nothing_left(floor), len(floor.value)
    power = np.mean(np.concatenate(run_residuals(fit)) ** 2, axis=0)
    found = []
    with threadpool_limits(limits=1, user_api="blas"):
        for j in np.flatnonzero(~at_floor).tolist():
            share = float(np.clip(1 - floor.value[j] ** 2 / power[j], 0.0, 1.0))
            leftover = leftovers.joints.get(j)
            if leftover is None or leftovers.candidates is None or leftover.p_value * n > SIGNIFICANT:
                found.append(Unexplained(j, share, float(floor.p_value[j]), (), (), 0.0, None, None))
            else:
                found.append(_named(fit, leftover, leftovers.candidates, share))
    return sorted(found, key=lambda unexplained: -unexplained.share)


def _named(fit: ThreeLoopIdentifier, leftover: Leftover, candidates: Candidates, share: float) -> Unexplained:
    """Structure with its signals."""
    j, rows = leftover.joint, leftover.rows
    depends = dependence(LeftOutRows(rows, candidates), leftover.found)
    return Unexplained(
        j,
        share,
        leftover.p_value,
        tuple(zip(depends.signals, depends.strengths, strict=True)),
        depends.ties,
        depends.explained,
        picture_of(depends, rows, candidates),
        fit_data_term(j, depends.signals, depends.score.ridge, depends.score.reach, rows, candidates, fit.runs_),
    )


def names(unexplained: Unexplained, joint_names: Sequence[str]) -> list[tuple[str, float]]:
    """Signals as columns are called, with their strengths: ``q_elbow_joint``; ``time`` for that of the run."""
    return [(name if j < 0 else f"{name}_{joint_names[j]}", strength) for (name, j), strength in unexplained.depends_on]
