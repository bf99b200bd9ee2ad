"""The whole declared model as a projector: what a candidate adds beside it, from products of columns alone.

A declared model has absorbed part of what it lacks, so a candidate is never fitted to the residual: its columns C stand
beside the model's A, ``min |W (A x + C c - tau)|``. With ``R'R = A'W^2 A`` and ``T = R^-T A'W^2 C`` the candidate's own
part is ``S = C'W^2 C - T'T`` and its score ``s = C'W^2 e``, e the declared residual; then ``c = S^-1 s``.

Of the four modules of this kind only this one weighs thousands of candidates, from the fit's stored triangular factors,
under bounds of sign, with whole blocks left out and own columns taken out of the model.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.columns import Observations, Plan
from dynid_rs.identification import ThreeLoopIdentifier
from dynid_rs.links import ASYMMETRY, alike_rows
from dynid_rs.systems import block_residuals, stack

FloatArray = NDArray[np.float64]

ABSORBED = 1e-5
"""A candidate of whose power less than this is its own cannot be told from the declared model."""
TINY_RIDGE = 1e-9
"""Relative size of a pull on unit-norm columns: where the runs say nothing of one, it stays at zero."""


@dataclass(frozen=True, eq=False)
class Gain:
    """What a candidate would take off the weighted residual power: `power`, with these `coefficients`.

    `own` is the part of the candidate's power that the declared model cannot imitate, at least of one of its columns;
    `bound` tells coefficients that physics keeps at zero.
    """

    power: float
    coefficients: FloatArray
    own: float
    bound: NDArray[np.bool_]


class Beside:
    """A fitted model as what candidates stand beside.

    Parameters
    ----------
    fit : ThreeLoopIdentifier
        Without a third loop.
    without : collection of (joint, own column)
        Own columns that are taken out of the model, to ask what they were needed for.

    Attributes
    ----------
    residual : ndarray (n_rows, n_joints)
        What the model leaves, over all runs [torque unit].
    blocks : list of slice
        Rows of every block that can be left out.
    n_runs : int
        Runs that the rows come from.
    weights : ndarray (n_joints,)
        One over the residual's standard deviation.
    """

    def __init__(self, fit: ThreeLoopIdentifier, without: Sequence[tuple[int, int]] = ()) -> None:
        self._observations: Observations = fit.observations_
        observations = self._observations
        self._plan: Plan = observations.plan
        plan = self._plan
        self._scale = fit.links_.torque_scale_
        self.n_joints = plan.robot.n_joints
        used = plan.estimable().copy()
        for j, column in without:
            used[plan.n_base + j * plan.n_own + column] = False
        self._used = used
        edges = np.cumsum([0, *(block.n_rows for block in observations.blocks)])
        self.blocks = [slice(int(a), int(b)) for a, b in pairwise(edges)]
        self.n_rows = int(edges[-1])
        self.n_runs = len({block.run for block in observations.blocks})
        noise = np.maximum(fit.links_.noise_std_, 1e-300)
        self.weights: FloatArray = 1 / noise
        posterior = fit.links_.posterior_
        self._pull = (
            alike_rows(plan, observations.factors(), observations.n_rows, fit.links_.asymmetry or ASYMMETRY)
            if posterior is None
            else posterior.pull
        )
        self._columns, self._tau, self._places = [], [], []
        where = np.cumsum(used) - 1
        for j in range(self.n_joints):
            rows = np.concatenate([block.rows[j] for block in observations.blocks])
            unknowns = plan.unknowns(j)
            kept = used[unknowns]
            columns = rows[:, :-1] * np.where(np.arange(len(unknowns)) < plan.n_own, 1.0, self._scale[j])
            self._columns.append(np.ascontiguousarray(columns[:, kept]))
            self._tau.append(rows[:, -1])
            self._places.append(where[unknowns[kept]])
        self._root, self._x = self._solve(range(len(self.blocks)))
        self.residual: FloatArray = self.left(self._x)

    @cached_property
    def leverage(self) -> list[list[FloatArray]]:
        """Part of every spectral line's power that the fit takes away, per joint and block."""
        from scipy.linalg import solve_triangular

        inverse = solve_triangular(self._root, np.eye(len(self._root)), check_finite=False)
        taken = []
        for j, columns in enumerate(self._columns):
            taken.append(line_power(self.weights[j] * (columns @ inverse[self._places[j]]), self.blocks))
        return taken

    def left(self, x: FloatArray) -> FloatArray:
        """Residual (n_rows, n_joints) of unknowns `x`."""
        parts = zip(self._columns, self._tau, self._places, strict=True)
        return np.stack([tau - columns @ x[places] for columns, tau, places in parts], axis=1)

    def error_on(self, rows: Observations) -> FloatArray:
        """RMSE (n_joints,) of this model on other rows of the same plan."""
        x = np.zeros(self._plan.n_columns)
        x[self._used] = self._x
        left = np.concatenate(block_residuals(rows, x, self._scale))
        error: FloatArray = np.sqrt(np.mean(left**2, axis=0))
        return error

    def imitate(self, columns: Mapping[int, FloatArray]) -> FloatArray:
        """``R^-T A'W^2 C``: how the model imitates the columns, (n_unknowns, k)."""
        from scipy.linalg import solve_triangular

        width = next(iter(columns.values())).shape[1]
        product = np.zeros((len(self._root), width))
        for j, C in columns.items():
            product[self._places[j]] += self.weights[j] ** 2 * (self._columns[j].T @ C)
        imitated: FloatArray = solve_triangular(self._root, product, trans="T", check_finite=False)
        return imitated

    def imitated_scores(self, copies: FloatArray) -> FloatArray:
        """``R^-T A'W^2 e`` of residuals `copies` (n_joints, n_rows, n_copies): what the model would take of them."""
        from scipy.linalg import solve_triangular

        product = np.zeros((len(self._root), copies.shape[2]))
        for j, places in enumerate(self._places):
            product[places] += self.weights[j] ** 2 * (self._columns[j].T @ copies[j])
        imitated: FloatArray = solve_triangular(self._root, product, trans="T", check_finite=False)
        return imitated

    def own_part(self, columns: Mapping[int, FloatArray]) -> dict[int, FloatArray]:
        """Columns less what the model imitates of them: on every joint (n_rows, k)."""
        from scipy.linalg import solve_triangular

        x = solve_triangular(self._root, self.imitate(columns), check_finite=False)
        rest = {j: -self._columns[j] @ x[self._places[j]] for j in range(self.n_joints)}
        for j, C in columns.items():
            rest[j] = rest[j] + C
        return rest

    def products(self, columns: Mapping[int, FloatArray]) -> tuple[FloatArray, FloatArray, FloatArray]:
        """T (n_unknowns, k), ``C'W^2 C`` (k, k) and ``C'W^2 e`` (k,)."""
        imitated = self.imitate(columns)
        gram = sum(self.weights[j] ** 2 * (C.T @ C) for j, C in columns.items())
        score = sum(self.weights[j] ** 2 * (C.T @ self.residual[:, j]) for j, C in columns.items())
        return imitated, np.asarray(gram), np.asarray(score)

    def gains(
        self, columns: Mapping[int, FloatArray], groups: Sequence[slice], bounds: Sequence[FloatArray]
    ) -> list[Gain]:
        """What each group of columns would take off by itself; `bounds` (k, 2) per group."""
        imitated, gram, score = self.products(columns)
        return [
            bounded_gain(gram[g, g] - imitated[:, g].T @ imitated[:, g], np.diag(gram)[g], score[g], bound)
            for g, bound in zip(groups, bounds, strict=True)
        ]

    def with_columns(self, columns: Mapping[int, FloatArray], coefficients: FloatArray) -> FloatArray:
        """Residual (n_rows, n_joints) beside columns with these coefficients, the model fitted again."""
        own = self.own_part(columns)
        return self.residual - np.stack([own[j] @ coefficients for j in range(self.n_joints)], axis=1)

    def friction_with(self, j: int, columns: Mapping[int, FloatArray], coefficients: FloatArray) -> FloatArray:
        """The model's own friction of joint j at every row (n_rows,), fitted again beside columns."""
        from scipy.linalg import solve_triangular

        x = self._x - solve_triangular(self._root, self.imitate(columns) @ coefficients, check_finite=False)
        own = np.flatnonzero(self._used[self._plan.unknowns(j)][: self._plan.n_own])
        at = np.flatnonzero(np.isin(own, np.arange(self._plan.n_own)[self._plan.friction[1]]))
        friction: FloatArray = self._columns[j][:, at] @ x[self._places[j][at]]
        return friction

    def left_out(self, columns: Mapping[int, FloatArray] | None, bounds: FloatArray | None = None) -> FloatArray:
        """Residual (n_rows, n_joints) of every block under a fit to the others, with or without a candidate."""
        out = np.zeros_like(self.residual)
        for k, block in enumerate(self.blocks):
            others = [b for b in range(len(self.blocks)) if b != k]
            root, x = self._solve(others)
            left = self.left(x)
            if columns is not None and bounds is not None:
                left = self._with_candidate(root, left, columns, bounds, block)
            out[block] = left[block]
        return out

    def with_coefficients_of_others(self, columns: Mapping[int, FloatArray], bounds: FloatArray) -> FloatArray:
        """Residual (n_rows, n_joints) of every block with a candidate whose coefficients come from the others.

        The model beside it has seen all blocks. Where one run is all there is, a third of it more or less moves base
        parameters by far more than any candidate does, and this tells the candidate's own part.
        """
        own = self.own_part(columns)
        left = self.residual.copy()
        for block in self.blocks:
            seen = np.ones(self.n_rows, dtype=bool)
            seen[block] = False
            width = len(bounds)
            gram, score, power = np.zeros((width, width)), np.zeros(width), np.zeros(width)
            for j, C in own.items():
                gram += self.weights[j] ** 2 * (C[seen].T @ C[seen])
                score += self.weights[j] ** 2 * (C[seen].T @ self.residual[seen, j])
                if j in columns:
                    power += self.weights[j] ** 2 * np.sum(columns[j][seen] ** 2, axis=0)
            coefficients = bounded_gain(gram, power, score, bounds).coefficients
            for j, C in own.items():
                left[block, j] -= C[block] @ coefficients
        return left

    def _with_candidate(
        self, root: FloatArray, left: FloatArray, columns: Mapping[int, FloatArray], bounds: FloatArray, block: slice
    ) -> FloatArray:
        """Residual of a fit to all rows but those of `block`, with the candidate."""
        from scipy.linalg import solve_triangular

        mask = np.ones(self.n_rows, dtype=bool)
        mask[block] = False
        width = len(bounds)
        product, gram, score = np.zeros((len(root), width)), np.zeros((width, width)), np.zeros(width)
        for j, C in columns.items():
            seen, weight = C[mask], self.weights[j] ** 2
            product[self._places[j]] += weight * (self._columns[j][mask].T @ seen)
            gram += weight * (seen.T @ seen)
            score += weight * (seen.T @ left[mask, j])
        imitated = solve_triangular(root, product, trans="T", check_finite=False)
        gain = bounded_gain(gram - imitated.T @ imitated, np.diag(gram), score, bounds)
        x = solve_triangular(root, imitated @ gain.coefficients, check_finite=False)
        left = left + np.stack([self._columns[j] @ x[self._places[j]] for j in range(self.n_joints)], axis=1)
        for j, C in columns.items():
            left[:, j] -= C @ gain.coefficients
        return left

    def _solve(self, blocks: Sequence[int]) -> tuple[FloatArray, FloatArray]:
        """Triangular factor of the weighted columns of some blocks, and their solution."""
        from scipy.linalg import solve_triangular

        factors = [
            _core.merge_factors([self._observations.blocks[k].factors[j] for k in blocks]) for j in range(self.n_joints)
        ]
        system = stack(self._plan, factors, self.weights, self._scale)
        system = np.concatenate([system, self._pull])[:, np.append(self._used, True)]
        norms = np.linalg.norm(system[:, :-1], axis=0)
        ridge = np.zeros((len(norms), system.shape[1]))
        np.fill_diagonal(ridge, TINY_RIDGE * np.where(norms > 0, norms, max(norms.max(initial=0.0), 1.0)))
        R = _core.triangular_factor(np.ascontiguousarray(np.concatenate([system, ridge])))
        root = R[:-1, :-1]
        return root, solve_triangular(root, R[:-1, -1], check_finite=False)


