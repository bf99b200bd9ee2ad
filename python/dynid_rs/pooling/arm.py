"""One arm's estimates as pooling needs them: values, covariance, and what a wrong gain would do to them."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.identification.results import base_names
from dynid_rs.identification.smooth_friction import sign_by_way
from dynid_rs.pooling.gains import gain_response, log_gains
from dynid_rs.regression.columns import Plan
from dynid_rs.regression.uncertainty import NORMAL_95

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from dynid_rs.identification.three_loops import ThreeLoopIdentifier

FloatArray = NDArray[np.float64]

DIGITS = 9
"""Significant digits that are kept of an estimate: a hundred-millionth of a standard error is nothing."""

NO_INTERVAL = 1.0
"""Standard error of an error's logarithm where the runs are too short to say one: no arm is named for a factor of e."""
BY_WAY = frozenset(sign_by_way(1).coefficient_names)
"""Coefficients of friction whose sign is told by the way: at speed it is that of Coulomb's."""
WORDS = ("name", "type", "kinematics", "torque_unit")
TEXTS = ("joints", "links", "kinds", "names", "base_links", "base_units", "own_names")
NUMBERS = ("x", "gain_response", "speed", "error", "torque_std", "error_spread")


@dataclass(frozen=True, eq=False)
class ArmEstimate:
    """What the fit of one arm says of its p unknowns: base parameters first, then every joint's own coefficients.

    Where gains of torque channels were fitted (of currents), the logarithms of all joints' come last: a channel that
    shows more moves these first.

    Parameters
    ----------
    name, type : str
        Of the arm, and of the arms that it is pooled with: its robot's, unless said otherwise.
    kinematics : str
        A mark of joints, lengths and gravity, which arms of one type share; empty where `type` was said.
    joints, links : tuple of str
        Names along the chain, (n_joints,) and (n_links,).
    torque_unit : str
        ``"N*m"`` or ``"A"``.
    kinds : tuple of str
        Of the joints, ``"revolute"`` or ``"prismatic"``.
    names, base_links, base_units : tuple of str
        Of the base parameters, (n_base,).
    own_names : tuple of str
        Of one joint's own coefficients, (n_own,).
    estimable : ndarray (p,)
        Unknowns that were estimated; the others are zero.
    x : ndarray (p,)
        Values, in the units of `result.json`.
    covariance : ndarray (p, p)
        Their covariance, samples that resemble their neighbours in time taken into account.
    gain_response : ndarray (n_joints, p)
        Change of `x` per relative change of the torque of one joint alone, see `gain_response`.
    regrouping : ndarray (n_base, 10 n_links)
        Base parameters per inertial parameter of the links (Eq. 2): what a load adds.
    friction : tuple
        Kind of the friction's effect and its shape parameters, one value per joint each.
    speed : ndarray (n_joints,)
        Root mean square speed of the training runs' rows in motion [rad/s, m/s].
    error, torque_std : ndarray (n_joints,)
        On test runs [torque unit].
    error_spread : ndarray (n_joints,)
        Standard error of the error's logarithm: test runs are short.
    """

    name: str
    type: str
    kinematics: str
    joints: tuple[str, ...]
    links: tuple[str, ...]
    torque_unit: str
    kinds: tuple[str, ...]
    names: tuple[str, ...]
    base_links: tuple[str, ...]
    base_units: tuple[str, ...]
    own_names: tuple[str, ...]
    estimable: NDArray[np.bool_]
    x: FloatArray
    covariance: FloatArray
    gain_response: FloatArray
    regrouping: FloatArray
    friction: tuple[str, tuple[tuple[str, tuple[float, ...]], ...]]
    speed: FloatArray
    error: FloatArray
    torque_std: FloatArray
    error_spread: FloatArray

    @property
    def n_joints(self) -> int:
        """Number of joints."""
        return len(self.joints)

    @property
    def n_base(self) -> int:
        """Number of base parameters."""
        return len(self.names)

    @property
    def unknowns(self) -> tuple[str, ...]:
        """Names of all unknowns, (p,)."""
        own = tuple(f"{name} of {joint}" for joint in self.joints for name in self.own_names)
        gains = tuple(f"torque_scale of {joint}" for joint in self.joints)
        return (*self.names, *own, *gains)[: len(self.x)]

    @property
    def n_scales(self) -> int:
        """Torque scales among the unknowns: those of all joints, or none."""
        return len(self.x) - self.n_base - self.n_joints * len(self.own_names)

    def split(self, x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray | None]:
        """Of `x` base parameters (n_base,), own coefficients (n_joints, n_own), torque scales (n_joints,)."""
        last = len(x) - self.n_scales
        scale = np.exp(x[last:]) if self.n_scales else None
        return x[: self.n_base], x[self.n_base : last].reshape(self.n_joints, -1), scale

    @property
    def form(self) -> tuple[Any, ...]:
        """What arms of one type must have in common to be pooled."""
        pivots = tuple(name.split()[0] for name in self.names)
        return self.joints, self.links, self.torque_unit, pivots, self.own_names, self.estimable.tobytes()

    @property
    def friction_names(self) -> tuple[str, ...]:
        """Coefficients of one joint's friction."""
        return (*self._friction.coefficient_names, *(BY_WAY & set(self.own_names)))

    @cached_property
    def _friction(self) -> _core.Effect:
        kind, shape = self.friction
        return _core.Effect.of(kind, **{name: list(values) for name, values in shape})

    def own(self, joint: int, name: str) -> int | None:
        """Place among the unknowns of a joint's own coefficient; None where there is none."""
        if name not in self.own_names:
            return None
        place = self.n_base + joint * len(self.own_names) + self.own_names.index(name)
        return place if self.estimable[place] else None

    def friction_at(self, joint: int, speed: float) -> tuple[FloatArray, FloatArray]:
        """Rows (p,) and (p,) that give of `x` the friction at a speed, and the constant torque there.

        Half the difference and half the sum of the torques at plus and minus `speed` [rad/s, m/s], all own
        coefficients together, after a way that has turned every sign round; both are linear in `x`.
        """
        effect = self._friction
        dq = np.zeros((2, self.n_joints))
        dq[:, joint] = speed, -speed
        columns = _core.effect_columns(effect, np.zeros_like(dq), dq, np.zeros_like(dq))[:, joint]
        level, offset = np.zeros(len(self.x)), np.zeros(len(self.x))
        for k, name in enumerate(effect.coefficient_names):
            place = self.own(joint, name)
            if place is not None:
                level[place] = 0.5 * (columns[0, k] - columns[1, k])
                offset[place] = 0.5 * (columns[0, k] + columns[1, k])
        for name in BY_WAY:
            if (place := self.own(joint, name)) is not None:
                level[place] = 1.0
        constant = self.own(joint, "torque_offset")
        if constant is not None:
            offset[constant] = 1.0
        return level, offset

    @staticmethod
    def of(name: str, identifier: ThreeLoopIdentifier, result: Mapping[str, Any]) -> ArmEstimate:
        """From a fitted identifier and the content of its `result.json`."""
        plan, robot, links = identifier.observations_.plan, identifier.robot, identifier.links_
        effect, _ = plan.friction
        moving = [np.where(states.counted, states.dq_motor[states.rows], np.nan) for states in identifier.runs_]
        square = np.nanmean(np.concatenate(moving) ** 2, axis=0)
        test = result["rmse"]["test"]
        names, base = tuple(base_names(plan)), result["parameters"]["base"]
        gains, free = log_gains(identifier)
        return ArmEstimate(
            name=name,
            type=robot.name,
            kinematics=_mark(robot, names, identifier.torque_unit_),
            joints=tuple(robot.joint_names),
            links=tuple(robot.link_names),
            torque_unit=identifier.torque_unit_,
            kinds=tuple(robot.joint_kinds),
            names=names,
            base_links=tuple(entry["link"] for entry in base),
            base_units=tuple(entry["unit"] for entry in base),
            own_names=tuple(name for effect in plan.effects for name in effect.coefficient_names),
            estimable=np.append(plan.estimable(), free),
            x=np.append(links.x_, gains),
            covariance=identifier.covariance_with_gains(),
            gain_response=gain_response(identifier),
            regrouping=_regrouping(plan),
            friction=(effect.kind, tuple((key, tuple(values)) for key, values in effect.shape)),
            speed=np.sqrt(np.nan_to_num(square, nan=1.0)),
            error=np.asarray(test["after"]),
            torque_std=np.asarray(test["torque_std"]),
            error_spread=_spread(test["after_interval"], robot.n_joints),
        )

    def to_json(self) -> dict[str, Any]:
        """Everything in lists, numbers of `DIGITS` digits, the covariance as its lower triangle, row by row."""
        lower = self.covariance[np.tril_indices(len(self.x))]
        rows, columns = np.nonzero(self.regrouping)
        return {
            "name": self.name,
            "type": self.type,
            "kinematics": self.kinematics,
            "joints": list(self.joints),
            "links": list(self.links),
            "torque_unit": self.torque_unit,
            "kinds": list(self.kinds),
            "names": list(self.names),
            "base_links": list(self.base_links),
            "base_units": list(self.base_units),
            "own_names": list(self.own_names),
            "estimable": self.estimable.tolist(),
            "x": _short(self.x),
            "covariance": _short(lower),
            "gain_response": [_short(row) for row in self.gain_response],
            "regrouping": [rows.tolist(), columns.tolist(), _short(self.regrouping[rows, columns])],
            "friction": [self.friction[0], [[key, list(values)] for key, values in self.friction[1]]],
            "speed": _short(self.speed),
            "error": _short(self.error),
            "torque_std": _short(self.torque_std),
            "error_spread": _short(self.error_spread),
        }

    @staticmethod
    def from_json(content: Mapping[str, Any]) -> ArmEstimate:
        """The other way round.

        Raises
        ------
        KeyError, TypeError, ValueError
            It is not what `to_json` gives.
        """
        p, n_base = len(content["x"]), len(content["names"])
        covariance = np.zeros((p, p))
        covariance[np.tril_indices(p)] = content["covariance"]
        covariance += np.tril(covariance, -1).T
        regrouping = np.zeros((n_base, 10 * len(content["links"])))
        rows, columns, values = content["regrouping"]
        regrouping[rows, columns] = values
        kind, shape = content["friction"]
        given: dict[str, Any] = {key: content[key] for key in WORDS}
        given |= {key: tuple(content[key]) for key in TEXTS}
        given |= {key: np.array(content[key], dtype=float) for key in NUMBERS}
        return ArmEstimate(
            **given,
            estimable=np.array(content["estimable"], dtype=bool),
            covariance=covariance,
            regrouping=regrouping,
            friction=(kind, tuple((key, tuple(values)) for key, values in shape)),
        )


