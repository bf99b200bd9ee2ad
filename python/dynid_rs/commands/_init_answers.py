"""Findings of `dynid init` that a person can answer with yes: the rule that each one asks for."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from dynid_rs.base.findings import Finding
from dynid_rs.commands._init_proposal import Proposal
from dynid_rs.runs.readers import Config
from dynid_rs.sensors.words import OF_ONE_RUN, gravity_of

SIGNS = {"torque_flipped": ("tau",), "position_flipped": ("q",), "joint_flipped": ("q", "tau")}
"""Signals whose signs a finding says to turn, by its code."""
MOUNTING = "mounting"
ANSWERABLE = (*SIGNS, MOUNTING)
"""Codes of the questions that ``--accept`` takes."""


def answers(questions: Sequence[Finding], rules: Config, n_joints: int) -> Iterator[tuple[str, Proposal]]:
    """What would be written if a finding were right, with its code; findings on one run alone need a file of their own.

    Parameters
    ----------
    questions : sequence of Finding
        As `dynid init` says them.
    rules : Config
        What is known.
    n_joints : int
        Of the robot.
    """
    for code, signals in SIGNS.items():
        found = [one for one in questions if one.code == code and one.column and OF_ONE_RUN not in one.message]
        if not found:
            continue
        turned = {int(str(one.column).rpartition("_")[2]) for one in found}
        signs = dict(rules.signs)
        for signal in signals:
            before = signs.get(signal, (1.0,) * n_joints)
            before = before * n_joints if len(before) == 1 else before
            signs[signal] = tuple(-sign if j in turned else sign for j, sign in enumerate(before))
        value = {signal: [int(sign) for sign in signs[signal]] for signal in signals}
        yield code, Proposal("[signs]", value, found[0].message, replace(rules, signs=signs))
    for one in questions:
        gravity = gravity_of(one) if one.code == MOUNTING else None
        if gravity is not None:
            yield MOUNTING, Proposal("[robot] gravity", list(gravity), one.message, replace(rules, gravity=gravity))
