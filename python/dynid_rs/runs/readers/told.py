"""Units that the file itself gives: adopted where `dynid.toml` says nothing, and said."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from dynid_rs.base.errors import DataError
from dynid_rs.base.quoting import shown
from dynid_rs.runs.readers.columns import ColumnMap
from dynid_rs.runs.readers.config import Config
from dynid_rs.runs.readers.measures import QUANTITIES, measured, other_unit, unknown_unit
from dynid_rs.runs.readers.table import Table
from dynid_rs.runs.readers.units import in_brackets, may_be_unit, unit_in_name, unit_of

_NEEDED = ("t", "q", "tau", "current")
"""Signals that no run can do without."""


@dataclass(frozen=True)
class Told:
    """Columns and rules with the file's own units in them; `notes` say which."""

    columns: ColumnMap
    config: Config
    notes: tuple[str, ...]


def adopt_units(found: ColumnMap, table: Table, config: Config, joints: Sequence[str]) -> Told:
    """Take over the units that stand in the header.

    Parameters
    ----------
    found : ColumnMap
        Which column is which signal.
    table : Table
        The file.
    config : Config
        What it says itself stands.
    joints : sequence of str
        Joint names, which may stand in brackets where units do.

    Raises
    ------
    DataError
        A unit is that of another quantity; columns of one quantity are in different units; a torque is in percent of
        nobody knows what.
    """
    file = table.file
    adopted: dict[str, tuple[str, str, str]] = {}
    signals, notes, unknown = dict(found.signals), list[str](), dict[str, tuple[str, str]]()
    for signal, names in (("t", (found.time,)), *found.signals.items()):
        for name in names:
            word = _said(name, names, table, joints)
            if signal not in unknown and (said := _unknown(signal, name, word, table, config)):
                unknown[signal] = name, said
            quantity, unit = _unit(signal, name, word)
            if quantity not in QUANTITIES.get(signal, ()) or signal == "temperature":
                continue
            if quantity == "percent":
                notes += _of_percent(signal, name, config, file)
                continue
            other, first, its = adopted.setdefault(quantity, (unit, name, signal))
            if other != unit:
                spare = next((one for one in (signal, its) if one not in _NEEDED), None)
                mend = "" if spare is None else f", or leave {spare} out in dynid.toml: [columns] {spare} = false"
                raise DataError(
                    f"{file}: column {shown(name)} is in {unit} and {shown(first)} in {other}, by the file's own "
                    f"words; write them again in one unit{mend}",
                    code="mixed_units",
                    file=file,
                    column=name,
                )
    for wrong, right, held in (("tau", "current", "current"), ("current", "tau", "torque")):
        if wrong in signals and right not in signals and _quantity(wrong, signals[wrong], table, joints) == held:
            signals[right] = signals.pop(wrong)
            unit = adopted[held][0]
            notes.append(f"{shown(signals[right][0])} is in {unit} by the file's own words, and so is read as {held}")
    notes = list(dict.fromkeys(notes))
    new = {quantity: unit for quantity, (unit, *_) in adopted.items() if quantity not in config.units}
    not_si = [f"{quantity} in {unit}" for quantity, unit in new.items() if Config(units=new).factor(quantity) != 1.0]
    if not_si:
        notes.append(f"{', '.join(not_si)}, as the file's own header says")
    columns = replace(found, signals=signals, unknown_units=tuple(unknown.values()))
    return Told(columns, replace(config, units={**config.units, **new}), tuple(notes))


def _said(name: str, names: Sequence[str], table: Table, joints: Sequence[str]) -> str | None:
    """Unit that stands beside a column, as the file spells it, known or not; None where none does."""
    found = in_brackets(name)
    if name in table.units or found is None or found[1] in joints:
        return table.units.get(name)
    # Members of an array may be called by what no robot's file calls its joints: `M[A1]`, `M[A2]`.
    one = len({(in_brackets(other) or ("", ""))[1] for other in names}) == 1
    return found[1] if unit_of(found[1]) or (one and may_be_unit(found[1])) else None


def _unknown(signal: str, name: str, word: str | None, table: Table, config: Config) -> str:
    """What is to be said of a unit that nobody knows, where `config` does not say the unit; dates need none.

    Raises
    ------
    DataError
        It is the unit of another quantity.
    """
    quantities = QUANTITIES.get(signal, ())
    told = None if word is None else unit_of(word)
    known = told is not None and measured(signal, told)[0] in ("", *quantities)
    if not quantities or word is None or known or name in table.stamps:
        return ""
    if any(quantity in config.units for quantity in quantities):
        return ""
    column = table.written.get(name, name)
    if told is not None:
        raise other_unit(table.file, column, word, signal)
    return unknown_unit(column, word, signal)


def _quantity(signal: str, names: Sequence[str], table: Table, joints: Sequence[str]) -> str | None:
    quantities = {_unit(signal, name, _said(name, names, table, joints))[0] for name in names}
    return quantities.pop() if len(quantities) == 1 else None


def _unit(signal: str, name: str, word: str | None) -> tuple[str, str]:
    word = word or unit_in_name(name)
    told = None if word is None else unit_of(word)
    return ("", "") if told is None else measured(signal, told)


def _of_percent(signal: str, name: str, config: Config, file: str) -> list[str]:
    """What is to be said of a current in percent: like one in A it has a gain of its own at every joint."""
    if signal == "current":
        text = "the current is in percent of what no column says, and is called A; give N m per percent as [drive] gain"
        return [] if config.drive_gain is not None else [text]
    raise DataError(
        f"{file}: column {shown(name)} is in percent of a rated torque or current that the file does not hold; map it "
        "in dynid.toml as [columns] current (and tau = false), and give N m per percent as [drive] gain",
        code="percent",
        file=file,
        column=name,
    )
