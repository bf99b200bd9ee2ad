"""What was found about sensors and clocks, for people and for the list of effects."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from dynid_rs.base.findings import Finding, joint_words
from dynid_rs.base.units import torque_of
from dynid_rs.runs.encoders import N_PARTS, EncoderDelay
from dynid_rs.runs.recording import Recording
from dynid_rs.sensors.contact import Contact

LEVEL = 2e-3
"""Chance that channels on one clock are said to be on two."""
LEAST_ENCODER_DELAY = 1e-4
"""Encoder channels closer than this [s] are on one clock: their steps alone shift them as much."""


def contact_findings(
    contacts: Sequence[Contact], recordings: Sequence[Recording], *, left_out: bool = True
) -> list[Finding]:
    """One warning per burst, with its rows in the run; `left_out` says whether it is kept from the fit."""
    done = "these samples are neither fitted nor scored"
    if not left_out:
        done = "they are fitted and scored all the same; leave them out, or let `dynid diagnose` do so"
    runs = {recording.name: recording for recording in recordings}
    findings = []
    for contact in contacts:
        recording = runs[contact.run]
        rows = np.searchsorted(recording.t, [contact.start, contact.end])
        joint = contact.most
        peak = contact.peak[contact.joints.index(joint)]
        unit = torque_of(recording.torque_unit, recording.kinds[joint])
        said = unit.replace("*", " ")
        findings.append(
            Finding(
                "contact",
                "warning",
                f"something from outside acts from {contact.start:.2f} to {contact.end:.2f} s on "
                f"{joint_words(*(recording.joints[j] for j in contact.joints))} (up to {abs(peak):.3g} {said} on "
                f"{joint_words(recording.joints[joint])}); {done}",
                contact.run,
                f"tau_{joint}",
                (int(rows[0]), int(rows[1])),
                float(peak),
                unit,
                recording.line_of(int(rows[0])),
            )
        )
    return findings


def encoder_entries(delay: EncoderDelay | None) -> list[dict[str, Any]]:
    """Return the delay between the encoder channels, one for all axes that have two, for the list of effects."""
    from scipy.special import stdtr, stdtrit

    if delay is None or not delay.measured.any():
        return []
    value, std_error = delay.value[delay.measured], np.maximum(delay.std_error[delay.measured], 1e-9)
    weights = 1 / std_error**2
    mean = float(np.sum(weights * value) / np.sum(weights))
    count = len(value)
    # One clock: axes that differ by more than their errors say how little the errors say.
    spread = max(1.0, float(np.sum(weights * (value - mean) ** 2) / (count - 1))) if count > 1 else 1.0
    error = float(np.sqrt(spread / np.sum(weights)))
    dof = count - 1 if spread > 1 else N_PARTS - 1
    reach = float(stdtrit(dof, 0.975)) * error
    p_value = float(2 * stdtr(dof, -abs(mean) / error))
    return [
        {
            "kind": "encoder_delay",
            "joints": tuple(np.flatnonzero(delay.measured).tolist()),
            "value": mean,
            "std_error": error,
            "interval": (mean - reach, mean + reach),
            "p_value": p_value,
            "significant": bool(p_value < LEVEL and abs(mean) > LEAST_ENCODER_DELAY),
            "per_joint": tuple(value.tolist()),
        }
    ]
