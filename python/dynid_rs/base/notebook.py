"""Tables as a notebook shows them."""

from __future__ import annotations

import html
from collections.abc import Sequence


def html_table(head: Sequence[str], rows: Sequence[Sequence[str]], *, title: str = "", note: str = "") -> str:
    """HTML of a small table, as notebooks show data frames; every text is escaped.

    Parameters
    ----------
    head, rows : sequence of str, sequence of sequence of str
        Names of the columns, and cells; the first column holds names.
    title, note : str
        Lines above and below.
    """
    above = f"<p><strong>{html.escape(title)}</strong></p>\n" if title else ""
    below = f"<p>{html.escape(note)}</p>\n" if note else ""
    names = "".join(f'<th scope="col">{html.escape(name)}</th>' for name in head)
    body = "".join(
        f'<tr><th scope="row">{html.escape(row[0])}</th>'
        + "".join(f"<td>{html.escape(cell)}</td>" for cell in row[1:])
        + "</tr>\n"
        for row in rows
    )
    table = f'<table class="dataframe">\n<thead><tr>{names}</tr></thead>\n<tbody>\n{body}</tbody>\n</table>\n'
    return f"<div>\n{above}{table}{below}</div>"


def text_table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """The same as plain text: the first column to the left, all others to the right."""
    table = [list(head), *(list(row) for row in rows)]
    widths = [max(len(line[k]) for line in table) for k in range(len(head))]
    return "\n".join(
        "  ".join(
            cell.ljust(width) if k == 0 else cell.rjust(width)
            for k, (cell, width) in enumerate(zip(line, widths, strict=True))
        ).rstrip()
        for line in table
    )
