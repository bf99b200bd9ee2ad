"""What a model is believed to be made of: the declared model and, piece by piece, what was found beside it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.identification.three_loops import ThreeLoopIdentifier
from dynid_rs.model.placed import HeldEffect, PlacedEffect
from dynid_rs.model.placement import is_placed_alike

FloatArray = NDArray[np.float64]
Windows = tuple[tuple[float, float], ...]


@dataclass(frozen=True, eq=False)
class Setup:
    """The declared model and what was found beside it. Immutable: every finding gives a new one.

    Parameters
    ----------
    robot : RobotModel
        Geometry and gravity as they are believed to be.
    effects : tuple of PlacedEffect
        Torques that were found, with their shapes; coefficients are fitted.
    held : tuple of HeldEffect
        Torques that were found and fitted at full rate; coefficients stay as they are.
    gain_joints : tuple of int
        Joints whose torque channel has a gain of its own, which is fitted.
    encoder_error : ndarray (n_joints, 2)
        Cosine and sine parts [rad] of what the link encoder shows too much: `e_c cos q + e_s sin q`.
    torque_delay : float
        How late the torque channels are [s]; drives share a clock.
    own_delay : ndarray (n_joints,)
        How much later than that the channel of each joint is [s].
    excluded : mapping of str to windows
        Name of a run to the times [s] in which something from outside acts: neither fitted nor scored.
    options : mapping
        Arguments of `ThreeLoopIdentifier` that stay the same.
    declared : RobotModel
        Geometry and gravity as the robot file has them; `robot` as it was at first, if left out.
    """

    robot: _core.RobotModel
    effects: tuple[PlacedEffect, ...] = ()
    held: tuple[HeldEffect, ...] = ()
    gain_joints: tuple[int, ...] = ()
    encoder_error: FloatArray = None  # type: ignore[assignment]
    torque_delay: float = 0.0
    own_delay: FloatArray = None  # type: ignore[assignment]
    excluded: Mapping[str, Windows] = field(default_factory=dict)
    options: Mapping[str, Any] = field(default_factory=dict)
    declared: _core.RobotModel = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        n = self.robot.n_joints
        if self.declared is None:
            object.__setattr__(self, "declared", self.robot)
        if self.encoder_error is None:
            object.__setattr__(self, "encoder_error", np.zeros((n, 2)))  # the only way in, the class is frozen
        if self.own_delay is None:
            object.__setattr__(self, "own_delay", np.zeros(n))

    @property
    def delays(self) -> FloatArray:
        """How late the torque channel of each joint is [s], (n_joints,)."""
        return self.torque_delay + self.own_delay

    def is_like(self, other: Setup) -> bool:
        """Whether a fit of one is a fit of the other, to the same runs with the same options."""
        one, two = ((setup.effects, setup.held, setup.gain_joints) for setup in (self, other))
        arrays = [(self.encoder_error, other.encoder_error), (self.delays, other.delays)]
        return one == two and is_placed_alike(self.robot, other.robot) and all(np.array_equal(*pair) for pair in arrays)

    def identifier(self, **options: Any) -> ThreeLoopIdentifier:
        """Return an identifier of a model made of this."""
        parts = {
            "effects": self.effects,
            "held": self.held,
            "free_gains": self.gain_joints,
            "encoder_error": self.encoder_error,
            "torque_delay": self.delays,
            "excluded": dict(self.excluded) or None,
        }
        return ThreeLoopIdentifier(self.robot, **{"friction_law": "smooth", **parts, **self.options, **options})


def believed(declared: Setup, found: Setup) -> Setup:
    """Return the declared setup with what was found beside another one of the same robot."""
    return replace(
        declared,
        robot=found.robot,
        effects=found.effects,
        gain_joints=found.gain_joints,
        encoder_error=found.encoder_error,
        torque_delay=found.torque_delay,
        own_delay=found.own_delay,
    )
