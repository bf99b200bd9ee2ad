"""Runs in ROS bags: `sensor_msgs/JointState` of ROS 1 (.bag) and ROS 2 (sqlite3, MCAP), joints by name in any order.

Only the message type that the library itself brings is ever decoded: definitions in a bag are not looked at.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.errors import DataError
from dynid_rs.base.quoting import file_name, shown, shown_names
from dynid_rs.runs.cells import FloatArray
from dynid_rs.runs.readers.bag_library import open_bag
from dynid_rs.runs.readers.columns import fill
from dynid_rs.runs.readers.config import Config
from dynid_rs.runs.readers.table import Columns, Table, damaged, refuse_too_large

SIGNALS = {"position": "q", "velocity": "dq", "effort": "effort"}
"""Field of a message: what its columns are called, before the joint's name."""

TRIFLE = 1.0
"""Messages that are out of order by less than this [s] were overtaken on the way, and are put in order."""


@dataclass
class _Source:
    """Messages of one topic and node that name the same joints, all with efforts or all without: one publisher."""

    topic: str
    joints: tuple[str, ...]
    publisher: str = ""
    stamps: list[int] = field(default_factory=list)
    received: list[int] = field(default_factory=list)
    values: dict[str, list[FloatArray]] = field(default_factory=lambda: {name: [] for name in SIGNALS})

    def columns(self) -> list[str]:
        whole = [name for name in SIGNALS if len(self.values[name]) == len(self.stamps)]
        return ["t", *(f"{SIGNALS[name]}_{joint}" for name in whole for joint in self.joints)]

    def has_effort(self, joints: Collection[str]) -> bool:
        """Whether every message has an effort of these joints; what is not measured is sent as NaN or as zeros."""
        places = [k for k, joint in enumerate(self.joints) if joint in joints]
        efforts = [row[places] for row in self.values["effort"]]
        whole = len(efforts) == len(self.stamps) and all(np.isfinite(row).all() for row in efforts)
        return whole and any(row.any() for row in efforts)


def open_bag_file(path: str | Path, joints: Sequence[str] | None, config: Config) -> Table:
    """Open a bag: of its publishers of joint states the one that names the robot's joints.

    Parameters
    ----------
    path : str or Path
        ``.bag``, ``.db3``, ``.mcap``, or the folder of a ROS 2 bag.
    joints : sequence of str, optional
        Names in chain order.
    config : Config
        Its topic, and its rules for q.

    Raises
    ------
    DataError
        No bag, damaged, no joint states, or several publishers that could be meant.
    MissingLibraryError
        The library is not installed.
    OSError
        The file cannot be opened.
    """
    place, file = Path(path), file_name(path)
    kind, sources, topics = _sources(place, file)
    found = [source for source in sources if config.topic in (None, source.topic)]
    if not found:
        listed = ", ".join(sorted({shown(source.topic) for source in sources})) or "none"
        wanted = f"on {shown(config.topic)}" if config.topic else f"among its topics ({shown_names(topics)})"
        raise DataError(
            f"{file}: holds no sensor_msgs/JointState {wanted}; topics with joint states: {listed}"
            + ("; choose one in dynid.toml: [file] topic" if sources else "; record /joint_states"),
            code="no_joint_states",
            file=file,
        )
    chosen, why = _chosen(found, joints, config, file)
    columns, notes = _arrays(chosen)
    others = [source for source in sources if source is not chosen]
    if others:
        listed = ", ".join(f"{shown(s.topic)} ({len(s.stamps)} messages, {shown_names(s.joints)})" for s in others[:4])
        notes.append(f"read from {shown(chosen.topic)}{why}; other joint states are left out: {listed}")

    def load(wanted: Sequence[str]) -> Columns:
        return {name: columns[name] for name in wanted}

    return Table(file, kind, tuple(columns), len(columns["t"]), load, stamps=frozenset({"t"}), notes=tuple(notes))


def _sources(place: Path, file: str) -> tuple[str, list[_Source], list[str]]:
    """Kind of bag, publishers of joint states, and all topics."""
    sources: dict[tuple[str, str, frozenset[str], bool], _Source] = {}
    size = 0
    with open_bag(place, file) as bag:
        try:
            for number, (topic, publisher, received, message) in enumerate(bag.messages):
                names, rows = _rows(message, topic, number, file)
                key = (topic, publisher, frozenset(names), "effort" in rows)
                source = sources.setdefault(key, _Source(topic, tuple(names), publisher))
                order = [names.index(joint) for joint in source.joints]
                stamp = message.header.stamp
                nanoseconds = int(getattr(stamp, "nanosec", getattr(stamp, "nsec", 0)))
                source.stamps.append(int(stamp.sec) * 10**9 + nanoseconds)
                source.received.append(int(received))
                for name, row in rows.items():
                    source.values[name].append(row[order])
                size += 8 * (2 + len(rows) * len(names))
                refuse_too_large(size, file)
        except (DataError, MemoryError):
            raise
        except Exception as error:  # the library, sqlite3 and the unpackers have each their own
            raise damaged(bag.kind, error, file) from None
        return bag.kind, list(sources.values()), bag.topics


