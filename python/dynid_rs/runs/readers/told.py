"""Units that the file itself gives: adopted where `dynid.toml` says nothing, and said."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from dynid_rs.base.errors import DataError
from dynid_rs.base.quoting import shown
from dynid_rs.runs.readers.columns import ColumnMap
from dynid_rs.runs.readers.config import Config
from dynid_rs.runs.readers.units import unit_in_name, unit_of

_QUANTITIES: Mapping[str, tuple[str, ...]] = {
    "t": ("time",),
    "q": ("angle", "length"),
    "q_motor": ("angle", "length"),
    "q_reference": ("angle", "length"),
    "dq": ("velocity",),
    "dq_motor": ("velocity",),
    "tau": ("torque", "current", "percent"),
    "current": ("current", "torque", "percent"),
}
"""What the columns of a signal may be measured in; of others no unit is adopted."""


@dataclass(frozen=True)
class Told:
    """Columns and rules with the file's own units in them; `notes` say which."""

    columns: ColumnMap
    config: Config
    notes: tuple[str, ...]


def adopt_units(found: ColumnMap, units: Mapping[str, str], config: Config, file: str) -> Told:
    """Take over the units that stand in the header.

    Parameters
    ----------
    found : ColumnMap
        Which column is which signal.
    units : mapping of str to str
        Column -> unit, as the file spells it.
    config : Config
        What it says itself stands.
    file : str
        Name for messages.

    Raises
    ------
    DataError
        Columns of one quantity are in different units, or a torque is in percent of nobody knows what.
    """
    adopted: dict[str, tuple[str, str]] = {}
    signals, notes = dict(found.signals), []
    for signal, names in (("t", (found.time,)), *found.signals.items()):
        for name in names:
            told = _unit(name, units)
            if told is None or told[0] not in _QUANTITIES.get(signal, ()):
                continue
            quantity, unit = told
            if quantity == "percent":
                notes += _of_percent(signal, name, config, file)
                continue
            other, first = adopted.setdefault(quantity, (unit, name))
            if other != unit:
                raise DataError(
                    f"{file}: column {shown(name)} is in {unit} and {shown(first)} in {other}, by the file's own "
                    "words; write them again in one unit, or leave one out under [columns] in dynid.toml",
                    code="mixed_units",
                    file=file,
                    column=name,
                )
    for wrong, right, held in (("tau", "current", "current"), ("current", "tau", "torque")):
        if wrong in signals and right not in signals and _quantity(signals[wrong], units) == held:
            signals[right] = signals.pop(wrong)
            unit = adopted[held][0]
            notes.append(f"{shown(signals[right][0])} is in {unit} by the file's own words, and so is read as {held}")
    notes = list(dict.fromkeys(notes))
    new = {quantity: unit for quantity, (unit, _) in adopted.items() if quantity not in config.units}
    not_si = [f"{quantity} in {unit}" for quantity, unit in new.items() if Config(units=new).factor(quantity) != 1.0]
    if not_si:
        notes.append(f"{', '.join(not_si)}, as the file's own header says")
    return Told(replace(found, signals=signals), replace(config, units={**config.units, **new}), tuple(notes))


def _unit(name: str, units: Mapping[str, str]) -> tuple[str, str] | None:
    word = units.get(name) or unit_in_name(name)
    return None if word is None else unit_of(word)


def _quantity(names: Sequence[str], units: Mapping[str, str]) -> str | None:
    quantities = {(_unit(name, units) or ("",))[0] for name in names}
    return quantities.pop() if len(quantities) == 1 else None


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
