"""The report: one HTML file that opens offline, made from ``result.json`` and ``residuals.parquet``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dynid_rs.report.source import Source

REPORT_FILE = "report.html"


def write_report(directory: Path, source: Source | None = None) -> Path:
    """Write ``report.html`` into the folder that ``dynid identify`` filled, whole or not at all.

    Parameters
    ----------
    directory : Path
        Holds ``result.json`` and ``residuals.parquet``.
    source : Source, optional
        The content of the two files, where it is at hand; else it is read from them.

    Returns
    -------
    Path
        The report.

    Raises
    ------
    FileNotFoundError, OSError
        The folder or a file in it is missing, or cannot be read or written.
    DataError
        A file is damaged or not what it should be; the sentence names the place.
    """
    from dynid_rs.report.page import build_page, write_page
    from dynid_rs.report.source import read_source

    directory = Path(directory)
    page = build_page(read_source(directory) if source is None else source)
    return write_page(directory / REPORT_FILE, page)
