"""What two encoders reveal, as `result.json` tells it, and what it changes in the setup."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from dynid_rs.diagnosis.deflection import DeflectionFinding
from dynid_rs.diagnosis.setup import Setup

ECCENTRICITY = "encoder_eccentricity"
ELASTIC = ("joint_elasticity", "nonlinear_elasticity")
LOSS = "gear_hysteresis"


def with_true_encoders(setup: Setup, found: Sequence[DeflectionFinding]) -> Setup:
    """Return the setup with the link encoders' errors that were found, on top of those it has."""
    error = np.array(setup.encoder_error)
    for finding in found:
        if finding.kind == ECCENTRICITY:
            values = {parameter.name: parameter.value for parameter in finding.parameters}
            error[finding.joints[0]] += [values["cosine"], values["sine"]]
    return setup if np.array_equal(error, setup.encoder_error) else replace(setup, encoder_error=error)


def seen_again(again: Sequence[DeflectionFinding], first: Sequence[DeflectionFinding]) -> list[DeflectionFinding]:
    """Findings of the second look, and of the first the encoders' errors, which the second no longer shows."""
    corrected = [finding for finding in first if finding.kind == ECCENTRICITY]
    joints = {finding.joints for finding in corrected}
    further = [finding for finding in again if finding.kind != ECCENTRICITY or finding.joints not in joints]
    return [*corrected, *further]


def deflection_entries(found: Sequence[DeflectionFinding], joint_names: Sequence[str]) -> list[dict[str, Any]]:
    """Entries of effects that show in the deflection; their errors are angles, so they stand in a note."""
    entries = []
    for finding in found:
        entry = finding.to_json(joint_names, 0)
        before, after = (np.sqrt(np.mean(np.square(x))) for x in (finding.rms_test_before, finding.rms_test_after))
        for name in ("rmse_test_before", "rmse_test_after", "unit", "rank"):
            entry.pop(name, None)
        x, partial, curve = finding.plot
        order = np.argsort(x, kind="stable")
        entry["note"] = (
            f"seen in motor minus link position: on the test runs {before:.3g} rad before, {after:.3g} after"
        )
        entry["plot"] = {
            "joint": joint_names[finding.joints[0]],
            "signal": finding.signal,
            "unit": "1",
            "x": x[order].tolist(),
            "partial": partial[order].tolist(),
            "curve_x": x[order].tolist(),
            "curve": curve[order].tolist(),
        }
        entries.append(entry)
    return entries


def merged_gears(entries: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Entries with the torque that a gear loses told by the elasticity of that gear, where that was found."""
    losses = {entry["joints"][0]: entry for entry in entries if entry["kind"] == LOSS}
    out = []
    for entry in entries:
        loss = losses.get(entry["joints"][0]) if entry["kind"] in ELASTIC else None
        if loss is not None:
            errors = {name: value for name, value in loss.items() if name.startswith("rmse")}
            entry = {**entry, **errors, "parameters": [*entry["parameters"], *loss["parameters"]]}
            losses.pop(entry["joints"][0])
            entry["note"] += "; the errors here are those of the torque that it loses in its teeth"
        out.append(entry)
    return [entry for entry in out if entry["kind"] != LOSS or entry["joints"][0] in losses]
