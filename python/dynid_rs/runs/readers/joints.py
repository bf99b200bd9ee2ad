"""The joints of a file whose robot is not known."""

from __future__ import annotations

from dynid_rs.runs.readers.columns import ALIASES, FileColumns, fill, missing_column
from dynid_rs.runs.readers.config import Config
from dynid_rs.runs.readers.table import Table


def infer_joints(table: Table, config: Config) -> tuple[str, ...]:
    """Joints of a file whose robot is not known: ``q_0``, ``q_1``, ..., else names shared by q and torque.

    Joints without a name are called by their index: ``"0"``, ``"1"``, ...

    Raises
    ------
    DataError
        No joint is recognised.
    """
    source, names = FileColumns(table, config), table.names
    rule = config.columns.get("q")
    if isinstance(rule, tuple):
        return tuple(map(str, range(len(rule))))
    templates = (rule,) if isinstance(rule, str) else tuple(f"{alias}_{{i}}" for alias in ALIASES["q"])
    if rule is not None and "{joint}" in str(rule):
        head, _, tail = str(rule).partition("{joint}")
        listed = tuple(n[len(head) : len(n) - len(tail)] for n in names if n.startswith(head) and n.endswith(tail))
        if listed and all(listed):
            return listed
    count = 0
    while any(fill(template, count, "") in source.names for template in templates):
        count += 1
    if count:
        return tuple(map(str, range(count)))
    heads = [f"{alias}_" for signal in ("tau", "current") for alias in ALIASES[signal]]
    if isinstance(torque := config.columns.get("tau"), str):
        heads.append(torque.removesuffix("{joint}"))
    suffixes = {name.removeprefix(head) for head in heads for name in names if name.startswith(head)}
    shared = tuple(name[2:] for name in names if name.startswith("q_") and name[2:] in suffixes)
    if shared and rule is None and not any(suffix.isdigit() for suffix in shared):
        return shared
    raise missing_column(source, "q", ("0",))
