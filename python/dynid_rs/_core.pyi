"""Compiled part of `dynid_rs`: every formula of a torque model, over arrays.

Conventions of every function here:

- Signals are (n_samples, n_joints), links and joints in chain order, SI units [rad, rad/s, rad/s²; m for
  prismatic joints], torques in N·m (N for prismatic joints) or in the unit of the torque channel (A).
- Anything that numpy turns into a float64 array is accepted; C-ordered float64 is not copied. What a masked array
  hides is NaN.
- `ValueError` names the argument, its shape and the expected one, or the place of a NaN or an infinity.
  `TypeError` if an argument is no array of numbers.
- The interpreter's lock is released while a batch is computed.

Equation numbers are those of the paper that README.md names.
"""

from collections.abc import Sequence
from os import PathLike
from typing import Any, Final, TypeAlias, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dynid_rs.model.summary import ModelSummary

_FloatArray: TypeAlias = NDArray[np.float64]
_Filter: TypeAlias = tuple[_FloatArray, _FloatArray, int]
"""`scipy.signal.butter(output="sos")` (n, 6), its `scipy.signal.sosfilt_zi` (n, 2), samples of padding."""
_Motion: TypeAlias = tuple[_FloatArray, _FloatArray, _FloatArray]
"""Something for q, dq and ddq, (n_samples, n_joints) each."""
_Regression: TypeAlias = GaussianMixtureRegression | NormalisedRbf
_Box: TypeAlias = tuple[Sequence[Sequence[float]], Sequence[float], Sequence[float]]

__all__ = [
    "FRICTION_NAMES",
    "LINK_PARAMETER_NAMES",
    "BaseParameters",
    "Effect",
    "Excitation",
    "FormatError",
    "FrictionSearch",
    "GaussianMixtureRegression",
    "MdhError",
    "NormalisedRbf",
    "PhysicalSet",
    "RobotModel",
    "TorqueModel",
    "UrdfError",
    "__version__",
    "adapt_run",
    "align_link_side",
    "c_header",
    "c_prefix",
    "effect_catalogue",
    "effect_columns",
    "effect_torque",
    "extent",
    "fit_mixture",
    "fold",
    "friction_basis",
    "inverse_dynamics_gradient",
    "likeliest",
    "low_pass",
    "merge_factors",
    "mjcf_with_physical",
    "motor_torque",
    "named_signals",
    "observe",
    "observe_momentum",
    "phi_from_pseudo_inertia",
    "point_gradient",
    "point_places",
    "processor_path",
    "pseudo_inertia",
    "read_contact",
    "read_watch",
    "residual_inputs",
    "sign_slopes",
    "slope",
    "triangular_factor",
    "true_motion",
    "urdf_with_physical",
    "watch_run",
    "weighted_fit",
    "with_adapted",
]

__version__: Final[str]
LINK_PARAMETER_NAMES: Final[list[str]]
"""`m, hx, hy, hz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz` [kg, kg·m, kg·m²]: h = m c, I about the link-frame origin."""
FRICTION_NAMES: Final[list[str]]
"""The eight coefficients of Eqs. 10-11, in the order of `friction_basis`."""

class UrdfError(ValueError):
    """A robot file that is broken, hostile or not a serial chain; names file, line, column and element."""

class MdhError(ValueError):
    """A `robot.toml` that is broken, hostile or no table of joints; names file, line, column and key."""

class FormatError(ValueError):
    """A model file that is not one, or was cut or changed."""

@final
class RobotModel:
    """A serial robot: kinematics, gravity and declared inertial parameters. Immutable."""

    @staticmethod
    def from_urdf(
        path: str | PathLike[str],
        *,
        base: str | None = None,
        tip: str | None = None,
        gravity: Sequence[float] = ...,
        rotor_inertia: Sequence[float] | None = None,
    ) -> RobotModel:
        """Read a robot from a URDF file.

        Parameters
        ----------
        path : str or path-like
            The file.
        base, tip : str, optional
            First and last link of the chain; the root and the end of the longest chain by default, see `choice`.
        gravity : (3,)
            Acceleration of free fall in the base frame [m/s²]; (0, 0, -9.81) by default.
        rotor_inertia : (n_joints,), optional
            Reflected to the link side [kg·m²]; instead of what the file declares.

        Raises
        ------
        UrdfError
            The file is broken, hostile or no serial chain of revolute, continuous and prismatic joints.
        OSError
            It cannot be read.
        """

    @staticmethod
    def from_urdf_string(
        text: str,
        *,
        source_name: str = "<string>",
        base: str | None = None,
        tip: str | None = None,
        gravity: Sequence[float] = ...,
        rotor_inertia: Sequence[float] | None = None,
    ) -> RobotModel:
        """As `from_urdf`, from the text itself; `source_name` stands for the file in errors."""

    @staticmethod
    def from_mdh(
        path: str | PathLike[str],
        *,
        gravity: Sequence[float] | None = None,
        rotor_inertia: Sequence[float] | None = None,
    ) -> RobotModel:
        """Read a robot from a table of modified Denavit-Hartenberg rows, `robot.toml`.

        `T(i-1 -> i) = Rx(alpha) Tx(a) Rz(theta) Tz(d)`, the paper's convention; docs/reference/robot_toml.md
        describes the file.

        Parameters
        ----------
        path : str or path-like
            The file.
        gravity : (3,), optional
            Acceleration of free fall in the base frame [m/s²]; the file's, or else (0, 0, -9.81), by default.
        rotor_inertia : (n_joints,), optional
            Reflected to the link side [kg·m²]; instead of what the file declares.

        Raises
        ------
        MdhError
            The file is broken, hostile or holds a key or a value that is not expected.
        OSError
            It cannot be read.
        """

    @staticmethod
    def from_mdh_string(
        text: str,
        *,
        source_name: str = "<string>",
        gravity: Sequence[float] | None = None,
        rotor_inertia: Sequence[float] | None = None,
    ) -> RobotModel:
        """As `from_mdh`, from the text itself; `source_name` stands for the file in errors."""

    @staticmethod
    def from_file(
        path: str | PathLike[str],
        *,
        base: str | None = None,
        tip: str | None = None,
        gravity: Sequence[float] | None = None,
        rotor_inertia: Sequence[float] | None = None,
    ) -> RobotModel:
        """Read a robot by the suffix of its file: `from_mdh` for `.toml`, `from_urdf` for everything else.

        Raises
        ------
        ValueError
            `base` or `tip` with a `.toml`, which is one chain; and whatever the two raise.
        """

    @property
    def name(self) -> str:
        """Name in the robot file."""

    @property
    def n_joints(self) -> int:
        """Moving joints."""

    @property
    def n_links(self) -> int:
        """Moving links: one behind every moving joint."""

    @property
    def joint_names(self) -> list[str]:
        """In chain order."""

    @property
    def link_names(self) -> list[str]:
        """In chain order; link i hangs on joint i."""

    @property
    def joint_kinds(self) -> list[str]:
        """`"revolute"` (continuous joints too) or `"prismatic"`."""

    @property
    def choice(self) -> str | None:
        """One sentence on the chain that was chosen, where the URDF branches; None where it leaves no choice.

        Robots that were copied to another process, or that come out of a model file, have none.
        """

    @property
    def notes(self) -> list[str]:
        """What was passed over, lumped or held in the URDF, each a sentence with file, line and column."""

    @property
    def gravity(self) -> _FloatArray:
        """Acceleration of free fall in the base frame (3,) [m/s²]."""

    @property
    def phi(self) -> _FloatArray:
        """Declared inertial parameters (10 n_links,), ordered as `LINK_PARAMETER_NAMES`; else zeros."""

    @property
    def rotor_inertia(self) -> _FloatArray:
        """Declared rotor inertia, reflected to the link side (n_joints,) [kg·m², kg]."""

    @property
    def gear_ratio(self) -> _FloatArray:
        """Motor turns per joint turn (n_joints,); NaN where the file declares none."""

    @property
    def lower(self) -> _FloatArray:
        """Least positions (n_joints,) [rad, m]; minus infinity where the file gives none."""

    @property
    def upper(self) -> _FloatArray:
        """Greatest positions (n_joints,) [rad, m]."""

    @property
    def velocity_limits(self) -> _FloatArray:
        """Greatest speeds (n_joints,) [rad/s, m/s]."""

    @property
    def acceleration_limits(self) -> _FloatArray:
        """Greatest accelerations (n_joints,) [rad/s², m/s²]; infinite where the file gives none."""

    @property
    def effort_limits(self) -> _FloatArray:
        """Greatest torques (n_joints,) [N·m, N]."""

    def link_frame(self, link: str) -> tuple[int | None, _FloatArray, _FloatArray]:
        """Return how a link of the URDF stands in the link that carries it.

        Returns
        -------
        joint : int or None
            The joint of the chain that moves it; None for what stands still with the base.
        rotation : (3, 3)
            From its axes to those of the frame of that joint's link, of the base link for what stands still.
        translation : (3,)
            Its origin in that frame [m].

        Raises
        ------
        ValueError
            No link of the chain, or fixed to it, has that name; names those that there are. Robots that come out of a
            model file know no links.
        """

    def with_gravity(self, gravity: Sequence[float]) -> RobotModel:
        """Return the same robot under another gravity (3,) [m/s²].

        Raises
        ------
        ValueError
            A component is not finite.
        """

    def with_joint_moved(self, joint: int, offset: Sequence[float], rotation_vector: Sequence[float]) -> RobotModel:
        """Return the same robot with one joint frame elsewhere.

        Parameters
        ----------
        joint : int
            Which one, from 0.
        offset : (3,)
            Of its origin, in the parent link's frame [m].
        rotation_vector : (3,)
            By which it is turned, in its own frame [rad].

        Raises
        ------
        ValueError
            There is no such joint, or a number is not finite.
        """

    def __copy__(self) -> RobotModel: ...
    def __deepcopy__(self, _memo: object, /) -> RobotModel: ...
    def inverse_dynamics(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        phi: ArrayLike | None = None,
        *,
        out: _FloatArray | None = None,
    ) -> _FloatArray:
        """Torque of the links `M(q) ddq + C(q, dq) dq + G(q)` (Eq. 1, no friction): (n_samples, n_joints).

        Parameters
        ----------
        q, dq, ddq : (n_samples, n_joints)
            Positions, velocities, accelerations.
        phi : (10 n_links,), optional
            Inertial parameters, which need not be physical; the declared ones by default.
        out : (n_samples, n_joints), optional
            Float64 array in C order that the result is written to and that is returned; a new one by default.

        Raises
        ------
        ValueError
            An argument has the wrong shape or holds a NaN or an infinity; `out` is not as said.
        """

    def rnea(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        phi: ArrayLike | None = None,
        *,
        out: _FloatArray | None = None,
    ) -> _FloatArray:
        """Other name of `inverse_dynamics`."""

    def joint_torque_regressor(
        self, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike, *, out: _FloatArray | None = None
    ) -> _FloatArray:
        """Regressor Y with `tau = Y phi` (Eq. 2): (n_samples, n_joints, 10 n_links).

        Parameters
        ----------
        q, dq, ddq : (n_samples, n_joints)
            Positions, velocities, accelerations.
        out : (n_samples, n_joints, 10 n_links), optional
            Float64 array in C order that the result is written to and that is returned; a new one by default. In a loop
            it saves more time than the regressor takes: memory fresh from the system is slow.

        Raises
        ------
        ValueError
            An argument has the wrong shape or holds a NaN or an infinity; `out` is not as said.
        """

    def base_parameters(self, random_state: int = 0, rtol: float = 1e-9) -> BaseParameters:
        """Which parameters the torque can tell apart, by pivoted QR of the regressor at random states.

        Parameters
        ----------
        random_state : int
            Seed of the probing states.
        rtol : float
            A column whose diagonal entry of R is below this part of the first one counts as dependent.
        """

