"""First loop with a smooth law: how Coulomb's sign turns round at rest, by the evidence.

``F(v) = c s + c' |s| + k v + k' |v| + m v |v| + m' v^2 + h z`` with ``s(v) = v / (|v|^p + e^p)^(1/p)``. A sign that
turns round wider or rounder than a model allows looks like Stribeck's friction on every joint of an arm; with width e
and sharpness p free a curve that falls is still told from it. z is the sign once more, told by the way instead of the
speed: it has turned round when the joint has come back by a tenth of a milliradian, it is sharp where a speed from an
encoder's steps is not, and it keeps its value where the joint rests.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.base.estimator import Estimator
from dynid_rs.base.odds import SURE
from dynid_rs.identification.links import LinkDynamicsIdentifier
from dynid_rs.regression.columns import Observations, Plan
from dynid_rs.regression.evidence import FIRST_MEMORY, Posterior
from dynid_rs.regression.priors import usual_torque
from dynid_rs.regression.uncertainty import law_slopes
from dynid_rs.runs.preprocessing import States, top_speed

FloatArray = NDArray[np.float64]
Shapes = tuple[FloatArray, FloatArray]

KIND = "smooth_friction"
SHARPNESS = (1.2, 1.5, 2.5, 4.0)
"""Sharpnesses that are tried: like an arctan, a root, a tanh, a corner."""
WAY = 1e-4
"""Way [rad] on which a sign that is told by it turns round: less than the arc minute of lost motion that gears have
(`PRESLIDING_DISTANCE` in the catalogue of effects), more than an encoder's step at the joint."""
FIRST_WIDTH, FIRST_SHARPNESS = 4e-3, 2.5
"""Shape [rad/s, 1] before there is a fit."""
WIDTHS = (0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.04, 0.08)
"""Widths that are tried, over the joint's greatest speed."""
USUAL_WIDTH, SPREAD = 0.003, 1.0
"""Usual width over the greatest speed, and the spread of its logarithm: what is wide is a curve of friction too."""
AT_ONCE = 8
"""Shapes whose columns are built in one pass over the runs; more would only take more memory."""
DIGITS = 9
"""Of a shape that are kept. What another library of linear algebra rounds otherwise would come back a hundredfold from
each step on the shapes; nobody knows one to a hundredth."""
HALF_UP = float(np.log(3.0) / 2)
"""Speed over its width at which a hyperbolic tangent is half up."""
LONGEST, SHARPEST = 1.0, 10.0
"""Sharpness of the longest tail and of the sharpest corner."""
SPREAD_HERE, LARGEST_STEP = 0.3, 0.5
"""How far the logarithm of a shape may be off in a Gauss-Newton step, and the longest step."""


