"""Plots for notebooks and papers: matplotlib, imported when the first one is drawn."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.errors import MissingLibraryError
from dynid_rs.base.quoting import shown_value

FloatArray = NDArray[np.float64]
Axes = Any
"""`matplotlib.axes.Axes`."""

MOST_POINTS = 4000
"""Longer lines are drawn by the least and the greatest value of every so many samples: no peak is lost."""
WIDTH, HEIGHT = 4.4, 1.7
"""Of one panel [inch]."""


def panels(
    n_rows: int, n_columns: int, axes: Any = None, *, height: float = HEIGHT, share: bool = True
) -> NDArray[Any]:
    """Axes (n_rows, n_columns) of a new figure, or those that the caller gives; `share` one axis per column.

    Raises
    ------
    MissingLibraryError
        matplotlib is not installed.
    ValueError
        As many axes as panels are needed.
    """
    if axes is not None:
        given = np.atleast_1d(np.asarray(axes, dtype=object))
        if given.size != n_rows * n_columns:
            raise ValueError(f"axes: {n_rows * n_columns} axes are needed, {n_rows} x {n_columns}, got {given.size}")
        return given.reshape(n_rows, n_columns)
    try:
        import matplotlib.pyplot as plt
    except ImportError:
        raise MissingLibraryError("matplotlib", extra="plot", purpose="plots") from None
    size = (WIDTH * n_columns if n_columns > 1 else 1.6 * WIDTH, height * n_rows + 0.5)
    _, made = plt.subplots(
        n_rows, n_columns, figsize=size, sharex="col" if share else False, squeeze=False, layout="constrained"
    )
    return np.asarray(made)


def chosen_joints(joints: Sequence[str | int] | str | int | None, names: Sequence[str]) -> list[int]:
    """Indices of joints that are named, counted from 0, or not said at all.

    Raises
    ------
    ValueError
        There is no such joint, or none is asked for.
    """
    if joints is None:
        return list(range(len(names)))
    if not isinstance(joints, str | int | np.integer) and not len(joints):
        raise ValueError(f"joints: none is given; expected some of {', '.join(names)}, or their indices from 0")
    asked = [joints] if isinstance(joints, str | int | np.integer) else joints
    found = []
    for joint in asked:
        if isinstance(joint, str) and joint in names:
            found.append(list(names).index(joint))
        elif isinstance(joint, int | np.integer) and 0 <= joint < len(names):
            found.append(int(joint))
        else:
            raise ValueError(
                f"joints: there is no joint {shown_value(joint)}; expected some of {', '.join(names)}, or their "
                "indices from 0"
            )
    return found


def line(axes: Axes, t: FloatArray, values: FloatArray, **style: Any) -> None:
    """Draw a line, thinned where it is long; NaN are breaks."""
    if len(t) > MOST_POINTS:
        size = -(-len(t) // (MOST_POINTS // 2))
        edges = np.arange(0, len(t), size)
        low, high = (np.minimum.reduceat(values, edges), np.maximum.reduceat(values, edges))
        t, values = np.repeat(t[edges], 2), np.stack([low, high], axis=1).ravel()
    axes.plot(t, values, **{"linewidth": 0.9, **style})


def titled(axes: NDArray[Any], titles: Sequence[str]) -> None:
    """Name every row of panels by its joint, and keep grids faint."""
    for row, title in zip(axes, titles, strict=True):
        row[0].set_title(title, loc="left", fontsize="medium")
        for one in row:
            one.grid(visible=True, alpha=0.3, linewidth=0.6)


def whole(axes: NDArray[Any]) -> NDArray[Any]:
    """Axes as they are handed back: one row or column of panels as a line of them."""
    return axes.ravel() if 1 in axes.shape else axes


def grid(n: int, axes: Any = None) -> NDArray[Any]:
    """`n` axes of a new figure, three in a row, or those that the caller gives: (n,).

    Raises
    ------
    MissingLibraryError, ValueError
        As `panels`.
    """
    if axes is not None:
        return panels(n, 1, axes).ravel()
    columns = min(n, 3)
    made = panels(-(-n // columns), columns, height=1.5 * HEIGHT, share=False).ravel()
    for spare in made[n:]:
        spare.remove()
    return made[:n]
