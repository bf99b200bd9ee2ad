"""Laws of friction: which columns a joint's friction has.

``coulomb_viscous``: Coulomb and viscous torque with a coefficient per direction; ``stribeck``: those and a part that
falls with speed; ``paper``: Eqs. 9-11, viscous torque up to the third order above a threshold; ``smooth``: Coulomb's
sign rounded by a width and a sharpness (`smooth_friction.py`), on all joints or none.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.regression.columns import Observations, Plan

FloatArray = NDArray[np.float64]

LAWS = ("coulomb_viscous", "smooth", "stribeck", "paper")
"""From the fewest coefficients per joint to the most."""
LAWS_BY_JOINT = tuple(law for law in LAWS if law != "smooth")
"""Those that joints of one model may have side by side."""
N_ORDERS_KEPT = 4
"""Coulomb and first viscous order, two directions each: what the simpler laws keep of friction's eight columns."""
EXPONENTS = (1.0, 2.0)
N_VELOCITIES = 6
"""Stribeck velocities that are tried at a time."""
LARGEST_VELOCITY = 0.5
"""Largest Stribeck velocity that is tried, over the joint's greatest speed."""
WEAK = 1e-3
"""Directions of a joint's columns weaker than this (relative singular value) do not count in the search."""


def laws_per_joint(law: str | Sequence[str], n_joints: int) -> tuple[str, ...]:
    """One law per joint from one for all or one each.

    Raises
    ------
    ValueError
        No such law, or not one per joint.
    """
    if not isinstance(law, Iterable):
        raise ValueError(f"friction_law must be one of {', '.join(LAWS)}, or one per joint; found {law!r}")
    laws = (law,) * n_joints if isinstance(law, str) else tuple(law)
    unknown = [name for name in laws if name not in LAWS]
    if unknown:
        raise ValueError(f"friction_law must be one of {', '.join(LAWS)}, found {unknown[0]!r}")
    if "smooth" in laws and set(laws) != {"smooth"}:
        raise ValueError("friction_law 'smooth' is a law for all joints; give it alone")
    if len(laws) != n_joints:
        raise ValueError(f"friction_law must be one law or {n_joints}, one per joint; found {len(laws)}")
    return laws


def usual_law(*, with_prior: bool, with_pairs: bool) -> str:
    """Law of all joints where none is asked for.

    "smooth": its shapes are as probable as the data make them beside all other unknowns, which takes the weak prior.
    The pairs of a friction experiment decide a shape by themselves, the paper's; without a prior it is the paper's too.
    """
    return "smooth" if with_prior and not with_pairs else "paper"


def with_laws(plan: Plan, laws: Sequence[str], stribeck_at: int | None = None) -> Plan:
    """Return the plan without the columns that a joint's law does not have; friction's are the last own ones.

    `stribeck_at`: place among the effects of the law's own part that falls with speed.
    """
    if "smooth" in laws:
        return plan
    own = plan.own.copy()
    names = [name for effect in plan.effects for name in effect.coefficient_names]
    places = [place for place, effect in enumerate(plan.effects) for _ in range(effect.n_columns)]
    stribeck = np.array([place == stribeck_at for place in places])
    high = np.arange(len(names)) >= len(names) - len(_core.FRICTION_NAMES) + N_ORDERS_KEPT
    for j, law in enumerate(laws):
        if law != "paper":
            own[j, high] = False
        if law != "stribeck":
            own[j, stribeck] = False
    return replace(plan, own=own)


def fit_stribeck(
    friction: _core.Effect, top_speed: FloatArray, left: Callable[[_core.Effect], FloatArray]
) -> _core.Effect:
    """Stribeck velocity and exponent of every joint, by a scan and a finer one around its best.

    Parameters
    ----------
    friction : Effect
        Friction whose transition widths the law shares.
    top_speed : ndarray (n_joints,)
        Greatest speeds [rad/s].
    left : callable
        Residual power per joint (n_joints,) with an effect of this shape.
    """
    width = np.array(dict(friction.shape)["transition_width"])
    low = np.log(2 * width)
    span = np.log(np.maximum(LARGEST_VELOCITY * top_speed, 4 * width)) - low
    best = np.full(len(width), np.inf)
    place, exponent = np.zeros(len(width)), np.full(len(width), EXPONENTS[0])
    tries = [
        (np.full(len(width), x), np.full(len(width), d)) for d in EXPONENTS for x in np.linspace(0, 1, N_VELOCITIES)
    ]
    for step in (1.0, 1 / N_VELOCITIES, 1 / N_VELOCITIES**2):
        if step < 1:
            tries = [(place + step * x, exponent) for x in np.linspace(-0.8, 0.8, 5) if x]
        for where, power_law in list(tries):
            power = left(_stribeck(low + span * where, power_law, width))
            better = power < best
            best = np.where(better, power, best)
            place, exponent = np.where(better, where, place), np.where(better, power_law, exponent)
    return _stribeck(low + span * place, exponent, width)


def _stribeck(log_velocity: FloatArray, exponent: FloatArray, width: FloatArray) -> _core.Effect:
    velocity = np.exp(log_velocity)
    return _core.Effect.of("stribeck", stribeck_velocity=velocity, exponent=exponent, transition_width=width)


def power_left(observations: Observations, beside: Sequence[FloatArray] | None = None) -> FloatArray:
    """Residual power (n_joints,) of every joint's own equation; of `beside`'s factors where they have rows."""
    plan = observations.plan
    powers = np.zeros(plan.robot.n_joints)
    for j, factor in enumerate(observations.factors()):
        R = beside[j] if beside is not None and np.any(beside[j]) else factor
        used = np.concatenate([plan.own[j], np.ones(R.shape[1] - plan.n_own - 1, dtype=bool)])
        columns = R[:, :-1][:, used]
        norms = np.linalg.norm(columns, axis=0)
        columns = columns[:, norms > 1e-6 * norms.max(initial=0.0)]
        columns = columns / np.linalg.norm(columns, axis=0)
        x = np.linalg.lstsq(columns, R[:, -1], rcond=WEAK)[0]
        powers[j] = np.sum((R[:, -1] - columns @ x) ** 2)
    return powers