class SmoothFrictionIdentifier(Estimator):
    """Width and sharpness of every joint's friction.

    Parameters
    ----------
    start : (ndarray (n_joints,), ndarray (n_joints,)), optional
        Width and sharpness that an earlier fit of the same runs has found: they are only improved.
    held : bool or ndarray (n_joints,)
        Joints on which they are not even improved; True for all.

    Attributes
    ----------
    transition_width_, sharpness_ : ndarray (n_joints,)
        e [rad/s] and p.
    velocity_threshold_ : ndarray (n_joints,)
        Zeros: this law has none.
    effect_ : Effect
        The same as an effect of the torque model.
    """

    def __init__(
        self, start: tuple[FloatArray, FloatArray] | None = None, *, held: bool | NDArray[np.bool_] = False
    ) -> None:
        self.start = start
        self.held = held

    def begin(self, n_joints: int) -> SmoothFrictionIdentifier:
        """Take the usual shape on every joint."""
        self.velocity_threshold_ = np.zeros(n_joints)
        usual = (np.full(n_joints, FIRST_WIDTH), np.full(n_joints, FIRST_SHARPNESS))
        self._keep(*(usual if self.start is None else self.start))
        return self

    def fit(
        self, observations: Observations, links: LinkDynamicsIdentifier, runs: Sequence[States]
    ) -> SmoothFrictionIdentifier:
        """Choose the shapes beside everything else that `links` has fitted to `observations`."""
        self._top = top_speed(runs)
        grid = [list(product(np.array(WIDTHS) * v, SHARPNESS)) for v in self._top]
        width, sharpness = self.transition_width_.copy(), self.sharpness_.copy()
        for j, best in enumerate(self._best(observations, links, runs, grid)):
            width[j], sharpness[j] = best
        self._keep(width, sharpness)
        return self

    def improve(self, observations: Observations, links: LinkDynamicsIdentifier, runs: Sequence[States]) -> float:
        """One Gauss-Newton step on all shapes beside everything else; its greatest change of a logarithm."""
        plan, posterior = observations.plan, _posterior(links)
        free = np.flatnonzero(~np.broadcast_to(self.held, plan.robot.n_joints))
        model = posterior.model(plan, observations.joint_rows(), n_effective=_at_least(posterior, observations))
        model = model.beside(*({j: SPREAD_HERE * shape_slopes(plan, links, runs, j)} for j in free.tolist()))
        fit = model.fit(posterior.choice, posterior.noise_std)
        step = np.zeros((plan.robot.n_joints, 2))
        found = SPREAD_HERE * fit.x[len(fit.x) - 2 * len(free) :].reshape(-1, 2)
        step[free] = np.clip(found, -LARGEST_STEP, LARGEST_STEP)
        width, sharpness = np.exp(step).T
        self._keep(self.transition_width_ * width, np.clip(self.sharpness_ * sharpness, LONGEST, SHARPEST))
        return float(np.max(np.abs(step[:, 0])))

    def doubt(self, runs: Sequence[States]) -> float:
        """Minus the logarithm of all shapes' probability beforehand."""
        shapes = zip(self.transition_width_, self.sharpness_, top_speed(runs), strict=True)
        return sum(_doubt(*shape) for shape in shapes)

    def _best(
        self,
        observations: Observations,
        links: LinkDynamicsIdentifier,
        runs: Sequence[States],
        tries: Sequence[Sequence[tuple[float, float]]],
    ) -> list[tuple[float, float]]:
        """Shape of every joint under which the data are most probable, all other joints' shapes as they are."""
        plan, posterior = observations.plan, _posterior(links)
        n = plan.robot.n_joints
        effects = [
            _core.Effect.of(KIND, transition_width=[t[k][0] for t in tries], sharpness=[t[k][1] for t in tries])
            for k in range(len(tries[0]))
        ]
        rows = observations.joint_rows()
        _, own = plan.friction
        whole = posterior.model(plan, rows, n_effective=_at_least(posterior, observations))
        sizes = (usual_torque(effects[0], name) for name in effects[0].coefficient_names)
        usual = np.array([size * (posterior.choice.bends if bends else 1.0) for size, bends in sizes])
        bounds = np.tile([-np.inf, np.inf], (len(usual), 1))
        bounds[0, 0] = 0.0  # friction does not drive
        fits = []
        for j in range(n):
            first = plan.n_base + j * plan.n_own
            model = whole.without([(j, first + k) for k in range(own.start, own.stop)])
            # At the noise that friction leaves: without friction it would be noise, and no shape better than others.
            fits.append(model.at(posterior.choice, posterior.noise_std))
        values = np.empty((n, len(effects)))
        for first in range(0, len(effects), AT_ONCE):
            part = effects[first : first + AT_ONCE]
            tried = [
                _core.observe(plan.robot, part, [], *s.signals(), np.zeros_like(s.tau), filter=s.filter, kept=s.kept)
                for s in runs
            ]
            for j, fit in enumerate(fits):
                columns = np.concatenate([run[j][:, :-1] for run in tried])
                torque = np.sqrt(np.mean(rows[j][:, -1] ** 2))
                hypotheses = [{j: _standardised(own, torque * usual)} for own in np.split(columns, len(part), axis=1)]
                scores = fit.model.screen(fit, hypotheses, [bounds] * len(part))
                values[j, first : first + len(part)] = [score.value for score in scores]
        doubts = [[_doubt(*shape, self._top[j]) for shape in tries[j]] for j in range(n)]
        return [tries[j][k] for j, k in enumerate(np.argmax(values - doubts, axis=1).tolist())]

    def _keep(self, width: FloatArray, sharpness: FloatArray) -> None:
        self.transition_width_, self.sharpness_ = _to_digits(width), _to_digits(sharpness)
        self.effect_ = smooth(self.transition_width_, self.sharpness_)


def _to_digits(x: FloatArray) -> FloatArray:
    """Numbers to `DIGITS` digits."""
    return np.array([float(f"{value:.{DIGITS}g}") for value in x])


def smooth(width: FloatArray, sharpness: FloatArray) -> _core.Effect:
    """Return the law with these shapes."""
    return _core.Effect.of(KIND, transition_width=width, sharpness=sharpness)