def _rows(message: Any, topic: str, number: int, file: str) -> tuple[list[str], dict[str, FloatArray]]:
    """Joint names of a message, and its fields that are filled."""
    names = [str(name) for name in message.name]

    def fault(text: str) -> DataError:
        return DataError(f"{file}, message {number + 1} on {shown(topic)}: {text}", code="bad_message", file=file)

    if len(set(names)) < len(names):
        raise fault(f"names a joint twice ({shown_names(names)}); record the publisher that names each once")
    rows = {}
    for name in SIGNALS:
        row = np.asarray(getattr(message, name), dtype=np.float64)
        if len(row) not in (0, len(names)):
            raise fault(f"has {len(names)} names and {len(row)} numbers as {name}; expected one per joint, or none")
        if len(row):
            rows[name] = row
    return names, rows


def _chosen(sources: list[_Source], joints: Sequence[str] | None, config: Config, file: str) -> tuple[_Source, str]:
    """The publisher of the robot's joints, of several the one with efforts; and why it, where there was a choice."""
    wanted = _columns_of_q(joints, config)
    able = _with_most_joints(sources) if wanted is None else [s for s in sources if wanted <= set(s.columns())]
    if not able:  # what is missing is said with the names that are there
        return max(sources, key=lambda source: (len(source.joints), len(source.stamps))), ""
    whose = None if wanted is None else {name.removeprefix("q_") for name in wanted}
    with_effort = [source for source in able if source.has_effort(source.joints if whose is None else whose)]
    if len(with_effort) == 1:
        return with_effort[0], "" if len(able) == 1 else ", which alone has efforts of all these joints"
    rivals = with_effort or able
    if len(rivals) == 1:
        return rivals[0], ""
    topics = list(dict.fromkeys(shown(source.topic) for source in rivals))
    text = f"{len(rivals)} publishers send the states of these joints ({', '.join(sorted(topics))})"
    mend = f'say which in dynid.toml: [file] topic = "{min(topics)}"'
    if len(topics) == 1:
        nodes = sorted({source.publisher for source in rivals})
        others = f"are the nodes {shown_names(nodes)}" if len(nodes) > 1 else "name other joints beside them"
        mend = f"they {others}; record one publisher alone"
    raise DataError(f"{file}: {text}; {mend}", code="several_publishers", file=file)


def _columns_of_q(joints: Sequence[str] | None, config: Config) -> set[str] | None:
    """Columns of the robot's positions; None of a robot that is not known."""
    if joints is None:
        return None
    rule = config.columns.get("q", "q_{joint}")
    return set(rule) if isinstance(rule, tuple) else {fill(str(rule), k, name) for k, name in enumerate(joints)}


def _with_most_joints(sources: list[_Source]) -> list[_Source]:
    """Publishers of the most joints; where none of them sends efforts, also those of most of these joints that do."""
    most = max(len(source.joints) for source in sources)
    able = [source for source in sources if len(source.joints) == most]
    if any(source.has_effort(source.joints) for source in able):
        return able
    # The arm alone, with efforts, beside a sum of all states that has none; not its gripper alone.
    known = {joint for source in able for joint in source.joints}
    beside = [s for s in sources if 2 * len(s.joints) > most and known & set(s.joints) and s.has_effort(s.joints)]
    largest = max((len(source.joints) for source in beside), default=0)
    return able + [source for source in beside if len(source.joints) == largest]


def _arrays(source: _Source) -> tuple[dict[str, NDArray[Any]], list[str]]:
    """Columns in the order of time, each stamp once; and what was done to them."""
    notes = []
    stamps = np.array(source.stamps, dtype=np.int64)
    if not np.any(stamps):
        stamps = np.array(source.received, dtype=np.int64)
        notes.append("headers carry no stamps, so the times of arrival stand for them")
    back = np.diff(stamps)
    if np.any(back < 0) and np.min(back) > -TRIFLE * 1e9:
        order = np.argsort(stamps, kind="stable")
        notes.append(f"{int(np.sum(back < 0))} messages were stored out of order, and are put in the order of stamps")
    else:
        order = np.arange(len(stamps))
    repeats = np.flatnonzero(np.diff(stamps[order]) == 0) + 1
    if len(repeats):
        order = np.delete(order, repeats)
        notes.append(f"{len(repeats)} messages repeat the stamp of the one before, and are left out")
    columns: dict[str, NDArray[Any]] = {"t": stamps[order]}
    for name, prefix in SIGNALS.items():
        if len(source.values[name]) == len(stamps):
            matrix = np.array(source.values[name]).reshape(len(stamps), -1)[order]
            columns |= {f"{prefix}_{joint}": matrix[:, k].copy() for k, joint in enumerate(source.joints)}
        elif source.values[name]:
            notes.append(f"{name} is missing in some messages, and is not read")
    return columns, notes