@final
class BaseParameters:
    """`Y phi = Y[..., pivots] phi_base` with `phi_base = phi[pivots] + beta phi[dependent]`."""

    @property
    def n_base(self) -> int:
        """Number of base parameters."""

    @property
    def n_standard(self) -> int:
        """10 n_links."""

    @property
    def pivots(self) -> NDArray[np.int64]:
        """Indices into phi of the independent columns (n_base,), ascending."""

    @property
    def dependent(self) -> NDArray[np.int64]:
        """Indices into phi of the other columns that move the torque, ascending."""

    @property
    def beta(self) -> _FloatArray:
        """Regrouping (n_base, n_dependent)."""

    @property
    def gap(self) -> float:
        """`|r_kk| / |r_k+1,k+1|` across the cut: how clear the rank is. Infinite where nothing is left."""

    @property
    def spread(self) -> float:
        """`|r_00| / |r_kk|`: how well the weakest independent column is seen."""

    @property
    def names(self) -> list[str]:
        """For display: each base parameter as the sum of standard parameters that it stands for."""

    def reduce(self, regressor: ArrayLike) -> _FloatArray:
        """Columns of the base parameters: (..., 10 n_links) to (..., n_base)."""

    def project(self, phi: ArrayLike) -> _FloatArray:
        """Return the base parameters (n_base,) of a full set (10 n_links,)."""

    def lift(self, phi_base: ArrayLike) -> _FloatArray:
        """Full set (10 n_links,) with the torque of `phi_base` (n_base,): zeros in the other places."""

@final
class Effect:
    """An effect with its shape parameters: a torque linear in its coefficients, one term of a model."""

    @staticmethod
    def rotor_inertia() -> Effect:
        """`tau = J ddq_motor`, J reflected to the link side [kg·m²]."""

    @staticmethod
    def torque_offset() -> Effect:
        """Return a constant torque per joint."""

    @staticmethod
    def friction(velocity_threshold: Sequence[float], transition_width: Sequence[float]) -> Effect:
        """Friction of Eqs. 9-11 with lambda and eps per joint [rad/s].

        Raises
        ------
        ValueError
            Lengths differ, a threshold is negative or a width is not positive.
        """

    @staticmethod
    def of(kind: str, **shape: ArrayLike) -> Effect:
        """Return the effect `kind` of `effect_catalogue()`, one value per joint for each shape parameter named there.

        A function of the joint's own angle may have `held_from` and `held_to` too: angles [rad, m] beyond which it
        keeps the value that it has there.

        Raises
        ------
        ValueError
            There is no such kind, names or lengths do not fit, or a value is out of its range.
        """

    @property
    def kind(self) -> str:
        """Name in `effect_catalogue()`."""

    @property
    def coefficient_names(self) -> list[str]:
        """Names of the coefficients of one joint."""

    @property
    def n_columns(self) -> int:
        """Coefficients per joint."""

    @property
    def signals(self) -> list[str]:
        """What it needs: of a state's signals, `tau_link`, `tau_motor` and `step`."""

    @property
    def is_declared(self) -> bool:
        """Whether it is a part of the declared model, and so of `motor_torque`.

        A kind that the catalogue calls declared, or Coulomb's friction with a sign that is told by the way:
        `friction_hysteresis` over a shorter way than any gear's lost motion.
        """

    @property
    def has_memory(self) -> bool:
        """Whether it depends on the samples before."""

    @property
    def shape(self) -> list[tuple[str, list[float]]]:
        """Shape parameters by name, one value per joint each; `held_from` and `held_to` last, where it has them."""

    def reaction(self, joint: int) -> tuple[int, list[float]] | None:
        """Return the partner of a joint, and its coefficients over the joint's own; None where it acts on that alone.

        Forces between two joints act on both by their power, so one set of coefficients tells the other.
        """

    def __copy__(self) -> Effect: ...
    def __deepcopy__(self, _memo: object, /) -> Effect: ...

