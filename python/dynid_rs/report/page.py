"""The report as one HTML page: what stands where, and the shell around it.

The page asks nothing of the network: style, scripts and data stand in it, and its content security policy
names the scripts by their hash, so that no text from a file can run even if an escape were forgotten.
"""

from __future__ import annotations

import base64
import hashlib
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path

from dynid_rs.report import declared, explanations, sections
from dynid_rs.report.figures import Figures
from dynid_rs.report.source import Source
from dynid_rs.report.text import esc


def build_page(source: Source) -> str:
    """Return the whole page; `source` is checked already."""
    result = source.result
    figures = Figures()
    parts = [
        ("errors", "Errors", sections.errors(result)),
        (
            "effects",
            "Effects found" if result.get("effects") else "Not explained yet",
            sections.effects(result),
        ),
        ("torque", "Torque over time", sections.torque(figures, source)),
        ("velocity", "Friction and residual", sections.velocity(figures, source)),
        ("parameters", "Parameters", explanations.parameters(figures, result)),
        ("declared", "What was declared", declared.declared(result)),
        ("loops", "What the loops did", explanations.loops(figures, result)),
        ("data", "Data", explanations.data(result)),
        ("provenance", "Where this comes from", explanations.provenance(source)),
    ]
    shown = [(key, title, body) for key, title, body in parts if body]
    links = "".join(f'<a href="#{key}">{title}</a>' for key, title, _ in shown)
    body = "".join(f'<section id="{key}"><h2>{title}</h2>\n{html}</section>\n' for key, title, html in shown)
    return shell(
        title=f"{result['robot']} \u2013 identified torque model",
        body=f"<header>{sections.head(result)}<nav>{links}</nav></header>\n<main>{body}</main>\n",
        figures=figures,
    )


def shell(*, title: str, body: str, figures: Figures) -> str:
    """Return a page around `body`, which is HTML already: style, scripts and the data of its figures."""
    here = files("dynid_rs.report")
    plotly = _script_text(_plotly_path().read_text(encoding="utf-8"))
    runtime = _script_text(here.joinpath("page.js").read_text(encoding="utf-8"))
    style = here.joinpath("page.css").read_text(encoding="utf-8")
    policy = (
        "default-src 'none'; style-src 'unsafe-inline'; img-src data: blob:; "
        f"script-src {_hash(plotly)} {_hash(runtime)}; base-uri 'none'; form-action 'none'"
    )
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f'<title>{esc(title)}</title>\n<link rel="icon" '
        f'href="data:,">\n<style>\n{style}</style>\n</head>\n<body>\n'
        f"{body}<noscript><p>The plots need JavaScript; all tables are complete without it.</p></noscript>\n"
        f'<script type="application/json" id="report-data">{figures.to_json()}</script>\n'
        f"<script>{plotly}</script>\n<script>{runtime}</script>\n</body>\n</html>\n"
    )


def _plotly_path() -> Path:
    """Return the place of plotly.min.js without importing the package, which costs more than the page."""
    spec = find_spec("plotly")
    places = (spec.submodule_search_locations if spec else None) or []
    for place in places:
        path = Path(place) / "package_data" / "plotly.min.js"
        if path.is_file():
            return path
    raise FileNotFoundError("plotly.min.js is missing; install it with `pip install plotly`")


def _script_text(code: str) -> str:
    """Code as the browser will hash it: its line ends, and nothing that ends the element."""
    code = code.replace("\r\n", "\n").replace("\r", "\n")
    return code.replace("</script", "<\\/script").replace("<!--", "<\\!--")


def _hash(code: str) -> str:
    return "'sha256-" + base64.b64encode(hashlib.sha256(code.encode()).digest()).decode("ascii") + "'"
