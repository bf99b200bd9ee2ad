"""Where results go: checked before the work begins."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from dynid_rs.base.files import check_replaceable
from dynid_rs.base.held import held_folder


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
        Something that is no folder is in the way, something that is no file is in the place of a result, or the system
        refuses; the text is a sentence.
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
        check_replaceable(folder / name)


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


def check_unfinished(folder: Path, last: str) -> None:
    """Refuse a folder that holds a finished result: the file `last`, which is there when all of it is.

    Raises
    ------
    FileExistsError
        It does; the text is a sentence.
    """
    if (folder / last).exists():
        raise FileExistsError(
            f"{folder}: holds a finished result already ({last}); name another folder, or replace it with --force"
        )


def check_absent(paths: Iterable[Path]) -> None:
    """Refuse to replace what an earlier command wrote.

    Raises
    ------
    FileExistsError
        One of the files is there; the text is a sentence.
    """
    for path in paths:
        if path.is_file() and not path.is_symlink():  # `check_replaceable` has words for what is no file
            raise FileExistsError(f"{path}: there is one already; name another file, or replace it with --force")


def after_interrupt(results: Path, again: str = "the same command begins again") -> Callable[[], str]:
    """What to say when an interrupt has come: whether `results`, the file that is written last, is there anew.

    Parameters
    ----------
    results : Path
        A command's last file; asked now and after the interrupt.
    again : str
        How to go on where it is not.
    """
    before = _written(results)

    def said() -> str:
        if _written(results) != before:
            return f"{results} and what belongs to it are complete"
        return f"nothing was written to {results.parent}; {again}"

    return said


def _written(path: Path) -> tuple[int, int] | None:
    try:
        info = path.stat()
    except OSError:
        return None
    return info.st_ino, info.st_mtime_ns


def check_suffix(path: Path, suffix: str, kind: str) -> None:
    """Refuse a name that says another format than the one that is written.

    Raises
    ------
    ValueError
        It does not end in `suffix`.
    """
    if path.suffix.lower() != suffix:
        raise ValueError(f"{path}: is written as {kind}; give it the ending {suffix}")


def check_file(path: Path) -> None:
    """Refuse a file that cannot be written before any work is done.

    Raises
    ------
    OSError
        Its folder is missing or cannot be written, or what is in its place is no file; the text is a sentence.
    """
    folder = path.parent
    try:
        if not folder.exists():
            raise FileNotFoundError(f"{path}: the folder {folder} does not exist; create it first")
    except OSError as error:
        raise (_refusal(error, path, "its path") if error.errno else error) from None
    if not folder.is_dir():
        raise NotADirectoryError(f"{path}: {folder} is not a folder; name another place")
    check_replaceable(path)
    _try(path, folder)


def _try(target: Path, folder: Path) -> None:
    """Rights alone do not tell: root may do everything, a disk may be read-only or full."""
    if str(target) == "-":
        raise ValueError("-: nothing but --json is written to standard output; name a file or a folder")
    if "\0" in str(target):
        raise FileNotFoundError(f"{str(target)!r}: this is not a path; check its spelling")
    try:
        with held_folder(folder):
            pass
    except OSError as error:
        raise _refusal(error, target, f"the folder {folder}") from None


def _refusal(error: OSError, target: Path, place: str) -> OSError:
    reason = (error.strerror or str(error)).lower()
    return type(error)(f"{target}: {place} cannot be written ({reason}); name another place")
