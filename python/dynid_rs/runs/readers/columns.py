"""Which column is which signal of which joint."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

from dynid_rs.base.errors import DataError
from dynid_rs.base.quoting import shown, shown_names
from dynid_rs.runs.readers.config import Config
from dynid_rs.runs.readers.table import Table

ALIASES: Mapping[str, tuple[str, ...]] = {
    "t": ("t", "time", "timestamp"),
    "q": ("q",),
    "dq": ("dq", "qd"),
    "ddq": ("ddq", "qdd"),
    "q_motor": ("q_motor", "qm"),
    "dq_motor": ("dq_motor", "qmd"),
    "ddq_motor": ("ddq_motor",),
    "tau": ("tau", "effort"),
    "current": ("current",),
    "q_reference": ("q_reference", "q_ref", "qref"),
    "temperature": ("temperature", "temp"),
}
"""Names of the signals; a joint follows after an underscore: ``q_0`` or ``q_elbow_joint``."""

_PER_JOINT = tuple(signal for signal in ALIASES if signal != "t")


@dataclass(frozen=True)
class ColumnMap:
    """Columns of a file by meaning.

    Parameters
    ----------
    time : str
        Name of the time column.
    signals : mapping of str to tuple of str
        Signal -> its column for each joint in chain order.
    ignored : tuple of str
        All other columns.
    notes : tuple of str
        Sentences about what was read as what, and about columns that could have been read and were not.
    unknown_units : tuple of (str, str)
        Columns beside which something stands that may be a unit and is none that is known, with a sentence each.
    """

    time: str
    signals: Mapping[str, tuple[str, ...]]
    ignored: tuple[str, ...]
    notes: tuple[str, ...] = ()
    unknown_units: tuple[tuple[str, str], ...] = ()

    def with_notes(self, *notes: str) -> ColumnMap:
        """Return the same columns with more to be said, first."""
        return replace(self, notes=(*notes, *self.notes))

    def used(self) -> tuple[str, ...]:
        """Columns that are read, each once."""
        return tuple(dict.fromkeys([self.time, *(name for names in self.signals.values() for name in names)]))


@dataclass(frozen=True)
class FileColumns:
    """Columns and rules of one file, and the words to refuse them."""

    table: Table
    config: Config

    @property
    def names(self) -> tuple[str, ...]:
        """Columns, each once."""
        return self.table.names

    def fault(self, code: str, text: str, column: str | None = None) -> DataError:
        """Return the error that refuses this file."""
        return DataError(f"{self.table.file}: {text}", code=code, file=self.table.file, column=column)

    def has(self) -> str:
        """Say what the file has, in its own words."""
        return f"the file has {shown_names([self.table.written.get(name, name) for name in self.names])}"


def match_columns(table: Table, joints: Sequence[str], config: Config, *, require_torque: bool = True) -> ColumnMap:
    """Find the column of every signal and joint.

    Parameters
    ----------
    table : Table
        The file.
    joints : sequence of str
        Joint names in chain order.
    config : Config
        Rules of `dynid.toml`.
    require_torque : bool
        Whether a file without torque and current is refused.

    Raises
    ------
    DataError
        A signal is missing, incomplete, or there twice under different names; a column is two signals; the file has
        more joints.
    """
    source = FileColumns(table, config)
    found = {signal: _one_signal(source, signal, joints) for signal in _PER_JOINT}
    notes = []
    if found["tau"] is not None and found["current"] is not None:
        notes.append("current is ignored because torque is read; write `tau = false` under [columns] to use it")
        found["current"] = None
    if found["tau"] is not None and config.drive_gain is not None:
        notes.append("drive gains are for currents, and torque is read: they are not used")
    if found["q"] is None:
        raise missing_column(source, "q", joints)
    if require_torque and found["tau"] is None and found["current"] is None:
        raise missing_column(source, "tau", joints)
    signals = {signal: columns for signal, columns in found.items() if columns is not None}
    time = _time(source)
    _refuse_shared(source, time, signals)
    used = {time, *(name for columns in signals.values() for name in columns)}
    return ColumnMap(time, signals, tuple(name for name in table.names if name not in used), tuple(notes))


def fill(template: str, index: int, joint: str) -> str:
    """Column name of one joint by a template of `dynid.toml`."""
    return template.format(i=index, n=index + 1, joint=joint)


def _time(source: FileColumns) -> str:
    rule = source.config.columns.get("t")
    wanted = (rule,) if isinstance(rule, str) else ALIASES["t"]
    present = [name for name in wanted if name in source.names]
    if len(present) > 1:
        raise source.fault(
            "ambiguous_column",
            f"columns {' and '.join(present)} both give the time; remove one, or choose in dynid.toml: "
            f'[columns] t = "{present[0]}"',
            present[1],
        )
    if not present:
        raise source.fault(
            "missing_column",
            f"the time column is missing, expected {' or '.join(map(shown, wanted))}{' [s]' if rule is None else ''}; "
            f"{source.has()}; "
            'name it in dynid.toml: [columns] t = "..."',
            "t",
        )
    return present[0]


def _one_signal(source: FileColumns, signal: str, joints: Sequence[str]) -> tuple[str, ...] | None:
    """Columns of one signal in chain order; None when the file has none of them."""
    columns = source.config.columns
    if signal in columns and columns[signal] is None:
        return None
    rule = columns.get(signal)
    if isinstance(rule, tuple):
        return _listed(source, signal, rule, joints)
    expected = [tuple(_candidates(rule, signal, i, joint)) for i, joint in enumerate(joints)]
    _refuse_unclear(source, expected, joints)
    chosen = [_choose(source, signal, names, joint) for names, joint in zip(expected, joints, strict=True)]
    if rule is not None or any(chosen):
        extra = _beyond(source, signal, rule, len(joints)) if signal != "temperature" else None
        if extra is not None:
            raise source.fault(
                "too_many_joints",
                f"column {shown(extra)} is there, but the robot has {len(joints)} "
                f"joints ({_short(joints)}); give "
                "the robot of this run, or list the columns in dynid.toml: [columns] "
                f'{signal} = ["...", ...]',
                extra,
            )
    if all(name is not None for name in chosen):
        return tuple(name for name in chosen if name is not None)
    # Nobody needs a reference: one of some joints only is an unknown column like any other.
    if rule is None and (not any(chosen) or signal == "q_reference"):
        return None
    raise missing_column(source, signal, joints, expected, chosen)


def _candidates(rule: str | None, signal: str, index: int, joint: str) -> Iterator[str]:
    if rule is not None:
        yield fill(rule, index, joint)
        return
    for alias in ALIASES[signal]:
        yield f"{alias}_{index}"
        if joint != str(index):
            yield f"{alias}_{joint}"


def _refuse_unclear(source: FileColumns, expected: Sequence[tuple[str, ...]], joints: Sequence[str]) -> None:
    """Robots whose joints are called "1", "2", ...: the column q_1 then has two meanings."""
    owner: dict[str, str] = {}
    for names, joint in zip(expected, joints, strict=True):
        for name in names:
            other = owner.setdefault(name, joint)
            if other != joint and name in source.names:
                raise source.fault(
                    "ambiguous_column",
                    f"column {shown(name)} can mean joint {shown(other)} or joint "
                    f"{shown(joint)}; say which in "
                    'dynid.toml: [columns] q = "q_{i}" (joints from 0), "q_{n}" (from '
                    '1) or "q_{joint}" (names)',
                    name,
                )


def _choose(source: FileColumns, signal: str, names: Sequence[str], joint: str) -> str | None:
    present = [name for name in names if name in source.names]
    if len(present) > 1:
        raise source.fault(
            "ambiguous_column",
            f"columns {' and '.join(map(shown, present))} both give {signal} of joint "
            f"{shown(joint)}; remove one, or "
            f"choose in dynid.toml under [columns] {signal}",
            present[1],
        )
    return present[0] if present else None


def _listed(source: FileColumns, signal: str, rule: tuple[str, ...], joints: Sequence[str]) -> tuple[str, ...]:
    if len(rule) != len(joints):
        raise source.fault(
            "bad_config",
            f"{source.config.source} lists {len(rule)} columns for {signal}, but the "
            f"robot has {len(joints)} joints "
            f"({_short(joints)}); list one per joint",
            signal,
        )
    if len(set(rule)) < len(rule):
        raise source.fault("bad_config", f"{source.config.source} lists a column of {signal} twice", signal)
    lacking = [name for name in rule if name not in source.names]
    if lacking:
        raise source.fault(
            "missing_column",
            f"column {shown(lacking[0])} is missing, which {source.config.source} names for {signal}; {source.has()}",
            lacking[0],
        )
    return rule


def _refuse_shared(source: FileColumns, time: str, signals: Mapping[str, tuple[str, ...]]) -> None:
    """One column is one signal of one joint; a temperature may be of all joints, a reference the position itself."""
    owner = {time: "t"}
    for signal, columns in signals.items():
        for name in () if signal in ("temperature", "q_reference") else columns:
            other = owner.setdefault(name, signal)
            if other != signal:
                raise source.fault(
                    "ambiguous_column",
                    f"column {shown(name)} would be both {other} and {signal}; name another one for one of them in "
                    f"dynid.toml under [columns], or leave {signal} out: {signal} = false",
                    name,
                )


def _beyond(source: FileColumns, signal: str, rule: str | None, n_joints: int) -> str | None:
    """First column that continues the count of joints where the robot has no more."""
    templates = (rule,) if rule is not None else tuple(f"{alias}_{{i}}" for alias in ALIASES[signal])
    for template in templates:
        if "{joint}" in template or ("{i" not in template and "{n" not in template):
            continue
        name = fill(template, n_joints, "")
        # With joints counted from 1, q_6 is the last of six and q_0 is missing: `missing_column` says so.
        if name in source.names and fill(template, 0, "") in source.names:
            return name
    return None


INIT_WRITES = " (dynid init writes one)"
"""Behind a mend that is a dynid.toml; no word of `dynid init` itself."""


def missing_column(
    source: FileColumns,
    signal: str,
    joints: Sequence[str],
    expected: Sequence[tuple[str, ...]] | None = None,
    chosen: Sequence[str | None] | None = None,
) -> DataError:
    """Return the error for a signal without columns, or with columns for some joints only."""
    if expected is None:
        rule = source.config.columns.get(signal)
        pattern = rule if isinstance(rule, str) else None
        expected = [tuple(_candidates(pattern, signal, i, joint)) for i, joint in enumerate(joints)]
        chosen = [None] * len(expected)
    chosen = chosen or []
    names, joint = next((n, j) for n, c, j in zip(expected, chosen, joints, strict=True) if c is None)
    n_there = sum(c is not None for c in chosen)
    also = " (or current_0, ... in A)" if signal == "tau" and not n_there else ""
    there = f"; the file has {signal} for {n_there} of {len(joints)} joints" if n_there else ""
    if signal not in ("q", "tau", "current") and signal not in source.config.columns:
        mend = f"add it, or leave {signal} out in dynid.toml: [columns] {signal} = false"
    elif other := _other_template(source, signal, joints):
        mend = (
            "{i} counts from 0, {n} counts from 1, {joint} is the joint's name; by the file's columns, write in "
            f'dynid.toml: [columns] {signal} = "{other}"'
        )
    elif n_there:
        mend = "give the robot of this run, or add the column"
    else:
        mend = f'map it in dynid.toml, e.g. [columns] {signal} = "actual_{signal}_{{i}}"{INIT_WRITES}'
    return source.fault(
        "missing_column",
        f"column {' or '.join(map(shown, names))} is missing ({signal} of joint "
        f"{shown(joint)}{also}){there}; "
        f"{source.has()}; {mend}",
        names[0],
    )


def _other_template(source: FileColumns, signal: str, joints: Sequence[str]) -> str | None:
    """A signal's template with another field in its place, where the file has all the columns that it then gives."""
    rule = source.config.columns.get(signal)
    templates = [rule] if isinstance(rule, str) else [f"{alias}_{{i}}" for alias in ALIASES[signal]]
    for template in templates:
        for field, other in product(("{i}", "{n}", "{joint}"), ("{n}", "{i}", "{joint}", "_{joint}")):
            names = {fill(template.replace(field, other), k, joint) for k, joint in enumerate(joints)}
            if field in template and field != other and names <= set(source.names):
                return template.replace(field, other)
    return None


def _short(joints: Sequence[str]) -> str:
    return ", ".join(map(shown, joints))
