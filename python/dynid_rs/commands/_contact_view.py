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
from dynid_rs.commands._run import said_of
from dynid_rs.model.units import torque_units

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from dynid_rs._core import TorqueModel
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


@dataclass(frozen=True)
class LookedAt:
    """What was seen on a run: `judged` [s] of it had an answer, with thresholds of this median [torque unit]."""

    run: str
    contacts: list[Contact]
    delay: float
    judged: float
    threshold: list[float] | None


def looked_at(name: str, seen: Observation) -> LookedAt:
    """What the observer saw on a run, contacts by time."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], seen.contact, [False]]).astype(np.int8)))
    found = []
    for first, last in edges.reshape(-1, 2).tolist():
        beyond = np.abs(seen.external[first:last]) / seen.threshold[first:last]
        at, joint = np.unravel_index(np.argmax(beyond), beyond.shape)
        torque = float(seen.external[first + at, joint])
        found.append(Contact(float(seen.t[first]), float(seen.t[last - 1]), int(joint), torque))
    judged: NDArray[np.bool_] = np.all(np.isfinite(seen.threshold), axis=1)
    seconds = float(np.count_nonzero(judged[:-1]) * np.median(np.diff(seen.t))) if len(judged) > 1 else 0.0
    typical = np.median(seen.threshold[judged], axis=0).tolist() if judged.any() else None
    return LookedAt(name, found, seen.delay, seconds, typical)


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


def answer(
    observer: MomentumObserver,
    observed: Sequence[LookedAt],
    said: Mapping[str, list[float]] | None,
    findings: Sequence[Finding],
    errors: Sequence[Exception],
) -> dict[str, Any]:
    """As `--json` prints it; `errors` are of runs that could not be looked at."""
    joints = list(observer.model.robot.joint_names)
    return {
        "format": "dynid-contacts",
        "version": 2,
        "joints": joints,
        "torque_unit": observer.model.torque_unit,
        "false_contacts_per_hour": observer.false_contacts_per_hour,
        "time_constant": observer.time_constant,
        "deviation": said,
        "runs": [
            {
                "run": one.run,
                "judged_seconds": one.judged,
                "threshold": one.threshold,
                "delay": one.delay,
                "contacts": [asdict(contact) | {"joint": joints[contact.joint]} for contact in one.contacts],
            }
            for one in observed
        ],
        "findings": [finding.to_json() for finding in findings],
        **said_of(errors),
    }


def lines(
    observed: Sequence[LookedAt],
    model: TorqueModel,
    said: Mapping[str, list[float]] | None,
    findings: Sequence[Finding],
) -> list[str]:
    """Deviations that were learned, thresholds, and a line per contact."""
    joints, units = model.robot.joint_names, [unit_text(unit) for unit in torque_units(model)]
    all_of_one = len(set(units)) == 1
    text = []
    if said is None:
        text.append(
            "nothing was learned about false contacts (--healthy, two minutes in all): thresholds follow from the "
            "deviation that the model expects"
        )
    else:
        for j, joint in enumerate(joints):
            words = ", ".join(f"{significant(said[name][j], 2)} {name}" for name in DOING)
            text.append(f"{shown(joint)}: without contact off by {words} [{units[j]}]")
    for one in observed:
        late = f" (said {significant(1e3 * one.delay, 2)} ms late)" if one.delay else ""
        text.append(f"{shown(one.run)}: {_count(one)}{late}")
        if one.threshold is not None:
            sizes = [significant(size, 2) for size in one.threshold]
            if all_of_one:
                thresholds = f"{' '.join(sizes)} {units[0]}"
            else:
                thresholds = ", ".join(f"{size} {unit}" for size, unit in zip(sizes, units, strict=True))
            text.append(f"  {significant(one.judged, 2)} s were judged, by thresholds of {thresholds} (median)")
        for contact in one.contacts[:AT_MOST]:
            j = contact.joint
            torque = f"{significant(contact.torque, 2)} {units[j]} on {shown(joints[j])}"
            text.append(f"  {contact.start:.3f} to {contact.end:.3f} s: {torque}")
        if len(one.contacts) > AT_MOST:
            text.append(f"  and {len(one.contacts) - AT_MOST} more (--json has them all)")
    return [*text, *(f"{one.severity}: {words}" for one, words in told_once(findings) if one.severity != "info")]


def _count(one: LookedAt) -> str:
    if one.threshold is None:
        return "could not be judged: it is shorter than what the observer's filter looks back"
    if not one.contacts:
        return "nothing pushes the arm"
    return f"{len(one.contacts)} contact{'s' if len(one.contacts) > 1 else ''}"
