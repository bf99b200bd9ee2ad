"""A data-driven torque on named signals, for what no physical effect explains.

The leftover is fitted as products of functions of its signals beside the declared model (`products.py`), and that
function is handed to a Gaussian mixture regression (Eqs. 31-38), which the core evaluates online. The mixture's inputs
stand on a grid, so its responsibilities are products of smooth steps along each signal; two components at plus and
minus m with variance m w share a velocity by half of one plus the hyperbolic tangent of dq / w, which is how friction
turns round; farther out they grow wider, so that all speeds are near some component. What is left to find, a level and
a slope per component, is linear.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.diagnosis.products import RidgePath, product_columns, raw_columns
from dynid_rs.diagnosis.rows_beside import JointRows, Split, spread_of_sum
from dynid_rs.diagnosis.signals import STATE, Basis, Candidates, Signal, state_signals
from dynid_rs.preprocessing import States

FloatArray = NDArray[np.float64]

CENTERS = {1: {"q": 24, "ddq": 5, "tau_link": 8}, 2: {"q": 14, "ddq": 5, "tau_link": 7}}
"""Components along each signal, by the number of signals; with three of them as in `MANY_CENTERS`."""
MANY_CENTERS = {"q": 8, "ddq": 3, "tau_link": 4}
SLOWEST, SPREAD = 2.0, 1.4
"""Where the pair of components next to standstill has its means, and how wide it is, over the width of friction's step:
the one's square over the other is that width."""
GROWTH = {1: 2.0, 2: 3.0}
"""Each component along a velocity stands so many times farther out than the one before, and is as much wider."""
MANY_GROWTH = 5.0
"""The same where there are three signals."""
OVERLAP = 0.6
"""Standard deviation of a component over the distance to the next."""
SAMPLES = 3000
"""Most states at which the mixture is fitted to the products."""
INNER = 0.3
"""Weight of states that combine values which the data has only one by one: they keep the mixture tame."""
SLOPE_RIDGE = 1e-4
"""Pull on levels and slopes, relative to the data's."""
WORTH = 0.1
"""A term is kept where it takes this part of the power off rows left out, less one standard error."""


@dataclass(frozen=True, eq=False)
class DataTerm:
    """Torque of one joint as a regression on signals.

    Parameters
    ----------
    joint : int
        Where it acts.
    signals : tuple of Signal
        Inputs in order: name of `STATE` and joint.
    mixture : GaussianMixtureRegression
        From inputs (n, k) to the torque [torque unit].
    power : (float, float)
        Mean square on rows left out without it and with it [torque unit squared].
    gain_error : float
        Standard error of the part of the power that it takes.
    ridge : float
        That predicted best on rows left out.
    reach : int
        Functions that predicted best, see `products.FEW`.
    """

    joint: int
    signals: tuple[Signal, ...]
    mixture: _core.GaussianMixtureRegression
    power: tuple[float, float]
    gain_error: float
    ridge: float
    reach: int

    @property
    def gain(self) -> float:
        """Part of the power that it takes off rows left out."""
        return 1 - self.power[1] / self.power[0]

    @property
    def pays(self) -> bool:
        """Whether it is worth keeping."""
        return self.gain - self.gain_error > WORTH

    def torque(self, states: States, tau_link: FloatArray) -> FloatArray:
        """Torque (n,) along a run; `tau_link` (n, n_joints) the predicted load [N m]."""
        given = dict(zip(STATE, state_signals(states, tau_link), strict=True))
        inputs = np.stack([given[name][:, j] for name, j in self.signals], axis=1)
        return np.asarray(self.mixture.predict(inputs)[0])


def fit_data_term(
    joint: int,
    signals: Sequence[Signal],
    ridge: float,
    reach: int,
    rows: JointRows,
    candidates: Candidates,
    runs: Sequence[States],
    *,
    scored: bool = True,
) -> DataTerm | None:
    """Fit a term beside the declared model; None where a signal is no input of a model (time, or a memory).

    Parameters
    ----------
    joint : int
        Where it acts.
    signals : sequence of Signal
        At most three.
    ridge : float
        That predicted best on rows left out.
    reach : int
        Which functions, see `products.FEW`.
    rows, candidates : JointRows, Candidates
        Of the training runs.
    runs : sequence of States
        The training runs, in the order of the rows.
    scored : bool
        Whether rows are left out to see what it is worth; `power` and `gain_error` are NaN otherwise.
    """
    signals = tuple(sorted(signals))
    if any(name not in STATE for name, _ in signals):
        return None
    columns = product_columns(signals, candidates, rows.rows, reach=reach)
    mixture = _mixture(signals, candidates, reach, _coefficients(rows.whole, columns, ridge))
    if not scored:
        return DataTerm(joint, signals, mixture, (float("nan"), float("nan")), float("nan"), ridge, reach)
    squares = np.zeros((2, len(rows.rows)))
    for split in rows.splits:
        part = _mixture(signals, candidates, reach, _coefficients(split, columns, ridge))
        u = np.stack([candidates.states[signal] for signal in signals], axis=1)
        torque = _in_band(part.predict(u)[0], runs)[rows.rows][:, None]
        taken = split.taken.T @ torque[split.fitted]
        shown = split.weighed(torque[split.left]) - split.elsewhere @ taken
        squares[0, split.left] = split.e_left**2
        squares[1, split.left] = (split.e_left - shown[:, 0]) ** 2
    power = float(squares[0].mean()), float(squares[1].mean())
    return DataTerm(joint, signals, mixture, power, _gain_error(squares, rows.block), ridge, reach)