@final
class FrictionSearch:
    """Residual power of one joint's torque as a function of friction's shape, links taken out (Eq. 12).

    Parameters
    ----------
    runs : sequence of (speeds, filter, kept, mirrored)
        Motor-side speeds (n_samples,) [rad/s]; the band's filter; samples that become rows. Where `mirrored` is not
        None, half the difference of the rows at `kept` and at these samples becomes a row (Eq. 8).
    links : (n_rows, n_columns)
        Columns of the links in the rows of all runs.
    tau : (n_rows,)
        Torque in the same rows.
    weak : float
        Directions of the links weaker than this (relative singular value) are taken out on request only.
    n_orders : int
        Viscous orders that are fitted, 0 to 3.
    fixed : (n_fixed, 8), optional
        Rows of friction's columns that no shape in question changes; their torque stands at the end of `tau`.

    Raises
    ------
    ValueError
        Lengths that disagree, or a run that is too short for its filter.
    """

    def __new__(
        cls,
        runs: Sequence[tuple[ArrayLike, _Filter | None, Sequence[int], Sequence[int] | None]],
        links: ArrayLike,
        tau: ArrayLike,
        *,
        weak: float,
        n_orders: int = 3,
        fixed: ArrayLike | None = None,
    ) -> FrictionSearch: ...
    def power(
        self, velocity_threshold: ArrayLike, transition_width: ArrayLike, *, all_links: bool = False
    ) -> _FloatArray:
        """Sum of squares that is left at each shape, (n_shapes,). Shapes of one threshold are best given in a row."""

@final
class GaussianMixtureRegression:
    """Conditional mean and variance of a Gaussian mixture's last dimension given the others (Eqs. 31-39).

    Parameters
    ----------
    weights : (K,)
        Positive.
    means : (K, n_inputs + 1)
        Inputs first, output last.
    covariances : (K, n_inputs + 1, n_inputs + 1)
        Positive definite in their inputs.

    Raises
    ------
    ValueError
        Shapes disagree, a number is not finite, a weight not positive or a covariance not positive definite.
    """

    def __new__(cls, weights: ArrayLike, means: _FloatArray, covariances: _FloatArray) -> GaussianMixtureRegression: ...
    @property
    def covariances(self) -> _FloatArray:
        """Covariances, (n_components, n_inputs + 1, n_inputs + 1)."""

    @property
    def n_components(self) -> int:
        """K."""

    @property
    def weights(self) -> _FloatArray:
        """(K,)."""

    @property
    def means(self) -> _FloatArray:
        """(K, n_inputs + 1)."""

    def predict(self, u: ArrayLike) -> tuple[_FloatArray, _FloatArray]:
        """Mean (Eq. 38) and variance at `u` (n_samples, n_inputs): (n_samples,) each.

        The variance is the law of total variance's: Eq. 39 as printed leaves out the spread of the means.
        """

    def responsibilities(self, u: ArrayLike) -> _FloatArray:
        """h_k of Eq. 37 at `u` (n_samples, n_inputs): (n_samples, K); rows sum to one at any distance."""

@final
class NormalisedRbf:
    """Weighted mean of Gaussian bumps (Eqs. 27-29): `psi_j(u) = exp(-1/2 sum_i h_i (u_i - c_ji)^2)`.

    Parameters
    ----------
    centers : (N, n_inputs)
        c.
    precision : (n_inputs,)
        h [1/unit^2], positive; Eq. 27's sigma is `h ** -0.5`.
    weights : (N,)
        w of Eq. 29.
    variances : (N,)
        What is left about f near every centre, not negative.

    Raises
    ------
    ValueError
        Shapes disagree, a number is not finite or has the wrong sign.
    """

    def __new__(
        cls, centers: ArrayLike, precision: ArrayLike, weights: ArrayLike, variances: ArrayLike
    ) -> NormalisedRbf: ...
    @property
    def n_components(self) -> int:
        """N."""

    @property
    def centers(self) -> _FloatArray:
        """(N, n_inputs)."""

    @property
    def precision(self) -> _FloatArray:
        """(n_inputs,)."""

    @property
    def weights(self) -> _FloatArray:
        """(N,)."""

    @property
    def variances(self) -> _FloatArray:
        """(N,)."""

    def predict(self, u: ArrayLike) -> tuple[_FloatArray, _FloatArray]:
        """Value of f (Eq. 29) and the variance about it at `u` (n_samples, n_inputs): (n_samples,) each."""

    def basis(self, u: ArrayLike) -> _FloatArray:
        """psi_j (Eq. 27) at `u` (n_samples, n_inputs): (n_samples, N)."""

    def shares(self, u: ArrayLike) -> _FloatArray:
        """psi_j over their sum at `u` (n_samples, n_inputs): (n_samples, N); rows sum to one at any distance."""

@final
class PhysicalSet:
    """Standard parameters that bodies can have, beside a torque model, in SI whatever the model's unit. Immutable.

    Parameters
    ----------
    phi : (10 n_links,)
        Masses positive, pseudo-inertias positive definite.
    rotor_inertia : (n_joints,)
        Reflected to the link side, at least 0 [kg·m², kg].
    damping, friction : (n_joints,)
        Viscous [N·m·s/rad] and Coulomb [N·m] friction of both directions, at least 0.
    drive_gain : (n_joints,)
        Torque per unit of the model's torque channel [N·m per N·m or A]; ones where torques were fitted.

    Raises
    ------
    ValueError
        A length or a number does not fit; the message names it.
    """

    def __new__(
        cls,
        phi: ArrayLike,
        rotor_inertia: ArrayLike,
        *,
        damping: ArrayLike,
        friction: ArrayLike,
        drive_gain: ArrayLike,
    ) -> PhysicalSet: ...
    @property
    def phi(self) -> _FloatArray:
        """(10 n_links,)."""

    @property
    def rotor_inertia(self) -> _FloatArray:
        """(n_joints,) [kg·m², kg]."""

    @property
    def damping(self) -> _FloatArray:
        """(n_joints,) [N·m·s/rad]."""

    @property
    def friction(self) -> _FloatArray:
        """(n_joints,) [N·m]."""

    @property
    def drive_gain(self) -> _FloatArray:
        """(n_joints,) [N·m per torque unit of the model]."""

