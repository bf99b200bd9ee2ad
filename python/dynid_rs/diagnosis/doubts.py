"""What of a fit may be otherwise and is no effect: how friction turns round, what encoders hide.

Unknowns that every hypothesis stands beside. What they can imitate is no evidence for a name.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.diagnosis.structural.about import About
from dynid_rs.identification.loads import link_load
from dynid_rs.identification.smooth_friction import shape_slopes, tanh_widths
from dynid_rs.identification.three_loops import ThreeLoopIdentifier
from dynid_rs.model.assembly import evaluate
from dynid_rs.regression.kept_columns import effect_rows
from dynid_rs.regression.linear_model import Columns
from dynid_rs.runs.slope import slope

FloatArray = NDArray[np.float64]

SHAPE_SPREAD = 0.3
"""How far the logarithm of a shape of friction may be off where the fit has it."""
WIDER = (0.7, 1.0, 1.4)
"""Widths of a tanh beside a fitted sign, over its own: between them and the fitted one lies any sign that is round."""
YIELDS = 1e-3
"""Usual yielding of a gear [rad]: three arc minutes under the load that it usually has."""
NEVER = 1e9
"""Velocity [rad/s] at which a Stribeck part falls that is a rounded sign alone."""


def doubts(fit: ThreeLoopIdentifier) -> list[Columns]:
    """Columns of everything here, for coefficients that are standard normal beforehand."""
    found: list[Columns] = []
    turns = turning(fit)
    for j in range(fit.robot.n_joints):
        found.append({j: SHAPE_SPREAD * shape_slopes(fit.observations_.plan, fit.links_, fit.runs_, j)})
        found.append({j: SHAPE_SPREAD * other_roundings(fit, j)})
        found.append({j: SHAPE_SPREAD * other_time(fit, turns, j)})
    if any(states.two_encoders for states in fit.runs_):
        return found + apart(fit)
    return found + yielding(fit)


def other_roundings(fit: ThreeLoopIdentifier, j: int) -> FloatArray:
    """What joint j's Coulomb torque would be more with a tanh in the place of its own sign, (n_rows, k)."""
    friction, at = fit.observations_.plan.friction
    usual = tanh_widths(friction)
    coulomb = fit.links_.own_[j, at][0]
    n = fit.robot.n_joints
    own = _sign(fit, friction, j)
    columns = []
    for factor in WIDER:
        tanh = _core.Effect.of(
            "stribeck", stribeck_velocity=np.full(n, NEVER), exponent=np.ones(n), transition_width=factor * usual
        )
        columns.append(coulomb * (_sign(fit, tanh, j) - own))
    return np.stack(columns, axis=1)


def turning(fit: ThreeLoopIdentifier) -> FloatArray:
    """Change of all joints' friction per second that it turns round later, (n_rows, n_joints)."""
    friction, _ = fit.observations_.plan.friction
    term = 1 + [effect.kind for effect, _ in fit.model_.effects].index(friction.kind)
    rows = []
    for states in fit.raw_runs_:
        rows.append(states.in_band(-slope(evaluate(fit.model_, states)[1][:, term], states.rate)))
    return np.concatenate(rows)


def other_time(fit: ThreeLoopIdentifier, turns: FloatArray, j: int) -> FloatArray:
    """Change of joint j's friction if it turned round at another time, as large as that of another width."""
    width = shape_slopes(fit.observations_.plan, fit.links_, fit.runs_, j)[:, :1]
    size = float(np.sqrt(np.mean(turns[:, j] ** 2)))
    return turns[:, j : j + 1] * (float(np.sqrt(np.mean(width**2))) / max(size, 1e-300))


def apart(fit: ThreeLoopIdentifier) -> list[Columns]:
    """What two encoders that show other accelerations leave open: each of them, times each joint's usual torque.

    The steps of a coarse encoder are noise that links multiply with their inertia: whatever the finer one shows in the
    place of it explains that noise, and is no torque.
    """
    link, motor = (
        np.concatenate([states.in_band(getattr(states, name)) for states in fit.runs_]) for name in ("ddq", "ddq_motor")
    )
    size = np.sqrt(np.mean(link**2, axis=0))
    between: FloatArray = (motor - link)[:, size > 0] / size[size > 0]
    if not between.size:
        return []
    torque = np.concatenate([states.in_band(states.tau) for states in fit.runs_])
    return [{j: float(np.sqrt(np.mean(torque[:, j] ** 2))) * between} for j in range(torque.shape[1])]


def yielding(fit: ThreeLoopIdentifier) -> list[Columns]:
    """Change of all joints' torque if a gear yielded by `YIELDS` under its usual load, one column per joint.

    With one encoder, on the motor's side, a link is not where it is read to be but hangs behind by its load.
    """
    about, load = About.of(fit), link_load(fit.observations_.plan, fit.links_)
    bent = [load(states) for states in fit.runs_]
    size = np.sqrt(np.mean(np.concatenate(bent) ** 2, axis=0))
    found: list[Columns] = []
    for j in np.flatnonzero(size > 0).tolist():
        slopes = []
        for states, tau in zip(fit.runs_, bent, strict=True):
            behind = YIELDS * tau[:, j] / size[j]
            rate = slope(behind, states.rate)
            moved = behind, rate, slope(rate, states.rate)
            ends = []
            for sign in (-0.5, 0.5):
                motion = [x.copy() for x in (states.q, states.dq, states.ddq)]
                for x, change in zip(motion, moved, strict=True):
                    x[:, j] += sign * change
                q, dq, ddq = motion
                ends.append(fit.robot.inverse_dynamics(q, dq, ddq, about.phi))
            slopes.append((ends[0] - ends[1])[:, :, None])
        found.append(about.in_band(slopes))
    return found


def _sign(fit: ThreeLoopIdentifier, effect: _core.Effect, j: int) -> FloatArray:
    """Rounded sign of joint j's speed in the band, (n_rows,): a law's Coulomb columns taken together."""
    names = list(effect.coefficient_names)
    at = [k for k, name in enumerate(names) if name == "coulomb" or name.startswith(("coulomb_p", "coulomb_n", "stri"))]
    parts = []
    for states in fit.runs_:
        parts.append(effect_rows(effect, states, j)[:, at].sum(axis=1))
    return np.concatenate(parts)
