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
from boundary_calls import Call, calls
from data import ROOT
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

N_EXAMPLES = int(os.environ.get("DYNID_BOUNDARY_EXAMPLES", "12"))
"""Per function; more by hand."""
REFUSALS = (ValueError, TypeError, OSError, OverflowError, MemoryError, RuntimeError, AttributeError)
LONGEST = 1.0
"""Of one call, in time of the processor [s]."""


class NoArray:
    def __array__(self, *args: Any, **kwargs: Any) -> Any:
        raise RuntimeError("no array")


def spoiled_arrays(x: np.ndarray[Any, Any]) -> dict[str, Callable[[], Any]]:
    """Ways to spoil an array, or to give the same numbers in an unusual form."""

    def with_value(value: float) -> Callable[[], Any]:
        def spoil() -> Any:
            y = np.array(x, dtype=np.float64)
            if y.size:
                y.flat[y.size // 2] = value
            return y

        return spoil

    def frozen() -> Any:
        y = np.array(x)
        y.flags.writeable = False
        return y

    ways: dict[str, Callable[[], Any]] = {
        "reversed": lambda: x[::-1],
        "every_second": lambda: np.repeat(x, 2, axis=0)[::2] if x.ndim else x,
        "fortran": lambda: np.asfortranarray(x),
        "transposed": lambda: x.T,
        "one_row": lambda: np.broadcast_to(x[:1], x.shape) if x.ndim and len(x) else x,
        "frozen": frozen,
        "big_endian": lambda: x.astype(">f8"),
        "unaligned": lambda: np.frombuffer(b"x" + x.astype("<f8").tobytes(), np.uint8)[1:].view("<f8").reshape(x.shape),
        "lists": lambda: x.tolist(),
        "flat": lambda: x.ravel(),
        "deeper": lambda: x[None],
        "shorter": lambda: x[:-1] if x.ndim else x,
        "longer": lambda: np.concatenate([x, x[-1:]]) if x.ndim else x,
        "narrower": lambda: x[..., :-1] if x.ndim else x,
        "no_rows": lambda: x[:0] if x.ndim else x,
        "no_columns": lambda: x[..., :0] if x.ndim else x,
        "scalar": lambda: np.float64(1.0),
        "ragged": lambda: [[1.0], [1.0, 2.0]],
        "no_array": NoArray,
        "wide_of_nothing": lambda: np.zeros((0, 1 << 40)),
        "tall_of_nothing": lambda: np.zeros((1 << 40, 0)),
        "zeros": lambda: np.zeros_like(x, dtype=np.float64),
        "scaled_up": lambda: np.asarray(x, dtype=np.float64) * 1e200,
        "scaled_down": lambda: np.asarray(x, dtype=np.float64) * 1e-300,
    }
    for dtype in ("f4", "i8", "u1", "?", "c16", "O", "U8", "M8[s]", "V8"):
        ways[f"dtype_{dtype}"] = lambda dtype=dtype: x.astype(dtype)
    for value in (np.nan, np.inf, -np.inf, 1.7e308, -1.7e308, 5e-324, -0.0, 1e18):
        ways[f"with_{value}"] = with_value(value)
    return ways


NO_ARRAYS: dict[str, Callable[[], Any]] = {
    f"{type(value).__name__}_{str(value)[:12]}": lambda value=value: value
    for value in (
        *(None, True, "", "x", "\0", "\ud800", "x" * 100_000, b"\xff", [], [None], [[]], (), {}, {"a": 1}, object()),
        *(-1, 0, 1, 7, 1 << 31, (1 << 63) - 1, 1 << 63, 1 << 64, -(1 << 63), 1 << 70, 10**400),
        *(0.0, -0.0, -1.0, 1e-320, 1e308, float("nan"), float("inf"), float("-inf"), 1j),
        *([-1], [1 << 62], [0, 0], [1.5], ["a"], [("q", 0)], [("q", 1 << 62)], [("", -1)], [[0.0, float("nan")]]),
        *(
            np.array([-1]),
            np.array([[np.nan]]),
            np.array(0.0),
            np.zeros((2, 2, 2, 2)),
            np.datetime64("now"),
            np.ma.masked,
        ),
    )
}


def spoiled(value: Any) -> st.SearchStrategy[Callable[[], Any]]:
    """Something else for an argument; called, so that arrays are fresh."""
    ways = [st.sampled_from(sorted(NO_ARRAYS)).map(NO_ARRAYS.__getitem__)]
    if isinstance(value, np.ndarray | list) and len(value):
        try:
            numbers = np.asarray(value, dtype=np.float64)
        except (TypeError, ValueError):
            numbers = None
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


ENDLESS = {"max_iter", "n_reweightings", "n_orders", "window"}
"""Arguments that ask for work: as much of it as one likes is no fault."""


STUB = ast.parse((ROOT / "python" / "dynid_rs" / "_core.pyi").read_text(encoding="utf-8"))


def named_in(stub: ast.Module) -> Iterator[str]:
    """Functions, classes that can be made, and methods; copies and properties take nothing."""
    for node in stub.body:
        if isinstance(node, ast.FunctionDef):
            yield node.name
        elif isinstance(node, ast.ClassDef):
            for method in node.body:
                if isinstance(method, ast.FunctionDef) and "copy" not in method.name:
                    if "property" not in map(ast.unparse, method.decorator_list):
                        yield f"{node.name}.{method.name}"


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


def outcome(call: Call, arguments: dict[str | int, Any]) -> Exception | None:
    """What it raised; a panic passes through, because it is no `Exception`."""
    try:
        call(arguments)
    except Exception as error:
        return error
    return None


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