@final
class TorqueModel:
    """Torque model `rigid body + effects + residual` (Eq. 26). Owned by Rust, immutable.

    Parameters
    ----------
    robot : RobotModel
        Kinematics and gravity.
    phi : (10 n_links,)
        Inertial parameters, exact for torque and not necessarily physical.
    effects : sequence of (Effect, (n_joints, n_columns))
        Effects with their coefficients, summed in this order.
    residual : (str, sequence of GaussianMixtureRegression, NormalisedRbf or None), optional
        What the regressions see (`"deflection"`, `"joint_state"`, `"load_free_deflection"`, or `"signals"`), and one or
        None per joint.
    residual_signals : sequence of sequence of (str, int), optional
        With `"signals"`: name and joint of what each joint's regression sees, in the order of its inputs; one list per
        joint, at most six long, empty where there is no regression. Names: `q`, `dq`, `ddq`, `q_motor`, `dq_motor`,
        `ddq_motor`, `tau_link` (the rigid-body torque that the model predicts, before `torque_scale`).
    compliance : (n_joints,), optional
        Of the gears [rad per torque unit], for the load-free deflection; zeros by default.
    torque_scale : (n_joints,), optional
        Torque channel per unit of link torque; multiplies the rigid-body term. Ones by default.
    encoder_delay : (n_joints,)
        Delay of the link channel behind the motor channel [s].
    encoder_error : (n_joints, 2), optional
        Cosine and sine part [rad] of what a link encoder shows too much, `c cos q + s sin q`; taken out first, as
        `true_motion` does. Zeros by default; joints that slide have none.
    encoder_error_sides : {"link", "both"}
        `"both"` where joints have one encoder, so that the motor side is the same signal.
    torque_delay : float or (n_joints,)
        How late the torque channels are behind the encoders [s], all or each, at most 0.5 either way: the model
        predicts what they show, which is the torque of the state of that long ago. Needs `step`. Zero by default.
    noise_std : (n_joints,)
        Standard deviation of what the model leaves.
    domain : ((n_joints, 2), (n_joints,), (n_joints,))
        Least and greatest position, greatest speed, greatest acceleration of the training data.
    torque_unit : str
        `"N*m"` or `"A"`.
    step : float, optional
        Time between the samples that will come [s]; needed where an effect remembers in time or the torque is late.
    band : (cutoff, rate, standstill), optional
        Where its errors are told: cutoff [Hz] of the low-pass, rate [Hz] of the grid, whether standstill is scored.

    Raises
    ------
    ValueError
        A length or a number does not fit; the message names it.
    """

    def __new__(
        cls,
        robot: RobotModel,
        phi: ArrayLike,
        effects: Sequence[tuple[Effect, ArrayLike]],
        *,
        residual: tuple[str, Sequence[_Regression | None]] | None = None,
        residual_signals: Sequence[Sequence[tuple[str, int]]] | None = None,
        compliance: Sequence[float] | None = None,
        torque_scale: Sequence[float] | None = None,
        encoder_delay: Sequence[float],
        encoder_error: ArrayLike | None = None,
        encoder_error_sides: str = "link",
        torque_delay: ArrayLike | None = None,
        noise_std: Sequence[float],
        domain: _Box,
        torque_unit: str = "N*m",
        step: float | None = None,
        band: tuple[float, float, bool] | None = None,
    ) -> TorqueModel: ...
    @staticmethod
    def load(path: str | PathLike[str]) -> TorqueModel:
        """Read a model file.

        Raises
        ------
        FormatError
            It is no model file, or was cut or changed.
        OSError
            It cannot be read.
        """

    def save(self, path: str | PathLike[str]) -> None:
        """Write a model file, whole or not at all.

        Raises
        ------
        OSError
            The place cannot be written.
        """

    def evaluate(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        q_motor: ArrayLike | None = None,
        dq_motor: ArrayLike | None = None,
        ddq_motor: ArrayLike | None = None,
        *,
        step: float | None = None,
        temperature: ArrayLike | None = None,
    ) -> tuple[_FloatArray, _FloatArray, NDArray[np.uint32]]:
        """Torque by the estimator that runs online: total, terms and status.

        Parameters
        ----------
        q, dq, ddq : (n_samples, n_joints)
            Link side.
        q_motor, dq_motor, ddq_motor : (n_samples, n_joints), optional
            Motor side, divided by the gear ratio; the link side by default.
        step : float, optional
            Time between samples [s], where it is not the model's.
        temperature : (n_samples, n_joints), optional
            Measured [degC]; needed where the model's friction follows it.

        Returns
        -------
        total : (n_samples, n_joints)
            Sum of the terms.
        terms : (n_samples, n_terms, n_joints)
            In the order of `term_names`.
        status : (n_samples,)
            Bits: 1 overflow, the last good torque is repeated; 2 outside of the domain; 4 residual faded out; 512 the
            state that the torque channel shows lies outside of the run, and its first or last one was taken; 4096
            beyond the model's limits (`docs/how_to/online.md`) and evaluated at them;
            online also 8, a signal that an effect needs is missing and its torque zero.

        Raises
        ------
        ValueError
            An argument has the wrong shape or holds a NaN or an infinity; the temperature is needed and not given.
        """

    def torque(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        q_motor: ArrayLike | None = None,
        dq_motor: ArrayLike | None = None,
        ddq_motor: ArrayLike | None = None,
        *,
        out: _FloatArray | None = None,
    ) -> _FloatArray:
        """Total torque alone, to the same bits as `evaluate`; the fastest way to ask state by state.

        Parameters
        ----------
        q, dq, ddq : (n_samples, n_joints)
            Link side.
        q_motor, dq_motor, ddq_motor : (n_samples, n_joints), optional
            Motor side, divided by the gear ratio; the link side by default.
        out : (n_samples, n_joints), optional
            Float64 array in C order that the result is written to and that is returned; a new one by default.

        Returns
        -------
        total : (n_samples, n_joints)
            Sum of the terms.

        Raises
        ------
        ValueError
            An argument has the wrong shape or holds a NaN or an infinity; `out` is not as said; the model's friction
            follows a temperature, which only `evaluate` takes.
        """

    def predicted_std(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        q_motor: ArrayLike | None = None,
        dq_motor: ArrayLike | None = None,
        ddq_motor: ArrayLike | None = None,
    ) -> _FloatArray:
        """Standard deviation expected of measured minus predicted torque, (n_samples, n_joints) [torque unit].

        `noise_std` where no third loop acts. Where one is trusted, its own variance, which holds that noise too: by the
        law of total variance for a mixture, the mean squares left near the centres for radial basis functions. Where it
        fades, the noise and the residual's whole mean square. Parameters count as known. Arguments as for `evaluate`.

        Raises
        ------
        ValueError
            An argument has the wrong shape or holds a NaN or an infinity.
        """

    @property
    def robot(self) -> RobotModel:
        """Kinematics and gravity."""

    @property
    def term_names(self) -> list[str]:
        """`rigid_body`, the effects, `residual`: order of summation; a second one of a kind has a 2 behind it."""

    @property
    def phi(self) -> _FloatArray:
        """(10 n_links,)."""

    @property
    def effects(self) -> list[tuple[Effect, _FloatArray]]:
        """Effects with their coefficients (n_joints, n_columns)."""

    @property
    def residual(self) -> tuple[str, list[_Regression | None]] | None:
        """What the regressions see and one or None per joint; None without a third loop."""

    @property
    def residual_signals(self) -> list[list[tuple[str, int]]] | None:
        """Name and joint of what each joint's regression sees; None where they see a pair, and without a third loop."""

    @property
    def compliance(self) -> _FloatArray | None:
        """Of the gears [rad per torque unit], (n_joints,); None without a third loop."""

    @property
    def torque_scale(self) -> _FloatArray:
        """(n_joints,)."""

    @property
    def encoder_delay(self) -> _FloatArray:
        """(n_joints,) [s]."""

    @property
    def encoder_error(self) -> _FloatArray:
        """(n_joints, 2) cosine and sine parts [rad]; zeros where the encoders are right."""

    @property
    def encoder_error_sides(self) -> str:
        """`"link"` or `"both"`."""

    @property
    def torque_delay(self) -> _FloatArray:
        """(n_joints,) how late the torque channels are behind the encoders [s]; negative where they are early."""

    def with_torque_delay(self, delay: ArrayLike) -> TorqueModel:
        """Return the same model for torque channels that are `delay` [s] late, all by one number or each by its own.

        Raises
        ------
        ValueError
            Not one number and not one per joint; more than 0.5 s or 4094 steps either way; not zero, and there is no
            step.
        """

    @property
    def band(self) -> tuple[float, float, bool] | None:
        """Where its errors are told: cutoff [Hz], rate of the grid [Hz], whether standstill is scored; or None."""

    @property
    def noise_std(self) -> _FloatArray:
        """(n_joints,) [torque unit]."""

    @property
    def domain(self) -> tuple[list[list[float]], list[float], list[float]]:
        """Least and greatest position, greatest speed and acceleration per joint."""

    @property
    def torque_unit(self) -> str:
        """`"N*m"` or `"A"`."""

    @property
    def step(self) -> float | None:
        """Time between samples [s], where the model has one."""

    def summary(self) -> ModelSummary:
        """What is in it: where it was trained, what it leaves, every coefficient with its unit, joint by joint.

        Returns
        -------
        ModelSummary
            A table where it is printed and in a notebook; `to_dict` for more.
        """

    def predict(self, runs: Any) -> Any:
        """Torque along runs at their own stamps [`torque_unit`], as `ThreeLoopIdentifier.predict` of the fit gives it.

        Parameters
        ----------
        runs : Recording, data frame, or list of them
            Data frames have columns of the usual names; others are read by `Recording.from_dataframe` first.

        Returns
        -------
        ndarray (n_samples, n_joints), or a list of them
            A list for a list.

        Raises
        ------
        DataError
            Runs of another arm.
        """

    def score(self, runs: Any, *, per_joint: bool = False, as_recorded: bool = False) -> Any:
        """Coefficient of determination R2 along runs, as `ThreeLoopIdentifier.score` says it: mean, or (n_joints,).

        Raises
        ------
        DataError
            Runs of another arm, or with torque in another unit.
        """

    def plot_friction(
        self, runs: Any = None, *, joints: Sequence[str | int] | str | int | None = None, axes: Any = None
    ) -> NDArray[Any]:
        """Draw friction in steady sliding over speed, one panel per joint, as fast as the training data were.

        The line is the median over poses that the model was trained in, the band least and greatest: friction that
        follows load or position is another one in each. Friction with hysteresis is what it becomes once a joint has
        moved on for a while; one that follows a temperature is drawn at the temperature it is declared at. What speed
        does not tell (gears that warm up, a gear's hysteresis under load) is left out, and said above.

        Parameters
        ----------
        runs : Recording, data frame, or list of them, optional
            Dots: their torque in the band, less everything of the model but these curves, where the joint moves.
        joints : sequence of str or int, optional
            Names or indices; all by default.
        axes : array of matplotlib Axes, optional
            To draw into, one per joint; a new figure by default.

        Returns
        -------
        ndarray of matplotlib Axes, (n_joints,)

        Raises
        ------
        MissingLibraryError
            matplotlib, which the extra `plot` brings, is not installed.
        """

    def plot_residual(
        self, run: Any, *, joints: Sequence[str | int] | str | int | None = None, axes: Any = None
    ) -> NDArray[Any]:
        """Draw measured and predicted torque along a run, and what is left; in the band, where joints move.

        Parameters
        ----------
        run : Recording, data frame, or list of them
            Several stand one behind the other.
        joints, axes
            As for `plot_friction`; two axes per joint.

        Returns
        -------
        ndarray of matplotlib Axes, (n_joints, 2)

        Raises
        ------
        DataError
            A run of another arm, or with torque in another unit.
        MissingLibraryError
            matplotlib, which the extra `plot` brings, is not installed.
        """

    def _repr_html_(self) -> Any: ...
    def with_physical(self, physical: PhysicalSet) -> TorqueModel:
        """Return the same model with a physically consistent set beside it; evaluation does not use it.

        Raises
        ------
        ValueError
            The set is one of another number of joints.
        """

    @property
    def physical(self) -> PhysicalSet | None:
        """The physically consistent set; None where none was identified."""

    @property
    def physical_phi(self) -> _FloatArray | None:
        """Its inertial parameters (10 n_links,); None where there is none."""
    def __copy__(self) -> TorqueModel: ...
    def __deepcopy__(self, _memo: object, /) -> TorqueModel: ...

