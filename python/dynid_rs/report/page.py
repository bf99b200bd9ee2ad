"""The report as one HTML page: what stands where, and the shell around it.

The page asks nothing of the network: style, scripts and data stand in it, and its content security policy
names the scripts by their hash, so that no text from a file can run even if an escape were forgotten.
"""

from __future__ import annotations

import base64
import hashlib
from importlib.resources import files
from pathlib import Path

from dynid_rs.base.files import write_bytes
from dynid_rs.base.wording import against_reference
from dynid_rs.report import declared, diagnosis, explanations, sections
from dynid_rs.report.channel_plots import with_channel_plots
from dynid_rs.report.figures import Figures
from dynid_rs.report.shape import is_diagnosis
from dynid_rs.report.source import Source
from dynid_rs.report.text import esc

OWN_FIT = (
    "These are of a model that was fitted to these training runs alone. <code>model.json</code> is another one: the "
    "reference with what has changed."
)


def build_page(source: Source) -> str:
    """Return the whole page; `source` is checked already."""
    result = source.result
    figures = Figures()
    if is_diagnosis(result):
        body, title = _diagnosis(figures, source), f"{result['robot']} \u2013 what the torque model lacks"
    else:
        body, title = _identified(figures, source), f"{result['robot']} \u2013 identified torque model"
    return shell(title=title, body=body, figures=figures)


def _identified(figures: Figures, source: Source) -> str:
    """Body of the page of `dynid identify`."""
    result = source.result
    found = "Effects found" if result.get("effects") else "Not explained yet"
    parts = [
        ("errors", "Error of every joint", sections.errors(result)),
        ("effects", found, sections.effects(figures, result)),
    ]
    return body(sections.head(result, diagnosis=False), parts, _details(figures, source))


def _diagnosis(figures: Figures, source: Source) -> str:
    """Body of the page of `dynid diagnose`: the answer first, everything else folded."""
    result = with_channel_plots(source)
    parts = [
        ("errors", "Before and after", diagnosis.errors(result)),
        ("effects", "What was missing", diagnosis.effects(figures, result)),
        ("left", "What is left", diagnosis.left(figures, result)),
        ("next", "What would tell more", diagnosis.next_experiment(result)),
        ("sensors", "Sensors, clocks and signals", diagnosis.sensors(result)),
    ]
    folded = [("steps", "How it was found", diagnosis.steps(result)), *_details(figures, source)]
    return body(sections.head(result, diagnosis=True), parts, folded)


def _details(figures: Figures, source: Source) -> list[tuple[str, str, str]]:
    """Sections that both pages have: key, title and HTML, which may be empty."""
    result = source.result
    own = f'<p class="note">{OWN_FIT}</p>\n' if against_reference(result) else ""
    own_parts = [
        ("parameters", "Parameters", explanations.parameters(figures, result)),
        ("declared", "What was declared", declared.declared(result)),
        ("loops", "What the loops did", explanations.loops(figures, result)),
    ]
    return [
        ("torque", "Torque over time", sections.torque(figures, source)),
        ("velocity", "Friction and residual", sections.velocity(figures, source)),
        *((key, title, text and own + text) for key, title, text in own_parts),
        ("data", "Data", explanations.data(result)),
        ("provenance", "Where this comes from", explanations.provenance(source)),
    ]


def write_page(path: Path, text: str) -> Path:
    """Write a page, whole or not at all.

    Raises
    ------
    OSError
        The place cannot be written, or something that is no file is there; the text is a sentence.
    """
    # A lone surrogate in a name must not cost the user the page.
    write_bytes(path, text.encode("utf-8", errors="replace"))
    return path


def body(
    head: str,
    answer: list[tuple[str, str, str]],
    folded: list[tuple[str, str, str]],
    *,
    skip: str = "Skip to the errors",
) -> str:
    """HTML of a page: its head, sections that are open, and sections that are folded; key, title and HTML each.

    `skip` is the link that the keyboard meets first; it leads to the first section.
    """
    links = "".join(f'<a href="#{key}">{title}</a>' for key, title, body in [*answer, *folded] if body)
    html = "".join(_section(*part) for part in answer if part[2])
    html += "".join(_section(*part, folded=True) for part in folded if part[2])
    return (
        f'<a class="skip" href="#{answer[0][0]}">{skip}</a>\n'
        f'<header>{head}<nav aria-label="Sections">{links}</nav></header>\n<main>{html}</main>\n'
    )


def _section(key: str, title: str, html: str, *, folded: bool = False) -> str:
    if folded:
        head = f'<details id="{key}"><summary><h2>{title}</h2></summary>'
        return f'<section class="folded">{head}\n{html}</details></section>\n'
    return f'<section id="{key}"><h2>{title}</h2>\n{html}</section>\n'


def shell(*, title: str, body: str, figures: Figures) -> str:
    """Return a page around `body`, which is HTML already: style, scripts and the data of its figures."""
    library, *own = (_script_text(_file(name)) for name in ("vendor/uPlot.iife.min.js", "charts.js", "page.js"))
    runtime = "\n".join(own)
    style = "\n".join(_file(name) for name in ("vendor/uPlot.min.css", "page.css", "charts.css", "paper.css"))
    policy = (
        "default-src 'none'; style-src 'unsafe-inline'; img-src data: blob:; "
        f"script-src {_hash(library)} {_hash(runtime)}; base-uri 'none'; form-action 'none'"
    )
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f'<title>{esc(title)}</title>\n<link rel="icon" '
        f'href="data:,">\n<style>\n{style}</style>\n</head>\n<body>\n'
        f"{body}<noscript><p>The curves need JavaScript; all tables are complete without it.</p></noscript>\n"
        f'<script type="application/json" id="report-data">{figures.to_json()}</script>\n'
        f"<script>{library}</script>\n<script>{runtime}</script>\n</body>\n</html>\n"
    )


def _file(name: str) -> str:
    """Return the text of a file of this package."""
    return files("dynid_rs.report").joinpath(name).read_text(encoding="utf-8")


def _script_text(code: str) -> str:
    """Code as the browser will hash it: its line ends, and nothing that ends the element."""
    code = code.replace("\r\n", "\n").replace("\r", "\n")
    return code.replace("</script", "<\\/script").replace("<!--", "<\\!--")


def _hash(code: str) -> str:
    return "'sha256-" + base64.b64encode(hashlib.sha256(code.encode()).digest()).decode("ascii") + "'"
