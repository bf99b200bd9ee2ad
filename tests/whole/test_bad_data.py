"""A fast sample of `tests/bad_data`: every class once on one arm, and a clean set; the whole is a command."""

from __future__ import annotations

import ast
import functools
import sys
import tempfile
from pathlib import Path

import pytest
from bad_data.ask import answer
from bad_data.classes import CLASSES, draw_story, good_set
from bad_data.judge import Said, judge, said_by
from bad_data.sets import RunSet
from bad_data.story import ROBOT, Story, Wanted
from helpers.data import ROOT

from dynid_rs.base.codes import CODES

FOLDER = ROOT / "tests" / "bad_data"
GENERATOR = {"sets", "story", "clocks", "channels", "wiring", "arm", "classes"}
SEED, VARIANT = 3, {"contact": 1, "absurd samples": 2, "lost bits": 1, "stuck encoder": 2}
"""One of the seeds for choosing; variants that are not the first, where another one says more."""


@functools.cache
def clean_set() -> RunSet:
    return good_set(SEED, 0, 0)


def asked(story: Story, folder: Path, command: str = "inspect") -> list[Said]:
    paths = story.write(folder)
    return said_by(answer(command, folder / ROBOT, paths, folder / "out"))


def drawn(name: str) -> Story:
    return draw_story(name, clean_set(), VARIANT.get(name, 0))


@functools.cache
def inspected(name: str) -> tuple[Story, list[Said]]:
    """A story of a class, and what `dynid inspect` says of it."""
    story = drawn(name)
    with tempfile.TemporaryDirectory(prefix="dynid-tests-") as folder:
        return story, asked(story, Path(folder))


def test_the_generator_imports_nothing_of_the_product():
    for name in GENERATOR:
        for node in ast.walk(ast.parse((FOLDER / f"{name}.py").read_text(encoding="utf-8"))):
            imported = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            imported += [node.module] if isinstance(node, ast.ImportFrom) else []
            for module in imported:
                root = module.split(".")[0]
                known = {"bad_data", "exam", "numpy", "scipy", "pinocchio", "pyarrow", *sys.stdlib_module_names}
                assert root in known, f"{name}.py: {module}"


@pytest.mark.parametrize("name", CLASSES)
def test_every_class_is_found_and_named_right(name):
    story, said = inspected(name)
    mark = judge(said, story.wanted)
    assert mark.named, f"{story.what}: {mark.wrong}"


def test_a_clean_set_raises_no_alarm(tmp_path):
    said = asked(Story("clean", clean_set(), Wanted((), ())), tmp_path)
    assert [one.short() for one in said if one.severity != "info"] == []


@pytest.mark.parametrize("command", ["identify", "diagnose"])
@pytest.mark.parametrize("name", ["swapped joints", "unit of time", "wrap"])
def test_all_commands_say_the_same(name, command, tmp_path):
    story, before = inspected(name)
    said = asked(drawn(name), tmp_path, command)
    assert judge(said, story.wanted).named
    first = next(one for one in before if one.severity == "error")
    again = next(one for one in said if one.severity == "error")
    assert (again.code, again.file, again.column, again.mend) == (first.code, first.file, first.column, first.mend)


def test_a_marker_marks_what_is_wrong():
    wanted = Wanted(("stuck",), ("run_1.parquet",), ("q_1",), (10, 20))
    right = {"severity": "error", "code": "stuck", "file": "run_1.parquet", "column": "q_1", "rows": [12, 30]}
    right |= {"message": "it stays; cut these rows out"}
    changes = ({}, {"code": "gap"}, {"file": "run_0.parquet"}, {"column": "q_0"}, {"rows": [30, 40]})
    marks = [judge(said_by({"data": {"findings": [right | change]}}), wanted) for change in changes]
    assert [mark.named for mark in marks] == [True, False, False, False, False]
    assert [mark.found for mark in marks] == [True, False, True, True, True]


def test_every_code_has_words_and_a_mend():
    for code, words in CODES.items():
        assert all(words), code
