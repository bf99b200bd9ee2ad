"""Third loop: what is left, as a function of the gear's deflection (Section 5 of the paper), where that pays.

It is kept for a joint only if it predicts runs it has not seen better than nothing does.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator

from dynid_rs import _core
from dynid_rs.mixture import GaussianMixtureRegressor
from dynid_rs.preprocessing import States

FloatArray = NDArray[np.float64]
Inputs = Literal["auto", "deflection", "joint_state"]


class ResidualCompensator(BaseEstimator):  # type: ignore[misc]
    """Mixture regression of each joint's residual torque.

    Parameters
    ----------
    n_components : int or sequence of int
        Gaussians per joint, or the numbers among which the Bayesian information criterion chooses.
    inputs : {"auto", "deflection", "joint_state"}
        Deflection and its rate (two encoders) or motor-side position and velocity; "auto" takes the deflection where
        there are two encoders.
    least_gain : float
        Part of the residual's RMS that the third loop has to take off on left-out runs to be kept; twice as much
        where a lone run is all there is, because its parts resemble each other.
    max_samples : int
        Most samples that a mixture is fitted to; residuals are slow against the rows, so thinning loses little.
    random_state : int
        Seed of the fits.

    Attributes
    ----------
    mixtures_ : list of GaussianMixtureRegression or None
        One per joint, None where it is not kept.
    candidates_ : list of GaussianMixtureRegression or None
        The same without the question whether it pays; None where a joint has no second encoder.
    ratio_ : ndarray (n_joints,)
        RMS with over RMS without on left-out runs; on the training runs where not even those gained; 1 where nothing
        was fitted.
    inputs_ : str
        Inputs in use.
    """

    def __init__(
        self,
        n_components: int | Sequence[int] = (3, 6),
        *,
        inputs: Inputs = "auto",
        least_gain: float = 0.05,
        max_samples: int = 1000,
        random_state: int = 0,
    ) -> None:
        self.n_components = n_components
        self.inputs = inputs
        self.least_gain = least_gain
        self.max_samples = max_samples
        self.random_state = random_state

    def fit(self, runs: Sequence[States], residuals: Sequence[FloatArray]) -> ResidualCompensator:
        """Fit to training runs.

        Parameters
        ----------
        runs : sequence of States
            Channels on one clock.
        residuals : sequence of ndarray (n_rows, n_joints)
            What the first two loops leave, at the rows of each run.

        Raises
        ------
        ValueError
            Deflection is asked for without a second encoder.
        """
        self.inputs_ = choose_inputs(self.inputs, runs)
        blocks = [
            (u[part], left[part])
            for states, left in zip(runs, residuals, strict=True)
            for u in [inputs_of(states, self.inputs_)[states.rows]]
            for part in ([slice(None)] if len(runs) > 1 else np.array_split(np.arange(len(left)), 3))
        ]
        least_gain = self.least_gain * (1 if len(runs) > 1 else 2)
        n = residuals[0].shape[1]
        self.mixtures_: list[_core.GaussianMixtureRegression | None] = [None] * n
        self.candidates_: list[_core.GaussianMixtureRegression | None] = [None] * n
        self.ratio_ = np.ones(n)
        for j in range(n):
            u = [block[0][:, j] for block in blocks]
            left = [block[1][:, j] for block in blocks]
            if any(np.ptp(x[:, 0]) < 1e-12 for x in u):
                continue  # no second encoder on this joint
            fitted = self._best(np.concatenate(u), np.concatenate(left))
            self.candidates_[j] = fitted.mixture_
            self.ratio_[j] = _rms(np.concatenate(left) - fitted.predict(np.concatenate(u))) / _rms(np.concatenate(left))
            if self.ratio_[j] > 1 - least_gain:
                continue  # what does not pay on its own runs does not pay on others
            ratios = self._left_out(fitted.n_components, u, left)
            self.ratio_[j] = np.sqrt(np.sum(ratios[:, 0]) / np.sum(ratios[:, 1]))
            if self.ratio_[j] < 1 - least_gain and np.all(ratios[:, 0] < ratios[:, 1]):
                self.mixtures_[j] = fitted.mixture_
        return self

    def refit(self, runs: Sequence[States], residuals: Sequence[FloatArray]) -> ResidualCompensator:
        """Fit the kept mixtures again, with as many Gaussians as before; which joints are kept stays as it is."""
        for j in np.flatnonzero(self.kept):
            u = np.concatenate([inputs_of(states, self.inputs_)[states.rows][:, j] for states in runs])
            # From the last means, or the rounds would jump between equally good mixtures.
            mixture = self.mixtures_[j]
            assert mixture is not None  # it is kept
            means = mixture.means
            fitted = self._regressor(len(means), u, np.concatenate([left[:, j] for left in residuals]), means)
            self.mixtures_[j] = self.candidates_[j] = fitted.mixture_
        return self

    @property
    def kept(self) -> NDArray[np.bool_]:
        """(n_joints,) where the third loop pays."""
        return np.array([mixture is not None for mixture in self.mixtures_])

    def _best(self, u: FloatArray, left: FloatArray) -> GaussianMixtureRegressor:
        choices = [self.n_components] if isinstance(self.n_components, int) else list(self.n_components)
        return min((self._regressor(k, u, left) for k in choices), key=lambda fitted: fitted.bic_)

    def _regressor(
        self, n_components: int, u: FloatArray, left: FloatArray, means: FloatArray | None = None
    ) -> GaussianMixtureRegressor:
        thin = max(1, len(left) // self.max_samples)
        regressor = GaussianMixtureRegressor(n_components, tol=1e-2, means_init=means, random_state=self.random_state)
        return regressor.fit(u[::thin], left[::thin])

    def _left_out(self, n_components: int, u: list[FloatArray], left: list[FloatArray]) -> FloatArray:
        """Squared residual with and without the mixture on every block, fitted to the others: (n_blocks, 2)."""
        sums = np.zeros((len(u), 2))
        for k in range(len(u)):
            others = [i for i in range(len(u)) if i != k]
            regressor = self._regressor(
                n_components, np.concatenate([u[i] for i in others]), np.concatenate([left[i] for i in others])
            )
            sums[k] = np.sum((left[k] - regressor.predict(u[k])) ** 2), np.sum(left[k] ** 2)
        return sums


def _rms(x: FloatArray) -> float:
    return float(np.sqrt(np.mean(x**2)))


def choose_inputs(inputs: Inputs, runs: Sequence[States]) -> Literal["deflection", "joint_state"]:
    """Resolve "auto".

    Raises
    ------
    ValueError
        `inputs` is not a choice, or deflection is asked for without a second encoder.
    """
    two = all(states.two_encoders for states in runs)
    if inputs == "auto":
        return "deflection" if two else "joint_state"
    if inputs not in ("deflection", "joint_state"):
        raise ValueError(f"inputs must be 'auto', 'deflection' or 'joint_state', found {inputs!r}")
    if inputs == "deflection" and not two:
        raise ValueError("inputs='deflection' needs two encoders; the runs have no q_motor columns")
    return inputs


def inputs_of(states: States, inputs: str) -> FloatArray:
    """What the mixtures see at every sample of aligned `states`: (n, n_joints, 2)."""
    return _core.residual_inputs(inputs, states.q, states.dq, states.q_motor, states.dq_motor)
