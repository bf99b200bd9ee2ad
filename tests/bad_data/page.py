"""docs/bad_data.md: figures of one seed, class by class."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

from bad_data.classes import CLASSES

if TYPE_CHECKING:
    from bad_data.run import Clean, Told


def table(told: list[Told], clean: list[Clean]) -> str:
    """Class by class: found, named right; and false alarms by code."""
    lines = ["| class | drawn | found | named right |", "| --- | --- | --- | --- |"]
    for name in CLASSES:
        of = [one for one in told if one.name == name]
        if of:
            found, named = sum(one.mark.found for one in of), sum(one.mark.named for one in of)
            lines.append(f"| {name} | {len(of)} | {found} | {named} |")
    found, named = sum(one.mark.found for one in told), sum(one.mark.named for one in told)
    lines += [f"| **all** | {len(told)} | {found} | {named} |", ""]
    n_runs = sum(one.n_runs for one in clean)
    alarmed = sum(len({alarm.file for alarm in one.alarms}) for one in clean)
    codes = Counter(alarm.code for one in clean for alarm in one.alarms)
    listed = ", ".join(f"`{code}` {count}" for code, count in codes.most_common()) or "none"
    lines.append(f"Clean recordings: {n_runs}, with a false alarm: {alarmed}. By code: {listed}.")
    return "\n".join(lines)


def page(seed: int, told: list[Told], clean: list[Clean]) -> str:
    """The page."""
    return table(told, clean)