def friction_basis(dq: ArrayLike, velocity_threshold: float, transition_width: float) -> _FloatArray:
    """Basis of Eqs. 9-11 at speeds `dq` (n_samples,) of one joint: (n_samples, 8), columns `FRICTION_NAMES`.

    The superscripts of the paper's k_v are indices, not powers; the quadratic column is dq² on both sides.

    Raises
    ------
    ValueError
        The threshold (lambda) is negative or the width (eps) not positive [rad/s].
    """

def effect_catalogue() -> list[dict[str, Any]]:
    """Every kind of effect, those of every declared model first.

    Returns
    -------
    list of dict
        `kind`; `formula`; `coefficients`: of one joint, in order, dicts of `name`, `unit`, `lower` and `upper` (what
        physics allows); `shape`: dicts as below; `signals` that it needs, `tau_link`, `tau_motor`, `temperature` and
        `step` among them; `memory`: whether it depends on the samples before; `declared`: whether declared models have
        it. Units hold `{torque}` and `{angle}`, for `str.format`.

        What a search goes by: `places`: "joint", "pair" (any two) or "neighbours" (two that follow each other);
        `sought`: whether it is looked for; `requires`: of "two_encoders", "revolute", "load" and "temperature" what a
        joint must have or its runs must show; `drawn_against`: [signal, unit] of a report's plot, None for its own
        column; `most_relative`: largest part of the motor's torque that it may add within the trained load, or None.

        Of a shape parameter: `name`, `unit`, `rule`; `grid`: values that a search begins with; `relative_to`: None
        (they are in its unit), "load" (they are parts of the predicted load's standard deviation), "speed" (of the
        joint's greatest speed), "chain" (they are places along it from the joint), "friction_width" or
        "friction_sharpness" (it is that of friction's own sign, and the grid, in its unit, is for where there is no
        fit); `absent`: what it is where it is not given, None where it has to be; `not_below`: the shape parameter
        below which it is not searched, or None; `lowest`, `highest`, `scale`: bounds between which a search goes on,
        in its unit, and whether in even steps of the value ("linear") or of its magnitude's logarithm ("log"), None if
        it does not. Values of the grid outside of the bounds are not searched.
    """

def effect_columns(
    effect: Effect,
    q: ArrayLike,
    dq: ArrayLike,
    ddq: ArrayLike,
    q_motor: ArrayLike | None = None,
    dq_motor: ArrayLike | None = None,
    ddq_motor: ArrayLike | None = None,
    tau_link: ArrayLike | None = None,
    *,
    tau_motor: ArrayLike | None = None,
    step: float | None = None,
    temperature: ArrayLike | None = None,
    joints: Sequence[int] | None = None,
    filter: _Filter | None = None,
    kept: Sequence[int] | None = None,
) -> _FloatArray:
    """Torque per unit coefficient along a run, from a fresh memory: (n_samples, n_joints, n_columns).

    With `kept`, in the band at these samples, as `observe` gives them: (n_kept, n_joints, n_columns).

    Parameters
    ----------
    q, dq, ddq : (n_samples, n_joints)
        Link side, on the motor channel's clock.
    q_motor, dq_motor, ddq_motor : (n_samples, n_joints), optional
        Motor side, divided by the gear ratio; the link side by default.
    tau_link : (n_samples, n_joints), optional
        Rigid-body torque that the model predicts, before `torque_scale`; needed by effects of the load.
    tau_motor : (n_samples, n_joints), optional
        Torque that the model predicts at the motors, `motor_torque`; needed by effects of it.
    step : float, optional
        Time between samples [s]; needed by effects that remember in time.
    temperature : (n_samples, n_joints), optional
        Measured [degC]; needed by friction that follows it.
    joints : sequence of int, optional
        Only these, in this order; all by default.
    filter, kept : optional
        As for `observe`.

    Raises
    ------
    ValueError
        Shapes disagree, a number is not finite, the effect needs a signal that is not given, an index is out of range,
        or the run is shorter than the filter's padding.
    """

def effect_torque(
    effect: Effect,
    coefficients: ArrayLike,
    q: ArrayLike,
    dq: ArrayLike,
    ddq: ArrayLike,
    q_motor: ArrayLike | None = None,
    dq_motor: ArrayLike | None = None,
    ddq_motor: ArrayLike | None = None,
    tau_link: ArrayLike | None = None,
    *,
    tau_motor: ArrayLike | None = None,
    step: float | None = None,
    temperature: ArrayLike | None = None,
) -> _FloatArray:
    """Torque along a run, (n_samples, n_joints), to the bits of `TorqueModel.evaluate`.

    `coefficients` (n_joints, n_columns); everything else as for `effect_columns`.

    Raises
    ------
    ValueError
        As `effect_columns`; `coefficients` does not have one row per joint.
    """

