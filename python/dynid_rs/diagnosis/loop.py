"""`diagnose`: closes the loop. What the model lacks is found, added, and the error is reported before and after."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.entries import effect_entries, ranked
from dynid_rs.diagnosis.kinds import Kinds
from dynid_rs.diagnosis.search import Search, search
from dynid_rs.diagnosis.sensors import examine
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.structural_entries import clock_entries, structural_entries
from dynid_rs.findings import Finding
from dynid_rs.identification import ThreeLoopIdentifier
from dynid_rs.recording import Recording

FloatArray = NDArray[np.float64]


@dataclass
class Diagnosis:
    """What was found.

    Attributes
    ----------
    setup : Setup
        The model as it is believed to be now.
    before, after : ThreeLoopIdentifier
        The declared model with its three loops, and the model with what was found.
    findings : list of Finding
        On sensors, clocks and contacts.
    effects : list of dict
        One per effect, most important first; the entries of `result.json`.
    steps : list of dict
        History of the search.
    floor : dict
        `value` (n_joints,), `interval` (n_joints, 2), `method` per joint [torque unit].
    unexplained : list of dict
        Structure that is left, joint by joint.
    search : Search
        Its last state.
    """

    setup: Setup
    before: ThreeLoopIdentifier
    after: ThreeLoopIdentifier
    search: Search
    findings: list[Finding] = field(default_factory=list)
    effects: list[dict[str, Any]] = field(default_factory=list)
    steps: list[dict[str, Any]] = field(default_factory=list)
    floor: dict[str, Any] = field(default_factory=dict)
    unexplained: list[dict[str, Any]] = field(default_factory=list)


def diagnose(
    setup: Setup,
    train: Sequence[Recording],
    test: Sequence[Recording],
    *,
    on_progress: Callable[[str], None] = lambda step: None,
) -> Diagnosis:
    """Trace the residual to what the model lacks, and add it.

    Parameters
    ----------
    setup : Setup
        Robot and options; what is already believed.
    train : sequence of Recording
        Runs to fit and to choose on.
    test : sequence of Recording
        Runs that only the reported errors see.
    on_progress : callable
        Called with a few words before every step.

    Raises
    ------
    DataError
        As `ThreeLoopIdentifier.fit`.
    """
    asked, findings, clocks = examine(setup, train, test, on_progress)
    on_progress("the declared model")
    before = replace(setup, excluded=asked.excluded).identifier().fit(list(train))
    if any(finding.severity == "error" for finding in findings):
        return Diagnosis(setup, before, before, Search(setup, before, Kinds(before)), findings=findings)
    found = search(asked, train, on_progress=on_progress)
    on_progress("the model with what was found")
    after = found.setup.identifier().fit([found.setup.corrected(recording) for recording in train])
    tests = [found.setup.corrected(recording) for recording in test]
    return Diagnosis(
        found.setup,
        before,
        after,
        found,
        findings=[f for f in findings if f.code != "torque_gain" or found.setup.gain_joints],
        effects=ranked(
            [
                *clock_entries(clocks, setup.robot),
                *structural_entries(found, train, tests),
                *effect_entries(found, tests),
            ]
        ),
        steps=[_step(found, step) for step in found.steps],
    )


def _step(found: Search, step: Any) -> dict[str, Any]:
    candidate = step.choice.weighed.candidate
    names = found.setup.robot.joint_names
    return {
        "action": step.action,
        "kind": candidate.kind,
        "joints": [names[j] for j in candidate.joints],
        "evidence": step.choice.weighed.evidence,
        "p_value": step.choice.p_value,
        "rmse_train": step.rmse.tolist(),
    }
