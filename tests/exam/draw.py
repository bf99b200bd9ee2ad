"""A case in numbers: what arm, what runs, what sensors, what is hidden. All of it from one seed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

REPORTED = 1000
"""Seeds from here on are for reporting; smaller ones are for choosing."""
_FIRST = (
    "stribeck",
    "load_dependent_friction",
    "load_hysteresis",
    "position_dependent_friction",
    "thermal_friction",
    "friction_hysteresis",
    "coupled_friction",
    "torque_ripple",
    "inertial_coupling",
    "gravity_tilt",
    "kinematic_error",
    "joint_spring",
    "counterbalance",
    "torque_saturation",
    "torque_delay",
    "torque_gain",
    "encoder_eccentricity",
    "backlash",
    "joint_elasticity",
)
LATER = ("bearing_friction",)
"""Kinds that came later: drawn apart, and no stand-ins, so that a seed of before is the case that it was, but for those
that get one."""
NAMED = (*_FIRST, *LATER)
"""Kinds that have a name in the catalogue."""
STRANGE = ("hose", "window_brake", "cable_stop", "neighbour_drag")
"""Kinds that have none."""
GROUPS = {"clean": 0.5, "single": 0.25, "mixture": 0.15, "outside": 0.1}
MOTIONS = {"fourier": 0.45, "moves": 0.25, "pauses": 0.15, "poor": 0.15}
SIGN_LAWS = ("tanh", "arctan", "root")


@dataclass(frozen=True)
class Wish:
    """One thing to hide: its kind, and what the declared model cannot imitate of it over the noise."""

    kind: str
    ratio: float


@dataclass(frozen=True)
class Case:
    """Everything about a case that is one number or one word; what is drawn per joint is drawn where it is used."""

    seed: int
    group: str
    wishes: tuple[Wish, ...]
    n_joints: int
    mass: float
    file_error: float
    file_inertials: str
    motion: str
    n_train: int
    durations: tuple[float, ...]
    speed: float
    rate: float
    jitter: float
    missing: float
    n_encoders: int
    encoder_bits: int
    at_joint: bool
    motor_bits: int
    windup: float
    elastic_gears: bool
    current: bool
    noise: float
    noise_corner: float
    quantum: float
    sign_law: str
    temperature: bool

    @property
    def n_runs(self) -> int:
        """Training and test runs together."""
        return len(self.durations)


def stream(seed: int, *part: int) -> np.random.Generator:
    """Random numbers of one part of a case: a change of one part leaves the others as they are."""
    return np.random.default_rng([seed, *part])


def log_uniform(rng: np.random.Generator, low: float, high: float, size: int | None = None):
    """Numbers whose logarithm is uniform."""
    return np.exp(rng.uniform(np.log(low), np.log(high), size))


def _one_of(rng: np.random.Generator, shares: dict[str, float]) -> str:
    return str(rng.choice(list(shares), p=list(shares.values())))


def draw(seed: int) -> Case:
    """Draw the case of a seed."""
    rng = stream(seed, 0)
    group = _one_of(rng, GROUPS)
    n_train = int(rng.integers(1, 5))
    n_runs = n_train + int(rng.integers(0, 3))
    n_encoders = 1 + int(rng.random() < 0.4)
    at_joint = bool(n_encoders == 2 or rng.random() < 0.4)  # behind the gear a turn has fewer steps
    return Case(
        seed=seed,
        group=group,
        wishes=_with_later(stream(seed, 12), group, _wishes(rng, group, n_encoders)),
        n_joints=int(rng.integers(5, 8)),
        mass=float(log_uniform(rng, 3.0, 300.0)),
        file_error=float(rng.uniform(0.10, 0.25)),
        file_inertials=_one_of(rng, {"near": 0.8, "placeholder": 0.1, "missing": 0.1}),
        motion=_one_of(rng, MOTIONS),
        n_train=n_train,
        durations=tuple(float(d) for d in rng.uniform(8.0, 60.0, n_runs)),
        speed=float(log_uniform(rng, 0.5, 2.5)),
        rate=float(np.round(log_uniform(rng, 50.0, 1000.0))),
        jitter=float(rng.uniform(0.02, 0.3)) if rng.random() < 0.3 else 0.0,
        missing=float(log_uniform(rng, 0.001, 0.02)) if rng.random() < 0.25 else 0.0,
        n_encoders=n_encoders,
        encoder_bits=int(rng.integers(16 if at_joint else 12, 21)),
        at_joint=at_joint,
        motor_bits=int(rng.integers(12, 21)),
        windup=float(log_uniform(rng, 1e-5, 3e-3)) if rng.random() < 0.6 else 0.0,
        elastic_gears=bool(group != "clean" and rng.random() < 0.2),
        current=bool(rng.random() < 0.3),
        noise=float(log_uniform(rng, 0.003, 0.03)),
        noise_corner=float(log_uniform(rng, 2.0, 20.0)) if rng.random() < 0.4 else 0.0,
        quantum=float(log_uniform(rng, 0.1, 2.0)) if rng.random() < 0.4 else 0.0,
        sign_law=str(rng.choice(SIGN_LAWS)),
        temperature=bool(rng.random() < 0.3),
    )


def _wishes(rng: np.random.Generator, group: str, n_encoders: int) -> tuple[Wish, ...]:
    count = {"clean": 0, "single": 1, "mixture": int(rng.integers(2, 5)), "outside": 1}[group]
    names = [k for k in _FIRST if n_encoders == 2 or k not in ("backlash", "joint_elasticity")]
    kinds = rng.choice(STRANGE if group == "outside" else names, count, replace=False)
    return tuple(Wish(str(kind), float(log_uniform(rng, 0.3, 5.0))) for kind in kinds)


def _with_later(rng: np.random.Generator, group: str, wishes: tuple[Wish, ...]) -> tuple[Wish, ...]:
    """Each kind that came later in the place of one of the others, as often as any of them is drawn."""
    if group == "outside":
        return wishes
    for kind in LATER:
        chosen = rng.random(len(wishes)) < 1 / len(NAMED)
        if chosen.any():
            at = int(np.argmax(chosen))
            wishes = (*wishes[:at], Wish(kind, wishes[at].ratio), *wishes[at + 1 :])
    return wishes
