"""Clocks once more beside what was found: behind a wrong geometry a late torque channel shows only now."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from dynid_rs.diagnosis.beside import Beside, independent_rows
from dynid_rs.diagnosis.kinds import Kinds
from dynid_rs.diagnosis.search import search
from dynid_rs.diagnosis.sensors import TorqueDelay, choose_delay, delay_parts, measure_delay, moved_delay
from dynid_rs.diagnosis.sensors.beside import Beside as ClockBeside
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.state import Search, columns_in, fitted, rms
from dynid_rs.recording import Recording

NONE_LEFT = 3.0
"""A delay that is nearer to none than so many of its standard errors, seen beside what was found, was never there."""
LAGS = ("friction_hysteresis", "load_hysteresis")
"""Effects that a delay is taken for: it is looked for without them."""


def with_late_clock(
    found: Search,
    began: Setup,
    train: Sequence[Recording],
    *,
    on_progress: Callable[[str], None] = lambda step: None,
) -> tuple[Search, TorqueDelay | None]:
    """Return the search with another clock of the torque where that explains more, else `found` and None.

    Channels that came on the encoders' clock may be late, and a delay of all joints that was seen before the physics
    may have been the physics: then none is left, and the returned delay has no places.

    Parameters
    ----------
    found : Search
        What was found, with the torque as it was put on a clock before.
    began : Setup
        What `found` began with.
    train : sequence of Recording
        Training runs, as they were measured.
    """
    early = found.setup.torque_delay
    if np.ptp(early) > 0:  # one drive's: weighed against one clock already
        return found, None
    on_progress("clocks once more")
    without = tuple(effect for effect in found.setup.effects if effect.kind not in LAGS)
    same = len(without) == len(found.setup.effects)
    fit = found.fit if same else fitted(replace(found.setup, effects=without), train)
    delay = choose_delay(delay_parts(fit, ClockBeside(fit)))
    if not delay.places:
        return found, None
    if early.any():
        return _without_delay(found, began, train, delay, on_progress)
    on_progress("the same with a late torque channel")
    other = search(replace(began, torque_delay=delay.per_joint), train, on_progress=on_progress)
    step = measure_delay(delay_parts(other.fit, ClockBeside(other.fit)), delay.places)
    delay = moved_delay(delay, step)
    other.setup = replace(other.setup, torque_delay=delay.per_joint)
    other.fit = fitted(other.setup, train)
    other.kinds = Kinds(other.fit, other.kinds)
    if not explains_more(other, found, np.flatnonzero(delay.per_joint).tolist()):
        return found, None
    return other, delay


def _without_delay(
    found: Search, began: Setup, train: Sequence[Recording], step: TorqueDelay, on_progress: Callable[[str], None]
) -> tuple[Search, TorqueDelay | None]:
    """Without the delay that was seen before the physics, where `step` beside the physics takes it back."""
    left = found.setup.torque_delay + step.per_joint
    if np.any(np.abs(left) > NONE_LEFT * max(step.std_error)):
        return found, None
    on_progress("the same without a late torque channel")
    other = search(replace(began, torque_delay=np.zeros_like(left)), train, on_progress=on_progress)
    everywhere = range(found.setup.robot.n_joints)
    return (other, TorqueDelay(len(left))) if explains_more(other, found, everywhere) else (found, None)


def explains_more(first: Search, second: Search, joints: Sequence[int]) -> bool:
    """Whether the first leaves less on `joints` than the second, its further coefficients paid for."""
    evidence = []
    for state in (first, second):
        beside = Beside(state.fit)
        rows = float(independent_rows(beside.residual, beside.blocks)[list(joints)].sum())
        n_found = sum(len(places) for places in columns_in(state)) + len({*state.setup.torque_delay} - {0.0})
        evidence.append((rows, float(np.log(rms(state.fit)[list(joints)]).mean()), n_found))
    rows = min(n for n, *_ in evidence)
    (_, left, n_first), (_, left_second, n_second) = evidence
    return bool(rows * (left_second - left) > 0.5 * (n_first - n_second) * np.log(max(rows, 2.0)))