def motor_torque(
    terms: Sequence[tuple[Effect, ArrayLike]],
    torque_scale: ArrayLike,
    q: ArrayLike,
    dq: ArrayLike,
    ddq: ArrayLike,
    q_motor: ArrayLike | None = None,
    dq_motor: ArrayLike | None = None,
    ddq_motor: ArrayLike | None = None,
    *,
    tau_link: ArrayLike,
    step: float | None = None,
    temperature: ArrayLike | None = None,
) -> _FloatArray:
    """Torque that a model predicts at its motors, (n_samples, n_joints) [torque unit], before effects that it found.

    `torque_scale * tau_link` and all terms whose effect `is_declared` (rotor inertia, torque offset, friction), to the
    bits of `TorqueModel.evaluate`. No measured torque is in it.

    Parameters
    ----------
    terms : sequence of (Effect, array (n_joints, n_columns))
        Effects of a model and their coefficients; those that are not declared are left out.
    torque_scale : (n_joints,)
        Torque channel per unit of link torque.
    tau_link : (n_samples, n_joints)
        Rigid-body torque that the model predicts, before `torque_scale`.

    The others are as for `effect_columns`.

    Raises
    ------
    ValueError
        As `effect_torque`; `torque_scale` does not have one value per joint.
    """

def residual_inputs(
    inputs: str,
    q: _FloatArray,
    dq: ArrayLike,
    q_motor: ArrayLike,
    dq_motor: ArrayLike,
    wind_up: ArrayLike | None = None,
) -> _FloatArray:
    """Return what a regression of the third loop sees: (n_samples, n_joints, 2); the channels on one clock.

    `inputs`: `"deflection"` (motor minus link, and its rate), `"joint_state"` (of the motor side), or
    `"load_free_deflection"`: the deflection less `wind_up` (compliance times predicted rigid-body torque), and the
    deflection's rate.
    """

def named_signals(
    signals: Sequence[tuple[str, int]],
    q: ArrayLike,
    dq: ArrayLike,
    ddq: ArrayLike,
    q_motor: ArrayLike | None = None,
    dq_motor: ArrayLike | None = None,
    ddq_motor: ArrayLike | None = None,
    tau_link: ArrayLike | None = None,
) -> _FloatArray:
    """Return signals by name and joint along a run, (n_samples, n_signals): what a regression on them sees online.

    The channels on one clock; names as for `TorqueModel(residual_signals=)`, everything else as for `effect_columns`.

    Raises
    ------
    ValueError
        There is no such signal or joint, or `tau_link` is named and not given.
    """

def align_link_side(
    q: ArrayLike, dq: ArrayLike, ddq: ArrayLike, encoder_delay: ArrayLike
) -> tuple[_FloatArray, _FloatArray]:
    """Link-side position and velocity on the motor channel's clock; `encoder_delay` (n_joints,) [s]."""

def true_motion(
    q: ArrayLike, dq: ArrayLike, ddq: ArrayLike, encoder_error: ArrayLike
) -> tuple[_FloatArray, _FloatArray, _FloatArray]:
    """Motion (n_samples, n_joints) less what eccentric encoders show too much: q, dq and ddq of `q - e(q)`.

    `encoder_error` (n_joints, 2) [rad]: e(q) = c cos q + s sin q per joint. It belongs to the true angle, is taken at
    the shown one, and so leaves half its amplitude squared: microradians of milliradians.

    Raises
    ------
    ValueError
        Shapes disagree, or a number is not finite.
    """

def read_contact(
    path: str | PathLike[str], model: TorqueModel
) -> tuple[list[str], str, float, int | None, float, float]:
    """What a `contact.json` holds: joints, torque unit, step [s], window, time_constant [s], false contacts per hour.

    Raises
    ------
    ValueError
        It is of a model with other joints or effects.
    FormatError
        It is none, or of a newer program.
    OSError
        The system refuses.
    """

def adapt_run(
    model: TorqueModel,
    t: ArrayLike,
    motion: tuple[ArrayLike | None, ...],
    tau: ArrayLike,
    *,
    temperature: ArrayLike | None = None,
    step: float,
    window: int | None = None,
    inflation: Sequence[float],
    noise_memory: Sequence[float],
    friction: bool,
    payload: bool,
    row: float,
    memory: float,
    factor: tuple[float, float],
    mass: float,
    reach: float,
    said: float,
    observe: bool = False,
    remembered: str | None = None,
) -> tuple[
    list[dict[str, Any]],
    tuple[NDArray[np.uintp], _FloatArray, _FloatArray, _FloatArray, _FloatArray],
    _FloatArray,
    _FloatArray,
    _FloatArray,
    NDArray[np.uint32],
    str,
]:
    """How friction and a payload follow a run, by the code that runs online.

    Parameters
    ----------
    t, motion, tau, temperature, step, window
        As for `observe_momentum`.
    inflation, noise_memory : (n_joints,)
        Variance of a joint's rows over what the model expects; rows that are worth an independent one.
    friction, payload : bool
        What follows.
    row, memory : float
        Time over which what the model leaves is averaged, and motion after which a row counts 1/e [s].
    factor : (float, float)
        Limits of the factors on friction.
    mass, reach : float
        Limits of a payload [kg, m].
    said : float
        Moves of this part are said.
    observe : bool
        Whether nothing follows in a contact.
    remembered : str, optional
        What was known at the end of another run.

    Returns
    -------
    told : list of dict
        In order: sample, part, joint, from, to, estimate, std, moments, reason.
    rows : tuple
        Samples at which rows ended (n_rows,); factors that are used, their estimates and deviations (n_rows, n_joints);
        mass and first moments that are used, the mass's estimate and its deviation (n_rows, 6).
    tau, tau_model, tau_measured : ndarray (n_samples, n_joints)
        With what is added, the model's, and the measured one at the same state.
    status : ndarray (n_samples,)
        Bits.
    remembered : str
        What is known at the end.

    Raises
    ------
    FormatError
        What is remembered is of another model, or of an adaptation with other settings.
    ValueError
        As `observe_momentum`; a limit is none, a memory less than one.
    """

def with_adapted(model: TorqueModel, factors: Sequence[float], load: tuple[float, float, float, float]) -> TorqueModel:
    """Return another model, with factors on the friction of its joints, and a load at its last link.

    Parameters
    ----------
    factors : (n_joints,)
        On the friction of the joints.
    load : (float, float, float, float)
        Mass and first moments [kg, kg m].

    Raises
    ------
    ValueError
        A length is wrong, or a number is none that a model may have.
    """

def read_watch(path: str | PathLike[str]) -> dict[str, Any]:
    """What a `watch.json` holds.

    Its keys are joints, row, false_per_day, friction, gain, offset, load, delay, slip, unknown, inflation, memory,
    least_speed, frozen_after and frozen_way.

    Raises
    ------
    FormatError
        It is none, or of a newer program.
    OSError
        The system refuses.
    """

def watch_run(
    model: TorqueModel,
    t: ArrayLike,
    motion: tuple[ArrayLike | None, ...],
    tau: ArrayLike,
    *,
    temperature: ArrayLike | None = None,
    step: float,
    window: int | None = None,
    inflation: Sequence[float],
    memory: Sequence[float],
    least_speed: Sequence[float],
    frozen_after: Sequence[float],
    frozen_way: Sequence[float],
    row: float,
    false_per_day: float,
    friction: float,
    gain: float,
    offset: float,
    load: float,
    delay: float,
    slip: float,
    unknown: float,
    remembered: str | None = None,
) -> tuple[
    list[dict[str, Any]],
    NDArray[np.uintp],
    _FloatArray,
    _FloatArray,
    _FloatArray,
    tuple[list[dict[str, Any]], str],
    tuple[_FloatArray, _FloatArray],
]:
    """What of a model no longer holds along a run, by the code that runs online.

    Parameters
    ----------
    t, motion, tau, temperature, step, window
        As for `observe_momentum`.
    inflation, memory : (n_joints,)
        Variance of a joint's rows over what the model expects; rows that are worth an independent one.
    least_speed : (n_joints,)
        Mean speed below which a row says nothing [rad/s, m/s].
    frozen_after, frozen_way : (n_joints,)
        Time after which a repeated torque is none [s], where the model's has gone so far meanwhile [torque unit].
    row : float
        Time over which what the model leaves is averaged [s].
    false_per_day : float
        Alarms that nothing has caused.
    friction, gain, offset, load, delay, slip, unknown : float
        Changes that are none yet, as `Tolerated` has them.
    remembered : str, optional
        What the watch of another run knew at its end, which this one goes on with.

    Returns
    -------
    changes : list of dict
        In the order in which they were said: sample, kind, joint, size, std, moments, settled, or.
    ends : ndarray (n_rows,)
        Samples at which rows ended.
    left, variance, moves : ndarray (n_rows, n_joints)
        What was left, what the model expects of it, and 1 where the joint says something.
    before : list of dict
        What stood before the run, from what is remembered: as changes.
    remembered : str
        What the watch knows at the end.
    speed : ndarray (n_rows, n_joints)
        Mean speed of every row [rad/s, m/s].
    repeats : ndarray (n_joints, 4)
        Values that a torque channel showed while the arm moved, for how long all of them, and the longest of those
        while which the model's torque went faster than on average [s], and how far it went, at most, while one was
        shown [torque unit].

    Raises
    ------
    FormatError
        What is remembered is of another model, or of a watch with other settings.
    ValueError
        As `observe_momentum`; a setting is not positive, a memory less than one.
    """

