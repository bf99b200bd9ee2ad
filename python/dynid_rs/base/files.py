"""Files: whole or not at all, and every refusal of the system as a sentence."""

from __future__ import annotations

import os
import stat
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynid_rs.base.errors import DataError
from dynid_rs.base.held import held_file, held_folder
from dynid_rs.base.interrupt import uninterrupted
from dynid_rs.base.quoting import LONGEST, as_json, as_text, shown
from dynid_rs.base.together import alone_in, finish_killed, place

if TYPE_CHECKING:
    import numpy as np

_REASONS: dict[type[OSError], str] = {
    FileNotFoundError: "it does not exist; check the path",
    PermissionError: "permission is denied; change its rights or choose another path",
    IsADirectoryError: "it is a folder; name a file",
    NotADirectoryError: "a part of its path is a file, not a folder; check the path",
}


def with_sentence(error: OSError, path: str | os.PathLike[str], action: str) -> OSError:
    """Return an error of the same class whose text is one sentence.

    Parameters
    ----------
    error : OSError
        What the system said.
    path : str or path-like
        The file that was meant.
    action : str
        What was tried: ``"read"``, ``"write"``, ``"open"``, or, of a folder, ``"write into"``.
    """
    reason = _REASONS.get(type(error)) or (error.strerror or str(error) or type(error).__name__).lower()
    kind = "folder" if action == "write into" else "file"
    spoken = type(error)(f"{os.fspath(path)}: cannot {action} this {kind}: {reason}")
    # With errno alone (no strerror, no filename) str() stays the sentence.
    spoken.errno = error.errno
    return _sentence(spoken)


def check_readable(path: str | os.PathLike[str]) -> Path:
    """Return `path` when it is a regular file that can be opened and is not empty.

    Raises
    ------
    FileNotFoundError, PermissionError, IsADirectoryError, OSError
        The system refuses; the text is a sentence.
    DataError
        It is a device or a pipe, or holds no byte.
    """
    place = Path(path)
    try:
        info = place.stat()
        if stat.S_ISDIR(info.st_mode):
            raise IsADirectoryError  # open() says so on Linux only
        if stat.S_ISREG(info.st_mode):
            with place.open("rb"):
                pass
    except OSError as error:
        raise with_sentence(error, path, "read") from None
    except ValueError:  # a NUL byte in the path
        raise FileNotFoundError(f"{str(path)!r}: this is not a path; check its spelling") from None
    if not stat.S_ISREG(info.st_mode):
        raise DataError(
            f"{path}: this is a device or a pipe, not a file; save it as a file first",
            code="not_a_file",
            file=str(path),
        )
    if info.st_size == 0:
        raise DataError(f"{path}: the file is empty; record or copy it again", code="empty_file", file=str(path))
    return place


def check_replaceable(path: str | os.PathLike[str]) -> Path:
    """Return `path` when nothing is there yet, or a regular file, which a new one may replace.

    Renaming over a device or a pipe would put a file in its place for everybody, and over a link would cut what
    somebody has tied together.

    Raises
    ------
    FileExistsError, IsADirectoryError
        Something else is there: a folder, a link, a device, a pipe, a socket; the text is a sentence.
    OSError
        The system does not say what is there; the text is a sentence.
    """
    place = Path(path)
    try:
        mode = place.lstat().st_mode
        if stat.S_ISLNK(mode):
            aim = os.readlink(place)
    except (FileNotFoundError, NotADirectoryError):
        return place  # whether its folder is one shows when the file is written
    except OSError as error:
        raise with_sentence(error, path, "write") from None
    except ValueError:  # a NUL byte in the path
        raise _sentence(FileNotFoundError(f"{str(path)!r}: this is not a path; check its spelling")) from None
    if stat.S_ISREG(mode):
        return place
    if stat.S_ISDIR(mode):
        raise _sentence(
            IsADirectoryError(f"{path}: this is a folder, where a file is to be written; name a file, or remove it")
        )
    if stat.S_ISLNK(mode):
        what = f"this is a symbolic link to {shown(aim, LONGEST)}; name the file it points to, or remove the link"
    else:
        kind = next((words for is_kind, words in _KINDS if is_kind(mode)), "no file")
        what = f"this is {kind}, and a file would take its place; name another one"
    raise _sentence(FileExistsError(f"{path}: {what}"))


_KINDS: tuple[tuple[Callable[[int], bool], str], ...] = (
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISSOCK, "a socket"),
)


def _sentence(error: OSError) -> OSError:
    """Mark an error whose text needs no other words."""
    vars(error)["is_sentence"] = True
    return error


