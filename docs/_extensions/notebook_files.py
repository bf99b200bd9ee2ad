"""`{notebook-file}`: a link to the page as a Jupyter notebook, which is made of its text beside the built page."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import jupytext
from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

FOLDER = "notebooks"


class NotebookFile(SphinxDirective):
    """One sentence: where this page is to be had as a notebook."""

    def run(self) -> list[nodes.Node]:
        """The sentence, with its link."""
        name = Path(self.env.docname).name + ".ipynb"
        paragraph = nodes.paragraph("", "", nodes.Text("This page is a notebook: download "), classes=["notebook-file"])
        paragraph += nodes.reference("", name, refuri=name)
        paragraph += nodes.Text(". Every number on it was computed when the site was built.")
        return [paragraph]


def write(app: Sphinx, failure: Exception | None) -> None:
    """Write every text notebook of the folder as .ipynb, without outputs."""
    if failure is not None or app.builder.format != "html":
        return
    for source in sorted((Path(app.srcdir) / FOLDER).glob("*.md")):
        if source.stem == "index":
            continue
        notebook = jupytext.read(source)
        for cell in notebook.cells:
            cell.source = cell.source.replace("```{notebook-file}\n```\n\n", "")
        jupytext.write(notebook, Path(app.outdir) / FOLDER / f"{source.stem}.ipynb")


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the directive."""
    app.add_directive("notebook-file", NotebookFile)
    app.connect("build-finished", write)
    return {"parallel_read_safe": True}
