"""Why an arm is odd: which single change explains best how far its estimates are from its type.

For a candidate with the columns A (k of them) the arm's distance is ``d = A b + e``, ``e ~ N(0, V)``. With Zellner's
prior ``b ~ N(0, g (A' V^-1 A)^-1)`` the logarithm of the odds for it against nothing is, in closed form,
``x^2 g / (2 (1 + g)) - k / 2 log(1 + g)`` with ``x^2 = d' V^-1 A (A' V^-1 A)^-1 A' V^-1 d``: many columns have to earn
their place, whatever their units are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid_rs.pooling.arm import BY_WAY
from dynid_rs.pooling.hierarchy import WIDE
from dynid_rs.pooling.type_pool import ALL_JOINTS, TypePool, with_all

FloatArray = NDArray[np.float64]

MOST = 4
"""Causes of one arm that are looked for."""
LOAD_COLUMNS = 4
"""Mass and first moments of a link, which come first among its ten parameters."""
KNOWN = 1e-6
"""Directions of a candidate that V knows to less than this part of the best known one do not count."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """A change and the columns (k_unknowns, k) that it has in the arm's estimates."""

    kind: str
    place: str
    columns: FloatArray
    name: str = ""


@dataclass(frozen=True)
class Cause:
    """Why an arm is odd.

    Parameters
    ----------
    kind : str
        ``"friction"``, ``"offset"``, ``"coefficient"``, ``"gain"``, ``"load"``, ``"base"`` or ``"error"``.
    place : str
        Joint or link.
    name : str
        Coefficient or base parameter.
    change : float or None
        Relative to the type's mean; None where that means nothing.
    size : float
        Of the change, in `unit`.
    std_error : float or None
        Of `size`, the arms' deviation included; None where the mass of a load is not told from its moments.
    unit : str
        "1" for gains and errors.
    deviations : float
        How far the arm is from its type in this quantity, in deviations.
    mean, spread : float or None
        Of the type: mean and deviation.
    at, at_unit : float or None, str or None
        Speed at which friction is meant.
    """

    kind: str
    place: str
    name: str
    change: float | None
    size: float
    std_error: float | None
    unit: str
    deviations: float
    mean: float | None = None
    spread: float | None = None
    at: float | None = None
    at_unit: str | None = None


def causes(pool: TypePool, i: int, limit: float) -> list[Cause]:
    """Causes of arm i, the one that explains most first; none where no test named the arm.

    `limit` is the probability below which a test names an arm. Every cause has a test of its own among those that name
    the arm; a second one has to be as unlikely when those before it are known.
    """
    named = pool.named(i, limit)
    if not named:
        return []
    d, V, used = pool.deviation(i)
    chosen: list[Candidate] = []
    root = np.asarray(np.linalg.cholesky(V + 1e-12 * np.diag(np.diag(V))), dtype=np.float64)
    white = np.asarray(np.linalg.solve(root, d), dtype=np.float64)
    left = candidates(pool, i, used)
    basis = np.zeros((len(d), 0))
    while len(chosen) < MOST:
        best: tuple[float, Candidate | None, FloatArray] = (0.0, None, basis)
        for candidate in left:
            test = _test_of(pool, candidate, named)
            if test is None:
                continue
            own = _directions(_whitened(root, candidate.columns), basis)
            square, k = float(np.sum((own.T @ white) ** 2)), own.shape[1]
            odds = 0.5 * square * WIDE**2 / (1 + WIDE**2) - 0.5 * k * float(np.log(1 + WIDE**2))
            if chosen and _chance(square / _dispersion(pool, i, test, candidate, root), k) >= limit:
                continue
            if odds > best[0]:
                best = odds, candidate, own
        if best[1] is None:
            break
        chosen.append(best[1])
        left = [candidate for candidate in left if (candidate.kind, candidate.place) != (best[1].kind, best[1].place)]
        basis = np.column_stack([basis, best[2]])
        if best[1].kind == "base":  # a name for a number, no cause that explains others
            break
    found = [_told(pool, i, one, chosen, root, white) for one in chosen]
    if not found:
        found = [_of_quantity(pool, i, min(named, key=lambda q: pool.judged[q].p_value[i]))]
    return found


def candidates(pool: TypePool, i: int, used: NDArray[np.bool_]) -> list[Candidate]:
    """Every change that has a name, and every base parameter by itself."""
    arm = pool.arms[i]
    places = np.cumsum(used) - 1
    found: list[Candidate] = []

    def columns(rows: FloatArray) -> FloatArray:
        return np.ascontiguousarray(rows[used])

    for j, joint in enumerate(arm.joints):
        friction = np.zeros((len(arm.x), 2))
        for name in arm.friction_names:
            place = arm.own(j, name)
            if place is not None:
                friction[place, 0 if "coulomb" in name or name in BY_WAY else 1] = pool.mean[place]
        found.append(Candidate("friction", joint, columns(friction)))
        for name in arm.own_names:
            place = arm.own(j, name)
            if place is None or name in arm.friction_names or not used[place]:
                continue
            one = np.zeros((int(used.sum()), 1))
            one[places[place]] = 1.0
            found.append(Candidate("offset" if name == "torque_offset" else "coefficient", joint, one, name))
    for where, response in zip((*arm.joints, ALL_JOINTS), with_all(arm.gain_response), strict=True):
        found.append(Candidate("gain", where, columns(response[:, None])))
    for k, link in enumerate(arm.links):
        for width in (LOAD_COLUMNS, 10):
            load = np.zeros((len(arm.x), width))
            load[: arm.n_base] = arm.regrouping[:, 10 * k : 10 * k + width]
            found.append(Candidate("load", link, columns(load)))
    for k, name in enumerate(arm.names):
        if used[k]:
            one = np.zeros((int(used.sum()), 1))
            one[places[k]] = 1.0
            found.append(Candidate("base", arm.base_links[k], one, name))
    return [candidate for candidate in found if np.any(candidate.columns)]


