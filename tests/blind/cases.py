"""The list of cases: what is put into which arm. A case is reproduced by its number alone."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

import numpy as np
from strangers import STRANGERS

ONCE_WRONG = (27, 62, 101, 369)
"""Cases that an earlier program got wrong: physics that looks like one drive's delay, a line that the band shows as a
slower one, a cylinder in the wrong valley, a lever that shrinks to nothing."""
USUAL_SEED = 20250
SEED = int(os.environ.get("BLIND_SEED", USUAL_SEED))
"""Of the whole suite; joints, shapes, signs and trajectories of a case follow from it and the case's number. With
another one in `BLIND_SEED` every case is another one of its kind."""
N_TRAIN, N_TEST = 3, 2
DURATION, RATE = 20.0, 250.0
ARMS = ("four_axis", "six_axis", "seven_axis")
RATIOS = (2.0, 0.3, 0.1, 0.05)
"""Part of the effect that the declared model cannot absorb, over the torque noise."""

SCALED = (
    "stribeck",
    "load_dependent_friction",
    "position_dependent_friction",
    "friction_hysteresis",
    "coupled_friction",
    "torque_ripple",
    "inertial_coupling",
    "joint_spring",
    "counterbalance",
    "torque_saturation",
    "thermal_friction",
    "thermal_drift",
    "gravity_tilt",
    "kinematic_error",
    "torque_gain",
    "torque_delay",
    "encoder_eccentricity",
)
"""Kinds that leave torque, by the share of which they are sized; mixtures are drawn from these."""
LATER = ("load_hysteresis",)
"""Kinds of the lab that the diagnosis does not look for: it tells them by the two that they are made of."""
GEARS = (
    (("joint_elasticity", 1.0),),
    (("joint_elasticity", 0.3),),
    (("nonlinear_elasticity", 1.0),),
    (("nonlinear_elasticity", -1.0),),
    (("backlash", 1.0),),
    (("backlash", 0.3),),
    (("encoder_delay", 1.0),),
    (("encoder_delay", -0.3),),
    (("joint_elasticity", 1.0), ("backlash", 1.0)),
    (("joint_elasticity", 1.0), ("encoder_delay", 1.0)),
)
"""They show between two encoders, not in the torque: sizes are multiples of the laboratory's own."""
SINCE_REFERENCE = (("payload", 1.0), ("payload", 0.1), ("payload", 0.02), ("gravity_tilt", 1.0), None)
"""What has changed since a reference model was identified; None: nothing."""
CONTACTS = (("contact", 1.0), ("contact", 0.3))
N_MIXTURES, N_CLEAN = 14, 22
"""Per arm."""

GROUPS = {"single": 0, "gear": 300, "reference": 340, "mixture": 360, "clean": 420, "outside": 500, "contact": 580}
"""First number of each group."""


@dataclass(frozen=True)
class Put:
    """One thing that is put in: a kind, and how much of it.

    Parameters
    ----------
    kind : str
        Of the laboratory's catalogue, or of `strangers.py`.
    ratio : float, optional
        Unabsorbed part over torque noise that it is scaled to.
    size : float, optional
        Multiple of the laboratory's size, where it is not scaled.
    everywhere : bool
        At the kind's own place instead of a drawn joint.
    """

    kind: str
    ratio: float | None = None
    size: float | None = None
    everywhere: bool = False


@dataclass(frozen=True)
class Case:
    """One arm, one session of runs, and what is put in. `quick` cases are looked at by every test run."""

    number: int
    group: str
    arm: str
    encoders: int
    puts: tuple[Put, ...] = ()
    quick: bool = False

    def rng(self, stream: int = 0) -> np.random.Generator:
        """Source of all chance of this case."""
        return np.random.default_rng([SEED, self.number, stream])

    @property
    def motion(self) -> int:
        """Seed of its trajectories and of the noise."""
        return self.number if SEED == USUAL_SEED else int(self.rng(1).integers(10_000, 2**31))

    @property
    def label(self) -> str:
        """For a line on the screen."""
        what = " + ".join(
            f"{put.kind}" + (f" {put.ratio:.2g}" if put.ratio is not None else f" x{put.size:g}") for put in self.puts
        )
        return f"{self.number:3d} {self.group} {self.arm} {self.encoders}e {what or 'nothing'}"


