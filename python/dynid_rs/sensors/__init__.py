"""Are channels what they are called, and was the arm left to itself? Asked before a model is believed.

By every command that reads runs: `init` (channels), `inspect` (`set_findings`), `identify` (channels before the fit,
`contacts_beside` it), `diagnose`, which ends at a wrong channel and leaves contacts out.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from dynid_rs import _core
from dynid_rs.base.findings import Finding
from dynid_rs.identification.three_loops import NOT_SETTLED, ThreeLoopIdentifier
from dynid_rs.identification.training import prepare_training_run
from dynid_rs.runs.checks import check_recording, is_damage, moving_joints
from dynid_rs.runs.facts import RunFacts, check_facts
from dynid_rs.runs.preprocessing import choose_band, common_rate, prepare
from dynid_rs.runs.recording import Recording
from dynid_rs.sensors.channels import channel_findings
from dynid_rs.sensors.contact import SURE, Contact, Lookout, find_contacts, windows_of
from dynid_rs.sensors.messages import contact_findings

__all__ = ["Contact", "channel_errors", "channels_of", "contacts_beside", "find_contacts", "set_findings", "windows_of"]

STRONG = 2 * SURE
"""A contact is said without a diagnosis from this on: where nothing is left out, only what spoils a fit is of use."""


def set_findings(robot: _core.RobotModel, runs: Sequence[Recording]) -> list[Finding]:
    """What runs of one arm say together: of its channels, of its mounting, of what it carries, and of contacts.

    Nothing where a joint never moves, or where there is too little motion: a model says nothing then, and `runs/checks`
    say that. No contacts where the model is not the arm's.

    Parameters
    ----------
    robot : RobotModel
        As its file says.
    runs : sequence of Recording
        Without damage of their own (`is_damage`), training and test runs alike, each with a name of its own.
    """
    found = channels_of(robot, runs)
    if found:
        return found
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", NOT_SETTLED)  # the fit that is kept says so
            fit = ThreeLoopIdentifier(robot, friction_law="smooth", residual=None).fit(list(runs))
        states = [prepare(recording, fit.band_, fit.rate_) for recording in runs]
    except ValueError:  # too little motion, or joints that stand still
        return []
    contacts = [contact for contact in find_contacts(fit, states) if contact.strength > STRONG]
    return contact_findings(contacts, runs, left_out=False)


def contacts_beside(fit: ThreeLoopIdentifier, train: Sequence[Recording], test: Sequence[Recording]) -> list[Finding]:
    """Contacts that a fit to the training runs shows in them, and in the test runs against what is usual in them.

    A third loop that it has is left aside: it may hold what a contact looks like.
    """
    two = fit.without_third_loop()
    learned, judged = ([two.states(recording) for recording in runs] for runs in (train, test))
    lookout = Lookout(two, learned)
    contacts = [c for c in (*lookout.learned, *lookout.judged(judged)) if c.strength > STRONG]
    return contact_findings(contacts, [*train, *test], left_out=False)


def channels_of(robot: _core.RobotModel, runs: Sequence[Recording]) -> list[Finding]:
    """`channel_findings` of recordings, with the rows and lines of their files; nothing where no model can say."""
    kinds = {(recording.torque_unit, recording.has_motor_encoder) for recording in runs}
    moves = np.any([moving_joints(recording) for recording in runs], axis=0)
    alive = np.any([np.ptp(recording.tau, axis=0) > 0 for recording in runs], axis=0)
    if len(kinds) != 1 or len(moves) != robot.n_joints or not moves.all() or not alive.all():
        return []
    band, rate = choose_band(list(runs)), common_rate(list(runs))
    states = []
    for recording in runs:
        with suppress(ValueError):  # too short, or too little motion
            states.append(prepare_training_run(recording, band, rate))
    if not states:
        return []
    named = {recording.name: recording for recording in runs}
    found = []
    for finding in channel_findings(robot, states, runs[0].torque_unit):
        recording = named[finding.file or states[0].name]
        found.append(replace(finding, rows=(0, recording.n_samples), line=recording.line_of(0)))
    return found


def channel_errors(
    robot: _core.RobotModel, train: Sequence[Recording], test: Sequence[Recording] = ()
) -> list[Finding]:
    """Channels that are not what they are called; first of all, what is wrong with the runs themselves.

    Errors, after which nothing can be concluded, or a warning of what a model can hold.

    Raises
    ------
    DataError
        As `check_training_runs`: a joint that never moves, say, would look like a robot file of another arm.
    """
    facts = [RunFacts.of(recording) for recording in train]
    check_facts(robot, facts, [RunFacts.of(recording).clock for recording in test])
    runs = [*train, *test]
    damaged = [finding for run in runs for finding in check_recording(run, robot) if is_damage(finding)]
    if damaged:  # whatever damage does to a fit looks like another robot, or another order of the joints
        return damaged
    return channels_of(robot, runs)
