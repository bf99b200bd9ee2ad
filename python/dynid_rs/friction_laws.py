"""Laws of friction: which columns a joint's friction has, and how several laws compare on runs that were not fitted.

``coulomb_viscous``: Coulomb and viscous torque with a coefficient per direction; ``stribeck``: those and a part that
falls with speed; ``paper``: Eqs. 9-11, viscous torque up to the third order above a threshold.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.columns import Observations, Plan
from dynid_rs.evaluation import LEAST_BLOCK, LEAST_BLOCKS, N_RESAMPLES, compare, rmse
from dynid_rs.recording import Recording

if TYPE_CHECKING:
    from dynid_rs.identification import ThreeLoopIdentifier

FloatArray = NDArray[np.float64]

LAWS = ("coulomb_viscous", "stribeck", "paper")
"""From the fewest coefficients per joint to the most."""
DEFAULT_LAW = "paper"
N_ORDERS_KEPT = 4
"""Coulomb and first viscous order, two directions each: what the simpler laws keep of friction's eight columns."""
EXPONENTS = (1.0, 2.0)
N_VELOCITIES = 6
"""Stribeck velocities that are tried at a time."""
LARGEST_VELOCITY = 0.5
"""Largest Stribeck velocity that is tried, over the joint's greatest speed."""
WEAK = 1e-3
"""Directions of a joint's columns weaker than this (relative singular value) do not count in the search."""
BEYOND = 0.05
"""A difference is beyond noise where at most this part of the resampled ones has the other sign."""


def laws_per_joint(law: str | Sequence[str], n_joints: int) -> tuple[str, ...]:
    """One law per joint from one for all or one each.

    Raises
    ------
    ValueError
        No such law, or not one per joint.
    """
    laws = (law,) * n_joints if isinstance(law, str) else tuple(law)
    unknown = [name for name in laws if name not in LAWS]
    if unknown:
        raise ValueError(f"friction_law must be one of {', '.join(LAWS)}, found {unknown[0]!r}")
    if len(laws) != n_joints:
        raise ValueError(f"friction_law must be one law or {n_joints}, one per joint; found {len(laws)}")
    return laws


def with_laws(plan: Plan, laws: Sequence[str], stribeck_at: int | None = None) -> Plan:
    """Return the plan without the columns that a joint's law does not have; friction's are the last own ones.

    `stribeck_at`: place among the effects of the law's own part that falls with speed.
    """
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


@dataclass(frozen=True, eq=False)
class LawComparison:
    """Errors of several laws on runs that were not fitted.

    Parameters
    ----------
    joints : tuple of str
        Names.
    laws : tuple of str
        Laws, simplest first.
    rmse, interval : ndarray (n_laws, n_joints), (n_laws, n_joints, 2)
        Error on the test runs and its 95 % interval [torque unit].
    best : tuple of str
        Law of the least error, per joint.
    beyond_noise : ndarray (n_laws, n_joints)
        Whether a law is worse than the best one by more than noise explains.
    chosen : tuple of str
        The simplest law that is not worse than the best one beyond noise, per joint.
    models : dict
        Fitted `ThreeLoopIdentifier` of every law.
    """

    joints: tuple[str, ...]
    laws: tuple[str, ...]
    rmse: FloatArray
    interval: FloatArray
    best: tuple[str, ...]
    beyond_noise: NDArray[np.bool_]
    chosen: tuple[str, ...]
    models: dict[str, ThreeLoopIdentifier]

    def __str__(self) -> str:
        """Return a table: a row per joint, a column per law, worse ones beyond noise with a star."""
        width = max(len("joint"), *(len(joint) for joint in self.joints))
        lines = ["  ".join(["joint".ljust(width), *(law.rjust(16) for law in self.laws), "chosen"])]
        for j, joint in enumerate(self.joints):
            cells = [
                f"{self.rmse[k, j]:.4g}{'*' if self.beyond_noise[k, j] else ' '}".rjust(16)
                for k in range(len(self.laws))
            ]
            lines.append("  ".join([joint.ljust(width), *cells, self.chosen[j]]))
        return "\n".join(lines)


