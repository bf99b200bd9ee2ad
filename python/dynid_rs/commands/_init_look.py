"""What `dynid init` finds out about runs before any fit: columns by their names, units by their numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from dynid_rs.base.errors import DataError
from dynid_rs.base.findings import Finding
from dynid_rs.base.guide import page
from dynid_rs.base.quoting import shown
from dynid_rs.commands._init_answers import answers
from dynid_rs.commands._init_proposal import Proposal
from dynid_rs.commands._init_words import fact, told
from dynid_rs.commands._inputs import run_names
from dynid_rs.runs.checks.clocks import WORDS, Clock, likely_unit
from dynid_rs.runs.checks.clocks import clock_findings as clocks_found
from dynid_rs.runs.checks.limits import check_limits
from dynid_rs.runs.readers import Config, Run, open_run, read_run
from dynid_rs.runs.readers.columns import INIT_WRITES, fill, match_columns
from dynid_rs.runs.readers.config import MOTOR_SIDE, UNITS, ColumnRule
from dynid_rs.runs.readers.dialects import speak
from dynid_rs.runs.readers.file_words import in_file_words
from dynid_rs.runs.readers.guess import Guess, guess
from dynid_rs.runs.readers.headers import by_plain_names
from dynid_rs.runs.readers.list_cells import lists_explained
from dynid_rs.runs.recording import FloatArray, Recording

ROUNDS = 8
"""Each answer changes what the next look sees: a unit of time comes before one of velocity."""
ALIKE = 0.05
"""Ratios of two channels within this share of a unit's factor are that unit."""
GEARED = 1.5
"""A motor's angle that is so many times the link's was not divided by the gear ratio."""
CURRENTS = (
    "currents without a gain: no torques, and what is learned from them is not in N m; give [drive] gain, N m per "
    "unit of the current at each joint"
)


@dataclass
class Look:
    """What was found: rules, what they rest on, and what only a person can answer."""

    rules: Config
    runs: list[Run] = field(default_factory=list)
    guessed: Guess | None = None
    taken: list[Proposal] = field(default_factory=list)
    refused: list[Proposal] = field(default_factory=list)
    questions: list[Finding] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def look(
    robot: Any,
    paths: Sequence[Path],
    rules: Config,
    ask: Callable[[Proposal], bool],
    answer: Callable[[str, Proposal], bool] = lambda code, proposal: False,
) -> Look:
    """Look at runs of a robot.

    Parameters
    ----------
    robot : RobotModel
        The arm.
    paths : sequence of Path
        Runs that one `dynid.toml` is for.
    rules : Config
        What is known already; it stays as it is.
    ask : callable
        Whether a proposal is taken.
    answer : callable
        Whether what a question asks for, given by its code, is so. By default it stays a question.

    Raises
    ------
    DataError, OSError
        A run cannot be read, whatever its columns are called.
    """
    names = run_names(paths)
    found = _named(robot, paths[0], rules, names[0])
    for _ in range(ROUNDS):
        found.runs = _read(paths, names, robot, found.rules)
        proposal = next(_proposals(robot, found), None)
        if proposal is None:
            break
        if ask(proposal):
            found.rules = proposal.rules
            found.taken.append(proposal)
        else:
            found.refused.append(proposal)
    found.questions = _questions(robot, found)
    denied: set[str] = set()
    for _ in range(ROUNDS):
        asked = answers(found.questions, found.rules, robot.n_joints)
        open_ones = [one for one in asked if one[0] not in denied]
        if not open_ones:
            break
        code, proposal = open_ones[0]
        denied.add(code)  # and asked once, whatever the next look says
        if not answer(code, proposal):
            continue
        found.rules = proposal.rules
        found.taken.append(proposal)
        if found.rules.gravity is not None:
            robot = robot.with_gravity(list(found.rules.gravity))
        found.runs = _read(paths, names, robot, found.rules)
        found.questions = _questions(robot, found)
    found.questions = [
        one if one.code == "joint_order" else _named_as_there(one, found.runs) for one in found.questions
    ]
    found.notes += told(found.runs)
    signals = found.runs[0].columns.signals
    if "tau" in signals and found.rules.drive_gain is not None:
        # For currents alone: other commands refuse it beside torque.
        found.rules = replace(found.rules, drive_gain=None)
    if "current" in signals and "tau" not in signals and found.rules.drive_gain is None:
        found.notes.append(f"{shown(signals['current'][0])}, ... are {CURRENTS}")
    found.notes = list(dict.fromkeys(found.notes))
    return found


def _named_as_there(finding: Finding, runs: Sequence[Run]) -> Finding:
    columns = {part.name: run.columns for run in runs for part in run.parts}
    return in_file_words(finding, columns.get(finding.file or "", runs[0].columns))


