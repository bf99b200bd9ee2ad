"""`{terminal}`: commands that are run while the page is read, each shown with what it printed.

The commands of one page run in order in one folder of their own, outside of the sources; a command that fails is a
warning, and warnings are errors. (sphinxcontrib-programoutput knows neither a folder that is not in the sources nor an
order.)
"""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

from docutils import nodes
from docutils.parsers.rst import directives
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

COLUMNS = "100"
"""Width of the terminal that answers are printed for: what a page shows without scrolling."""
SECONDS = 600
"""Nothing on a page may take longer by the wall clock, which other programs share."""


class Terminal(SphinxDirective):
    """A block of shell commands, one per line; a line that ends in a backslash goes on."""

    has_content = True
    option_spec = {  # noqa: RUF012  # docutils' own way to declare options
        "ends": directives.nonnegative_int,  # exit code of every command, 0 if left out
        "silent": directives.flag,  # run, and show the commands only
        "with": directives.unchanged,  # files beside the page that are put into the folder first
        "lines": directives.nonnegative_int,  # show that many lines of an answer, then "..."
    }

    def run(self) -> list[nodes.Node]:
        """Run the commands and show them, with a prompt, above what they printed."""
        folder = place(Path(self.env.doctreedir), self.env.docname)
        for name in self.options.get("with", "").split():
            shutil.copy(Path(self.env.doc2path(self.env.docname)).parent / name, folder)
        shown = []
        for command in "\n".join(self.content).replace("\\\n", "\\\0").split("\n"):
            command = command.replace("\\\0", "\\\n")
            done = subprocess.run(
                ["bash", "-o", "pipefail", "-c", command],
                cwd=folder,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                stdin=subprocess.DEVNULL,
                text=True,
                timeout=SECONDS,
                check=False,
            )
            if done.returncode != self.options.get("ends", 0):
                return [self.state.document.reporter.warning(f"{command}: {done.stdout}", line=self.lineno)]
            shown += [f"$ {command}", *([] if "silent" in self.options else self.cut(done.stdout))]
        block = nodes.literal_block("\n".join(shown), "\n".join(shown), language="console", classes=["terminal"])
        block["force"] = False
        return [block]

    def cut(self, answer: str) -> list[str]:
        """Lines of an answer without the spaces that a table ends in, as many as are wanted."""
        lines = [line.rstrip() for line in answer.rstrip().splitlines()]
        most = self.options.get("lines", len(lines))
        return lines if len(lines) <= most else [*lines[:most], "..."]


def place(doctrees: Path, page: str) -> Path:
    """Folder in which the commands of a page run; made where it is missing."""
    folder = doctrees / "places" / page
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def empty(app: Sphinx, _: Any, page: str) -> None:
    """Remove what an earlier build of the page has left."""
    shutil.rmtree(Path(app.doctreedir) / "places" / page, ignore_errors=True)


def keep_reports(app: Sphinx, failure: Exception | None) -> None:
    """Put the reports that commands have written beside their pages, as `PAGE.FOLDER.html`."""
    if failure is None and app.builder.format == "html":
        places = Path(app.doctreedir) / "places"
        for report in places.rglob("report.html"):
            page = report.parent.parent.relative_to(places)
            if (Path(app.outdir) / page.parent / f"{page.name}.html").exists():  # not that of one arm of a fleet
                shutil.copy(report, Path(app.outdir) / page.parent / f"{page.name}.{report.parent.name}.html")


def prepare(app: Sphinx) -> None:
    """Put `dynid` and `python` of this interpreter on PATH, for commands and for the kernels of notebooks."""
    programs = Path(app.doctreedir) / "bin"
    programs.mkdir(parents=True, exist_ok=True)
    for name, options in (("python", ""), ("dynid", '-c "from dynid_rs.cli import main; main()"')):
        script = programs / name
        script.write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)} {options} "$@"\n', encoding="utf-8")
        script.chmod(0o755)
    built = Path(app.srcdir).parent / "target" / "release"  # dynid-estimator, where only cargo has built it
    package = str(Path(sys.modules["dynid_rs"].__file__ or "").parents[1])
    found = os.environ.get("PYTHONPATH")
    os.environ |= {
        "PATH": os.pathsep.join([str(programs), str(Path(sys.executable).parent), os.environ["PATH"], str(built)]),
        "PYTHONPATH": os.pathsep.join([package, *([found] if found else [])]),
        "COLUMNS": COLUMNS,
        "DOCS": str(app.srcdir),
    }


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the directive."""
    app.add_directive("terminal", Terminal)
    app.connect("builder-inited", prepare)
    app.connect("env-purge-doc", empty)
    app.connect("build-finished", keep_reports)
    return {"parallel_read_safe": False}
