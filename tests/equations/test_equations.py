"""docs/explanation/equations.md says for each equation where it is and what checks it: all of that must be there."""

import ast
import re

import pytest
from helpers.data import ROOT

PAGE = ROOT / "docs" / "explanation" / "equations.md"
NUMBERS = range(1, 40)
COLUMNS = 6
PLACE = re.compile(r"`([\w/.-]+\.(?:py|rs))::(\w+)`")
MENTION = re.compile(r"\bEqs?\.\s*(\d+(?:(?:-|, | and | to )\d+)*)")


def table():
    """Rows of the page: (number, cells)."""
    rows = []
    for line in PAGE.read_text(encoding="utf-8").splitlines():
        if re.match(r"\| \d", line):
            cells = [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]
            rows.append((int(cells[0]), cells))
    return rows


ROWS = dict(table())


def names_of(path):
    """Functions and classes that a file defines; comments and strings do not count."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".py":
        kinds = ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef
        return {node.name for node in ast.walk(ast.parse(text)) if isinstance(node, kinds)}
    return set(re.findall(r"(?m)^\s*(?:pub(?:\([a-z]+\))? )?(?:fn|struct|enum|trait) (\w+)", text))


def numbers_in(text, *, whole_ranges):
    """Equations that a text names; of a range like 9-12 all, or only its ends, which a search would find."""
    found = set()
    for mention in MENTION.findall(re.sub(r"\n\s*(?:///?!?|#)?\s*", " ", text)):
        found |= {int(number) for number in re.findall(r"\d+", mention)}
        if whole_ranges:
            for first, last in re.findall(r"(\d+)(?:-| to )(\d+)", mention):
                found |= set(range(int(first), int(last) + 1))
    return found


def test_every_equation_has_one_row():
    assert [number for number, _ in table()] == list(NUMBERS)
    for number, cells in table():
        assert len(cells) == COLUMNS, number
        assert all(cells[:5]), f"Eq. {number} has an empty cell before its remark"


@pytest.mark.parametrize("number", NUMBERS)
def test_code_is_where_the_page_says_and_names_its_equation(number):
    cell = ROWS[number][2]
    places = PLACE.findall(cell)
    assert places
    assert PLACE.sub("", cell).strip(", ") == ""  # nothing in the cell that is not a place
    outright = False
    for file, name in places:
        path = ROOT / file
        assert path.is_file(), file
        assert name in names_of(path), f"{file} has no {name}"
        text = path.read_text(encoding="utf-8")
        assert number in numbers_in(text, whole_ranges=True), f"{file} does not name Eq. {number}"
        outright |= number in numbers_in(text, whole_ranges=False)
    assert outright, f"no place of Eq. {number} names it by its own number"


@pytest.mark.parametrize("number", NUMBERS)
def test_tests_are_where_the_page_says(number):
    cell = ROWS[number][3]
    places = PLACE.findall(cell)
    assert places
    assert PLACE.sub("", cell).strip(", ") == ""
    for file, name in places:
        assert file.startswith("tests/"), file
        assert name.startswith("test_"), name
        assert name in names_of(ROOT / file), f"{file} has no {name}"


def test_every_test_that_names_an_equation_is_on_the_page():
    """A new test called test_eq_17_... belongs there, and in the row of its number."""
    for path in sorted((ROOT / "tests" / "equations").glob("test_equations_*.py")):
        for name in names_of(path):
            named = re.match(r"test_(?:eqs?|equations?)_(\d+)(?:_(?:to|and)_(\d+))?", name)
            if named is None:
                continue
            first, last = int(named[1]), int(named[2] or named[1])
            rows = [n for n in range(first, last + 1) if f"tests/equations/{path.name}::{name}`" in ROWS[n][3]]
            assert rows, f"tests/equations/{path.name}::{name} is in no row from {first} to {last}"


def test_mentions_are_read_as_they_are_written():
    """What the checks above count as naming an equation."""
    text = "as in Eq. 5 (Eqs. 9-11, one), Eqs. 13, 14; Eqs. 3, 4 and\n    /// 6-8, Eq. of motion 20"
    assert numbers_in(text, whole_ranges=True) == {3, 4, 5, 6, 7, 8, 9, 10, 11, 13, 14}
    assert numbers_in(text, whole_ranges=False) == {3, 4, 5, 6, 8, 9, 11, 13, 14}
