"""Pages of the documentation that messages and help name: they are there, and where an installed package has them."""

import ast
import re
import tomllib

import pytest
from helpers.data import ROOT
from helpers.small_arm import dynid

from dynid_rs.base.guide import DOCUMENTATION, REPOSITORY, page
from dynid_rs.cli import app

SOURCES = sorted((ROOT / "python" / "dynid_rs").rglob("*.py"))
OF_THE_CHECKOUT = "key_page.py"
"""Makes a page of the documentation, and speaks to whoever builds it."""


def is_documentation(tree):
    """Strings that are docstrings of modules: nobody is shown them."""
    return {id(tree.body[0].value)} if tree.body and isinstance(tree.body[0], ast.Expr) else set()


def test_no_message_names_a_path_below_docs():
    named = []
    for path in SOURCES:
        tree = ast.parse(path.read_text(encoding="utf-8"))
        hidden = is_documentation(tree)
        if path.name in (OF_THE_CHECKOUT, "guide.py"):
            continue
        named += [
            f"{path.name}:{node.lineno} {node.value}"
            for node in ast.walk(tree)
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in hidden
            if re.search(r"\bdocs/", node.value)
        ]
    assert named == []


def test_no_message_of_the_compiled_code_names_one():
    literal = re.compile(r'"(?:[^"\\\n]|\\.)*"')
    named = []
    for path in sorted((ROOT / "rust").rglob("src/**/*.rs")):
        code = re.sub(r"(?m)^\s*//.*$", "", path.read_text(encoding="utf-8"))
        named += [f"{path.name}: {text}" for text in literal.findall(code) if re.search(r"(?<!/blob/main/)docs/", text)]
    assert named == []


def test_every_page_that_is_named_is_there():
    names = set()
    for path in SOURCES:
        names |= set(re.findall(r"""\bpage\(["']([\w/]+)["']\)""", path.read_text(encoding="utf-8")))
    assert {"how_to/logs", "reference/dynid_toml"} <= names
    for name in names:
        assert (ROOT / "docs" / f"{name}.md").is_file(), name
    for path in (ROOT / "rust").rglob("src/**/*.rs"):
        for name in re.findall(r"/blob/main/(docs/[\w/]+\.md)", path.read_text(encoding="utf-8")):
            assert (ROOT / name).is_file(), name


def test_addresses_are_the_projects():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    cargo = tomllib.loads((ROOT / "Cargo.toml").read_text(encoding="utf-8"))["workspace"]["package"]
    assert project["urls"] == {"Documentation": DOCUMENTATION, "Repository": REPOSITORY}
    assert cargo["repository"] == REPOSITORY


@pytest.mark.parametrize("command", ["", *sorted(command.callback.__name__ for command in app.registered_commands)])
def test_no_help_names_a_path_and_none_breaks_an_address(command):
    said = dynid(*command.split(), "--help").output
    assert not re.search(r"(?<!/main/)docs/\w", said)
    for address in re.findall(r"https://\S+", said):
        assert address == DOCUMENTATION or address in [page(f"how_to/{name}") for name in ("logs", "archive", "fleet")]
