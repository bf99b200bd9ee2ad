"""The compiled module under arguments that nobody should give: an exception with a sentence, never a panic."""

from __future__ import annotations

import ast
import os
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.boundary_calls import Call, calls
from helpers.data import ROOT
from helpers.robots import random_chain
from helpers.spoiled import ENDLESS, LONGEST, NO_ARRAYS, REFUSALS, as_array, outcome, spoiled_arrays
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dynid_rs import _core

N_EXAMPLES = int(os.environ.get("DYNID_BOUNDARY_EXAMPLES", "12"))
"""Per function; more by hand."""


def spoiled(value: Any) -> st.SearchStrategy[Callable[[], Any]]:
    """Something else for an argument; called, so that arrays are fresh."""
    ways = [st.sampled_from(sorted(NO_ARRAYS)).map(NO_ARRAYS.__getitem__)]
    numbers = as_array(value)
    if numbers is not None:
        spoils = spoiled_arrays(numbers)
        ways += 3 * [st.sampled_from(sorted(spoils)).map(spoils.__getitem__)]
    if isinstance(value, str):
        ways.append(st.text(max_size=300).map(lambda text: lambda: text))
    if isinstance(value, int | float) or value is None:
        number = st.integers() | st.floats()
        ways.append(number.map(lambda x: lambda: x))
    if isinstance(value, list | tuple):
        part = st.integers(0, max(0, len(value) - 1))
        ways.append(part.map(lambda k: lambda: [*value[:k], *value[k + 1 :]]))
        ways.append(part.map(lambda k: lambda: [*value[:k], None, *value[k + 1 :]]))
        ways.append(st.just(lambda: [*value, *value]))
        ways.append(
            st.integers(0, max(0, len(value) - 1)).flatmap(
                lambda k: spoiled(value[k]).map(
                    lambda other: lambda: type(value)([*value[:k], other(), *value[k + 1 :]])
                )
            )
            if value
            else st.just(lambda: [0])
        )
    return st.one_of(ways)


STUB = ast.parse((ROOT / "python" / "dynid_rs" / "_core.pyi").read_text(encoding="utf-8"))


def named_in(stub: ast.Module) -> Iterator[str]:
    """Functions, classes that can be made, and methods; copies and properties take nothing."""
    for node in stub.body:
        if isinstance(node, ast.FunctionDef):
            yield node.name
        elif isinstance(node, ast.ClassDef):
            methods = [method for method in node.body if isinstance(method, ast.FunctionDef)]
            called = [method for method in methods if "property" not in map(ast.unparse, method.decorator_list)]
            yield from (f"{node.name}.{method.name}" for method in called if "copy" not in method.name)


NAMES = [*named_in(STUB), "TorqueModel.__new__ (signals)"]


@pytest.fixture(scope="module")
def known(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Call]]:
    folder, where = tmp_path_factory.mktemp("boundary"), Path.cwd()
    (folder / "here").mkdir()
    os.chdir(folder / "here")  # whatever string is taken for a path names a file in here
    yield calls(folder)
    os.chdir(where)


def test_every_function_of_the_stub_is_tried(known: dict[str, Call]) -> None:
    assert set(known) == set(NAMES)


@pytest.mark.filterwarnings("ignore:Warning. converting a masked element to nan")  # numpy's, before we see the number
@pytest.mark.parametrize("name", NAMES)
def test_spoiled_arguments_are_refused_with_a_sentence(name: str, known: dict[str, Call]) -> None:
    call = known[name]
    assert outcome(call, call.arguments) is None

    @settings(
        max_examples=N_EXAMPLES, deadline=None, suppress_health_check=list(HealthCheck), derandomize=True, database=None
    )
    @given(st.data())
    def refused(data: st.DataObject) -> None:
        places = sorted(call.arguments, key=str)
        chosen = data.draw(st.lists(st.sampled_from(places), min_size=1, max_size=2, unique=True))
        arguments = dict(call.arguments)
        for place in chosen:
            other = data.draw(spoiled(call.arguments[place]))()
            asks_for_work = place in ENDLESS and isinstance(other, int)
            arguments[place] = min(other, 1000) if asks_for_work else other
        start = time.thread_time()
        error = outcome(call, arguments)
        assert time.thread_time() - start < LONGEST
        if error is not None:
            assert isinstance(error, REFUSALS), repr(error)
            assert 0 < len(str(error).strip()) < 4000

    if call.arguments:
        refused()


TWO_JOINTS = _core.RobotModel.from_urdf_string(random_chain(0).urdf)


@pytest.mark.parametrize("dtype", [float, int])
def test_what_a_mask_hides_is_missing(dtype: type) -> None:
    """The numbers behind the mask were taken for measured ones."""
    hidden = np.ma.array([[1, 2], [3, 99], [5, 7]], dtype=dtype)
    hidden[1, 1] = np.ma.masked
    with pytest.raises(ValueError, match="q holds NaN at row 1, column 1; every value must be finite"):
        TWO_JOINTS.inverse_dynamics(hidden, np.zeros((3, 2)), np.zeros((3, 2)))
    plain = np.array([[1, 2], [3, np.nan], [5, 7]])
    np.testing.assert_array_equal(_core.slope(hidden, 10.0), _core.slope(plain, 10.0))
    hidden[1, 1] = 4
    np.testing.assert_array_equal(_core.slope(hidden, 10.0), _core.slope(np.asarray(hidden), 10.0))


def test_rows_in_lists_are_taken_as_arrays_are() -> None:
    rows = [[1.0, 2.0], [3.0, 4.0], [5.0, 7.0]]
    functions: list[Callable[[Any], Any]] = [
        lambda x: _core.low_pass(x, None),
        lambda x: _core.slope(x, 10.0),
        _core.extent,
    ]
    for function in functions:
        np.testing.assert_array_equal(function(rows), function(np.array(rows)))