def _read(paths: Sequence[Path], names: Sequence[str], robot: Any, rules: Config) -> list[Run]:
    return [read_run(path, robot, rules, name=name) for path, name in zip(paths, names, strict=True)]


def _named(robot: Any, path: Path, rules: Config, name: str) -> Look:
    """Rules by the names of the first run's columns."""
    joints = tuple(robot.joint_names)
    table = open_run(path, joints, rules, name=name)
    given = by_plain_names(rules, table.written)
    spoken, _ = speak(table.names, given, table.file, table.stamps)
    try:
        match_columns(table, joints, spoken)
        return Look(rules)
    except DataError as error:
        if error.code not in ("missing_column", "too_many_joints", "ambiguous_column"):
            raise
    said = {key: rule for key, rule in spoken.columns.items() if _fits(rule, joints, table.names)}
    names = guess(table.names, joints, table.units, said)
    columns = dict(names.columns)
    if "t" not in spoken.columns and names.time:
        columns["t"] = names.time[0]
    if "tau" in columns and "current" in columns:
        columns.pop("current")
    guessed = replace(_moved(rules, names.moved), columns={**columns, **said, **given.columns}, units=spoken.units)
    with lists_explained(table, joints):
        try:
            match_columns(table, joints, guessed)
        except DataError as error:
            raise DataError(
                f"{str(error).removesuffix(INIT_WRITES)}; the names say no more, so write it by hand "
                f"({page('reference/dynid_toml')})",
                code=error.code,
                file=error.file,
                column=error.column,
            ) from None
    return Look(guessed, guessed=names)


def _moved(rules: Config, names: Mapping[str, str]) -> Config:
    """Gears and signs of motors whose signals are read as those of the links: they go with them."""
    applies = tuple(names.get(signal, signal) for signal in rules.gear_apply_to)
    own = {signal: sign for signal, sign in rules.signs.items() if signal not in names}
    signs = {names[signal]: sign for signal, sign in rules.signs.items() if signal in names} | own
    return replace(rules, gear_apply_to=tuple(dict.fromkeys(applies)), signs=signs)


def _fits(rule: ColumnRule, joints: Sequence[str], names: Sequence[str]) -> bool:
    """Whether a log's own rule holds for these joints: where it calls them by other names than the robot, none does."""
    by_name = isinstance(rule, str) and "{joint}" in rule
    return not by_name or all(fill(str(rule), k, joint) in names for k, joint in enumerate(joints))


def _proposals(robot: Any, found: Look) -> Iterator[Proposal]:
    """What the numbers say, the first things first; what was answered already is not asked again."""
    asked = {one.key for one in (*found.taken, *found.refused)}
    longest = [run.recording for run in found.runs]
    for key, propose in (
        ("[units] time", _time),
        ("[units] angle", _angle),
        ("[units] length", _length),
        ("[units] velocity", _velocity),
        ("[gear] ratio", _gear),
        ("[columns] current", _current),
    ):
        if key not in asked:
            proposal = propose(robot, longest, found)
            if proposal is not None:
                yield proposal


def _time(robot: Any, runs: Sequence[Recording], found: Look) -> Proposal | None:
    clocks = [Clock.of(run) for run in runs]
    for at, finding in clocks_found(clocks).items():
        unit = likely_unit(clocks[at])
        if unit is not None and (len(runs) == 1 or len(clocks_found(clocks)) == len(runs)):
            rules = replace(found.rules, units={**found.rules.units, "time": unit})
            reason = f"{finding.file}: {fact(finding.message)}"
            if np.all(np.diff(runs[at].t) == 1.0):
                reason += (
                    f"; but t counts 1, 2, 3, ...: if it counts rows and not {WORDS[unit]}, write a column of seconds, "
                    "row times step, instead"
                )
            return Proposal("[units] time", unit, reason, rules)
    return None


def _angle(robot: Any, runs: Sequence[Recording], found: Look) -> Proposal | None:
    return _of_position(robot, runs, found, "angle", "deg", "units_degrees")


def _length(robot: Any, runs: Sequence[Recording], found: Look) -> Proposal | None:
    return _of_position(robot, runs, found, "length", "mm", "units_length")


def _of_position(
    robot: Any, runs: Sequence[Recording], found: Look, quantity: str, unit: str, code: str
) -> Proposal | None:
    """The positions' unit, by where they go."""
    if quantity in found.rules.units:
        return None
    for run in runs:
        for limited in (robot, None):
            said = next((one for one in check_limits(run, limited) if one.code == code), None)
            if said is not None:
                rules = replace(found.rules, units={**found.rules.units, quantity: unit})
                return Proposal(f"[units] {quantity}", unit, f"{run.name}: {fact(said.message)}", rules)
    return None


