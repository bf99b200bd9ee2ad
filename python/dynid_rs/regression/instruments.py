"""Instrumental variables, and the Durbin-Wu-Hausman test of whether least squares is biased.

Under feedback the noise of a position enters twice: through differentiation into the regressor, and through the
controller into the torque. Least squares is then biased, however long the run. Columns made from another account of the
same motion, whose noise is none or another, keep what both have in common: project the regressor on them, and fit with
the projection (two-stage least squares; Janot, Vandanjon and Gautier 2014, IEEE Trans. Control Syst. Technol. 22, do so
with a simulated motion). Without bias both estimates agree but for noise, which is what the test compares them with
(Hausman 1978, Econometrica 46).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.base.estimator import Estimator
from dynid_rs.regression.columns import Observations, run_rows
from dynid_rs.regression.fitted import FittedLinks
from dynid_rs.regression.noise_spectrum import noise_products
from dynid_rs.regression.systems import block_residuals
from dynid_rs.runs.preprocessing import States

FloatArray = NDArray[np.float64]
Source = Literal["auto", "reference", "second_encoder", "smooth"]

FOLLOWS = 0.5
"""A reference is one if every joint stays this near to it but for an offset, of its own standard deviation."""
MOTION = 0.99
"""Part of the speed's power that the motion proper has..."""
SMOOTH = 1.5
"""...below a frequency; smooth instruments end at this multiple of it, and at half of the band."""
NO_DIFFERENCE = 1e-3
"""Estimates that differ by less than this of a standard error are the same; a standard error below this part of what
independent rows would leave is none."""
SIGNIFICANT, GREATEST_SHIFT = 0.01, 3.0
"""Least squares is called biased below this probability if a parameter moves by more than so many standard errors."""
NEGLIGIBLE = 1e-10
"""Relative singular values of instruments below this are rounding."""


class InstrumentalVariables(Estimator):
    """Two-stage least squares beside a fit of the same rows, and the test of one against the other.

    Parameters
    ----------
    source : {"auto", "reference", "second_encoder", "smooth"}
        What the instruments are made of. ``"reference"``: the position that the controller was asked for, which holds
        no measurement noise at all. ``"second_encoder"``: the other encoder of every joint, whose noise is its own.
        ``"smooth"``: the measured motion below the frequencies that it is made of; noise of accelerations grows with
        the fifth power of the frequency, so that next to nothing of it is left. ``"auto"``: the first of these that
        the runs hold.

    Attributes
    ----------
    source_ : str
        In use.
    x_ : ndarray (n_columns,)
        All unknowns, as `LinkDynamicsIdentifier.x_`.
    std_error_ : ndarray (n_columns,)
        Their standard errors, honest under autocorrelated noise; zeros where not estimated.
    shift_ : ndarray (n_columns,)
        Estimate less that of least squares, in standard errors of least squares; zero where the runs are too short to
        tell these.
    statistic_, dof_, p_value_ : float, int, float
        Of the test that least squares is consistent.
    strength_ : float
        Least part of a column's power that its instruments hold; near 0 they say nothing of it.
    """

    def __init__(self, source: Source = "auto") -> None:
        self.source = source

    def fit(self, observations: Observations, links: FittedLinks, runs: Sequence[States]) -> InstrumentalVariables:
        """Fit; `runs` are the states that the observations were made from.

        Raises
        ------
        ValueError
            `source` is none, or the runs do not hold it.
        """
        from scipy.special import chdtrc

        self.source_ = choose_source(runs, self.source)
        plan = observations.plan
        used = plan.estimable()
        accounts = [run_rows(plan, instrument_states(states, self.source_), states.tau) for states in runs]
        joints = [
            _first_stage(observations, links, [account[j] for account in accounts], j, used)
            for j in range(plan.robot.n_joints)
        ]
        factor, instrumented = (_factor(joints, part, int(used.sum())) for part in ("columns", "projected"))
        ridge = _ridge(factor, links.ridge_)
        plain, projected = _bread(factor, ridge), _bread(instrumented, ridge)
        moments = np.zeros((2, int(used.sum())))
        for s in joints:
            moments[:, s.known] += [s.columns.T @ s.tau, s.projected.T @ s.tau]
        least_squares, estimate = plain @ moments[0], projected @ moments[1]
        # Both estimates are linear in the torque, x = sum_j B C_j' tau_j; so is their difference in the noise.
        products = noise_products(
            observations,
            runs,
            block_residuals(observations, links.x_, links.torque_scale_),
            [s.on_blocks(np.column_stack([s.columns, s.projected])) for s in joints],
            [plain[np.ix_(s.known, s.known)] for s in joints],
        )

        def covariance(of_plain: float, of_projected: float) -> FloatArray:
            total = np.zeros_like(plain)
            for s, product in zip(joints, products, strict=True):
                gain = s.weight * np.concatenate([of_plain * plain[s.known], of_projected * projected[s.known]])
                total += gain.T @ product @ gain
            return total

        # A part's noise may be known no better than to a rounding below nothing: of hardly more rows than unknowns.
        std_plain, std_own = (np.sqrt(np.maximum(np.diag(covariance(*of)), 0.0)) for of in ((1.0, 0.0), (0.0, 1.0)))
        told = std_plain > NO_DIFFERENCE * np.linalg.norm(factor @ plain, axis=0)
        shift = np.zeros(len(estimate))
        shift[told] = (estimate - least_squares)[told] / std_plain[told]
        between = covariance(-1.0, 1.0)[np.ix_(told, told)] / np.outer(std_plain[told], std_plain[told])
        self.statistic_, self.dof_ = _wald(shift[told], between)
        self.p_value_ = float(chdtrc(self.dof_, self.statistic_)) if self.dof_ else 1.0
        self.x_, self.std_error_, self.shift_ = (np.zeros(plan.n_columns) for _ in range(3))
        self.x_[used], self.std_error_[used], self.shift_[used] = estimate, std_own, shift
        self.strength_ = min(s.strength for s in joints)
        return self