def observe_momentum(
    model: TorqueModel,
    t: ArrayLike,
    motion: tuple[ArrayLike | None, ...],
    tau: ArrayLike,
    *,
    temperature: ArrayLike | None = None,
    step: float,
    window: int | None = None,
    time_constant: float,
    correlation_time: float | None = None,
    false_per_hour: float,
    uncertainty: str | None = None,
) -> tuple[list[_FloatArray], list[_FloatArray], NDArray[np.uint32], float]:
    """External torque by the generalised momentum, sample by sample, by the code that runs online.

    Parameters
    ----------
    t : (n_samples,)
        Time [s].
    motion : tuple of six arrays or None
        q, dq, ddq, q_motor, dq_motor, ddq_motor. q is needed; without dq or ddq all signals go through the causal
        filter.
    tau : (n_samples, n_joints)
        Measured torque.
    step : float
        Usual time between samples [s].
    window : int, optional
        Samples to differentiate over.
    time_constant, correlation_time, false_per_hour : float
        Of the observer [s], of what the model leaves [s], and how many contacts noise may make.
    uncertainty : str, optional
        Text of a `contact.json`, from which thresholds follow then.

    Returns
    -------
    said : list of five ndarray (n_samples, n_joints)
        External torque, beyond what it is a contact, what of that is friction at rest, the deviation that the model
        expects, and what a hand may guide the arm by.
    sources : list of three ndarray (n_samples, n_joints)
        With `uncertainty` what every joint does (0 moves, 1 stands, 2 has just begun, stopped or turned), the predicted
        torque, and its variance by the parameters; else zeros.
    status : ndarray (n_samples,)
        Status bits; 2048 in contact.
    delay : float
        Of all of it [s].

    Raises
    ------
    ValueError
        Shapes disagree, q is missing, a setting is not positive, or `uncertainty` is of another model.
    FormatError
        `uncertainty` is no `contact.json`.
    """

def observe(
    robot: RobotModel,
    effects: Sequence[Effect],
    pivots: Sequence[int],
    q: ArrayLike,
    dq: ArrayLike,
    ddq: ArrayLike,
    q_motor: ArrayLike,
    dq_motor: ArrayLike,
    ddq_motor: ArrayLike,
    tau: ArrayLike,
    *,
    filter: _Filter | None = None,
    kept: Sequence[int],
    tau_link: ArrayLike | None = None,
    tau_motor: ArrayLike | None = None,
    step: float | None = None,
    temperature: ArrayLike | None = None,
) -> list[_FloatArray]:
    """Rows `[effects | base columns of the links it moves | torque]` of every joint, filtered, decimated.

    The same zero-phase low-pass runs over every column and over the torque.

    Parameters
    ----------
    pivots : sequence of int
        Indices into phi of the base columns, ascending.
    filter : (sections, steady state, padding), optional
        As `scipy.signal` gives them; None filters nothing.
    kept : sequence of int
        Samples that become rows, ascending.
    tau_link, tau_motor, step, temperature : optional
        As for `effect_columns`.

    Returns
    -------
    list of ndarray (n_kept, n_columns)
        One per joint.

    Raises
    ------
    ValueError
        Shapes disagree, an index is out of range, or the run is shorter than the filter's padding.
    """

def fold(
    robot: RobotModel,
    effects: Sequence[Effect],
    pivots: Sequence[int],
    q: ArrayLike,
    dq: ArrayLike,
    ddq: ArrayLike,
    q_motor: ArrayLike,
    dq_motor: ArrayLike,
    ddq_motor: ArrayLike,
    tau: ArrayLike,
    *,
    filter: _Filter | None = None,
    kept: Sequence[int] | None = None,
    tau_link: ArrayLike | None = None,
    tau_motor: ArrayLike | None = None,
    step: float | None = None,
    temperature: ArrayLike | None = None,
) -> list[_FloatArray]:
    """`triangular_factor` of every joint's `observe` rows, in one pass: without a filter the rows never exist.

    Every sample is a row where `kept` is not given. The same bits for any number of threads.

    Raises
    ------
    ValueError
        As `observe`.
    """

def weighted_fit(
    factors: Sequence[_FloatArray], pivots: Sequence[int], n_rows: int, *, n_reweightings: int = 2
) -> list[_FloatArray]:
    """Weighted least squares on the joints' factors, each joint weighted by its own noise `n_reweightings` times.

    Returns
    -------
    base, base_std, effects, effects_std, noise_std : ndarray
        Base parameters (n_base,), effects' coefficients (n_joints * n_effect_columns,), what is left per joint
        (n_joints,), and standard deviations of the first two.

    Raises
    ------
    ValueError
        Sizes disagree, rows are no more than parameters, or the data do not tell the columns apart.
    """

def processor_path(path: str | None = None) -> str:
    """Name of the instructions that the kernels run on: "baseline", "avx2" or "avx512".

    With `path` the whole process takes those from now on, for tests and measurements. Results of the last two are the
    same bits; the first rounds products on their own.

    Raises
    ------
    ValueError
        This processor does not have them.
    """

def low_pass(x: ArrayLike, filter: _Filter | None) -> _FloatArray:
    """Every column of `x` (n, k) forwards and backwards through a low-pass, as `scipy.signal.sosfiltfilt`: (n, k).

    Raises
    ------
    ValueError
        There are no more samples than padding.
    """

def sign_slopes(
    dq: ArrayLike,
    transition_width: float,
    sharpness: float,
    *,
    filter: _Filter | None = None,
    kept: Sequence[int],
) -> _FloatArray:
    """Change of a smooth law's sign with its shape at speeds `dq` (n_samples,), filtered and decimated: (n_kept, 4).

    Of `s` and `|s|` with the logarithm of the width, then of both with that of the sharpness.

    Raises
    ------
    ValueError
        A shape that is not positive; `dq` is shorter than the filter's padding, or a kept sample is behind its end.
    """

def slope(x: ArrayLike, rate: float) -> _FloatArray:
    """Derivative of every column of `x` (n, k) sampled at `rate` [1/s], (n, k).

    By Collatz's compact scheme: slopes are tied to each other, and right for cubics.
    """

def extent(x: ArrayLike) -> _FloatArray:
    """What every column of `x` (n, k) spans, (4, k).

    Lowest and highest number, largest step from row to row, rows of the longest stretch of equal neighbours.

    Raises
    ------
    ValueError
        There is no row, or a number is not finite.
    """

def triangular_factor(rows: _FloatArray) -> _FloatArray:
    """R with `R.T @ R == A.T @ A` for rows A (m, width): (width, width), upper triangular, diagonal >= 0."""

def merge_factors(factors: Sequence[_FloatArray]) -> _FloatArray:
    """R of several factors stacked, merged in a fixed tree: (width, width).

    Raises
    ------
    ValueError
        There is none, or widths differ.
    """

