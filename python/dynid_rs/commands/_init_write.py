"""`dynid.toml` as `dynid init` writes it: every rule with what it rests on, and every key that might be needed."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from dynid_rs.base.guide import page
from dynid_rs.base.quoting import file_name, shown
from dynid_rs.commands._init_look import Look
from dynid_rs.runs.readers.columns import fill
from dynid_rs.runs.readers.config import UNITS
from dynid_rs.runs.readers.key_page import SCHEMA_URL
from dynid_rs.runs.readers.keys import KEYS, TABLES

WIDTH = 110
_TITLES = {
    "error": "TO BE ANSWERED before a model is learned from these runs:",
    "warning": "Worth knowing:",
}


def config_text(robot: Any, robot_path: Path, runs: Sequence[Path], found: Look) -> str:
    """Text of the file; `read_config` reads it back to the rules that were found."""
    lines = [
        f"#:schema {SCHEMA_URL}",  # taplo and Even Better TOML look for it in the first line
        *_comment(f"Written by dynid init for {file_name(robot_path)}, from {', '.join(map(file_name, runs[:6]))}."),
        *_comment(
            f"Every key is explained in {page('reference/dynid_toml')}. Give this file to commands with --config."
        ),
    ]
    if found.notes:
        lines += ["#", *(line for note in found.notes for line in _comment(note))]
    for severity, title in _TITLES.items():
        asked = [one for one in found.questions if one.severity == severity]
        if asked:
            lines += [
                "#",
                *_comment(title),
                *(line for one in asked for line in _comment(f"- {one.file}: {one.message}")),
            ]
    lines += ["", *_columns(robot, found), "", *_units(found), ""]
    lines += [*_rest(robot, found)]
    return "\n".join(lines) + "\n"


def _columns(robot: Any, found: Look) -> Iterator[str]:
    signals, ignored = found.runs[0].columns.signals, found.runs[0].columns.ignored
    yield from _head("columns")
    rows = [("t", quoted(found.runs[0].columns.time))]
    for signal, names in signals.items():
        rows.append((signal, rule_text(names, list(robot.joint_names), ignored)))
    denied = [signal for signal, rule in found.runs[0].rules.columns.items() if rule is None and signal not in signals]
    if "current" in signals and "tau" not in signals:
        denied.append("tau")
    rows += [(signal, "false") for signal in dict.fromkeys(denied)]
    means = {key.name: key.means for key in KEYS if key.table == "columns"}
    for signal, value in rows:
        yield f"{signal} = {value}  # {means[signal]}"
    for proposal in found.taken:
        if proposal.key.startswith("[columns]"):
            yield from _comment(f"evidence: {proposal.evidence}")
    guessed = found.guessed
    if guessed is not None:
        yield from _comment("These columns were found by their names alone; look whether they are what they seem.")
        for doubt in guessed.doubts:
            yield from _comment(f"in doubt: {doubt}")
        for form, why in guessed.others.items():
            yield from _comment(f"not read: {shown(form, 60)}: {why}")


def quoted(value: str | list[str]) -> str:
    """Names as TOML: JSON's escapes are TOML's, but for one character that TOML wants escaped too."""
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def rule_text(names: Sequence[str], joints: Sequence[str], ignored: Sequence[str] = ()) -> str:
    """A rule that gives these columns, as a template where one does.

    Where one of the `ignored` columns would be that of a joint more, a template is refused by the reader: a list then.
    """
    for k, joint in enumerate(joints):
        forms = [(joint, "{joint}"), (str(k), "{i}"), (str(k + 1), "{n}")]
        for word, place in forms:
            head, found, tail = names[k].rpartition(word)
            if not found or {"{", "}"} & set(head + tail):
                continue
            template = f"{head}{place}{tail}"
            if place != "{joint}" and fill(template, len(joints), "") in ignored:
                continue
            if all(fill(template, i, joint) == name for i, (joint, name) in enumerate(zip(joints, names, strict=True))):
                return quoted(template)
        break
    return quoted(list(names))


def _units(found: Look) -> Iterator[str]:
    yield from _head("units")
    evidence = {one.key.removeprefix("[units] "): one.evidence for one in found.taken if one.key.startswith("[units]")}
    means = {key.name: key.means for key in KEYS if key.table == "units"}
    for quantity in UNITS:
        if quantity in evidence:
            yield from _comment(f"evidence: {evidence[quantity]}")
        rules = found.runs[0].rules
        mark = "" if quantity in rules.units else "# "
        units = ", ".join(UNITS[quantity])
        yield f'{mark}{quantity} = "{rules.unit(quantity)}"  # {means[quantity]}; {units}'
    for one in found.refused:
        yield from _comment(f"asked and denied: {one.key} = {one.value!r}: {one.evidence}")


def _rest(robot: Any, found: Look) -> Iterator[str]:
    """Signs, gears, drives, motors, robot and file: what is known, and the rest to be filled in."""
    rules = found.rules
    known: dict[tuple[str, str], str] = {("robot", "joints"): quoted(list(robot.joint_names))}
    known["robot", "gravity"] = json.dumps(
        [round(float(g), 9) for g in (robot.gravity if rules.gravity is None else rules.gravity)]
    )
    for name, value in (("base", rules.base), ("tip", rules.tip)):
        if value is not None:
            known["robot", name] = quoted(value)
    for name, value in (("topic", rules.topic), ("sheet", rules.sheet)):
        if value is not None:
            known["file", name] = quoted(value)
    if rules.gear_ratio is not None:
        known["gear", "ratio"] = json.dumps(list(rules.gear_ratio))
    if rules.gear_ratio is not None or rules.gear_of_robot:
        known["gear", "apply_to"] = json.dumps([name for name in rules.gear_apply_to])
    if rules.drive_gain is not None:
        known["drive", "gain"] = json.dumps(list(rules.drive_gain))
    if rules.rotor_inertia is not None:
        known["motor", "rotor_inertia"] = json.dumps(list(rules.rotor_inertia))
    for signal, signs in rules.signs.items():
        known["signs", signal] = json.dumps([int(sign) for sign in signs])
    for table in ("signs", "gear", "drive", "motor", "robot", "file"):
        yield from _head(table)
        for proposal in found.taken:
            if proposal.key.startswith(f"[{table}]"):
                yield from _comment(f"evidence: {proposal.evidence}")
        for key in (key for key in KEYS if key.table == table):
            value = known.get((table, key.name))
            yield f"{key.name} = {value}  # {key.means}" if value else f"# {key.name} = {key.example}  # {key.means}"
        yield ""
    yield from _comment(
        "Tool: what is bolted to the flange in these runs counts as a part of the last link, and is identified with "
        "it. Use runs of one tool together."
    )


def _head(table: str) -> Iterator[str]:
    yield from _comment(TABLES[table])
    yield f"[{table}]"


def _comment(text: str) -> Iterator[str]:
    line = "#"
    text = "".join(letter if letter.isprintable() else " " for letter in text)
    for word in " ".join(text.split()).split(" "):
        if len(line) + len(word) >= WIDTH and line != "#":
            yield line
            line = "#  "
        line += f" {word}"
    yield line
