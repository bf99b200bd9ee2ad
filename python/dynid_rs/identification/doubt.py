"""How well the parameters of a saved model are known: their covariance, as `result.json` holds it.

With C = D D' the torque of a state with the columns y is off by ``y D z``, z ~ N(0, 1): whoever looks for changes
against the model has the columns ``y D`` beside them, each with a prior of one around zero.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.base.errors import DataError
from dynid_rs.base.symmetric import packed, unpacked
from dynid_rs.identification.three_loops import ThreeLoopIdentifier
from dynid_rs.model.assembly import evaluate, with_changes
from dynid_rs.regression.columns import Plan
from dynid_rs.runs.preprocessing import States

FloatArray = NDArray[np.float64]

LARGEST = 2000
"""Unknowns that are read at most."""


@dataclass(frozen=True, eq=False)
class Doubt:
    """Covariance of a model's parameters.

    Parameters
    ----------
    pivots : ndarray (n_base,) of int
        Places of the base parameters among the ten numbers of every link.
    widths : tuple of int
        Columns of each effect that was fitted: the first ones of the model.
    covariance : ndarray (n_base + n_joints sum(widths),) * 2
        Of the base parameters, then of each joint's own coefficients.
    """

    pivots: NDArray[np.int64]
    widths: tuple[int, ...]
    covariance: FloatArray

    @staticmethod
    def of(identifier: ThreeLoopIdentifier) -> Doubt:
        """What a fit leaves open.

        Raises
        ------
        ValueError
            The identifier is not fitted.
        """
        covariance = identifier.parameter_covariance(gains_known=True)
        plan = identifier.observations_.plan
        return Doubt(plan.pivots, tuple(effect.n_columns for effect in plan.effects), covariance)

    def to_json(self) -> dict[str, Any]:
        """As `covariance` of a `result.json`."""
        std, correlation = packed(self.covariance)
        return {
            "pivots": self.pivots.tolist(),
            "columns": list(self.widths),
            "std_error": std,
            "correlation": correlation,
        }

    @staticmethod
    def from_json(said: Mapping[str, Any], model: _core.TorqueModel) -> Doubt:
        """Read it again, for the model that lies beside it.

        Raises
        ------
        DataError
            It is damaged, or of another model.
        """
        try:
            pivots, widths = np.array(said["pivots"]), tuple(said["columns"])
            std, upper = (np.array(said[key], dtype=np.float64) for key in ("std_error", "correlation"))
            n, size, fitted = len(std), len(model.phi), model.effects[: len(widths)]
            right = (
                pivots.dtype.kind == "i"
                and ((pivots >= 0) & (pivots < size)).all()
                and widths == tuple(effect.n_columns for effect, _ in fitted)
                and n == len(pivots) + model.robot.n_joints * sum(widths) <= LARGEST
                and upper.shape == (n * (n + 1) // 2,)
                and np.isfinite(std).all()
                and (std >= 0).all()
                and (np.abs(upper) <= 1 + 1e-6).all()
            )
        except (KeyError, TypeError, ValueError, OverflowError):
            right = False
        if not right:
            raise DataError(
                "`covariance` is damaged, or of another model; write both again with `dynid identify`",
                code="wrong_reference",
            )
        return Doubt(pivots.astype(np.int64), widths, unpacked(std, upper))

    def plan(self, model: _core.TorqueModel) -> Plan:
        """What the unknowns are, of `model`, whose doubt it is."""
        effects = tuple(effect for effect, _ in model.effects[: len(self.widths)])
        return Plan(model.robot, effects, self.pivots, np.ones((model.robot.n_joints, sum(self.widths)), dtype=bool))

    def is_of(self, model: _core.TorqueModel, phi_base: FloatArray) -> bool:
        """Whether a model has these base parameters (n_base,), whose covariance it is."""
        return len(phi_base) == len(self.pivots) and bool(
            np.allclose(np.asarray(model.phi)[self.pivots], phi_base, rtol=1e-9, atol=0.0)
        )

    def columns(self, model: _core.TorqueModel, states: States) -> FloatArray:
        """Columns ``y D`` of a run's torque in the band, (n_rows, n_joints, n); of `model`, whose doubt it is."""
        aligned = states.aligned(model.encoder_delay, model.encoder_error)
        regressor = model.robot.joint_torque_regressor(aligned.q, aligned.dq, aligned.ddq)[:, :, self.pivots]
        base = states.in_band(regressor) * np.asarray(model.torque_scale)[:, None]
        own, root = states.in_band(self._own_columns(model, states)), _root(self.covariance)
        columns: FloatArray = base @ root[: len(self.pivots)]
        for j, coefficients in enumerate(np.split(root[len(self.pivots) :], model.robot.n_joints)):
            columns[:, j] += own[:, j] @ coefficients
        return columns

    def _own_columns(self, model: _core.TorqueModel, states: States) -> FloatArray:
        """Torque per unit of every own coefficient, (n_samples, n_joints, sum(widths)): effect by effect."""
        columns = np.zeros((len(states.t), model.robot.n_joints, sum(self.widths)))
        places = [(k, c) for k, width in enumerate(self.widths) for c in range(width)]
        for place, (k, c) in enumerate(places):
            # Alone among the others as they are: what saturates is the cube of all their torque.
            effects = model.effects
            effect, values = effects[k]
            alone = np.zeros(values.shape)
            alone[:, c] = 1.0
            effects[k] = (effect, alone)
            columns[:, :, place] = evaluate(with_changes(model, effects=effects), states)[1][:, 1 + k]
        return columns


def _root(covariance: FloatArray) -> FloatArray:
    """D with D D' = covariance, (n, n_directions); what rounding made negative is none."""
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    unit = np.where(std > 0, std, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(unit, unit))
    kept = values > 1e-12 * values[-1]
    root: FloatArray = unit[:, None] * vectors[:, kept] * np.sqrt(values[kept])
    return root
