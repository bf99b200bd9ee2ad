"""Names of columns as a file writes them, with their units in brackets, and the plain names that stand for them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from dynid_rs.runs.readers.config import ColumnRule, Config
from dynid_rs.runs.readers.table import Columns, Table, Texts
from dynid_rs.runs.readers.units import stem_of, without_unit


def plain_names(table: Table) -> Table:
    """Return a table whose columns are called without their units: `q_0` for `q_0 [deg]`.

    Two columns that only their units tell apart keep them: `q_0 [deg]` beside `q_0 [rad]`. So do members of an array
    that are called by their joints: `position[a]` is in no ampere.
    """
    stems: dict[str, list[str]] = {}
    for name in table.names:
        stems.setdefault(stem_of(name), []).append(name)
    told = {}
    for name in table.names:
        plain, unit = without_unit(name)
        others = [other for other in stems.get(plain, ()) if other != name]
        if unit is not None and (not others or _is_alone(plain, unit, others)):
            told[name] = plain, unit
    if not told:
        return table
    written = {plain: name for name, (plain, _) in told.items()}
    texts = table.texts

    def own(wanted: Sequence[str]) -> list[str]:
        return [written.get(name, name) for name in wanted]

    def load(wanted: Sequence[str]) -> Columns:
        read = table.load(own(wanted))
        return {name: read[written.get(name, name)] for name in wanted}

    def load_texts(wanted: Sequence[str]) -> Texts:
        assert texts is not None
        read = texts(own(wanted))
        return {name: read[written.get(name, name)] for name in wanted}

    def plainly(names: Sequence[str] | frozenset[str]) -> list[str]:
        return [told[name][0] if name in told else name for name in names]

    # What a row below the header says goes before what stands in it.
    units = {pair[0]: table.units.get(name, pair[1]) for name, pair in told.items()}
    return replace(
        table,
        names=tuple(plainly(table.names)),
        load=load,
        units={**table.units, **units},
        stamps=frozenset(plainly(table.stamps)),
        texts=None if texts is None else load_texts,
        lists=tuple(plainly(table.lists)),
        written=written,
    )


def _is_alone(plain: str, unit: str, others: Sequence[str]) -> bool:
    """Whether of columns that are called alike only one has a unit; a letter may as well be a member's name."""
    return len(unit) > 1 and plain not in others and all(without_unit(other)[1] is None for other in others)


def by_plain_names(config: Config, written: Mapping[str, str]) -> Config:
    """Rules whose columns are called by their plain names, where they call them as the file writes them."""
    plain = {name: short for short, name in written.items()}

    def of(signal: str, rule: ColumnRule) -> ColumnRule:
        if isinstance(rule, tuple):
            return tuple(plain.get(name, name) for name in rule)
        if rule is None or signal == "t":
            return None if rule is None else plain.get(rule, rule)
        short = without_unit(rule)[0]
        behind = rule[len(short) :]
        return short if behind and any(name.endswith(behind) for name in plain) else rule

    return replace(config, columns={signal: of(signal, rule) for signal, rule in config.columns.items()})
