"""The bundled arm in a friction experiment: the paper's limits, friction with both directions, known truth."""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np

from dynid_rs import FrictionIdentifier, Recording, RobotModel, ThreeLoopIdentifier, _core
from dynid_rs.excitation.friction_experiment import plan_friction_experiment
from dynid_rs.excitation.friction_segments import FrictionExperiment
from dynid_rs.identification.friction import friction_effect
from dynid_rs.simulation import MotionLimits, SimulatedArm, bundled_robot, simulate, typical_arm
from dynid_rs.simulation.limits import plausible_effort
from helpers.paper_tables import LIMITS

TOP = LIMITS["velocity"]
"""Greatest speeds of the paper's Table 1 [rad/s]."""
RATE = 1000.0


@functools.cache
def robot() -> RobotModel:
    return RobotModel.from_urdf(bundled_robot())


def paper_limits() -> MotionLimits:
    """Table 1: position, velocity, acceleration; the third joint about the middle of what the arm can do."""
    reach = LIMITS["position"]
    middle = np.deg2rad([0.0, 20.0, -45.0, 0.0, 0.0, 0.0])
    return MotionLimits(middle - reach, middle + reach, TOP, LIMITS["acceleration"])


def arm() -> SimulatedArm:
    """Rigid gears; Coulomb 4 % of the effort, viscous torque of three orders 15, -12 and 5 % at top speed, directions
    10 % apart, an offset; encoders of 20 and 22 bits, torque noise of 0.2 % of the effort at every sample."""
    effort = plausible_effort(robot())
    columns = []
    for order, share in enumerate((0.04, 0.15, -0.12, 0.05)):
        size = share * effort / TOP**order
        columns += [1.05 * size, (-0.95 if order == 2 else 0.95) * size]
    return replace(
        typical_arm(robot()).rigid(),
        delay=0.0,
        friction=np.stack(columns, axis=1),
        velocity_threshold=0.02 * TOP,
        transition_width=0.008 * TOP,
        noise_std=0.002 * effort,
    )


def plan() -> FrictionExperiment:
    """Long enough for single coefficients of all three orders: eight pairs at full speed carry the cubic ones."""
    return plan_friction_experiment(
        robot(), paper_limits(), n_speeds=6, leg_time=1.0, levels=(1.0,) * 8 + (0.3, 0.1, 0.03)
    )


@functools.cache
def experiment() -> Recording:
    """The friction experiment, measured at 1 kHz."""
    return arm().record(plan(), RATE, np.random.default_rng(5), "friction.parquet")


@functools.cache
def exciting_runs() -> tuple[Recording, ...]:
    """Two runs of 20 s over the whole workspace, at 250 Hz."""
    return simulate(arm(), n_runs=2, duration=20.0, rate=250.0, seed=1).recordings


class KnownShape(FrictionIdentifier):
    """An oracle that knows lambda and eps and has only the coefficients to find."""

    def fit(self, *_, **__):
        self.velocity_threshold_, self.transition_width_ = arm().velocity_threshold, arm().transition_width
        self.effect_ = friction_effect(self.velocity_threshold_, self.transition_width_)
        return self


@functools.cache
def identified(oracle: bool = False) -> ThreeLoopIdentifier:
    friction = KnownShape() if oracle else None
    model = ThreeLoopIdentifier(robot(), friction=friction, residual=None)
    return model.fit(list(exciting_runs()), experiment())


def friction_torque(model: ThreeLoopIdentifier, j: int, speeds: np.ndarray) -> np.ndarray:
    """Friction of joint j by the fitted model, (n,)."""
    shape = model.friction_
    columns = _core.friction_basis(speeds, shape.velocity_threshold_[j], shape.transition_width_[j])
    return columns @ model.links_.own_[j, -8:]


def true_torque(j: int, speeds: np.ndarray) -> np.ndarray:
    truth = arm()
    columns = _core.friction_basis(speeds, truth.velocity_threshold[j], truth.transition_width[j])
    return columns @ truth.friction[j]
