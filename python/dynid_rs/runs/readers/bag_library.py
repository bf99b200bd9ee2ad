"""The library that reads ROS bags, behind one face for ROS 1 and ROS 2."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dynid_rs.base.errors import DataError, MissingLibraryError
from dynid_rs.base.files import check_readable
from dynid_rs.runs.readers.table import damaged, not_of_kind

TYPE = "sensor_msgs/msg/JointState"
_ONE, _TWO = "ROS 1 bag", "ROS 2 bag"
_MAGIC = {
    ".bag": (b"#ROSBAG V2", _ONE),
    ".db3": (b"SQLite format 3", f"{_TWO} (sqlite3)"),
    ".mcap": (b"\x89MCAP", f"{_TWO} (MCAP)"),
}


@dataclass(frozen=True)
class Bag:
    """An opened bag: its `kind`, all its `topics`, and its joint states.

    `messages`: topic, publisher (a ROS 1 node; ROS 2 keeps none: empty), time of arrival [ns], message.
    """

    kind: str
    topics: list[str]
    messages: Iterator[tuple[str, str, int, Any]]


@contextmanager
def open_bag(place: Path, file: str) -> Iterator[Bag]:
    """Open a bag; its messages are decoded while they are taken.

    Raises
    ------
    DataError
        Not a bag, damaged.
    MissingLibraryError
        The library is not installed.
    OSError
        The file cannot be opened.
    """
    kind = f"{_TWO} (folder)" if place.is_dir() else _checked(place, file)
    try:
        from rosbags import rosbag1, rosbag2
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise MissingLibraryError("rosbags", "io", f"{file}: ROS bags") from None
    packed = sorted(place.glob("*.zst*")) if place.is_dir() else []
    if packed:
        raise DataError(
            f"{file}: its files are packed whole ({packed[0].name}); unpack them first: ros2 bag convert, or zstd -d",
            code="packed_bag",
            file=file,
        )
    from dynid_rs.runs.readers.bag_bounds import bounded

    with ExitStack() as stack:
        stack.enter_context(bounded())
        try:
            reader: Any = rosbag1.Reader(place) if kind == _ONE else rosbag2.Reader(place)
            stack.enter_context(reader)
            connections = [c for c in reader.connections if c.msgtype == TYPE]
            topics = sorted({str(c.topic) for c in reader.connections})
            # The types of the library's own: those in the bag would be compiled.
            store = get_typestore(Stores.ROS1_NOETIC if kind == _ONE else Stores.ROS2_HUMBLE)
        except Exception as error:
            raise damaged(kind, error, file) from None
        decode = store.deserialize_ros1 if kind == _ONE else store.deserialize_cdr

        def messages() -> Iterator[tuple[str, str, int, Any]]:
            if connections:
                for connection, received, data in reader.messages(connections):
                    publisher = str(getattr(connection.ext, "callerid", None) or "")
                    yield connection.topic, publisher, received, decode(data, TYPE)

        yield Bag(kind, topics, messages())


def _checked(place: Path, file: str) -> str:
    magic, kind = _MAGIC[place.suffix.lower()]
    with check_readable(place).open("rb") as stream:
        head = stream.read(64)
    if not head.startswith(magic):
        raise not_of_kind(f"a {kind}", head, file, "not_a_bag")
    if place.suffix != place.suffix.lower():
        raise DataError(f"{file}: write the suffix {place.suffix} in small letters", code="unknown_suffix", file=file)
    return kind