def _velocity(robot: Any, runs: Sequence[Recording], found: Look) -> Proposal | None:
    """The velocity's unit by the derivative of the position."""
    if "velocity" in found.rules.units:
        return None
    ratios = np.concatenate([_slopes(run) for run in runs])
    ratios = ratios[np.isfinite(ratios)]
    if not len(ratios):
        return None
    ratio = float(np.median(ratios))
    angle = found.rules.unit("angle")
    for unit in ("rad/s", "deg/s", "rpm"):
        factor = UNITS["angle"][angle] / UNITS["velocity"][unit]
        if unit != f"{angle}/s" and abs(ratio / factor - 1) < ALIKE:
            rules = replace(found.rules, units={**found.rules.units, "velocity": unit})
            text = (
                f"dq is {ratio:.4g} times the derivative of q as it is read, and {unit} over {angle}/s is {factor:.4g}"
            )
            return Proposal("[units] velocity", unit, f"{runs[0].name}: {text}", rules)
    return None


def _slopes(run: Recording) -> FloatArray:
    """Recorded velocity over the position's derivative, joint by joint; NaN where it does not follow it."""
    if run.dq is None:
        return np.zeros(0)
    derivative = np.gradient(run.q, run.t, axis=0)
    slopes = np.full(run.n_joints, np.nan)
    for joint in range(run.n_joints):
        x, y = derivative[:, joint], run.dq[:, joint]
        if x.std() > 0 and y.std() > 0 and np.corrcoef(x, y)[0, 1] > 0.9:
            slopes[joint] = float(y.std() / x.std())
    return slopes


def _gear(robot: Any, runs: Sequence[Recording], found: Look) -> Proposal | None:
    """The gear ratios by the two encoders."""
    if found.rules.gear_ratio is not None or found.rules.gear_of_robot:
        return None
    slopes = np.array([_motor_slopes(run) for run in runs if run.q_motor is not None])
    if not len(slopes) or not np.isfinite(slopes).any(axis=0).all():
        return None
    ratios = np.nanmedian(np.abs(slopes), axis=0)
    if not np.all(ratios > GEARED):
        return None
    rounded = tuple(float(f"{ratio:.6g}") for ratio in ratios)
    listed = ", ".join(f"{ratio:.6g}" for ratio in rounded)
    rules = replace(found.rules, gear_ratio=rounded, gear_apply_to=MOTOR_SIDE)
    text = f"q_motor turns {listed} times as far as q: the motors' own turns, not divided by the gear ratios"
    return Proposal("[gear] ratio", list(rounded), f"{runs[0].name}: {text}; the makers' numbers are better", rules)


def _motor_slopes(run: Recording) -> FloatArray:
    assert run.q_motor is not None
    slopes = np.full(run.n_joints, np.nan)
    for joint in range(run.n_joints):
        x, y = run.q[:, joint], run.q_motor[:, joint]
        if x.std() > 1e-3 and abs(np.corrcoef(x, y)[0, 1]) > 0.99:
            slopes[joint] = float(np.polyfit(x - x.mean(), y - y.mean(), 1)[0])
    return slopes


def _current(robot: Any, runs: Sequence[Recording], found: Look) -> Proposal | None:
    """Currents that call themselves torque, by the arm's model."""
    said = next((one for one in _channels(robot, runs) if one.code == "current_as_torque"), None)
    signals = found.runs[0].columns.signals
    if said is None or "tau" not in signals:
        return None
    rule = found.rules.columns.get("tau") or signals["tau"]
    rules = replace(found.rules, columns={**found.rules.columns, "tau": None, "current": rule})
    return Proposal("[columns] current", rule, f"{shown(signals['tau'][0])}: {said.message}", rules)


def _channels(robot: Any, runs: Sequence[Recording]) -> list[Finding]:
    from dynid_rs.sensors import channels_of

    try:
        return channels_of(robot, runs)
    except ValueError:  # too little motion for a model to say anything
        return []


def _questions(robot: Any, found: Look) -> list[Finding]:
    """What is wrong and only a person can put right: findings of the runs, and of the arm's model on them."""
    from dynid_rs.runs.checks import check_recording, refused_sources

    name = found.runs[0].recording.name
    said = [Finding("joint_order", "error", text, name) for text in (found.guessed.questions if found.guessed else ())]
    cleaned = []
    for run in found.runs:
        for part in run.parts:
            findings = check_recording(part, robot)
            said += [one for one in findings if one.severity != "info"]
            cleaned.append(part.without(*refused_sources(findings)))
    if not any(one.severity == "error" for one in said):
        said += _channels(robot, cleaned)
    return said