def _whitened(root: FloatArray, columns: FloatArray) -> FloatArray:
    """Columns in deviations: `root` is the triangular root of V."""
    return np.asarray(np.linalg.solve(root, columns), dtype=np.float64)


def _directions(columns: FloatArray, known: FloatArray) -> FloatArray:
    """Orthonormal directions of whitened columns beside those that are known."""
    norms = np.linalg.norm(columns, axis=0)
    columns = columns[:, norms > 0] / norms[norms > 0]
    beside = columns - known @ (known.T @ columns)
    u, s, _ = np.linalg.svd(beside, full_matrices=False)
    own: FloatArray = u[:, s > KNOWN**0.5]
    return own


def _chance(square: float, k: int) -> float:
    from scipy.special import chdtrc

    return float(chdtrc(max(k, 1), square))


def _test_of(pool: TypePool, candidate: Candidate, named: list[int]) -> int | None:
    """Of the tests that named the arm, one that speaks of this candidate."""
    own = "base" if candidate.kind == "load" else candidate.kind
    for q in named:
        quantity = pool.quantities[q]
        if quantity.kind != own or (candidate.kind != "load" and quantity.place != candidate.place):
            continue
        if candidate.kind not in ("coefficient", "base") or quantity.name == candidate.name:
            return q
    return None


def _dispersion(pool: TypePool, i: int, q: int, candidate: Candidate, root: FloatArray) -> float:
    """How much more arms deviate along a candidate than V says, at least 1.

    V takes deviations of different unknowns for independent, which they need not be. Of gains and frictions, which are
    quantities of their own: variance of the quantity among arms over that of V.
    """
    quantity, shared = pool.quantities[q], pool.judged[q].shared
    found = shared.deviation**2 + quantity.s[i] ** 2
    white = _whitened(root, candidate.columns)
    if candidate.kind == "gain":
        expected = 1 / max(float(np.sum(white**2)), 1e-300)
    elif candidate.kind == "friction":
        # In parts of the type's friction: both columns together are all of it.
        found /= shared.mean**2
        expected = 1 / max(float(np.sum(white.sum(axis=1) ** 2)), 1e-300)
    else:
        return 1.0
    return max(1.0, float(found) / expected)


def _told(
    pool: TypePool, i: int, one: Candidate, chosen: list[Candidate], root: FloatArray, white: FloatArray
) -> Cause:
    for q, quantity in enumerate(pool.quantities):
        same_name = one.kind not in ("coefficient", "base") or quantity.name == one.name
        if (quantity.kind, quantity.place) == (one.kind, one.place) and same_name and one.kind != "load":
            return _of_quantity(pool, i, q)
    # A load is no quantity of its own: it is fitted beside the other causes.
    stacked = _whitened(root, np.column_stack([one.columns, *(c.columns for c in chosen if c is not one)]))
    size, error = _fitted(stacked, white)
    told = float(error[0]) if np.isfinite(error[0]) else None
    base = [judged.deviations[i] for q, judged in zip(pool.quantities, pool.judged, strict=True) if q.kind == "base"]
    far = max(base, key=abs, default=0.0)
    unit = "kg" if pool.arms[i].torque_unit == "N*m" else "kg*A/(N*m)"
    return Cause("load", one.place, "mass", None, float(size[0]), told, unit, float(far))


def _fitted(columns: FloatArray, white: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Least squares of whitened columns, and standard errors; infinite where a column is not told from the others."""
    norms = np.linalg.norm(columns, axis=0)
    norms[norms == 0] = 1.0
    u, s, vt = np.linalg.svd(columns / norms, full_matrices=False)
    good = s > KNOWN * s[0]
    size = vt[good].T @ ((u[:, good].T @ white) / s[good]) / norms
    power = np.sum((vt[good].T / s[good]) ** 2, axis=1)
    hidden = np.sum(vt[~good] ** 2, axis=0) > KNOWN
    return size, np.where(hidden, np.inf, np.sqrt(power)) / norms


def _of_quantity(pool: TypePool, i: int, q: int) -> Cause:
    quantity, judged = pool.quantities[q], pool.judged[q]
    shared = judged.shared
    size = float(quantity.y[i] - shared.mean)
    if quantity.kind == "error":
        change: float | None = float(np.expm1(size))
    elif quantity.kind == "gain":
        change = size
    elif quantity.kind == "offset":
        change = None
    else:
        known = abs(shared.mean) > 3 * max(shared.mean_std_error, 1e-300)
        change = size / abs(shared.mean) if known else None
    return Cause(
        quantity.kind,
        quantity.place,
        quantity.name,
        change,
        size,
        float(np.hypot(quantity.s[i], shared.deviation)),
        quantity.unit,
        float(judged.deviations[i]),
        shared.mean,
        shared.deviation,
        quantity.at,
        quantity.at_unit,
    )
