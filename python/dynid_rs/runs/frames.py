"""A recording as a table in memory: Arrow, and from there pandas or polars, where they are installed."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from dynid_rs.base.errors import MissingLibraryError

if TYPE_CHECKING:
    from dynid_rs.runs.recording import Recording

KINDS = ("pandas", "polars", "pyarrow")


def column_names(recording: Recording, signal: str) -> list[str]:
    """Names of a signal's columns: by joint, ``q_elbow``; by index, ``q_1``, where a joint is called by a number.

    A joint called "1" would else be mistaken for the second one.
    """
    signal = "current" if signal == "tau" and recording.torque_unit == "A" else signal
    numbers = any(joint.isdigit() for joint in recording.joints)
    names = [str(j) for j in range(recording.n_joints)] if numbers else list(recording.joints)
    return [f"{signal}_{name}" for name in names]


def to_table(recording: Recording) -> Any:
    """`pyarrow.Table` of a recording: ``t`` [s], then signal by signal; `read_recording` takes it back."""
    import pyarrow as pa

    columns: dict[str, Any] = {"t": pa.array(recording.t)}
    for signal in recording.signals:
        values = getattr(recording, signal)
        for j, name in enumerate(column_names(recording, signal)):
            columns[name] = pa.array(values[:, j])
    said = {"name": recording.name, "joints": list(recording.joints), "torque_unit": recording.torque_unit}
    return pa.table(columns).replace_schema_metadata({"dynid_rs": json.dumps(said)})


def as_kind(table: Any, kind: str) -> Any:
    """Return an Arrow table as another library's.

    Raises
    ------
    ValueError
        There is no such kind.
    MissingLibraryError
        The library is not installed.
    """
    if kind not in KINDS:
        raise ValueError(f"kind must be one of {', '.join(KINDS)}, got {kind!r}")
    if kind == "pyarrow":
        return table
    try:
        if kind == "polars":
            import polars

            return polars.from_arrow(table)
        import pandas  # noqa: F401  pyarrow's own way asks for it, in words of its own
    except ImportError:
        raise MissingLibraryError(
            kind, mend=f"pip install {kind}, or take an Arrow table: to_dataframe('pyarrow')", purpose="its data frames"
        ) from None
    return table.to_pandas()
