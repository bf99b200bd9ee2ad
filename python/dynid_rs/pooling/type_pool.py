"""Arms of one type: the type's mean and spread, every arm's distance from it, and better estimates of every arm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dynid_rs.pooling.arm import ArmEstimate
from dynid_rs.pooling.hierarchy import Judged, Shared, judge, likely_power, prior_power, share
from dynid_rs.pooling.quantities import Quantity, quantities

FloatArray = NDArray[np.float64]

ALL_JOINTS = "all joints"
"""Place of a gain that all channels share: a supply, a unit, one torque constant."""


@dataclass(frozen=True, eq=False)
class TypePool:
    """Arms that share a form (`ArmEstimate.form`), pooled.

    `quantities` and `judged` go together, gains included; `unknowns` (p,) is what the arms share of every unknown.
    """

    name: str
    arms: tuple[ArmEstimate, ...]
    quantities: tuple[Quantity, ...]
    judged: tuple[Judged, ...]
    unknowns: tuple[Shared, ...]

    @property
    def n_arms(self) -> int:
        """Number of arms."""
        return len(self.arms)

    @cached_property
    def mean(self) -> FloatArray:
        """Type's mean of every unknown, (p,)."""
        return np.array([shared.mean for shared in self.unknowns])

    @cached_property
    def power(self) -> FloatArray:
        """T of every unknown, (p,)."""
        return np.array([shared.deviation**2 for shared in self.unknowns])

    def named(self, i: int, limit: float) -> list[int]:
        """Places among the quantities whose test names arm i: less likely than `limit`, and no error that is small."""
        found = []
        for q, (quantity, judged) in enumerate(zip(self.quantities, self.judged, strict=True)):
            if judged.p_value[i] < limit and not (quantity.kind == "error" and judged.deviations[i] < 0):
                found.append(q)
        return found

    def deviation(self, i: int) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
        """How far arm i is from its type: distance (k,), its covariance (k, k), and which unknowns are meant, (p,).

        ``x_i - mu ~ N(0, S_i + diag T)`` for an arm that is not odd. What S_i says of torque scales and links together
        is left out: it knows their product to a part of what either deviates by, which no sum of columns follows.
        """
        arm = self.arms[i]
        spread = np.diag(arm.covariance) + self.power
        used = arm.estimable & (spread > 0)
        noise, first = arm.covariance.copy(), len(arm.x) - arm.n_scales
        noise[:first, first:], noise[first:, :first] = 0.0, 0.0
        covariance = noise[np.ix_(used, used)] + np.diag(self.power[used])
        return (arm.x - self.mean)[used], covariance, used

    @cached_property
    def _likely_power(self) -> FloatArray:
        """T of every unknown to draw arms to the mean with, (p,)."""
        x, std = _estimates(self.arms)
        return np.array([likely_power(x[:, k], std[:, k], shared)[0] for k, shared in enumerate(self.unknowns)])

    def shrunken(self, i: int) -> tuple[FloatArray, FloatArray]:
        """Unknowns of arm i with what its type says of them: values (p,) and covariance (p, p).

        ``mu + D (S_i + D)^-1 (x_i - mu)`` with D the variances of the arm's deviations (`prior_power`): the mean of the
        normal distribution that the prior ``N(mu, D)`` and the estimate ``N(theta, S_i)`` leave. What one coefficient
        says of another, through S_i, is used. Its covariance is ``D - D (S_i + D)^-1 D``, and the mean's own error.
        A lone arm keeps its own.
        """
        arm = self.arms[i]
        if self.n_arms == 1:
            return arm.x, arm.covariance
        std = np.sqrt(np.maximum(np.diag(arm.covariance), 0.0))
        usual = np.array([shared.usual[i] for shared in self.unknowns])
        power = prior_power(std, self._likely_power, usual)
        used = arm.estimable & (np.diag(arm.covariance) + power > 0)
        S, D = arm.covariance[np.ix_(used, used)], np.diag(power[used])
        keep = np.linalg.solve((S + D).T, D).T
        x, covariance = arm.x.copy(), np.zeros_like(arm.covariance)
        x[used] = self.mean[used] + keep @ (arm.x - self.mean)[used]
        error = np.array([shared.mean_std_error for shared in self.unknowns])[used]
        left = np.eye(len(S)) - keep
        covariance[np.ix_(used, used)] = D - keep @ D + left @ np.diag(error**2) @ left.T
        return x, covariance


def pool(name: str, arms: Sequence[ArmEstimate]) -> TypePool:
    """Pool arms of one form."""
    x, std = _estimates(arms)
    unknowns = tuple(share(x[:, k], std[:, k]) for k in range(x.shape[1]))
    bare = TypePool(name, tuple(arms), (), (), unknowns)
    found = [*quantities(arms), *_gains(bare)]
    return TypePool(name, tuple(arms), tuple(found), tuple(judge(one.y, one.s) for one in found), unknowns)


def _gains(known: TypePool) -> list[Quantity]:
    """Gain of every joint, and of all joints, of every arm against its type: least squares of ``x_i - mu = g r_ij``.

    ``g = r' V^-1 d / (r' V^-1 r)`` with ``V = S_i + diag T``; `r` is what the arm's own estimate does where its channel
    shows more (`gain_response`), so that a channel which shows ``f`` times the torque gives ``g = 1 - 1 / f``; what is
    kept is ``f - 1 = g / (1 - g)``. The standard error is that of noise alone, ``w' S w`` with ``w = V^-1 r / (r' V^-1
    r)``: how far arms differ is told by the arms.
    """
    places = (*known.arms[0].joints, ALL_JOINTS)
    y, s = np.zeros((2, known.n_arms, len(places)))
    for i, arm in enumerate(known.arms):
        d, V, used = known.deviation(i)
        S, r = arm.covariance[np.ix_(used, used)], with_all(arm.gain_response)[:, used]
        weights = np.linalg.solve(V, r.T).T
        weights /= np.maximum(np.sum(weights * r, axis=1, keepdims=True), 1e-300)
        y[i] = gain_of(weights @ d)
        s[i] = np.sqrt(np.maximum(np.einsum("jk,kl,jl->j", weights, S, weights), 0.0))
    return [Quantity("gain", "gain", place, "1", y[:, j], s[:, j]) for j, place in enumerate(places)]


def with_all(response: FloatArray) -> FloatArray:
    """Responses of all joints, and of all of them together where there are several, (n_joints + 1, p)."""
    whole: FloatArray = np.concatenate([response, response.sum(axis=0, keepdims=True)])
    return whole


def gain_of(shift: FloatArray) -> FloatArray:
    """Relative gain from the shift along an arm's own response."""
    bounded = np.clip(shift, -10.0, 0.9)  # a tenth to eleven times: beyond, it is no gain
    result: FloatArray = bounded / (1 - bounded)
    return result


def _estimates(arms: Sequence[ArmEstimate]) -> tuple[FloatArray, FloatArray]:
    """Unknowns of all arms and their standard errors, (n_arms, p) each."""
    x = np.stack([arm.x for arm in arms])
    return x, np.sqrt(np.maximum(np.stack([np.diag(arm.covariance) for arm in arms]), 0.0))
