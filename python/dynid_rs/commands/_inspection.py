"""One run file as `dynid inspect` sees it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.errors import DataError
from dynid_rs.base.findings import Finding
from dynid_rs.commands._run import EXIT_NO, EXIT_UNUSABLE, error_object
from dynid_rs.runs.checks import check_recording, gaps, is_damage, refused_sources, relative_jitter, severity_order
from dynid_rs.runs.checks.beside import beside_each_other
from dynid_rs.runs.readers import Config, Run, read_run
from dynid_rs.runs.readers.file_words import in_file_words
from dynid_rs.runs.recording import Recording


@dataclass(frozen=True)
class Inspection:
    """One file: what was read and found, or why it could not be read."""

    path: Path
    run: Run | None = None
    findings: tuple[Finding, ...] = ()
    error: Exception | None = None


def inspect_run(
    path: Path, robot: Any | None, rules: Config, name: str, config: Path | None = None
) -> list[Inspection]:
    """Read and check one file, which messages call `name`, part by part; what it did wrong is kept, not raised.

    `config`: where `rules` stand, if anywhere.
    """
    try:
        run, lacking = _read(path, robot, rules, name, config)
        checked = [(part, check_recording(part, robot)) for part in run.parts]
    except (ValueError, OSError) as error:
        return [Inspection(path, error=error)]
    said = [*lacking, *run.findings(run.parts[0].name)]
    inspections = []
    for k, (part, found) in enumerate(checked):
        heard = found if run.has_torque else [one for one in found if not (one.column or "").startswith("tau")]
        named = (in_file_words(finding, run.columns) for finding in heard)
        own = sorted((*named, *(said if k == 0 else ())), key=severity_order)
        inspections.append(Inspection(path, replace(run, parts=(part,)), tuple(own)))
    return inspections


def _read(path: Path, robot: Any | None, rules: Config, name: str, config: Path | None) -> tuple[Run, list[Finding]]:
    """One file, and what it lacks: a run without torque is read for its motion."""
    try:
        return read_run(path, robot, rules, name=name), []
    except DataError as error:
        if error.code != "missing_column":
            raise
        run = read_run(path, robot, rules, name=name, require_torque=False)
        lacking = f"{str(error).removeprefix(f'{name}: ')}{hint(path, error, config)}"
        text = f"{lacking}; `dynid estimate` takes the run for its motion all the same"
        return run, [Finding(error.code, "error", text, run.parts[0].name, "tau_0")]


def compared(inspections: Sequence[Inspection], robot: Any | None) -> list[Inspection]:
    """Add what runs say of each other: units of time, samples that are there twice, and with a robot its channels."""
    result = _beside(inspections)
    return result if robot is None else _set(result, robot)


def _set(inspections: Sequence[Inspection], robot: Any) -> list[Inspection]:
    from dynid_rs.sensors import set_findings

    read = {str(k): one for k, one in enumerate(inspections) if one.run is not None}
    damaged = any(is_damage(finding) for one in read.values() for finding in one.findings)
    if not read or damaged or not all(one.run is not None and one.run.has_torque for one in read.values()):
        return list(inspections)
    runs = [
        replace(one.run.recording.without(*refused_sources(one.findings)), name=key)
        for key, one in read.items()
        if one.run is not None
    ]
    result = list(inspections)
    for finding in set_findings(robot, runs):
        one = read[finding.file or "0"]
        assert one.run is not None
        named = in_file_words(replace(finding, file=one.run.recording.name), one.run.columns)
        place = inspections.index(one)
        result[place] = replace(one, findings=tuple(sorted((*one.findings, named), key=severity_order)))
    return result


def _beside(inspections: Sequence[Inspection]) -> list[Inspection]:
    result = list(inspections)
    read = [(k, one.run) for k, one in enumerate(inspections) if one.run is not None]
    told = beside_each_other([run.recording for _, run in read], [inspections[k].findings for k, _ in read])
    for (k, run), findings in zip(read, told, strict=True):
        own = result[k].findings
        named = (one if one in own else in_file_words(one, run.columns) for one in findings)
        result[k] = replace(result[k], findings=tuple(named))
    return result


def exit_code(inspections: list[Inspection]) -> int:
    """2 when a file is unreadable, 1 when one has errors in it, else 0."""
    if any(inspection.error is not None for inspection in inspections):
        return EXIT_UNUSABLE
    return EXIT_NO if any(f.severity == "error" for item in inspections for f in item.findings) else 0


def to_json(inspection: Inspection) -> dict[str, object]:
    """Return everything `inspect` knows about one file, for programs."""
    if inspection.run is None:
        error = inspection.error or ValueError("not read")
        return {"path": str(inspection.path), "error": error_object(error)}
    rec, columns, has_torque = inspection.run.recording, inspection.run.columns, inspection.run.has_torque
    return {
        "path": str(inspection.path),
        "kind": inspection.run.kind,
        "n_samples": rec.n_samples,
        "duration_s": rec.duration,
        "rate_hz": rec.rate,
        "jitter": relative_jitter(rec),
        "n_gaps": len(gaps(rec)),
        "torque_unit": rec.torque_unit if has_torque else None,
        "encoders": 2 if rec.has_motor_encoder else 1,
        "columns": {
            "t": columns.time,
            **{signal: list(names) for signal, names in columns.signals.items()},
            "ignored": list(columns.ignored),
        },
        "joints": [_joint(rec, joint, has_torque=has_torque) for joint in range(rec.n_joints)],
        "findings": [finding.to_json() for finding in inspection.findings],
    }


def _joint(rec: Recording, joint: int, *, has_torque: bool) -> dict[str, object]:
    velocity = joint_velocity(rec, joint)
    tau = rec.tau[:, joint]
    return {
        "name": rec.joints[joint],
        "kind": rec.kinds[joint],
        "q": [float(rec.q[:, joint].min()), float(rec.q[:, joint].max())],
        "speed_p99": float(np.percentile(np.abs(velocity), 99)),
        "tau": [float(tau.min()), float(tau.max())] if has_torque else None,
        "tau_std": float(tau.std()) if has_torque else None,
    }


def joint_velocity(rec: Recording, joint: int) -> NDArray[np.float64]:
    """Velocity (n,) of a joint: the recorded one, or the position's differences."""
    if rec.dq is not None:
        return np.asarray(rec.dq[:, joint])
    with np.errstate(over="ignore"):  # the clock of a damaged run may be beyond all clocks, and is found
        return np.asarray(np.gradient(rec.q[:, joint], rec.t))


def hint(path: Path, error: Exception, config: Path | None) -> str:
    """Point at a config that lies beside the run and was not given."""
    beside = path.parent / "dynid.toml"
    missing = getattr(error, "code", "") == "missing_column"
    return f" (there is {beside}: give it with --config)" if config is None and missing and beside.is_file() else ""