def choose_source(runs: Sequence[States], source: Source = "auto") -> Source:
    """The best-founded instruments that all runs hold, or `source` if they hold it.

    Raises
    ------
    ValueError
        `source` is none, or the runs do not hold it.
    """
    held: dict[Source, bool] = {
        "reference": all(_follows(states) for states in runs),
        "second_encoder": all(_two_accounts(states) for states in runs),
        "smooth": True,
    }
    if source == "auto":
        return next(name for name, there in held.items() if there)
    if source not in held:
        raise ValueError(f"source must be 'auto', {', '.join(map(repr, held))}, found {source!r}")
    if not held[source]:
        what = {"reference": "a reference position that the joints follow", "second_encoder": "two encoders per joint"}
        raise ValueError(f"source is {source!r}, and not all runs hold {what[source]}; use 'smooth' or 'auto'")
    return source


def _follows(states: States) -> bool:
    if states.reference is None:
        return False
    error = (states.reference[0] - states.q)[states.moving].std(axis=0)
    return bool(np.all(error <= FOLLOWS * states.q[states.moving].std(axis=0)))


def _two_accounts(states: States) -> bool:
    return states.two_encoders and not np.any(np.all(states.q == states.q_motor, axis=0))


def instrument_states(states: States, source: Source) -> States:
    """The same run by another account of its motion."""
    if source == "reference" and states.reference is not None:
        q, dq, ddq = q_motor, dq_motor, ddq_motor = states.reference
    elif source == "second_encoder":
        q_motor, dq_motor, ddq_motor, q, dq, ddq = states.signals()
    else:
        cutoff = motion_band(states)
        q, dq, ddq, q_motor, dq_motor, ddq_motor = (
            np.ascontiguousarray(states.band.apply(x, states.rate, cutoff)) for x in states.signals()
        )
    return replace(states, q=q, dq=dq, ddq=ddq, q_motor=q_motor, dq_motor=dq_motor, ddq_motor=ddq_motor)


def motion_band(states: States) -> float:
    """Frequency [Hz] below which the motion proper lies, over all joints; half of the band at most."""
    speed = states.dq * states.moving[:, None]
    power = np.abs(np.fft.rfft(speed, axis=0)) ** 2
    power = np.cumsum((power / np.maximum(power.sum(axis=0), 1e-300)).mean(axis=1))
    frequency = float(np.searchsorted(power, MOTION * power[-1]) * states.rate / len(speed))
    return min(SMOOTH * frequency, 0.5 * states.band.cutoff)


@dataclass(frozen=True, eq=False)
class _Stage:
    """Weighted rows of one joint over all blocks, in the columns that it knows: as they are, and projected.

    `known`: the places of these columns among those in use; `edges`: where blocks begin and end.
    """

    columns: FloatArray
    projected: FloatArray
    tau: FloatArray
    known: NDArray[np.intp]
    weight: float
    strength: float
    edges: NDArray[np.intp]

    def on_blocks(self, rows: FloatArray) -> list[FloatArray]:
        """Rows cut into blocks."""
        return np.split(rows, self.edges)