def _coefficients(split: Split, columns: FloatArray, ridge: float) -> FloatArray:
    b = columns[split.fitted]
    return RidgePath(b, split.taken.T @ b, split.e_fitted[:, None]).at(ridge)[:, 0]


def _in_band(torque: FloatArray, runs: Sequence[States]) -> FloatArray:
    """Torque at every sample of all runs through the band, at their rows."""
    edges = np.cumsum([len(states.t) for states in runs])[:-1]
    return np.concatenate([s.in_band(part) for s, part in zip(runs, np.split(torque, edges), strict=True)])


def _gain_error(squares: FloatArray, block: NDArray[np.intp]) -> float:
    """Standard error of the gain, from stretches of about a second of each block."""
    ratio = squares[1].sum() / squares[0].sum()
    return spread_of_sum(squares[1] - ratio * squares[0], block) / float(squares[0].sum())


def _mixture(
    signals: tuple[Signal, ...], candidates: Candidates, reach: int, beta: FloatArray
) -> _core.GaussianMixtureRegression:
    """Mixture with the values of the products at the states of the data and between them."""
    rng = np.random.default_rng(0)
    u = np.stack([candidates.states[signal] for signal in signals], axis=1)
    u = u[:: max(1, -(-len(u) // SAMPLES))]
    mixed = np.stack([rng.permutation(column) for column in u.T], axis=1)
    points = np.concatenate([u, mixed]) if len(signals) > 1 else u
    weight = np.where(np.arange(len(points)) < len(u), 1.0, INNER)
    y = raw_columns(signals, candidates, points, reach=reach) @ beta
    means, variances = _grid(signals, [candidates.bases[signal] for signal in signals], u)
    k, n = means.shape
    bare = _mixture_of(means, variances, np.zeros(k), np.zeros((k, n)), 1.0)
    share = bare.responsibilities(points)
    scaled = (points[:, None, :] - means) / np.maximum(np.ptp(points, axis=0), 1e-300)
    design = np.concatenate([share[:, :, None], share[:, :, None] * scaled], axis=2).reshape(len(points), -1)
    design, target = design * weight[:, None], y * weight
    gram = design.T @ design
    gram[np.diag_indices_from(gram)] += SLOPE_RIDGE * np.trace(gram) / len(gram)
    found = np.linalg.solve(gram, design.T @ target).reshape(k, n + 1)
    slopes = found[:, 1:] / np.maximum(np.ptp(points, axis=0), 1e-300)
    noise = float(np.sqrt(np.mean((target - design @ found.ravel()) ** 2)))
    return _mixture_of(means, variances, found[:, 0], slopes, max(noise, 1e-9 * float(np.abs(y).max()), 1e-12))


def _grid(signals: Sequence[Signal], bases: Sequence[Basis], u: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Centres and variances of the components, (n_components, n_signals) each."""
    centers, variances = [], []
    for i, ((name, _), basis) in enumerate(zip(signals, bases, strict=True)):
        low, high = float(u[:, i].min()), float(u[:, i].max())
        if name == "dq":
            growth = GROWTH.get(len(signals), MANY_GROWTH)
            n_sides = 1 + max(0, int(np.ceil(np.log(max(-low, high) / (SLOWEST * basis.width)) / np.log(growth))))
            scales = basis.width * growth ** np.arange(n_sides)
            centers.append(SLOWEST * np.concatenate([-scales[::-1], scales]))
            variances.append((SPREAD * np.concatenate([scales[::-1], scales])) ** 2)
            continue
        n = CENTERS.get(len(signals), MANY_CENTERS)[name]
        line = np.linspace(low, high, n)
        centers.append(line)
        variances.append(np.full(n, (OVERLAP * max(float(line[1] - line[0]), 1e-9)) ** 2))
    return np.array(list(product(*centers))), np.array(list(product(*variances)))


def _mixture_of(
    means: FloatArray, variances: FloatArray, levels: FloatArray, slopes: FloatArray, noise: float
) -> _core.GaussianMixtureRegression:
    """Mixture whose components predict ``level + slope (u - mean)``; means, variances and slopes (k, n_signals)."""
    k, n = means.shape
    covariances = np.zeros((k, n + 1, n + 1))
    covariances[:, range(n), range(n)] = variances
    covariances[:, :n, n] = covariances[:, n, :n] = slopes * variances
    covariances[:, n, n] = np.sum(slopes**2 * variances, axis=1) + noise**2
    return _core.GaussianMixtureRegression(np.full(k, 1 / k), np.column_stack([means, levels]), covariances)
