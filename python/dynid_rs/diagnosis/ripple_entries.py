"""Ripple that was found at full rate, as `result.json` and the report tell it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from dynid_rs.diagnosis.ripple import RippleCandidate
from dynid_rs.identification import ThreeLoopIdentifier


def ripple_entries(found: Sequence[RippleCandidate], fit: ThreeLoopIdentifier) -> list[dict[str, Any]]:
    """One entry per family of an order and twice it, the strongest first."""
    entries = []
    for candidate in sorted(found, key=lambda one: one.p_value):
        before, after = candidate.residual_rms
        parameters: list[dict[str, Any]] = []
        for k, line in enumerate(candidate.lines):
            name = "" if k == 0 else "_2"
            low, high = line.amplitude_interval
            parameters += [
                {"name": f"cycles{name}", "value": line.order, "unit": "1/turn", "interval": list(line.order_interval)},
                {
                    "name": f"amplitude{name}",
                    "value": line.amplitude,
                    "unit": fit.torque_unit_,
                    "interval": [low, high],
                },
                {"name": f"phase{name}", "value": line.phase, "unit": "rad", "interval": None},
            ]
        entries.append(
            {
                "kind": candidate.kind,
                "joints": [fit.robot.joint_names[j] for j in candidate.joints],
                "parameters": parameters,
                "p_value": candidate.p_value,
                "ties": [],
                "note": f"a line in the angle, found and sized at full rate: the joint's residual there falls from "
                f"{before:.3g} to {after:.3g} {fit.torque_unit_}; most of it lies above the band of the other errors",
            }
        )
    return entries