@cache
def all_cases() -> dict[int, Case]:
    """Every case by its number."""
    makers = (_singles, _gears, _reference, _mixtures, _clean, _outside, _contacts)
    cases: dict[int, Case] = {}
    for (group, first), maker in zip(GROUPS.items(), makers, strict=True):
        for offset, (arm, encoders, puts, quick) in enumerate(maker()):
            number = first + offset
            assert number not in cases, f"group {group} is too long"
            cases[number] = Case(number, group, arm, encoders, puts, quick or number in ONCE_WRONG)
    return cases


Entry = tuple[str, int, tuple[Put, ...], bool]


def _singles() -> Iterator[Entry]:
    """Every kind at every ratio on every arm; one and two encoders by turns."""
    for k, kind in enumerate(SCALED):
        for r, ratio in enumerate(RATIOS):
            for a, arm in enumerate(ARMS):
                # Each kind once among the quick ones, at a ratio where it must be found.
                quick = a == k % 3 and r == k % 2
                yield arm, 1 + (a + r + k) % 2, (Put(kind, ratio),), quick


def _gears() -> Iterator[Entry]:
    for g, kinds in enumerate(GEARS):
        for a, arm in enumerate(ARMS):
            everywhere = (g + a) % 2 == 0
            puts = tuple(Put(kind, size=size, everywhere=everywhere) for kind, size in kinds)
            yield arm, 2, puts, (g, a) in ((0, 1), (4, 2))


def _reference() -> Iterator[Entry]:
    for k, change in enumerate(SINCE_REFERENCE):
        for a, arm in enumerate(ARMS):
            puts = () if change is None else (Put(change[0], size=change[1]),)
            yield arm, 1 + (a + k) % 2, puts, (k, a) == (0, 0)


def _mixtures() -> Iterator[Entry]:
    """Two to four kinds, drawn; with two encoders every other arm has elastic gears as well."""
    for m in range(N_MIXTURES):
        for a, arm in enumerate(ARMS):
            rng = np.random.default_rng([SEED, GROUPS["mixture"], m, a])
            kinds = list(rng.permutation(SCALED)[: 2 + (m + a) % 3])
            if {"thermal_drift", "thermal_friction"} <= set(kinds):  # two warmths in one arm
                kinds.remove("thermal_friction")
                kinds.append("stribeck" if "stribeck" not in kinds else "torque_ripple")
            ratios = 2.0 ** rng.uniform(np.log2(0.3), 1.0, len(kinds))
            puts = tuple(Put(str(kind), round(float(ratio), 2)) for kind, ratio in zip(kinds, ratios, strict=True))
            encoders = 1 + (m + a) % 2
            if encoders == 2 and m % 4 == 0:
                puts += (Put("joint_elasticity", size=1.0, everywhere=True),)
            yield arm, encoders, puts, m == 0


def _clean() -> Iterator[Entry]:
    for m in range(N_CLEAN):
        for a, arm in enumerate(ARMS):
            yield arm, 1 + (m + a) % 2, (), m == 0


def _outside() -> Iterator[Entry]:
    for k, kind in enumerate(STRANGERS):
        for r, ratio in enumerate((2.0, 0.3)):
            for a, arm in enumerate(ARMS):
                yield arm, 1 + (a + r + k) % 2, (Put(kind, ratio),), r == 0 and a == k % 3 and k % 3 == 0


def _contacts() -> Iterator[Entry]:
    for k, (kind, size) in enumerate(CONTACTS):
        for a, arm in enumerate(ARMS):
            yield arm, 1 + (a + k) % 2, (Put(kind, size=size),), (k, a) == (0, 1)
    for a, arm in enumerate(ARMS):
        yield arm, 1 + a % 2, (Put("contact", size=1.0), Put("stribeck", 2.0)), False