def bounded_gain(own: FloatArray, power: FloatArray, score: FloatArray, bounds: FloatArray) -> Gain:
    """Gain of one group: `own` S (k, k), `power` of the columns (k,), `score` s (k,), `bounds` (k, 2).

    Coefficients outside of their bounds are held there, worst first.
    """
    share = np.diag(own) / np.maximum(power, 1e-300)
    used = share > ABSORBED
    held = ~used
    coefficients = np.zeros(len(score))
    for _ in range(len(score) + 1):
        free = np.flatnonzero(~held)
        coefficients[:] = 0.0
        if not len(free):
            break
        root = np.sqrt(np.diag(own)[free])
        scale = 1 / root
        S = own[np.ix_(free, free)] * np.outer(scale, scale)
        values, vectors = np.linalg.eigh(S)
        good = values > 1e-8 * values[-1]
        coefficients[free] = scale * (vectors[:, good] / values[good] @ (vectors[:, good].T @ (scale * score[free])))
        beyond = np.maximum(bounds[free, 0] - coefficients[free], coefficients[free] - bounds[free, 1]) * root
        if np.all(beyond <= 0):
            break
        held[free[int(np.argmax(beyond))]] = True
    gained = float(2 * score @ coefficients - coefficients @ own @ coefficients)
    return Gain(max(gained, 0.0), coefficients, float(share.max(initial=0.0)), held & used)


