"""Errors that users see: one sentence each, with the place and the mend."""

from __future__ import annotations


class DataError(ValueError):
    """A run that cannot be used as it is.

    Parameters
    ----------
    message : str
        One sentence that names the place, what was expected, and the mend.
    code : str
        Stable name of the fault, e.g. ``"time_backwards"``.
    file, column : str, optional
        Where it is.
    row : int, optional
        0-based data row.
    """

    def __init__(
        self,
        message: str,
        *,
        code: str = "bad_data",
        file: str | None = None,
        column: str | None = None,
        row: int | None = None,
    ) -> None:
        super().__init__(message)
        self.code = code
        self.file = file
        self.column = column
        self.row = row


class RankDeficientError(ValueError):
    """The data does not determine the parameters that were asked for."""


class MissingLibraryError(ValueError):
    """An optional library is not installed.

    Parameters
    ----------
    library : str
        Its import name.
    extra : str
        Extra of this package that brings it.
    purpose : str
        What needs it, in the plural.
    mend : str
        What else to do, of a library that no extra brings.
    """

    def __init__(self, library: str, extra: str = "", purpose: str = "", *, mend: str = "") -> None:
        mend = mend or f"pip install 'dynid-rs[{extra}]'"
        super().__init__(f"{purpose} need the library {library}, which is not installed: {mend}")


class DamageWarning(UserWarning):
    """A run is damaged: degrees called radians, stamps out of order, a velocity that is not its position's."""
