"""Columns that are asked for again: while shapes are searched and effects come and go, motion and filter stay the same.

Columns are built by themselves, so those that are kept have the very bits of new ones.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from threading import Lock
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.runs.preprocessing import States

FloatArray = NDArray[np.float64]
PerJoint = list[FloatArray]
Answer = TypeVar("Answer")

MOST_BYTES = 20_000_000
"""Size of all columns that are kept; those that were used longest ago go first."""


@dataclass(eq=False)
class KeptColumns:
    """Columns by what they are made of."""

    _parts: dict[tuple[Any, ...], PerJoint] = field(default_factory=dict)
    _bytes: int = 0
    _lock: Lock = field(default_factory=Lock)
    """Of threads that ask side by side."""
    answers: dict[Any, tuple[Any, Any]] = field(default_factory=dict)
    """What else was made of the same runs, asked for at every fit: the last answer to every question."""

    def get(self, key: tuple[Any, ...]) -> PerJoint | None:
        """Return what was kept, as the last that was used."""
        with self._lock:
            part = self._parts.pop(key, None)
            if part is not None:
                self._parts[key] = part
            return part

    def put(self, key: tuple[Any, ...], part: PerJoint) -> None:
        """Keep, and let go of what was used longest ago."""
        with self._lock:
            self._bytes += _size(part) - _size(self._parts.pop(key, []))
            self._parts[key] = part
            while self._bytes > MOST_BYTES and self._parts:
                self._bytes -= _size(self._parts.pop(next(iter(self._parts))))


def _size(part: PerJoint) -> int:
    return sum(array.nbytes for array in part)


_KEPT: ContextVar[KeptColumns | None] = ContextVar("kept_columns", default=None)


@contextmanager
def keeping_columns() -> Iterator[None]:
    """Keep columns inside of this; inside of another one those are the same."""
    if _KEPT.get() is not None:
        yield
        return
    token = _KEPT.set(KeptColumns())
    try:
        yield
    finally:
        _KEPT.reset(token)


def kept(key: tuple[Any, ...], build: Callable[[], PerJoint]) -> PerJoint:
    """Return what is kept for `key`; built, and kept from now on, where there is nothing."""
    columns = _KEPT.get()
    part = None if columns is None else columns.get(key)
    if part is None:
        part = build()
        if columns is not None:
            columns.put(key, part)
    return part


def kept_answer(question: Any, made_of: Any, build: Callable[[], Answer]) -> Answer:
    """Return the last answer to a question if it was made of the same, inside of `keeping_columns`; nobody changes it.

    Of another robot or other runs it is built anew: the last ones are not asked for again.
    """
    columns = _KEPT.get()
    if columns is None:
        return build()
    if question not in columns.answers or columns.answers[question][0] != made_of:
        columns.answers[question] = made_of, build()
    answer: Answer = columns.answers[question][1]
    return answer


def effect_rows(effect: _core.Effect, states: States, j: int) -> FloatArray:
    """Columns of an effect on joint j in the band, (n_rows, n_columns), zeros or not where the joint rests."""
    if _KEPT.get() is None:
        return _effect_rows(effect, states, [j])[0]
    # Where one joint is asked for the others will be.
    every = list(range(states.q.shape[1]))
    return kept(effect_key(effect, states), lambda: _effect_rows(effect, states, every))[j]


def _effect_rows(effect: _core.Effect, states: States, joints: list[int]) -> PerJoint:
    rows = _core.effect_columns(
        effect,
        *states.signals(),
        tau_link=states.tau_link,
        tau_motor=states.tau_motor,
        step=1 / states.rate,
        temperature=states.temperature,
        joints=joints,
        filter=states.filter,
        kept=states.kept,
    )
    return [np.ascontiguousarray(rows[:, k]) for k in range(len(joints))]


def effect_key(effect: _core.Effect, states: States) -> tuple[Any, ...]:
    """What an effect's columns are made of."""
    shape = tuple((name, tuple(values)) for name, values in effect.shape)
    loads = [states.digest(name) for name in ("tau_link", "tau_motor") if name in effect.signals]
    return effect.kind, shape, *loads, states.motion


def observed(
    robot: _core.RobotModel,
    effects: list[_core.Effect],
    acts_on: list[list[int]],
    pivots: list[int],
    states: States,
    tau: FloatArray,
) -> PerJoint:
    """Return `_core.observe` of a run at the rows of the fit, of which only what is not kept is built.

    Then columns of an effect are zeros on joints that it does not act on: `acts_on` says on which it does.
    """
    columns = _KEPT.get()
    if columns is None:
        return _observe(robot, effects, pivots, states, tau)
    links_key = (robot, tuple(pivots), states.motion)
    n = robot.n_joints
    keys = [
        (*effect_key(effect, states), *(joints if len(joints) < n else ()))
        for effect, joints in zip(effects, acts_on, strict=True)
    ]
    parts = [columns.get(key) for key in keys]
    links = columns.get(links_key)
    missing = []
    for k, joints in enumerate(acts_on):
        if parts[k] is None and len(joints) == n:
            missing.append(k)
        elif parts[k] is None:
            part = parts[k] = [np.zeros((len(states.rows), effects[k].n_columns))] * n
            found = _effect_rows(effects[k], states, joints) if joints else []
            for j, rows in zip(joints, found, strict=True):
                part[j] = rows
            columns.put(keys[k], part)
    new = _observe(robot, [effects[k] for k in missing], pivots if links is None else [], states, tau)
    first = 0
    for k in missing:
        width = effects[k].n_columns
        own = [np.ascontiguousarray(rows[:, first : first + width]) for rows in new]
        columns.put(keys[k], own)
        parts[k] = own
        first += width
    if links is None:
        links = [np.ascontiguousarray(rows[:, first:-1]) for rows in new]
        columns.put(links_key, links)
    per_joint = zip(*(part for part in (*parts, links) if part is not None), new, strict=True)
    return [np.concatenate([*own, rows[:, -1:]], axis=1) for *own, rows in per_joint]


def _observe(
    robot: _core.RobotModel, effects: list[_core.Effect], pivots: list[int], states: States, tau: FloatArray
) -> PerJoint:
    return _core.observe(
        robot,
        effects,
        pivots,
        *states.signals(),
        tau,
        filter=states.filter,
        kept=states.kept,
        tau_link=states.tau_link,
        tau_motor=states.tau_motor,
        step=1 / states.rate,
        temperature=states.temperature,
    )
