"""The compiled module's documentation: docstrings and signatures of `_core.pyi`, and a check that nothing is missing.

The stub is what editors and type checkers show, so the site shows the same.
"""

from __future__ import annotations

import ast
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx
from sphinx.util import logging

import dynid_rs

LOGGER = logging.getLogger(__name__)
STUB = Path(dynid_rs.__file__).parent / "_core.pyi"


def _nodes() -> dict[str, ast.AST]:
    """Classes, their methods and functions of the stub, by the name that the package gives them."""
    found: dict[str, ast.AST] = {}

    def visit(body: list[ast.stmt], prefix: str) -> None:
        for node in body:
            if isinstance(node, ast.ClassDef | ast.FunctionDef):
                found.setdefault(f"{prefix}.{node.name}", node)
            if isinstance(node, ast.ClassDef):
                visit(node.body, f"{prefix}.{node.name}")

    visit(ast.parse(STUB.read_text(encoding="utf-8")).body, "dynid_rs")
    return found


NODES = _nodes()


def docstring(app: Sphinx, what: str, name: str, found: Any, options: Any, lines: list[str]) -> None:
    """Take the stub's words instead of the binary's."""
    node = NODES.get(name)
    text = ast.get_docstring(node) if isinstance(node, ast.ClassDef | ast.FunctionDef) else None
    if text is not None:
        lines[:] = text.splitlines()


def signature(
    app: Sphinx, what: str, name: str, found: Any, options: Any, arguments: str | None, returned: str | None
) -> tuple[str, str | None] | None:
    """Take the stub's names and defaults, without types: the text says shapes and units."""
    node = NODES.get(name) if what in ("class", "function", "method") else None
    if isinstance(node, ast.ClassDef):
        node = NODES.get(f"{name}.__new__")
    if not isinstance(node, ast.FunctionDef):
        return None
    static = any(isinstance(mark, ast.Name) and mark.id == "staticmethod" for mark in node.decorator_list)
    plain = node.args
    for argument in (*plain.posonlyargs, *plain.args, *plain.kwonlyargs, plain.vararg, plain.kwarg):
        if argument is not None:
            argument.annotation = None
    names = ast.unparse(plain)
    if (name.count(".") > 1 and not static) or node.name == "__new__":
        names = names.partition(",")[2].strip() if "," in names else ""
    return f"({names})", returned


KEPT: dict[str, list[str]] = {}
"""Docstrings of properties, which napoleon would take apart at their first colon as `type: meaning`."""


def keep(app: Sphinx, what: str, name: str, found: Any, options: Any, lines: list[str]) -> None:
    """Before napoleon: put a property's words aside, unless they have sections."""
    if what in ("property", "attribute") and not any(line.startswith("---") for line in lines):
        KEPT[name] = list(lines)


def restore(app: Sphinx, what: str, name: str, found: Any, options: Any, lines: list[str]) -> None:
    """After napoleon: put them back."""
    if name in KEPT:
        lines[:] = KEPT.pop(name)


def skip(app: Sphinx, what: str, name: str, found: Any, skipped: bool, options: Any) -> bool | None:
    """Take what the stub documents; leave out scikit-learn's routing of metadata, which no estimator here takes."""
    if name.endswith("_request") or name == "get_metadata_routing":
        return True
    node = NODES.get(f"dynid_rs.{getattr(found, '__qualname__', '')}")
    documented = isinstance(node, ast.FunctionDef) and ast.get_docstring(node) and not name.startswith("_")
    return False if documented else None


def unlink(app: Sphinx, tree: nodes.document) -> None:
    """Link the package's classes and no other word of a type, for it is prose: "ndarray (n, n_joints), optional"."""
    for link in list(tree.findall(addnodes.pending_xref)):
        if link.get("reftype") == "class" and link["reftarget"].removeprefix("dynid_rs.") not in dynid_rs.__all__:
            link.replace_self(link.children)


def source(app: Sphinx, module: str) -> tuple[str, dict[str, tuple[str, int, int]]] | None:
    """Let [source] of the compiled classes lead to the stub, which is all of them that is Python."""
    if module != "dynid_rs._core":
        return None
    tags = {
        name.removeprefix("dynid_rs."): (
            "class" if isinstance(node, ast.ClassDef) else "def",
            node.lineno,
            node.end_lineno,
        )
        for name, node in NODES.items()
        if isinstance(node, ast.ClassDef | ast.FunctionDef)
    }
    return STUB.read_text(encoding="utf-8"), tags


def check(app: Sphinx, env: Any) -> None:
    """Warn of every public name that no page of the reference documents."""
    documented = env.get_domain("py").objects
    for name in dynid_rs.__all__:
        if f"dynid_rs.{name}" not in documented and name != "__version__":
            LOGGER.warning("dynid_rs.%s is public, and no page of docs/reference/api documents it", name)


def setup(app: Sphinx) -> dict[str, Any]:
    """Come before napoleon, which reads the sections of docstrings."""
    app.connect("autodoc-process-docstring", docstring, priority=400)
    app.connect("autodoc-process-docstring", keep, priority=410)
    app.connect("autodoc-process-docstring", restore, priority=600)
    app.connect("autodoc-skip-member", skip)
    app.connect("autodoc-process-signature", signature)
    app.connect("viewcode-find-source", source)
    app.connect("doctree-read", unlink)
    app.connect("env-check-consistency", check)
    return {"parallel_read_safe": True}
