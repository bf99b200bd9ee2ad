"""What `dynid contact` answers: lines for people, one object for programs, a table of one run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from dynid_rs.base.findings import Finding, told_once
from dynid_rs.base.numbers import significant
from dynid_rs.base.quoting import shown
from dynid_rs.base.units import unit_text

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from dynid_rs.model.observer import MomentumObserver, Observation

DOING = ("moving", "standing", "turning")
AT_MOST = 20
"""Contacts of a run that people are shown one by one."""


@dataclass(frozen=True)
class Contact:
    """From when to when [s] something pushes, the joint that it passes its threshold on by most, and how hard there."""

    start: float
    end: float
    joint: int
    torque: float


def contacts_of(seen: Observation) -> list[Contact]:
    """Contacts of a run, by time."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], seen.contact, [False]]).astype(np.int8)))
    found = []
    for first, last in edges.reshape(-1, 2).tolist():
        beyond = np.abs(seen.external[first:last]) / seen.threshold[first:last]
        at, joint = np.unravel_index(np.argmax(beyond), beyond.shape)
        torque = float(seen.external[first + at, joint])
        found.append(Contact(float(seen.t[first]), float(seen.t[last - 1]), int(joint), torque))
    return found


def learned(observer: MomentumObserver) -> dict[str, list[float]] | None:
    """Deviation of the observer on every joint by what it does; None where nothing was learned."""
    known = getattr(observer, "uncertainty_", None)
    return None if known is None else {name: np.sqrt(known[name]).tolist() for name in DOING}


def columns(seen: Observation) -> dict[str, NDArray[Any]]:
    """Content of OUT.parquet."""
    table: dict[str, NDArray[Any]] = {"t": seen.t}
    for name in ("external", "threshold", "guide"):
        table |= {f"{name}_{j}": np.ascontiguousarray(column) for j, column in enumerate(getattr(seen, name).T)}
    return table | {"contact": seen.contact, "status": seen.status}


Observed = Sequence[tuple[str, list[Contact], float]]


def answer(
    observed: Observed,
    joints: Sequence[str],
    unit: str,
    said: Mapping[str, list[float]] | None,
    findings: Sequence[Finding],
) -> dict[str, Any]:
    """As `--json` prints it."""
    return {
        "format": "dynid-contacts",
        "version": 1,
        "joints": list(joints),
        "torque_unit": unit,
        "deviation": said,
        "runs": [
            {
                "run": name,
                "delay": delay,
                "contacts": [asdict(contact) | {"joint": joints[contact.joint]} for contact in contacts],
            }
            for name, contacts, delay in observed
        ],
        "findings": [finding.to_json() for finding in findings],
    }


def lines(
    observed: Observed,
    joints: Sequence[str],
    unit: str,
    said: Mapping[str, list[float]] | None,
    findings: Sequence[Finding],
) -> list[str]:
    """Deviations that were learned, and a line per contact."""
    text = []
    if said is None:
        text.append(
            "nothing was learned about false contacts (--healthy, two minutes in all): thresholds follow from the "
            "deviation that the model expects"
        )
    else:
        for j, joint in enumerate(joints):
            words = ", ".join(f"{significant(said[name][j], 2)} {name}" for name in DOING)
            text.append(f"{shown(joint)}: without contact off by {words} [{unit_text(unit)}]")
    for name, contacts, delay in observed:
        late = f" (said {significant(1e3 * delay, 2)} ms late)" if delay else ""
        count = f"{len(contacts)} contact{'s' if len(contacts) > 1 else ''}" if contacts else "nothing pushes the arm"
        text.append(f"{shown(name)}: {count}{late}")
        for one in contacts[:AT_MOST]:
            text.append(
                f"  {one.start:.3f} to {one.end:.3f} s: {significant(one.torque, 2)} {unit_text(unit)} "
                f"on {shown(joints[one.joint])}"
            )
        if len(contacts) > AT_MOST:
            text.append(f"  and {len(contacts) - AT_MOST} more (--json has them all)")
    return [*text, *(f"{one.severity}: {words}" for one, words in told_once(findings) if one.severity != "info")]
