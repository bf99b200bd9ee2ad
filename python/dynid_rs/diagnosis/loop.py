"""`diagnose`: closes the loop. What the model lacks is found, added, and the error is reported before and after.

channels and contacts  ->  declared model  ->  mounting, encoders centred  ->  search (`search.py`)
->  ripple at full rate  ->  gears, where there are two encoders  ->  rivals, what is left  ->  the last fit
->  errors on runs that chose nothing
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.base.findings import Finding, blaming
from dynid_rs.diagnosis.belief import fitted
from dynid_rs.diagnosis.entries import effect_entries
from dynid_rs.diagnosis.examination import examine
from dynid_rs.diagnosis.gears import centred, gear_entries
from dynid_rs.diagnosis.hypotheses import Catalogue
from dynid_rs.diagnosis.misfit import ended, nameless, of_the_angle
from dynid_rs.diagnosis.mounting import mounted
from dynid_rs.diagnosis.open_questions import OpenQuestions, open_questions
from dynid_rs.diagnosis.outcome import Diagnosis
from dynid_rs.diagnosis.ripple import find_ripple, measured_beside, ripple_entries
from dynid_rs.diagnosis.rivals import settle_rivals, weigh_rivals
from dynid_rs.diagnosis.search import look, search
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.shaped import Place
from dynid_rs.diagnosis.standing import without_nothing
from dynid_rs.diagnosis.unexplained import stood_in, unexplained_entries
from dynid_rs.diagnosis.weighing import last_fit
from dynid_rs.identification.doubt import Doubt
from dynid_rs.identification.smooth_friction import SmoothFrictionIdentifier
from dynid_rs.identification.training import check_motion
from dynid_rs.reference import compare
from dynid_rs.regression.kept_columns import keeping_columns
from dynid_rs.runs.given import Runs, as_recordings
from dynid_rs.runs.recording import Recording
from dynid_rs.runs.splitting import Split, refuse_repeats, split_runs
from dynid_rs.sensors import channel_errors

FloatArray = NDArray[np.float64]


def diagnose(
    setup: Setup | _core.RobotModel,
    train: Runs,
    test: Runs | None = None,
    *,
    reference: _core.TorqueModel | None = None,
    doubt: Doubt | None = None,
    after: OpenQuestions | None = None,
    on_progress: Callable[[str], None] = lambda step: None,
) -> Diagnosis:
    """Trace the residual to what the model lacks, and add it.

    Parameters
    ----------
    setup : RobotModel or Setup
        The robot, or a setup with options and what is already believed.
    train : Recording, data frame, or list of them
        Runs to fit and to choose on. What the columns of data frames are is the setup's option `config`.
    test : Recording, data frame, or list of them, optional
        Runs that only the reported errors see; without them the last run, or the last third of a lone one, is kept
        aside.
    reference : TorqueModel, optional
        Trusted model: then the question is what has changed against it, and nothing of it is fitted again.
    doubt : Doubt, optional
        How well the reference's parameters are known; without it, as if it had been learned from as much as `train`.
    after : OpenQuestions, optional
        What an earlier diagnosis left open (`Diagnosis.asked`), `train` holding its runs and new ones: only that is
        asked, and what it named is checked.
    on_progress : callable
        Called with a few words before every step.

    Raises
    ------
    ValueError
        Neither a robot nor a setup, or something else than runs; options under which no evidence can be weighed.
    DataError
        As `ThreeLoopIdentifier.fit`; a test run with hardly any motion, or that is learned from too.
    """
    from threadpoolctl import threadpool_limits

    if not isinstance(setup, Setup | _core.RobotModel):
        raise ValueError(
            f"diagnose takes a RobotModel or a Setup first, and runs behind it, got {type(setup).__name__}; read a "
            "robot with RobotModel.from_urdf"
        )
    setup = setup if isinstance(setup, Setup) else Setup(setup)
    config = setup.options.get("config")
    learned = as_recordings(train, setup.robot, config)
    if test is None:
        split = split_runs(learned, [])
    else:
        split = Split(learned, as_recordings(test, setup.robot, config))
        refuse_repeats(split.train, split.test)
    # Many small matrices: threads of a BLAS would only wait for each other.
    with threadpool_limits(limits=1, user_api="blas"), keeping_columns():
        if reference is None:
            found = _traced(setup, split.train, split.test, after, on_progress)
        else:
            found = _compared(setup, split.train, split.test, reference, doubt, on_progress)
    found.train, found.test = split.train, split.test
    found.findings += [] if split.finding is None else [split.finding]
    return found


def _traced(
    setup: Setup,
    train: Sequence[Recording],
    test: Sequence[Recording],
    after: OpenQuestions | None,
    on_progress: Callable[[str], None],
) -> Diagnosis:
    """The loop itself."""
    setup, before, findings = examine(setup, train, test, on_progress)
    if before is None:
        return _of_errors(setup, train, findings)
    if not isinstance(before.friction_, SmoothFrictionIdentifier):
        raise ValueError("a diagnosis needs the smooth law of friction; leave friction_law out of the setup's options")
    check_motion([before.states(recording) for recording in test])  # before the long part
    setup = replace(setup, options={**setup.options, "cutoff": before.band_.cutoff})  # the motion stays what it is
    on_progress("mounting")
    asked, odds = mounted(setup, before) if after is None else (setup, 0.0)
    asked, fit = centred(asked, train, before if asked is setup else fitted(asked, train), setup.encoder_error)
    found = search(asked, train, fit, mounting_odds=odds, after=after, on_progress=on_progress)
    on_progress("ripple")
    lines = find_ripple(found.setup, found.fit, train)
    if lines:
        found.hold([held for family in lines for held in family.held()])
        lines = measured_beside(lines, found.setup, found.fit, train)
        found.hold([held for family in lines for held in family.held()])
        look(found, on_progress, once_more=True)  # for what the ripple has covered
    found.setup, found.fit = centred(found.setup, train, found.fit, setup.encoder_error)
    found.catalogue = Catalogue(found.fit, found.catalogue)
    on_progress("what is left")
    contests, beside = settle_rivals(found), found.fit
    left = stood_in(found)
    if found.fit is not beside:
        contests = weigh_rivals(found)
    without_name = nameless(found, contests)
    left_open = open_questions(found, contests, without_name)
    found.setup = ended(found.setup, without_name, found.fit.model_.domain[0])
    if found.fit is not fit:  # judged by the noise that it leaves, and only then weighed
        settled = False
        while not settled:  # each time a torque less is there
            found.fit = last_fit(found, without_name)
            settled = not without_nothing(found)
        found.catalogue = Catalogue(found.fit, found.catalogue)
    names = setup.robot.joint_names
    entries = [
        *gear_entries(found.fit, of_the_angle(without_name)),
        *effect_entries(found, test, without_name),
        *ripple_entries(lines, found.fit),
    ]
    return Diagnosis(
        found.setup,
        before,
        found.fit,
        findings=findings,
        entries=[{**entry, "rank": rank + 1} for rank, entry in enumerate(sorted(entries, key=_doubt))],
        steps=[_step(*step, names) for step in found.steps],
        left=unexplained_entries(left, names),
        asked=left_open,
    )


def _doubt(entry: Mapping[str, Any]) -> float:
    """What entries are ordered by, the most certain first; a clock, which is measured, before all others."""
    return -float(entry.get("evidence", np.inf))


def _of_errors(setup: Setup, train: Sequence[Recording], findings: list[Finding]) -> Diagnosis:
    """The declared model alone, beside what is wrong with the runs."""
    with blaming(findings):
        fit = setup.identifier(residual=None).fit(list(train))
    return Diagnosis(setup, fit, fit, findings=findings)


def _compared(
    setup: Setup,
    train: Sequence[Recording],
    test: Sequence[Recording],
    reference: _core.TorqueModel,
    doubt: Doubt | None,
    on_progress: Callable[[str], None],
) -> Diagnosis:
    """What has changed against a reference; the model with what was found is the reference with it."""
    said = channel_errors(setup.robot, train, test)
    if any(finding.severity == "error" for finding in said):
        return _of_errors(setup, train, said)
    fit = setup.identifier(residual=None).fit(list(train))
    on_progress("comparing with the reference")
    changes = compare(reference, setup.robot, train, test, cutoff=setup.options.get("cutoff"), doubt=doubt)
    before, after = copy(fit), copy(fit)
    before.model_, after.model_ = reference, changes.model
    findings, entries = [*said, *changes.findings], list(changes.effects)
    return Diagnosis(setup, before, after, findings=findings, entries=entries, against_reference=True)


def _step(action: str, place: Place, left: FloatArray, names: Sequence[str]) -> dict[str, Any]:
    kind, joints = place
    return {"action": action, "kind": kind, "joints": [names[j] for j in joints], "rmse_train": left.tolist()}