def independent_rows(residual: FloatArray, blocks: Sequence[slice]) -> FloatArray:
    """How many independent rows the power of a residual is known as well as from, (n_joints,).

    ``N / (1 + 2 sum rho_k^2)``, rho the autocorrelation: Bartlett's formula for a variance.
    """
    from scipy.fft import irfft, next_fast_len, rfft

    n_joints = residual.shape[1]
    longest = max(block.stop - block.start for block in blocks)
    sums, counts = np.zeros((longest, n_joints)), np.zeros(longest)
    for block in blocks:
        part = residual[block]
        n = len(part)
        size = next_fast_len(2 * n)
        sums[:n] += irfft(np.abs(rfft(part, size, axis=0)) ** 2, size, axis=0)[:n]
        counts[:n] += n - np.arange(n)
    rho = sums / np.maximum(counts, 1.0)[:, None]
    rho = rho[1:] / np.maximum(rho[0], 1e-300)
    reach = max(1, longest // 10)
    result: FloatArray = len(residual) / (1 + 2 * np.sum(rho[:reach] ** 2, axis=0))
    return result


def line_power(x: FloatArray, blocks: Sequence[slice]) -> list[FloatArray]:
    """Power of every spectral line per sample, summed over the columns of `x` (n_rows, ...), block by block."""
    from scipy.fft import rfft

    powers = []
    for block in blocks:
        part = x[block].reshape(block.stop - block.start, -1)
        powers.append(np.sum(np.abs(rfft(part, axis=0)) ** 2, axis=1) / len(part))
    return powers