@final
class Excitation:
    """How well a motion excites a robot (Eqs. 13, 14), with the exact gradient.

    Parameters
    ----------
    robot : RobotModel
        The arm.
    pivots : sequence of int
        Base columns, ascending.
    whitening : (n_joints, n_joints), optional
        `Omega^(-1/2)` of Eq. 13; multiplies the rows of every sample.
    random_state, rtol : int, float
        Probing states and relative threshold of the blocks' structural ranks.

    Raises
    ------
    ValueError
        No column, an index out of range or not ascending, or a whitening of the wrong shape.
    """

    def __new__(
        cls,
        robot: RobotModel,
        pivots: Sequence[int],
        *,
        whitening: ArrayLike | None = None,
        random_state: int = 0,
        rtol: float = 1e-9,
    ) -> Excitation: ...
    @property
    def ranks(self) -> tuple[int, int, int, int]:
        """Structural ranks on the base columns: of the whole, and of its acceleration, velocity and gravity blocks."""

    def blocks(self, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike) -> tuple[_FloatArray, _FloatArray, _FloatArray]:
        """Whitened blocks of Eq. 14, (n_samples n_joints, n_base) each, sample by sample; they add up to the whole.

        Acceleration `Y(q, 0, ddq) - Y(q, 0, 0)`, velocity `Y(q, dq, 0) - Y(q, 0, 0)`, gravity `Y(q, 0, 0)`.
        """

    def conditions(self, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike) -> _FloatArray:
        """`s_1 / s_r` of the whole and of the blocks over structural ranks (4,), 1e8 at most; NaN where that is 0."""

    def value(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        *,
        criterion: str,
        weights: Sequence[float] | None = None,
    ) -> float:
        """Value of a criterion, smaller is better.

        Parameters
        ----------
        q, dq, ddq : (n_samples, n_joints)
            The motion.
        criterion : str
            `"block"`: Eq. 14. `"condition"`: the condition number alone. `"D"`: `-log det(W'W)`. `"A"`:
            `trace((W'W)^-1)`.
        weights : (3,), optional
            w_a, w_b, w_g of Eq. 14.
        """

    def value_and_gradient(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        *,
        criterion: str,
        weights: Sequence[float] | None = None,
    ) -> tuple[float, _Motion]:
        """As `value`, with its gradient with respect to q, dq and ddq."""

def inverse_dynamics_gradient(
    robot: RobotModel,
    q: ArrayLike,
    dq: ArrayLike,
    ddq: ArrayLike,
    direction: ArrayLike,
    phi: ArrayLike | None = None,
) -> _Motion:
    """Gradient of `sum(direction * robot.inverse_dynamics(q, dq, ddq, phi))` with respect to q, dq and ddq."""

def point_places(robot: RobotModel, q: ArrayLike, links: Sequence[int], places: ArrayLike) -> _FloatArray:
    """Points fixed to links, in the base frame (n_samples, n_points, 3) [m].

    Parameters
    ----------
    q : (n_samples, n_joints)
        Positions.
    links : (n_points,)
        Index of each point's link.
    places : (n_points, 3)
        Each point in its link's frame [m].
    """

def point_gradient(
    robot: RobotModel, q: ArrayLike, links: Sequence[int], places: ArrayLike, weights: _FloatArray
) -> _FloatArray:
    """Gradient of `sum(weights * point_places(robot, q, links, places))` with respect to q (n_samples, n_joints)."""

def pseudo_inertia(phi: ArrayLike) -> _FloatArray:
    """Pseudo-inertias `[[S, h], [h', m]]`, `S = tr(I)/2 1 - I`, of phi (10 n_links,): (n_links, 4, 4).

    Positive definite for just those bodies that can be built from points of positive mass.

    Raises
    ------
    ValueError
        Not ten numbers per link, or one is not finite.
    """

def phi_from_pseudo_inertia(pseudo: ArrayLike) -> _FloatArray:
    """Return phi (10 n_links,) of pseudo-inertias (n_links, 4, 4); of each the symmetric part counts.

    Raises
    ------
    ValueError
        Another shape, or a number that is not finite.
    """

def mjcf_with_physical(model: TorqueModel) -> str:
    """Return the chain with the physical set of `model` as a MuJoCo model: bodies, joints, motors.

    Raises
    ------
    ValueError
        The model has no physical set.
    """

def urdf_with_physical(model: TorqueModel, original: bytes | None = None, *, source_name: str = "<string>") -> bytes:
    """Return a URDF with the physical set of `model`.

    With the text of the original only its `<inertial>` and `<dynamics>` change, everything else stays byte for byte;
    without it, it is links and joints alone.

    Raises
    ------
    UrdfError
        The original is refused, or its chain is another one than the model's.
    ValueError
        The model has no physical set.
    """

def c_header(model: TorqueModel, prefix: str) -> str:
    """Return `model` as one self-contained C99 file whose names begin with `prefix`.

    Raises
    ------
    ValueError
        The prefix is no beginning of a C name, or an effect has no C form.
    """

def c_prefix(text: str) -> str:
    """Return a prefix for `c_header` made of any text."""

def likeliest(
    models: Sequence[
        tuple[
            Sequence[_FloatArray],
            Sequence[NDArray[np.intp]],
            int,
            _FloatArray,
            _FloatArray,
            _FloatArray,
            _FloatArray,
            _FloatArray,
            float,
            bool,
        ]
    ],
) -> list[tuple[_FloatArray, _FloatArray, _FloatArray, float, _FloatArray, float]]:
    """Most probable unknowns of linear models of all joints under normal priors, the models side by side.

    With ``w_j^2 = k_j / (n sigma_j^2)`` and ``H = sum_j w_j^2 M_j'M_j + P``, ``x = H^-1 (sum_j w_j^2 M_j'y_j + p)``.
    The noise goes to MacKay's fixed point ``sigma_j^2 = k_j |r_j|^2 / (n (k_j - gamma_j))``, gamma_j the unknowns that
    joint j determines, ``w_j^2 tr(H^-1 M_j'M_j)``, until it changes by less than 1 %, in at most 12 steps.

    Parameters
    ----------
    models : sequence of tuple
        Of each model: ``[M_j | y_j]'[M_j | y_j]`` (k_j + 1, k_j + 1) of every joint, places (k_j,) of the columns among
        all unknowns, how many these are, P (m, m) and p (m,) of the first m unknowns (the others are standard normal),
        noise (n_joints,) to begin with, samples k_j (n_joints,) that the rows are worth, the least noise (n_joints,),
        rows n, and whether the noise is known.

    Returns
    -------
    list of tuple
        Of each model: x, noise (n_joints,), ``|r_j|^2`` (n_joints,), ``x'P x - 2 p'x``, W with ``W'W = H^-1``, and
        ``ln det H``.

    Raises
    ------
    ValueError
        Sizes disagree, or numbers are not finite or so far apart that H cannot be factored.
    """

def fit_mixture(
    x: ArrayLike,
    weights: ArrayLike,
    means: ArrayLike,
    covariances: ArrayLike,
    *,
    reg_covar: float,
    tol: float,
    max_iter: int,
) -> tuple[_FloatArray, _FloatArray, _FloatArray, list[float], bool, float]:
    """Fit a Gaussian mixture to `x` (n_samples, n_dimensions) by expectation and maximisation from a start on.

    The steps are those of scikit-learn's `GaussianMixture` with full covariances, one pass over the data each. At most
    8 dimensions. The result does not depend on the number of threads.

    Returns
    -------
    weights (n_components,), means (n_components, n_dimensions), covariances (n_components, n_dimensions, n_dimensions)
        The mixture.
    lower_bounds : list of float
        Mean log-likelihood per sample, one for each iteration, before its maximisation.
    converged : bool
        The last change was below `tol`.
    log_likelihood : float
        Mean per sample, of the mixture returned.

    Raises
    ------
    ValueError
        A shape does not fit, a number is not finite, or a component has collapsed.
    """