def _first_stage(
    observations: Observations,
    links: FittedLinks,
    accounts: Sequence[FloatArray],
    j: int,
    used: NDArray[np.bool_],
) -> _Stage:
    plan = observations.plan
    weight = float(links.weights_[j])
    own = used[plan.unknowns(j)]
    known = (np.cumsum(used) - 1)[plan.unknowns(j)[own]]
    scale = weight * np.where(np.arange(len(own)) < plan.n_own, 1.0, links.torque_scale_[j])[own]
    columns = np.concatenate([block.rows[j][:, :-1][:, own] for block in observations.blocks]) * scale
    tau = weight * np.concatenate([block.rows[j][:, -1] for block in observations.blocks])
    basis = _range_of(np.concatenate([account[:, :-1][:, own] for account in accounts]))
    projected = basis @ (basis.T @ columns)
    power = np.sum(columns**2, axis=0)
    held = np.sum(projected**2, axis=0)[power > 0] / power[power > 0]
    edges = np.cumsum([block.n_rows for block in observations.blocks])[:-1]
    return _Stage(columns, projected, tau, known, weight, float(held.min(initial=1.0)), edges)


def _range_of(columns: FloatArray) -> FloatArray:
    """Orthonormal basis of what the columns span, (n_rows, rank), through their triangular factor."""
    norms = np.linalg.norm(columns, axis=0)
    unit = columns[:, norms > 0] / norms[norms > 0]
    _, s, vt = np.linalg.svd(_core.triangular_factor(unit))
    good = s > NEGLIGIBLE * s.max(initial=0.0)
    basis, _ = np.linalg.qr(unit @ (vt[good].T / s[good]))
    return np.asarray(basis, dtype=np.float64)


def _factor(joints: Sequence[_Stage], part: Literal["columns", "projected"], width: int) -> FloatArray:
    """Triangular factor of all joints' rows among the columns in use."""
    factors = []
    for stage in joints:
        own = _core.triangular_factor(np.ascontiguousarray(getattr(stage, part)))
        wide = np.zeros((len(own), width))
        wide[:, stage.known] = own
        factors.append(wide)
    return _core.triangular_factor(np.concatenate(factors))


def _ridge(factor: FloatArray, ridge: float) -> FloatArray:
    """Root (p,) of the ridge that the fit used, on the columns as they are."""
    norms = np.linalg.norm(factor, axis=0)
    norms[norms == 0] = 1.0
    greatest = np.linalg.svd(factor / norms, compute_uv=False)[0]
    root: FloatArray = ridge * greatest * norms
    return root


def _bread(factor: FloatArray, ridge: FloatArray) -> FloatArray:
    """``(sum_j C_j' C_j + ridge^2)^-1`` (p, p) from the factor of the rows."""
    system = np.concatenate([factor, np.diag(ridge)])
    norms = np.linalg.norm(system, axis=0)
    norms[norms == 0] = 1.0
    _, s, vt = np.linalg.svd(system / norms, full_matrices=False)
    inverse = np.where(s > NEGLIGIBLE * s[0], 1 / np.maximum(s**2, 1e-300), 0.0)
    bread: FloatArray = (vt.T * inverse) @ vt / np.outer(norms, norms)
    return bread


def _wald(difference: FloatArray, covariance: FloatArray) -> tuple[float, int]:
    """``d' cov^-1 d`` and its degrees of freedom, in the directions in which the two can differ."""
    values, axes = np.linalg.eigh(covariance)
    kept = values > NO_DIFFERENCE**2 * values.max(initial=1.0)
    scores = (axes[:, kept].T @ difference) / np.sqrt(values[kept])
    return float(scores @ scores), int(kept.sum())


def endogeneity(instruments: InstrumentalVariables, names: Sequence[str]) -> dict[str, object]:
    """What `result.json` says of the test; `names` (n_columns,) of all unknowns."""
    worst = int(np.argmax(np.abs(instruments.shift_)))
    shift = float(abs(instruments.shift_[worst]))
    biased = instruments.p_value_ < SIGNIFICANT and shift > GREATEST_SHIFT
    return {
        "instruments": instruments.source_,
        "statistic": instruments.statistic_,
        "degrees_of_freedom": instruments.dof_,
        "p_value": instruments.p_value_,
        "largest_shift": {"parameter": names[worst], "standard_errors": shift},
        "biased": bool(biased),
    }
