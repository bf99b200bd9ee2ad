"""Third loop: what is left, as a function of the gear's deflection (Section 5 of the paper), where that pays.

It is kept for a joint only if it predicts runs it has not seen better than nothing does.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.base.estimator import Estimator
from dynid_rs.identification.mixture_fit import MixtureFit
from dynid_rs.identification.partially_linear import LeftOut, LinearTerms, fit_beside
from dynid_rs.runs.preprocessing import States

FloatArray = NDArray[np.float64]
Method = Literal["mixture", "rbf"]
NamedInputs = Literal["deflection", "joint_state", "load_free_deflection"]
Inputs = Literal["auto", "deflection", "joint_state", "load_free_deflection"]
Regression = _core.GaussianMixtureRegression | _core.NormalisedRbf

CARRIES_OVER = 3.0
"""Where friction and links, fitted to the other blocks, leave more than this times what they leave when they have seen
a block, the others do not determine them, and nothing can be said about a third loop beside them."""
METHODS: tuple[Method, ...] = ("mixture", "rbf")
NAMED_INPUTS: tuple[NamedInputs, ...] = ("deflection", "joint_state", "load_free_deflection")


class ResidualCompensator(Estimator):
    """Regression of each joint's residual torque on a pair of its signals.

    With the load-free deflection it is fitted *beside* the terms of the first two loops; with the paper's own inputs to
    what they leave, because deflection and joint state hold the very load and speed that those terms are made of.

    Parameters
    ----------
    n_components : int or sequence of int
        Gaussians per joint, or the numbers among which the Bayesian information criterion chooses.
    method : {"mixture", "rbf"}
        Gaussian mixture regression (Eqs. 31-39) or normalised radial basis functions (Eqs. 27-30).
    n_centers : int or sequence of int
        Centres per input of the radial basis functions, or the numbers among which left-out runs choose.
    inputs : {"auto", "load_free_deflection", "deflection", "joint_state"}
        Deflection and its rate (two encoders), the same with the load's own wind-up taken out, or motor-side position
        and velocity; "auto" takes the load-free deflection where there are two encoders, the joint state elsewhere.
    least_gain : float
        Part of the residual's RMS that the third loop has to take off on left-out runs to be kept; twice as much
        where a lone run is all there is, because its parts resemble each other.
    max_samples : int
        Most samples that a regression is fitted to; residuals are slow against the rows, so thinning loses little.
    random_state : int
        Seed of the fits.

    Attributes
    ----------
    mixtures_ : list of GaussianMixtureRegression, NormalisedRbf or None
        One per joint, None where it is not kept.
    candidates_ : list of GaussianMixtureRegression, NormalisedRbf or None
        The same without the question whether it pays; None where a joint has no second encoder.
    ratio_ : ndarray (n_joints,)
        RMS with over RMS without on left-out runs; on the training runs where not even those gained; 1 where nothing
        was fitted, or where the first two loops do not carry over to left-out runs and nothing can be said.
    inputs_ : str
        Inputs in use.
    n_centers_ : list of int
        Centres per input of the radial basis functions, 0 where there are none.
    compliance_ : ndarray (n_joints,)
        Of the gears [rad per torque unit]; zeros unless the load-free deflection is in use.
    """

    def __init__(
        self,
        n_components: int | Sequence[int] = (3, 6),
        *,
        method: Method = "mixture",
        n_centers: int | Sequence[int] = (3, 5, 8),
        inputs: Inputs = "auto",
        least_gain: float = 0.05,
        max_samples: int = 1000,
        random_state: int = 0,
    ) -> None:
        self.n_components = n_components
        self.method = method
        self.n_centers = n_centers
        self.inputs = inputs
        self.least_gain = least_gain
        self.max_samples = max_samples
        self.random_state = random_state

    def fit(
        self,
        runs: Sequence[States],
        residuals: Sequence[FloatArray],
        *,
        tau_link: Sequence[FloatArray] | None = None,
        columns: Sequence[Sequence[FloatArray]] | None = None,
    ) -> ResidualCompensator:
        """Fit to training runs.

        Parameters
        ----------
        runs : sequence of States
            Channels on one clock.
        residuals : sequence of ndarray (n_rows, n_joints)
            What the first two loops leave, at the rows of each run.
        tau_link : sequence of ndarray (n, n_joints), optional
            Rigid-body torque predicted by the second loop at every sample; the load-free deflection needs it.
        columns : sequence of sequence of ndarray (n_rows, n_columns), optional
            Columns of the first two loops' terms, per joint and run.

        Raises
        ------
        ValueError
            An unknown choice, or a deflection is asked for without a second encoder.
        """
        if self.method not in METHODS:
            raise ValueError(f"method must be 'mixture' or 'rbf', found {self.method!r}")
        self.inputs_ = choose_inputs(self.inputs, runs, load_known=tau_link is not None)
        n = residuals[0].shape[1]
        load_free = self.inputs_ == "load_free_deflection"
        self.compliance_ = _compliance(runs, tau_link) if load_free and tau_link is not None else np.zeros(n)
        lone = len(runs) == 1
        signals = [part for x in self._inputs_of(runs, tau_link) for part in _parts(x, lone)]
        left_over = [part for x in residuals for part in _parts(x, lone)]
        moves = [part for states in runs for part in _parts(states.counted, lone)]
        least_gain = self.least_gain * (2 if lone else 1)
        self.mixtures_: list[Regression | None] = [None] * n
        self.candidates_: list[Regression | None] = [None] * n
        self.ratio_ = np.ones(n)
        self.n_centers_ = [0] * n
        for j in range(n):
            used = [k for k, counted in enumerate(moves) if counted[:, j].any()]
            rows = {k: moves[k][:, j] for k in used}
            u = [signals[k][rows[k], j] for k in used]
            if len(used) < 2 or any(np.ptp(x[:, 0]) < 1e-12 for x in u):
                continue  # no second encoder on this joint, or it rests nearly all the time
            beside: list[FloatArray | None] = [None] * len(u)
            if load_free and columns is not None:
                parts = [part for x in columns[j] for part in _parts(x, lone)]
                beside = [parts[k][rows[k]] for k in used]
            left = [left_over[k][rows[k], j] for k in used]
            kept, fitted, self.ratio_[j] = self._fit_joint(u, left, beside, least_gain)
            self.candidates_[j] = _evaluated(fitted)
            self.mixtures_[j] = self.candidates_[j] if kept else None
            self.n_centers_[j] = getattr(fitted, "n_centers", 0)
        return self

    def refit(
        self,
        runs: Sequence[States],
        residuals: Sequence[FloatArray],
        *,
        tau_link: Sequence[FloatArray] | None = None,
    ) -> ResidualCompensator:
        """Fit the kept regressions again, with as many terms as before; which joints are kept stays as it is."""
        signals = np.concatenate(self._inputs_of(runs, tau_link))
        left, counted = np.concatenate(list(residuals)), np.concatenate([states.counted for states in runs])
        thin = self._thin(len(left))
        for j in np.flatnonzero(self.kept):
            last = self.mixtures_[j]
            if isinstance(last, _core.NormalisedRbf):
                # Where the centres stand follows from the limits, which hardly move.
                regressor: Any = _functions(self.n_centers_[j])
            else:
                assert last is not None  # it is kept
                # From the last means, or the rounds would jump between equally good mixtures.
                regressor = self._mixture(last.n_components, last.means)
            rows = np.flatnonzero(counted[:, j])[::thin]
            fitted = regressor.fit(signals[rows, j], left[rows, j])
            self.mixtures_[j] = self.candidates_[j] = _evaluated(fitted)
        return self

    def torque(
        self, states: States, tau_link: FloatArray | None = None, regressions: Sequence[Regression | None] | None = None
    ) -> FloatArray:
        """Torque of the kept regressions, or of others, at every sample of aligned `states`, (n, n_joints)."""
        regressions = self.mixtures_ if regressions is None else regressions
        tau = np.zeros_like(states.tau)
        if any(regression is not None for regression in regressions):
            u = inputs_of(states, self.inputs_, None if tau_link is None else self.compliance_ * tau_link)
            for j, regression in enumerate(regressions):
                if regression is not None:
                    tau[:, j] = regression.predict(u[:, j])[0]
        return tau

    @property
    def kept(self) -> NDArray[np.bool_]:
        """(n_joints,) where the third loop pays."""
        return np.array([regression is not None for regression in self.mixtures_])

    def _fit_joint(
        self, u: list[FloatArray], e: list[FloatArray], beside: list[FloatArray | None], least_gain: float
    ) -> tuple[bool, Any, float]:
        """Whether the third loop pays on one joint, its regressor, and the ratio of Attributes."""
        all_u, all_e = np.concatenate(u), np.concatenate(e)
        known = [columns for columns in beside if columns is not None]
        linear = LinearTerms(np.concatenate(known) if known else None)
        thin = self._thin(len(all_e))
        left_out = LeftOut(u, e, beside)
        first = {k: fit_beside(self._maker(k), all_u, all_e, linear, thin=thin, rounds=1) for k in self._sizes()}
        if self.method == "mixture":
            size = min(first, key=lambda k: float(first[k].bic_))
        else:
            powers = {k: left_out.with_g(self._maker(k), thin) for k in first}
            size = min(powers, key=lambda k: float(powers[k].sum()))
        make = self._maker(size)
        best = fit_beside(make, all_u, all_e, linear, last=first[size], thin=thin) if linear.present else first[size]
        seen = float(np.sum((all_e - linear.fitted(all_e)) ** 2))
        with_best = all_e - best.predict(all_u)
        ratio = float(np.sqrt(np.sum((with_best - linear.fitted(with_best)) ** 2) / max(seen, 1e-300)))
        if ratio > 1 - least_gain:
            return False, best, ratio  # what does not pay on its own runs does not pay on others
        if np.sum(left_out.without) > CARRIES_OVER**2 * np.sum(all_e**2):
            return False, best, 1.0
        power = left_out.with_g(make, thin) if self.method == "mixture" else powers[size]
        ratio = float(np.sqrt(np.sum(power) / np.sum(left_out.without)))
        return bool(ratio < 1 - least_gain and np.all(power < left_out.without)), best, ratio

    def _sizes(self) -> list[int]:
        """Numbers of terms to choose from."""
        given = self.n_components if self.method == "mixture" else self.n_centers
        return [given] if isinstance(given, int) else list(given)

    def _maker(self, size: int) -> Callable[[Any], Any]:
        """What makes a regressor of that size, given the last one or None."""

        def make(last: Any) -> Any:
            if self.method == "rbf":
                return _functions(size)
            return self._mixture(size, None if last is None else last.mixture_.means)

        return make

    def _mixture(self, n_components: int, means: FloatArray | None) -> Any:
        return MixtureFit(n_components, tol=1e-2, means_init=means, random_state=self.random_state)

    def _thin(self, n_rows: int) -> int:
        return max(1, n_rows // self.max_samples)

    def _inputs_of(self, runs: Sequence[States], tau_link: Sequence[FloatArray] | None) -> list[FloatArray]:
        """What the regressions see at the rows of every run, (n_rows, n_joints, 2) each."""
        loads = [None] * len(runs) if tau_link is None else [self.compliance_ * load for load in tau_link]
        return [inputs_of(states, self.inputs_, load)[states.rows] for states, load in zip(runs, loads, strict=True)]


def _evaluated(regressor: Any) -> Regression:
    """What Rust evaluates of a fitted regressor."""
    regression: Regression = regressor.rbf_ if hasattr(regressor, "rbf_") else regressor.mixture_
    return regression


def _functions(size: int) -> Any:
    from dynid_rs.identification.rbf import RbfRegressor

    return RbfRegressor(size)


def _parts(x: NDArray[Any], lone: bool) -> list[NDArray[Any]]:
    """Blocks that are left out in turn: whole runs, or thirds of a lone one."""
    return np.array_split(x, 3) if lone else [x]


def _compliance(runs: Sequence[States], tau_link: Sequence[FloatArray]) -> FloatArray:
    """Compliance of every gear [rad per torque unit], (n_joints,): deflection on the predicted load, all in the band.

    A gear's friction follows the load's direction; without a column of its own it would pass for compliance.
    """
    systems = []
    for states, load in zip(runs, tau_link, strict=True):
        direction = np.sign(np.gradient(load, axis=0))
        deflection = states.q_motor - states.q
        systems.append(np.stack([states.in_band(x) for x in (load, direction, np.ones_like(load), deflection)], axis=2))
    system = np.concatenate(systems)
    compliance = np.zeros(system.shape[1])
    for j in range(len(compliance)):
        norms = np.maximum(np.linalg.norm(system[:, j, :-1], axis=0), 1e-300)
        solution, *_ = np.linalg.lstsq(system[:, j, :-1] / norms, system[:, j, -1], rcond=1e-9)
        compliance[j] = max(solution[0] / norms[0], 0.0)  # a gear yields in the direction of its load
    return compliance


def choose_inputs(inputs: Inputs, runs: Sequence[States], *, load_known: bool = True) -> NamedInputs:
    """Resolve "auto".

    Raises
    ------
    ValueError
        `inputs` is not a choice, or a deflection is asked for without a second encoder or without its load.
    """
    two = all(states.two_encoders for states in runs)
    if inputs == "auto":
        if not two:
            return "joint_state"
        return "load_free_deflection" if load_known else "deflection"
    if inputs not in NAMED_INPUTS:
        raise ValueError(f"inputs must be 'auto', {', '.join(map(repr, NAMED_INPUTS))}, found {inputs!r}")
    if inputs != "joint_state" and not two:
        raise ValueError(f"inputs={inputs!r} needs two encoders; the runs have no q_motor columns")
    if inputs == "load_free_deflection" and not load_known:
        raise ValueError("inputs='load_free_deflection' needs the predicted rigid-body torque; give tau_link")
    return inputs


def inputs_of(states: States, inputs: str, wind_up: FloatArray | None = None) -> FloatArray:
    """What the regressions see at every sample of aligned `states`: (n, n_joints, 2).

    `wind_up` (n, n_joints): compliance times the predicted rigid-body torque [rad], for the load-free deflection.
    """
    return _core.residual_inputs(inputs, states.q, states.dq, states.q_motor, states.dq_motor, wind_up)
