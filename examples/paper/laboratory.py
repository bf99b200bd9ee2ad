"""The experiment on the simulated laboratory arm: friction, exciting motion, identification, runs never fitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import tables
from clock import Clock
from errors import LAW, Outcome, outcome_of

from dynid_rs import FourierExcitation, FrictionIdentifier, Recording, ResidualCompensator, ThreeLoopIdentifier, _core
from dynid_rs.excitation.friction_experiment import plan_friction_experiment
from dynid_rs.identification.friction_experiment import OddFriction, odd_friction
from dynid_rs.simulation import SimulatedArm, Tracking, simulate, typical_arm

REST = 0.5
"""At rest before and after every motion [s]."""
ENCODER_NOISE = 1e-6
"""Of both encoders beside their steps [rad]."""
RATE = 250.0
"""Samples per second of all runs but the one that is timed [Hz]."""
DESIGNED, TABLE_3 = "another designed run", "the paper's Table 3"
"""Held-out runs."""


@dataclass(frozen=True)
class Extent:
    """How much is done: designs per objective, their search, runs to learn from, friction experiment, timing."""

    seeds: int
    search: dict[str, int]
    n_train: int
    friction: dict[str, Any]
    timed_rate: float
    repeats: int


FULL = Extent(5, {}, 3, {"n_speeds": 6, "leg_time": 1.0}, timed_rate=1000.0, repeats=3)
QUICK = Extent(
    3,
    {"n_restarts": 1, "max_iter": 6},
    2,
    {"n_speeds": 3, "leg_time": 1.0, "pair_time": 8.0, "levels": (1.0, 0.1)},
    timed_rate=250.0,
    repeats=1,
)


@dataclass(frozen=True, eq=False)
class Laboratory:
    """What was measured: the arm, runs to learn from, runs never fitted, the friction experiment, a run to be timed.

    `ideal_friction` is the friction experiment on the same arm without friction of the gears' teeth.
    """

    arm: SimulatedArm
    train: list[Recording]
    held_out: dict[str, list[Recording]]
    friction: Recording
    ideal_friction: Recording
    timed: Recording


def measure(robot: _core.RobotModel, designs: Sequence[FourierExcitation], extent: Extent) -> Laboratory:
    """Play the designs (the last one and Table 3 are held out) and the friction experiment, in a closed loop."""
    arm = typical_arm(robot, encoder_noise=ENCODER_NOISE)
    plans = [replace(design.trajectory_, rest=REST) for design in designs[: extent.n_train + 1]]
    plans.append(tables.table_3(REST))
    runs = list(_play(arm, plans, RATE, seed=0))
    slow = plan_friction_experiment(robot, tables.table_1_of_motion(), **extent.friction)
    (friction,) = _play(arm, [slow], RATE, seed=1)
    ideal = replace(arm, hysteresis_loss=np.zeros(robot.n_joints))
    (without_teeth,) = _play(ideal, [slow], RATE, seed=1)
    (timed,) = _play(arm, plans[:1], extent.timed_rate, seed=2)
    *train, designed, table_3 = runs
    return Laboratory(
        arm, train, {DESIGNED: [designed], TABLE_3: [table_3]}, replace(friction, name="friction"), without_teeth, timed
    )


def _play(arm: SimulatedArm, plans: Sequence[Any], rate: float, seed: int) -> tuple[Recording, ...]:
    played = simulate(arm, n_runs=len(plans), rate=rate, seed=seed, trajectories=plans, tracking=Tracking())
    return played.recordings


METHODS: dict[str, dict[str, Any]] = {
    "ours": {},
    "the paper's inputs": {"residual": ResidualCompensator(inputs="deflection")},
    "eps = 1e-4 as printed": {"friction": FrictionIdentifier(as_printed=True)},
}
"""Identifications without the friction experiment."""
WITH_FRICTION = "ours, with the friction experiment"


def identify(lab: Laboratory) -> dict[str, Outcome]:
    """Every method, learned from the same runs."""
    robot = lab.arm.robot
    outcomes = {}
    for name, options in METHODS.items():
        identifier = ThreeLoopIdentifier(robot, friction_law=LAW, **options).fit(lab.train)
        outcomes[name] = outcome_of(identifier, lab.held_out)
    identifier = ThreeLoopIdentifier(robot).fit(lab.train, lab.friction)
    outcomes[WITH_FRICTION] = outcome_of(identifier, lab.held_out)
    return outcomes


@dataclass(frozen=True, eq=False)
class Friction:
    """Figure 6: odd friction by Eq. 8, by the fitted law and in truth, at `speeds` (n_joints, m) [rad/s]."""

    pairs: list[OddFriction]
    ideal_pairs: list[OddFriction]
    speeds: np.ndarray
    law: np.ndarray
    truth: np.ndarray
    clock: Clock
    duration: float

    def errors(self, j: int) -> tuple[float, float, float]:
        """RMS over the pairs' speeds of joint j [N m]: of the truth, of pairs minus truth, of law minus truth."""
        odd = self.pairs[j]
        law, truth = (np.interp(odd.speed, self.speeds[j], values[j]) for values in (self.law, self.truth))
        size, pairs, fitted = (float(np.sqrt(np.mean(x**2))) for x in (truth, odd.tau_odd - truth, law - truth))
        return size, pairs, fitted

    def ideal_errors(self, j: int) -> float:
        """RMS of pairs minus truth where the gears' teeth have no friction [N m]."""
        odd = self.ideal_pairs[j]
        return float(np.sqrt(np.mean((odd.tau_odd - np.interp(odd.speed, self.speeds[j], self.truth[j])) ** 2)))


def friction(lab: Laboratory) -> Friction:
    """First and second loop with the friction experiment; of the law and the truth, what is odd in the speed.

    Tooth friction is not part of this truth: it follows the gear's deflection, which constant speed leaves as it is.
    """
    clock = Clock()
    identifier = ThreeLoopIdentifier(lab.arm.robot, residual=None)
    identifier.fit(lab.train, lab.friction, on_progress=clock)
    clock.stop()
    pairs = odd_friction(lab.friction)
    speeds = np.array([np.geomspace(0.8 * odd.speed.min(), odd.speed.max(), 400) for odd in pairs])
    found, arm = identifier.friction_, lab.arm
    fitted = found.velocity_threshold_, found.transition_width_, identifier.links_.own_[:, -8:]
    true = arm.velocity_threshold, arm.transition_width, arm.friction
    law, truth = (
        np.array([_odd(lambdas[j], widths[j], coefficients[j], speeds[j]) for j in range(len(pairs))])
        for lambdas, widths, coefficients in (fitted, true)
    )
    return Friction(pairs, odd_friction(lab.ideal_friction), speeds, law, truth, clock, lab.friction.duration)


def _odd(threshold: float, width: float, coefficients: np.ndarray, speeds: np.ndarray) -> np.ndarray:
    forth, back = (_core.friction_basis(v, threshold, width) @ coefficients for v in (speeds, -speeds))
    return (forth - back) / 2
