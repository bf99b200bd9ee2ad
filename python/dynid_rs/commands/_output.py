"""Where results go: checked before the work begins, written all together or not at all."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

_MARK = ".dynid-"


def check_folder(folder: Path, files: Sequence[str]) -> None:
    """Refuse a folder that cannot be written before any work is done; it need not exist yet.

    Parameters
    ----------
    folder : Path
        Folder for the results.
    files : sequence of str
        Names of the results.

    Raises
    ------
    OSError
        Something that is no folder is in the way, or the system refuses; the text is a sentence.
    """
    try:
        place = folder
        while not place.exists() and not place.is_symlink():
            place = place.parent
    except OSError as error:
        raise _refusal(error, folder, "its path") from None
    if not place.is_dir():
        raise NotADirectoryError(f"{folder}: {place} is not a folder; name another place")
    _try(folder, place)
    for name in files:
        if (folder / name).is_dir():
            raise IsADirectoryError(
                f"{folder / name}: this is a folder, and a file of that name is to be written; "
                "remove it or name another place"
            )


def check_not_read(outputs: Sequence[Path], inputs: Sequence[Path]) -> None:
    """Refuse to replace what is read.

    Raises
    ------
    ValueError
        An output is one of the inputs, by whatever path.
    """
    for path in outputs:
        if any(path.exists() and other.exists() and path.samefile(other) for other in inputs):
            raise ValueError(f"{path}: is read here and would be replaced; name another file or folder")


def check_file(path: Path) -> None:
    """Refuse a file that cannot be written before any work is done.

    Raises
    ------
    OSError
        Its folder is missing or cannot be written, or it is a folder itself; the text is a sentence.
    """
    folder = path.parent
    try:
        if not folder.exists():
            raise FileNotFoundError(f"{path}: the folder {folder} does not exist; create it first")
        if path.is_dir():
            raise IsADirectoryError(f"{path}: this is a folder; name a file")
    except OSError as error:
        raise (_refusal(error, path, "its path") if error.errno else error) from None
    if not folder.is_dir():
        raise NotADirectoryError(f"{path}: {folder} is not a folder; name another place")
    _try(path, folder)


@contextmanager
def filled_together(folder: Path) -> Iterator[Path]:
    """Temporary folder whose files move to `folder` when the body has succeeded.

    When the body raises, older results stay as they were, and a folder that was not there is not there again.
    """
    missing = [place for place in (folder, *folder.parents) if not place.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        stage = Path(tempfile.mkdtemp(prefix=_MARK, dir=folder))
        try:
            yield stage
            for file in sorted(stage.iterdir()):
                os.replace(file, folder / file.name)
        finally:
            shutil.rmtree(stage, ignore_errors=True)
    except BaseException:
        for place in missing:
            with suppress(OSError):
                place.rmdir()
        raise


def _try(target: Path, folder: Path) -> None:
    """Rights alone do not tell: root may do everything, a disk may be read-only or full."""
    if "\0" in str(target):
        raise FileNotFoundError(f"{str(target)!r}: this is not a path; check its spelling")
    try:
        with tempfile.TemporaryDirectory(prefix=_MARK, dir=folder):
            pass
    except OSError as error:
        raise _refusal(error, target, f"the folder {folder}") from None


def _refusal(error: OSError, target: Path, place: str) -> OSError:
    reason = (error.strerror or str(error)).lower()
    return type(error)(f"{target}: {place} cannot be written ({reason}); name another place")
