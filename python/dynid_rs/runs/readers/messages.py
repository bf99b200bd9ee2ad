"""Messages of ROS that were written as rows: joints' names beside their numbers, as `rostopic echo -p` writes them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.errors import DataError
from dynid_rs.base.quoting import shown, shown_names
from dynid_rs.runs.cells import row_text
from dynid_rs.runs.readers.table import Columns, Table, refuse_duplicates

_NAME = re.compile(r"(.*?)(?:joint[_ ]?)?names?([^0-9A-Za-z]*)0(\]?)", re.IGNORECASE)
"""Column of the first name: what is before it, between it and its number, and behind that."""


def by_joint(table: Table) -> Table:
    """Return a table whose numbers are called by the joints that its rows name.

    ``name_0, name_1`` beside ``position_0, position_1`` give ``position_elbow, position_wrist``: row by row, since
    messages name their joints in any order. A table without such names, or whose format gives no text, stays as it is.

    Raises
    ------
    DataError
        Rows name different joints, or one twice.
    """
    first = next((found for name in table.names if (found := _NAME.fullmatch(name))), None)
    if first is None or table.texts is None:
        return table
    head, mark, tail = first.groups()
    stem = first.string.removesuffix(f"{mark}0{tail}")
    named = _members(table, stem, mark, tail)
    cells = table.texts(named)
    names = np.array([cells[name] for name in named])
    stems = [name.removesuffix(f"{mark}0{tail}") for name in table.names if name.endswith(f"{mark}0{tail}")]
    families = {
        other: members
        for other in stems
        if other.startswith(head) and not other[-1:].isdigit() and other != stem
        if len(members := _members(table, other, mark, tail)) == len(named)
    }
    if not families or not names.size:
        return table
    joints = tuple(str(name) for name in names[:, 0])
    _check_names(table, joints, names)
    places = {
        f"{other}{mark or '_'}{joint}{tail}": (members, joint)
        for other, members in families.items()
        for joint in joints
    }
    hidden = {*named, *(name for members in families.values() for name in members)}
    kept = [name for name in table.names if name not in hidden]
    refuse_duplicates((*kept, *places), table.file)

    def load(wanted: Sequence[str]) -> Columns:
        sources = [name for name in wanted if name not in places]
        sources += [name for one in wanted if one in places for name in places[one][0]]
        read = table.load(list(dict.fromkeys(sources)))
        return {name: _of(*places[name], read, names) if name in places else read[name] for name in wanted}

    note = f"the numbers belong to the joints that {shown(named[0])}, ... name in the same row"
    units = {name: table.units[members[0]] for name, (members, _) in places.items() if members[0] in table.units}
    return replace(
        table, names=(*kept, *places), load=load, units={**table.units, **units}, notes=(*table.notes, note), texts=None
    )


def _members(table: Table, stem: str, mark: str, tail: str) -> list[str]:
    """Columns of one array: 0, 1, ..."""
    found: list[str] = []
    while (name := f"{stem}{mark}{len(found)}{tail}") in table.names:
        found.append(name)
    return found


def _check_names(table: Table, joints: Sequence[str], names: NDArray[np.str_]) -> None:
    """Check that every row (names: n_joints, n_rows) names the joints of the first, each once."""
    wrong = np.any(np.sort(names, axis=0) != np.sort(np.array(joints))[:, None], axis=0)
    twice = len(set(joints)) < len(joints) or not all(joints)
    if not twice and not wrong.any():
        return
    row = 0 if twice else int(np.argmax(wrong))
    listed = shown_names([str(name) for name in names[:, row]])
    expected = "expected every joint once" if twice else f"expected those of the first row, {shown_names(joints)}"
    raise DataError(
        f"{table.file}, {row_text(row, table.line_of)}: names the joints {listed}; {expected}: write the messages of "
        "one publisher alone",
        code="bad_message",
        file=table.file,
        row=row,
    )


def _of(members: Sequence[str], joint: str, read: Columns, names: NDArray[np.str_]) -> NDArray[np.generic]:
    """Column of one joint (n_rows,): of the array's members the one whose name it has in each row."""
    values = np.stack([read[name] for name in members])
    place = np.argmax(names == joint, axis=0)
    return np.asarray(np.take_along_axis(values, place[None, : values.shape[1]], axis=0)[0])