def compare_friction_laws(
    robot: _core.RobotModel,
    runs: Sequence[Recording],
    test: Sequence[Recording],
    laws: Sequence[str] = LAWS,
    *,
    friction_recording: Recording | Sequence[Recording] | None = None,
    **options: Any,
) -> LawComparison:
    """Fit the whole model with each law and compare errors on test runs, joint by joint.

    Links, rotors and offsets are fitted anew beside each law, by the same second loop; the third loop is left out.

    Parameters
    ----------
    robot : RobotModel
        The arm.
    runs, test : sequence of Recording
        Runs to learn from, and others to test on.
    laws : sequence of str
        Of "coulomb_viscous", "stribeck" and "paper".
    friction_recording : Recording or sequence of Recording, optional
        Friction experiment.
    options
        More arguments of `ThreeLoopIdentifier`.

    Raises
    ------
    ValueError
        No such law, fewer than one, or no test run.
    """
    from dynid_rs.assembly import evaluate
    from dynid_rs.identification import ThreeLoopIdentifier

    laws = [law for law in LAWS if law in laws_per_joint(laws, len(laws))]
    if not laws or not test:
        raise ValueError("comparing laws takes at least one law and one test run that is not fitted")
    models, errors = {}, []
    for law in laws:
        model = ThreeLoopIdentifier(robot, **{"residual": None, **options, "friction_law": law})
        models[law] = model.fit(list(runs), friction_recording)
        states = [model.states(recording) for recording in test]
        errors.append([compare(s, evaluate(model.model_, s)[0]).error for s in states])
    lengths = [max(1, int(LEAST_BLOCK * s.rate / s.step)) for s in states]
    return _compared(tuple(robot.joint_names), laws, errors, lengths, models)


def _compared(
    joints: tuple[str, ...],
    laws: Sequence[str],
    errors: Sequence[Sequence[FloatArray]],
    lengths: Sequence[int],
    models: dict[str, ThreeLoopIdentifier],
) -> LawComparison:
    """Resample the same blocks of every law's errors (n_rows, n_joints), so that differences keep what they share."""
    rng = np.random.default_rng(0)
    powers = np.array([rmse(parts) for parts in errors])
    sums, counts = [], []
    for run, parts in enumerate(zip(*errors, strict=True)):
        squares = np.array(parts) ** 2
        length = lengths[run]
        n_blocks = min(max(LEAST_BLOCKS, squares.shape[1] // length), squares.shape[1])
        for block in np.array_split(np.arange(squares.shape[1]), n_blocks):
            sums.append(squares[:, block].sum(axis=1))
            counts.append(len(block))
    draws = rng.integers(0, len(sums), (N_RESAMPLES, len(sums)))
    drawn = np.array(sums)[draws].sum(axis=1) / np.array(counts)[draws].sum(axis=1)[:, None, None]
    interval = np.sqrt(np.percentile(drawn, [2.5, 97.5], axis=0)).transpose(1, 2, 0)
    least = powers.argmin(axis=0)
    best_drawn = np.take_along_axis(drawn, least[None, None, :], axis=1)
    beyond = np.mean(drawn <= best_drawn, axis=0) <= BEYOND
    beyond[least, np.arange(len(joints))] = False
    simplest = np.argmin(beyond, axis=0)
    return LawComparison(
        joints,
        tuple(laws),
        powers,
        interval,
        tuple(laws[k] for k in least),
        beyond,
        tuple(laws[k] for k in simplest),
        models,
    )


def choose_friction_laws(robot: _core.RobotModel, runs: Sequence[Recording], **options: Any) -> tuple[str, ...]:
    """Law of every joint by training runs alone: the last one, or the last third of a lone one, is left out in turn."""
    from dynid_rs.splitting import split_runs

    split = split_runs(runs, [])
    return compare_friction_laws(robot, split.train, split.test, **options).chosen
