"""The UR10e's currents: what nobody declared is named and takes the error down on a run that nothing has touched."""

import numpy as np
import pytest
from real_diagnosis import CASES, load

from dynid_rs.diagnosis.loop import diagnose
from dynid_rs.results import score

BOUNDS = (0.71, 0.56, 0.57, 0.83, 0.82, 0.71)
"""Error after over before that has to be reached per joint."""
OTHER_DAYS = (0.95, 0.56, 0.57, 0.83, 0.82, 0.82)
"""The same over six more runs, most of other days: friction of joint 0 is not the same every day."""


@pytest.fixture(scope="module")
def diagnosis():
    runs = load(CASES["UR10e, currents"])
    return runs, diagnose(runs.setup(), runs.train, runs.test)


def test_the_error_falls_on_the_run_left_out(diagnosis):
    runs, found = diagnosis
    before, after = (
        score(fit.model_, [fit.states(recording) for recording in runs.test]).rmse
        for fit in (found.before, found.after)
    )
    assert np.all(after < np.array(BOUNDS) * before), after / before


def test_the_error_falls_on_runs_of_other_days(diagnosis):
    _, found = diagnosis
    runs = load(CASES["UR10e, currents, six more runs"]).test

    def errors(recordings):
        fits = found.before, found.after
        return (score(fit.model_, [fit.states(recording) for recording in recordings]).rmse for fit in fits)

    for recording in runs:
        before, after = errors([recording])
        print(recording.name, (after / before).round(2))
    before, after = errors(runs)
    assert np.all(after < np.array(OTHER_DAYS) * before), after / before


def test_load_friction_on_shoulder_and_elbow_and_memory_on_the_wrists_are_named(diagnosis):
    _, found = diagnosis
    named = {(effect["kind"], joint) for effect in found.effects for joint in effect["joints"]}
    for joint in ("shoulder_lift_joint", "elbow_joint"):
        assert ("load_dependent_friction", joint) in named
    for joint in ("wrist_1_joint", "wrist_2_joint", "wrist_3_joint"):
        assert ("friction_hysteresis", joint) in named


def test_nothing_of_the_sensors_is_accused(diagnosis):
    _, found = diagnosis
    assert not [finding for finding in found.findings if finding.severity != "info"]
    assert not any("delay" in effect["kind"] or "gain" in effect["kind"] for effect in found.effects)
