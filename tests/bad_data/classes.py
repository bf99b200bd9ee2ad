"""The classes: a name, and who draws a story of it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from bad_data import arm, channels, clocks, wiring
from bad_data.sets import RunSet, good_case, make_set
from bad_data.story import Story

CLASSES: dict[str, Callable[[np.random.Generator, RunSet, int], Story]] = {
    "no number": clocks.not_a_number,
    "time not increasing": clocks.time_not_increasing,
    "gaps": clocks.gaps,
    "degrees": clocks.degrees,
    "unit of time": clocks.unit_of_time,
    "jitter": clocks.jitter,
    "stuck encoder": channels.stuck_encoder,
    "lost bits": channels.lost_bits,
    "wrap": channels.wrapped,
    "saturation": channels.saturated,
    "swapped joints": wiring.swapped,
    "sign": wiring.signs,
    "delays": wiring.delays,
    "current called torque": wiring.current_called_torque,
    "mounting": arm.mounting,
    "filtered": channels.filtered,
    "velocity": channels.bad_velocity,
    "absurd samples": channels.absurd_samples,
    "contact": arm.contact,
    "payload change": arm.payload,
    "still joint": arm.still_joint,
    "poor motion": arm.poor_motion,
    "test run is training run": clocks.run_twice,
}
N_VARIANTS = 5
ARMS = (5, 6, 7)
"""Joints of the three arms; every variant has an arm of its own of that many joints."""


def good_set(seed: int, arm_of: int, variant: int) -> RunSet:
    """The clean set that a variant spoils."""
    return make_set(good_case(100 * seed + 10 * arm_of + variant, ARMS[arm_of]))


def draw_story(name: str, made: RunSet, variant: int) -> Story:
    """Draw a story of a class on a set."""
    place = list(CLASSES).index(name)
    return CLASSES[name](made.rng(10, place, variant), made, variant)
