"""`diagnose`: closes the loop. What the model lacks is found, added, and the error is reported before and after."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.diagnosis.deflection import examine_deflection
from dynid_rs.diagnosis.deflection_entries import deflection_entries, merged_gears, seen_again, with_true_encoders
from dynid_rs.diagnosis.dropping import drop_needless
from dynid_rs.diagnosis.entries import effect_entries, ranked
from dynid_rs.diagnosis.kinds import Kinds
from dynid_rs.diagnosis.late_clock import explains_more, with_late_clock
from dynid_rs.diagnosis.patchwork import as_unknown, nameless_patchworks
from dynid_rs.diagnosis.reference import compare
from dynid_rs.diagnosis.remainder import Remainder, lines_told, what_is_left, with_terms
from dynid_rs.diagnosis.remainder_entries import nearest_names, remainder_entries, unknown_entries
from dynid_rs.diagnosis.ripple import RippleCandidate, add_ripple
from dynid_rs.diagnosis.ripple_entries import ripple_entries
from dynid_rs.diagnosis.search import search
from dynid_rs.diagnosis.sensors import channel_errors, examine
from dynid_rs.diagnosis.sensors.messages import delay_entries, delay_findings
from dynid_rs.diagnosis.settling import settle
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.state import Search, fitted, still_trusted
from dynid_rs.diagnosis.structural_entries import clock_entries, structural_entries
from dynid_rs.diagnosis.wrong_geometry import with_other_geometry
from dynid_rs.findings import Finding
from dynid_rs.identification import ThreeLoopIdentifier
from dynid_rs.recording import Recording
from dynid_rs.training import check_motion

FloatArray = NDArray[np.float64]

FLOOR_METHODS = {
    "repetition": "deviation of the torque where the motion repeats",
    "left_out": "what one or two signals can predict of rows left out is taken off the residual",
    "noise": "wide-band noise of the torque channel in the band",
}


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
    reference: _core.TorqueModel | None = None,
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
    reference : TorqueModel, optional
        Trusted model: then the question is what has changed against it, and nothing of it is fitted again.
    on_progress : callable
        Called with a few words before every step.

    Raises
    ------
    DataError
        As `ThreeLoopIdentifier.fit`; a test run with hardly any motion.
    """
    from threadpoolctl import threadpool_limits

    # Many small matrices: threads of a BLAS would only wait for each other.
    with threadpool_limits(limits=1, user_api="blas"):
        if reference is None:
            return _traced(setup, train, test, on_progress)
        return _compared(setup, train, test, reference, on_progress)


def _compared(
    setup: Setup,
    train: Sequence[Recording],
    test: Sequence[Recording],
    reference: _core.TorqueModel,
    on_progress: Callable[[str], None],
) -> Diagnosis:
    """What has changed against a reference; the model with what was found is the reference with it."""
    errors = channel_errors(setup, train)
    fit = setup.identifier(residual=None).fit(list(train))
    if errors:
        return _stopped(setup, fit, errors)
    on_progress("comparing with the reference")
    changes = compare(reference, setup.robot, train, test, cutoff=setup.options.get("cutoff"))
    before, after = copy(fit), copy(fit)
    before.model_, after.model_ = reference, changes.model
    nothing = Search(setup, fit, Kinds(fit))
    return Diagnosis(setup, before, after, nothing, findings=list(changes.findings), effects=list(changes.effects))