def in_reach(shapes: Shapes, before: Shapes, runs: Sequence[States]) -> Shapes:
    """Return shapes where a sign has them beside names: what turns round over a tenth of all speeds is a curve.

    One that was beyond `before` may be so, but not further.
    """
    (width, sharpness), (was, _), top = shapes, before, top_speed(runs)
    narrowest, widest = np.minimum(WIDTHS[0] * top, was), np.maximum(WIDTHS[-1] * top, was)
    return np.clip(width, narrowest, widest), np.clip(sharpness, LONGEST, SHARPEST)


def sign_by_way(n_joints: int) -> _core.Effect:
    """Return the part of Coulomb's friction whose sign is told by the way."""
    return _core.Effect.of("friction_hysteresis", presliding_distance=np.full(n_joints, WAY))


def tanh_widths(friction: _core.Effect) -> FloatArray:
    """Width (n_joints,) [rad/s] of the tanh that is half up where the law's sign is; others turn round with it."""
    shape = {name: np.asarray(values) for name, values in friction.shape}
    if "sharpness" not in shape:
        return shape["transition_width"]
    widths: FloatArray = shape["transition_width"] * _half_up(shape["sharpness"]) / HALF_UP
    return widths


def sign_shape(friction: _core.Effect) -> Shapes:
    """Width (n_joints,) [rad/s] and sharpness of a law's sign, as effects have them; 0 is a tanh."""
    shape = {name: np.asarray(values) for name, values in friction.shape}
    width = shape["transition_width"]
    return width, shape.get("sharpness", np.zeros_like(width))


def _half_up(sharpness: FloatArray) -> FloatArray:
    """Speed over its width at which a smooth law's sign is half up."""
    speed: FloatArray = (2**sharpness - 1) ** (-1 / sharpness)
    return speed


def in_paper_terms(coefficients: dict[str, float]) -> dict[str, float]:
    """Coefficients of Eqs. 9-11 that give the same friction beyond the step; those of that law stay as they are."""
    if "coulomb_asymmetry" not in coefficients:
        return coefficients
    c, dc, k, dk, m, dm = (
        coefficients[name + end] for name in ("coulomb", "viscous", "quadratic") for end in ("", "_asymmetry")
    )
    # The printed quadratic term keeps its sign in both directions.
    pairs = {
        "coulomb": (c + dc, c - dc),
        "viscous1": (k + dk, k - dk),
        "viscous2": (dm + m, dm - m),
        "viscous3": (0, 0),
    }
    return {
        f"{name}_{side}": float(x) for name, both in pairs.items() for side, x in zip(("pos", "neg"), both, strict=True)
    }


def _posterior(links: LinkDynamicsIdentifier) -> Posterior:
    if links.posterior_ is None:
        raise ValueError("friction_law smooth needs a prior and weights; choose another law, or leave both as they are")
    return links.posterior_


def _at_least(posterior: Posterior, observations: Observations) -> FloatArray:
    """Independent samples per joint, (n_joints,): a shape that does not fit must not hide behind its long memory."""
    least: FloatArray = np.maximum(posterior.n_effective, FIRST_MEMORY * observations.n_counted)
    return least


def shape_slopes(plan: Plan, links: LinkDynamicsIdentifier, runs: Sequence[States], j: int) -> FloatArray:
    """Change of joint j's filtered friction with the logarithm of each shape parameter of its law, (n_rows, k)."""
    friction, at = plan.friction
    return np.concatenate([law_slopes(friction, states, j, links.own_[j, at]) for states in runs])


def _doubt(width: float, sharpness: float, top: float) -> float:
    """Minus the logarithm of a shape's probability beforehand.

    Another sharpness than the usual has to be sure: a long tail of the sign is a curve of friction too.
    """
    far = np.log(width / (USUAL_WIDTH * max(top, 1e-9))) / SPREAD
    return float(0.5 * far**2 + SURE * (sharpness != FIRST_SHARPNESS))


def _standardised(columns: FloatArray, torque: FloatArray) -> FloatArray:
    """Columns for coefficients that are standard normal beforehand: each may have so much `torque` (k,)."""
    size = np.sqrt(np.mean(columns**2, axis=0))
    scaled: FloatArray = columns * np.where(size > 0, torque / np.where(size > 0, size, 1.0), 0.0)
    return np.ascontiguousarray(scaled)