def _regrouping(plan: Plan) -> FloatArray:
    """Base parameters per parameter of the links, (n_base, 10 n_links)."""
    base = plan.robot.base_parameters()
    wide = np.zeros((base.n_base, base.n_standard))
    wide[np.arange(base.n_base), base.pivots] = 1.0
    wide[:, base.dependent] = base.beta
    return wide


def _mark(robot: _core.RobotModel, names: tuple[str, ...], unit: str) -> str:
    """Mark of a robot's kinematics: names of base parameters hold every length that matters."""
    gravity = (np.round(robot.gravity, 3) + 0.0).tolist()  # minus zero is zero
    told = repr((robot.joint_names, robot.joint_kinds, gravity, names, unit))
    return hashlib.sha256(told.encode()).hexdigest()[:6]


def _spread(intervals: Sequence[Sequence[float] | None] | None, n_joints: int) -> FloatArray:
    """Standard errors (n_joints,) of the logarithms of errors, from their 95 % intervals."""
    known = [None] * n_joints if intervals is None else intervals
    spread = np.full(n_joints, NO_INTERVAL)
    for j, interval in enumerate(known):
        if interval is not None and 0 < interval[0] < interval[1]:
            spread[j] = np.log(interval[1] / interval[0]) / (2 * NORMAL_95)
    return spread


def _short(values: FloatArray) -> list[float]:
    return [float(f"{value:.{DIGITS}g}") for value in values]