def _traced(
    setup: Setup, train: Sequence[Recording], test: Sequence[Recording], on_progress: Callable[[str], None]
) -> Diagnosis:
    """The loop itself: sensors and clocks, the declared model, gears, the search, what is left, the whole model."""
    asked, findings, clocks = examine(setup, train, test, on_progress)
    if setup.robot.n_joints == 1:
        # A drive by itself may well be nothing but what a declared model lacks; no robot file is wrong there.
        findings = [finding for finding in findings if finding.code != "residual_exceeds_torque"]
    on_progress("the declared model")
    before = replace(setup, excluded=asked.excluded).identifier().fit(list(train))
    check_motion([before.states(recording) for recording in test])  # before the long part
    if any(finding.severity == "error" for finding in findings):
        return _stopped(setup, before, findings)
    on_progress("two encoders")
    gears = examine_deflection(before, list(train), list(test))
    began = with_true_encoders(asked, gears)
    found = search(began, train, on_progress=on_progress)
    delays = [clock["joints"] for clock in clocks if clock["kind"] == "torque_delay"]
    late = {j for joints in delays if len(joints) < setup.robot.n_joints for j in joints}
    if late:
        # A drive that is late by itself is rare, and physics that lags looks like one: the better explanation stays.
        on_progress("the same with all drives on one clock")
        one_clock = examine(setup, train, test, on_progress, of_one=False)
        on_one_clock = with_true_encoders(one_clock[0], gears)
        other = search(on_one_clock, train, on_progress=on_progress)
        if explains_more(other, found, sorted(late)):
            found, began, (_, findings, clocks) = other, on_one_clock, one_clock
    found = with_other_geometry(found, began, train, on_progress=on_progress)
    found, delay = with_late_clock(found, began, train, on_progress=on_progress)
    if delay is not None:  # instead of what was seen before the physics
        findings = [finding for finding in findings if finding.code != "torque_delay"]
        clocks = [clock for clock in clocks if clock["kind"] != "torque_delay"]
        findings = [*findings, *delay_findings(setup.robot, delay, two_encoders=before.encoder_delay_ is not None)]
        clocks = [*clocks, *delay_entries(delay)]
    if gears:  # once more, with the load of a model that lacks nothing
        seen = [found.setup.corrected(recording) for recording in (*train, *test)]
        again = examine_deflection(found.fit, seen[: len(train)], seen[len(train) :])
        gears = seen_again(again, gears)
    on_progress("lines in the angle")
    lines = hold_ripple(found, train)
    on_progress("what is left")
    remainder = what_is_left(found, train)
    on_progress("the model with what was found")
    after = _final(found, remainder, train)
    tests = [found.setup.corrected(recording) for recording in test]
    names = setup.robot.joint_names
    nearest = [effect for group in remainder.nearest.values() for effect in group]
    others = [effect for effect in found.setup.effects if not any(effect is near for near in nearest)]
    nameless = [*nearest_names(remainder, names), *nameless_patchworks(others, names)]
    # The first look at gains is told apart from everything else by the search.
    own_gains = {f"tau_{j}" for j in found.setup.gain_joints}
    if gears:  # they know the delay better than the first look
        clocks = [clock for clock in clocks if clock["kind"] != "encoder_delay"]
    return Diagnosis(
        found.setup,
        before,
        after,
        found,
        findings=[f for f in findings if f.code != "torque_gain" or f.column in own_gains],
        effects=ranked(
            merged_gears(
                [
                    *clock_entries(clocks, setup.robot),
                    *deflection_entries(gears, names),
                    *structural_entries(found, train, tests),
                    *as_unknown(effect_entries(found, tests), nameless),
                    *unknown_entries(remainder, names),
                    *ripple_entries(lines_told(lines, found, remainder), found.fit),
                ]
            )
        ),
        steps=[_step(found, step) for step in found.steps],
        floor={
            "value": remainder.floor.value,
            "interval": remainder.floor.interval,
            "method": [FLOOR_METHODS[method] for method in remainder.floor.method],
        },
        unexplained=remainder_entries(remainder, names),
    )


def _stopped(setup: Setup, fit: ThreeLoopIdentifier, findings: list[Finding]) -> Diagnosis:
    """Where the data have an error, nothing is searched for: before and after are the declared model."""
    return Diagnosis(setup, fit, fit, Search(setup, fit, Kinds(fit)), findings=findings)


def _final(found: Search, remainder: Remainder, train: Sequence[Recording]) -> ThreeLoopIdentifier:
    """Model with what was found: the third loop where nothing unknown takes its place."""
    corrected = [found.setup.corrected(recording) for recording in train]
    options = still_trusted(found.setup, train)
    if remainder.terms:
        return with_terms(found, remainder.terms, corrected, options)
    return found.setup.identifier(**options).fit(corrected)


def hold_ripple(found: Search, train: Sequence[Recording]) -> list[RippleCandidate]:
    """Add the ripple that stands out at full rate to the state of the search, and fit everything else beside it."""
    setup, lines = add_ripple(found.setup, found.fit, train)
    if lines:
        found.setup = setup
        found.fit = fitted(setup, train)
        found.kinds = Kinds(found.fit, found.kinds)
        drop_needless(found, train)  # what the lines left in the band may have had another name
        settle(found, train, range(len(found.setup.effects)))
    return lines


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
