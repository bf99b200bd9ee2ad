"""How often the 95 % intervals of a weighed load hold, on simulated arms whose inertials differ from their file.

`python tests/load_coverage.py [DRAWS] [FIRST SEED]` draws that many arms with rigid gears and that many with elastic
ones, each with a tool of 0.5 to 4 kg, fits a reference without the tool, weighs the tool, and prints the share of
intervals that hold the truth, quantity by quantity, their median half-widths, and how often nothing on the flange was
taken for a load.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from functools import lru_cache

import numpy as np
from threadpoolctl import threadpool_limits

from dynid_rs import Doubt, RobotModel
from dynid_rs.identification.three_loops import ThreeLoopIdentifier
from dynid_rs.reference import weigh_load
from dynid_rs.reference.load import _body
from dynid_rs.reference.load_data import QUANTITIES
from dynid_rs.simulation import (
    Tracking,
    build_effects,
    bundled_robot,
    equip,
    parse_wish,
    simulate,
    typical_arm,
)
from dynid_rs.simulation.effects.structure import box_parameters

ENCODER_NOISE = 1e-6
"""[rad]"""
SPREAD = 0.25
"""Links are up to this part lighter or heavier than their file says."""
LEARNED = (12.0, 30.0)
"""Durations [s] of each of the two runs that the reference is fitted to, in turn."""
WEIGHED = 13.0
"""[s], of each of two."""
SURE = 0.01
"""As `dynid payload` has it."""


def drawn_arm(rng, *, elastic):
    """The typical arm with other links; with elastic gears it has a late link encoder too."""
    robot = RobotModel.from_urdf(bundled_robot())
    typical = typical_arm(robot, encoder_noise=ENCODER_NOISE)
    phi = np.asarray(robot.phi).reshape(-1, 10) * rng.uniform(1 - SPREAD, 1 + SPREAD, robot.n_joints)[:, None]
    arm = replace(typical.rigid(), delay=0.0)
    if elastic:
        arm = equip(arm, build_effects([parse_wish(wish) for wish in ("joint_elasticity", "encoder_delay")], typical))
    return replace(arm, phi=phi.ravel())


def drawn_tool(rng):
    """Ten parameters of a box on the last link."""
    mass, centre = rng.uniform(0.5, 4.0), rng.uniform([-0.03, -0.03, 0.03], [0.03, 0.03, 0.12])
    return box_parameters(mass, centre, rng.uniform(0.03, 0.15, 3))


@lru_cache(maxsize=1)  # of an arm that is weighed with its tool and then without
def learned(seed, elastic, duration):
    """The drawn arm and tool, and what runs without the tool tell of the arm."""
    rng = np.random.default_rng([seed, elastic])
    arm, tool = drawn_arm(rng, elastic=elastic), drawn_tool(rng)
    with threadpool_limits(1):
        runs = simulate(arm, n_runs=2, duration=duration, seed=2 * seed, tracking=Tracking()).recordings
        return arm, tool, ThreeLoopIdentifier(arm.robot, residual=None).fit(runs)


def weighed(seed, *, elastic, carried=True, duration=None, loaded_for=WEIGHED):
    """The load as it is weighed, and the truth (10,): mass, centre, inertia about it; zeros with nothing `carried`."""
    arm, tool, fit = learned(seed, elastic, LEARNED[seed % len(LEARNED)] if duration is None else duration)
    tool = tool * carried
    loaded = replace(arm, phi=arm.phi + np.pad(tool, (len(arm.phi) - len(tool), 0)))
    with threadpool_limits(1):
        runs = simulate(loaded, n_runs=2, duration=loaded_for, seed=2 * seed + 1, tracking=Tracking()).recordings
        return weigh_load(fit.model_, runs, doubt=Doubt.of(fit)), _body(tool, np.eye(3), np.zeros(3))


def held(load, truth):
    """Whether each interval (10,) holds."""
    return (load.intervals[:, 0] <= truth) & (truth <= load.intervals[:, 1])


def main(n_draws=24, first=100):
    """Print the table."""
    for elastic in (False, True):
        hits, widths, false = [], [], 0
        for seed in range(first, first + n_draws):
            load, truth = weighed(seed, elastic=elastic)
            hits.append(held(load, truth))
            widths.append(np.diff(load.intervals)[:, 0] / 2)
            nothing, _ = weighed(seed, elastic=elastic, carried=False)
            false += nothing.p_value < SURE and nothing.mass > 0
        share, half = np.mean(hits, axis=0), np.median(widths, axis=0)
        print(f"{'elastic' if elastic else 'rigid'}, {n_draws} draws from seed {first}: {100 * share.mean():.1f} %")
        for name, part, width in zip(QUANTITIES, share, half, strict=True):
            print(f"  {name:<5}{100 * part:>6.0f} %   half-width {width:.2g}")
        print(f"  nothing taken for a load: {false} of {n_draws}")


if __name__ == "__main__":
    main(*(int(word) for word in sys.argv[1:]))