@contextmanager
def atomic_path(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Temporary sibling of `path`, moved into its place when the body succeeds.

    Readers see the old file or the whole new one. When the body raises, the temporary file is removed
    and `path` is untouched. What a killed process left beside `path` is removed.

    Raises
    ------
    OSError
        The place cannot be written, or `check_replaceable` refuses what is there; the text is a sentence.
    """
    target = Path(path)
    try:
        check_replaceable(target)
        if not target.parent.exists():
            raise _sentence(FileNotFoundError(f"{target}: the folder {target.parent} does not exist; create it first"))
        finish_killed(target.parent)
        # The suffix stays last: some writers choose the format by it.
        with held_file(target.parent, target.suffix) as temporary:
            yield temporary
            _sync(temporary)
            check_replaceable(target)  # the body may have taken hours
            os.replace(temporary, target)
    except OSError as error:
        # A sentence from an inner file (another path) passes through as it is.
        if getattr(error, "is_sentence", False):
            raise
        raise with_sentence(error, target, "write") from None


@contextmanager
def filled_together(folder: Path, new: str | None = None) -> Iterator[Path]:
    """Temporary folder whose files move to `folder` when the body has succeeded, all of them or none.

    Where the file `new` is there by then, none of them: another process has finished meanwhile.

    When the body raises, older results stay as they were, and a folder that was not there is not there again.
    What a killed process left in `folder` is removed; where it was killed between the first file that it moved and the
    last, the others follow.

    Raises
    ------
    OSError
        `check_replaceable` refuses what is in the place of one of the files, or the system what is done; the text is
        a sentence.
    """
    missing = [place for place in (folder, *folder.parents) if not place.exists()]
    stage: Path | None = None
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with held_folder(folder) as stage:
            yield stage
            with alone_in(folder):
                if new is not None and (folder / new).exists():
                    raise _sentence(
                        FileExistsError(
                            f"{folder}: another command has finished its result here meanwhile ({new}), which stays; "
                            "run again with another folder"
                        )
                    )
                for file in sorted(stage.iterdir()):  # all of them before the first one moves
                    check_replaceable(folder / file.name)
                with uninterrupted():
                    place(stage, folder)
    except BaseException as error:
        for made in missing:
            with suppress(OSError):
                made.rmdir()
        if isinstance(error, OSError) and error.filename is not None and not getattr(error, "is_sentence", False):
            raise with_sentence(error, folder, "write into") from None
        if isinstance(error, OSError) and stage is not None and str(stage) in str(error):
            raise _sentence(_of_the_target(error, stage, folder)) from None
        raise


def _of_the_target(error: OSError, stage: Path, folder: Path) -> OSError:
    """Return an error with the place that the user named, for one with a file of `stage`, where it is filled."""
    spoken = type(error)(str(error).replace(str(stage), str(folder)))
    spoken.errno = error.errno
    return spoken


def _sync(path: Path) -> None:
    """Bytes on the disk before the name: else a power cut leaves an empty file under the right name."""
    descriptor = os.open(path, os.O_RDWR)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write `text` as UTF-8, with the names of files as text, whole or not at all."""
    with atomic_path(path) as temporary:
        temporary.write_text(as_text(text), encoding="utf-8", newline="\n")


def write_bytes(path: str | os.PathLike[str], content: bytes) -> None:
    """Write `content` as it is, whole or not at all."""
    with atomic_path(path) as temporary:
        temporary.write_bytes(content)


def write_json(path: str | os.PathLike[str], obj: object) -> None:
    """Write `obj` as JSON, whole or not at all; numpy scalars and arrays are allowed.

    Raises
    ------
    ValueError, TypeError
        As `as_json`.
    """
    write_text(path, as_json(obj, _plain))


def _plain(value: object) -> object:
    import numpy as np  # late: help and version do without

    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} cannot be written as JSON")


def write_table(path: str | os.PathLike[str], columns: Mapping[str, np.ndarray[Any, Any]]) -> None:
    """Write equally long columns as Parquet, whole or not at all.

    Parameters
    ----------
    path : str or path-like
        Usually ends in ``.parquet``.
    columns : mapping of str to ndarray, each (n,)
        Numbers or text.

    Raises
    ------
    ValueError
        Columns of different length, or not one-dimensional.
    OSError
        The place cannot be written.
    """
    import numpy as np
    import pyarrow as pa
    import pyarrow.parquet as pq

    from dynid_rs.base.arrow_arrays import to_array

    shapes = {name: np.shape(column) for name, column in columns.items()}
    if any(len(shape) != 1 for shape in shapes.values()) or len(set(shapes.values())) > 1:
        raise ValueError(f"columns of one table must be (n,) of one length, got {shapes}")
    table = pa.table({name: to_array(np.asarray(column)) for name, column in columns.items()})
    # By an open file: pyarrow takes names in UTF-8 alone.
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        pq.write_table(table, file, compression="zstd", write_page_checksum=True)
