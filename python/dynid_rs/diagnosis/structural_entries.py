"""Clocks, gravity, geometry, gains and encoders that were found, as `result.json` and the report tell them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from dynid_rs import _core
from dynid_rs.diagnosis.entries import refuted_entries, tie_entries
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.state import Choice, Search, fitted, rms
from dynid_rs.diagnosis.structural import Parameters, levelled, put_back, structural_parameters
from dynid_rs.recording import Recording
from dynid_rs.results import score


def clock_entries(clocks: Sequence[dict[str, Any]], robot: _core.RobotModel) -> list[dict[str, Any]]:
    """Return entries of the delays that are significant."""
    entries = []
    for clock in clocks:
        if not clock["significant"]:
            continue
        entries.append(
            {
                "kind": clock["kind"],
                "joints": [robot.joint_names[j] for j in clock["joints"]],
                "parameters": [
                    {"name": "delay", "value": clock["value"], "unit": "s", "interval": list(clock["interval"])}
                ],
                "p_value": clock["p_value"],
                "ties": [],
            }
        )
    return entries


def structural_entries(found: Search, train: Sequence[Recording], test: Sequence[Recording]) -> list[dict[str, Any]]:
    """One entry per tilt, displacement, gain and eccentricity of the final setup; `test` on its clock."""
    parts = structural_parameters(found.fit, found.setup)
    if not parts:
        return []
    names = found.setup.robot.joint_names
    told = {step.choice.weighed.candidate.place: step.choice for step in found.steps if step.action == "added"}
    states = [found.fit.states(recording) for recording in test]
    after = score(found.fit.model_, states).rmse.tolist() if test else []
    entries = []
    for part in parts:
        without = fitted(_without(found.setup, part), train)
        choice: Choice | None = told.get((part.kind, part.joints))
        entries.append(
            {
                "kind": part.kind,
                "joints": [names[j] for j in part.joints],
                "parameters": part.to_json(),
                "p_value": 1.0 if choice is None else choice.p_value,
                "rmse_train_before": rms(without).tolist(),
                "rmse_train_after": rms(found.fit).tolist(),
                "rmse_test_before": score(without.model_, states).rmse.tolist() if test else [],
                "rmse_test_after": after,
                "ties": [*tie_entries(found, choice), *_same_thing(part, names)],
                "told_apart_from": refuted_entries(found, choice),
            }
        )
    return entries


def _same_thing(part: Parameters, joint_names: Sequence[str]) -> list[dict[str, Any]]:
    """Names that no data can tell from this one: a first joint whose frame is turned stands on a tilted base."""
    return [{"kind": "kinematic_error", "joints": [joint_names[0]]}] if part.kind == "gravity_tilt" else []


def _without(setup: Setup, part: Parameters) -> Setup:
    """Setup as if this had not been found."""
    if part.kind == "gravity_tilt":
        return levelled(setup)
    if part.kind == "kinematic_error":
        return put_back(setup, part.joints[0])
    if part.kind == "torque_gain":
        return replace(setup, gain_joints=tuple(j for j in setup.gain_joints if j not in part.joints))
    error = np.array(setup.encoder_error)
    error[list(part.joints)] = 0.0
    return replace(setup, encoder_error=error)
