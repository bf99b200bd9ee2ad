"""A robot out of any file that holds one: URDF, robot.toml, xacro, MJCF."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from dynid_rs import _core
from dynid_rs.base.errors import MissingLibraryError
from dynid_rs.base.files import check_readable
from dynid_rs.base.quoting import as_text

_PLACE, _LINE = re.compile(r"^:\d+:\d+: "), re.compile(r" on line \d+")
"""Line and column before a message of the URDF's reader, and a line in it."""
XACRO, MJCF = ".xacro", (".xml", ".mjcf")
"""Suffixes that say what is inside; everything else but `.toml` is a URDF."""


def read_robot(
    path: str | os.PathLike[str],
    *,
    base: str | None = None,
    tip: str | None = None,
    gravity: Sequence[float] | None = None,
    rotor_inertia: Sequence[float] | None = None,
    xacro: Mapping[str, str] | bool = False,
) -> _core.RobotModel:
    """Read a robot by the suffix of its file: URDF, `robot.toml`, MuJoCo model (`.xml`, `.mjcf`) or xacro source.

    Parameters
    ----------
    path : path-like
        The file.
    base, tip : str, optional
        First and last link of the chain; the root and the end of the longest chain by default (`RobotModel.choice`).
    gravity : (3,), optional
        Free fall in the base frame [m/s^2]; the file's, or else (0, 0, -9.81), by default.
    rotor_inertia : (n_joints,), optional
        Reflected to the link side [kg*m^2, kg]; instead of what the file declares.
    xacro : bool or mapping, optional
        Expand a xacro source, with these arguments. A xacro source is a program that reads other files, so it runs on
        request only.

    Raises
    ------
    UrdfError, MdhError
        The file is broken, hostile or no serial chain.
    MissingLibraryError
        `xacro` or `mujoco` is not installed; names the extra.
    ValueError
        A xacro source without the request, or one that xacro refuses; a model that MuJoCo refuses, or that no serial
        chain expresses.
    OSError
        The file cannot be read.
    """
    place = check_readable(path)
    options: dict[str, Any] = {"base": base, "tip": tip, "rotor_inertia": rotor_inertia}
    if made := made_urdf(place, xacro=xacro):
        text, declared = made
        return _from_text(text, place, declared if gravity is None else gravity, options)
    return _core.RobotModel.from_file(place, gravity=gravity, **options)


def made_urdf(path: Path, *, xacro: Mapping[str, str] | bool = False) -> tuple[str, list[float] | None] | None:
    """URDF text that is made of a xacro source or a MuJoCo model, and the gravity it declares; None of other files.

    Raises
    ------
    MissingLibraryError, ValueError, OSError
        As `read_robot`.
    """
    place = check_readable(path)
    if place.suffix.lower() == XACRO or xacro:
        return expanded(place, {} if isinstance(xacro, bool) else xacro, asked=bool(xacro)), None
    if place.suffix.lower() in MJCF and is_mjcf(place):
        from dynid_rs.model.mjcf import urdf_of

        text, declared = urdf_of(place)
        return text, declared.tolist()
    return None


def expanded(path: Path, arguments: Mapping[str, str], *, asked: bool) -> str:
    """URDF text of a xacro source.

    Raises
    ------
    ValueError
        It was not asked for, or xacro refuses the source.
    MissingLibraryError
        xacro is not installed.
    """
    if not asked:
        raise ValueError(
            f"{path}: is a xacro source, a program that reads other files; ask for it with --xacro (xacro=True), or "
            "expand it first: xacro in.xacro > out.urdf"
        )
    try:
        import xacro
    except ImportError:
        raise MissingLibraryError("xacro", extra="xacro", purpose="robots out of xacro sources") from None
    try:
        text: str = xacro.process_file(str(path), mappings=dict(arguments)).toxml()
    except Exception as error:  # xacro raises whatever its expressions raise
        words = " ".join(str(error).split()) or type(error).__name__
        raise ValueError(f"{path}: xacro cannot expand it: {words}") from None
    return as_text(text)  # its first line is a comment with the path


def is_mjcf(path: Path) -> bool:
    """Whether the first element of an XML file is MuJoCo's."""
    with path.open("rb") as file:
        start = file.read(1 << 16)
    return b"<mujoco" in start and b"<robot" not in start


def _from_text(text: str, path: Path, gravity: Sequence[float] | None, options: dict[str, Any]) -> _core.RobotModel:
    """Read the URDF that was made of `path`, of whose lines nobody has seen one.

    Raises
    ------
    UrdfError
        As `RobotModel.from_urdf_string`; names element and joint or link, and no line.
    """
    if gravity is not None:
        options = options | {"gravity": gravity}
    try:
        return _core.RobotModel.from_urdf_string(text, source_name=as_text(str(path)), **options)
    except _core.UrdfError as error:
        said = str(error).removeprefix(as_text(str(path)))
        said = _LINE.sub("", _PLACE.sub(": ", said, count=1))
        raise _core.UrdfError(f"{path}, as the URDF made of it{said}") from None
