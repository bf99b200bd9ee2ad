"""Arguments that nobody should give."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from helpers.boundary_calls import Call

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


ENDLESS = {"max_iter", "n_reweightings", "n_orders", "window"}
"""Arguments that ask for work: as much of it as one likes is no fault."""


def as_array(value: Any) -> np.ndarray[Any, Any] | None:
    """Numbers of an argument that is an array of some, or a list."""
    if not isinstance(value, np.ndarray | list) or not len(value):
        return None
    try:
        return np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        return None


def outcome(call: Call, arguments: dict[str | int, Any]) -> Exception | None:
    """What it raised; a panic passes through, because it is no `Exception`."""
    try:
        call(arguments)
    except Exception as error:
        return error
    return None
