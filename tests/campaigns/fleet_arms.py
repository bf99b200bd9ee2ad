"""Simulated arms of three types: every arm a draw of its own, some of them odd in one known way."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from exam.draw import stream
from helpers.run_files import write
from numpy.typing import NDArray

from dynid_rs import RobotModel
from dynid_rs.simulation import SimulatedArm, simulate, typical_arm
from dynid_rs.simulation.folder import run_columns

FloatArray = NDArray[np.float64]

URDF = """<robot name="{name}">
  <link name="base"/>
  <link name="upper"><inertial><origin xyz="0.02 0 0.05"/><mass value="{upper}"/>
    <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.08"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/>
    <origin xyz="0 0 0.3"/><axis xyz="0 0 1"/><limit lower="-3" upper="3" velocity="3" effort="{effort}"/></joint>
  <link name="fore"><inertial><origin xyz="{half} 0 0.02"/><mass value="{fore}"/>
    <inertia ixx="0.02" ixy="0" ixz="0.003" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="fore"/>
    <origin xyz="0 0 0.1"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" velocity="3" effort="{effort}"/></joint>
  <link name="hand"><inertial><origin xyz="0.1 0.01 0"/><mass value="{hand}"/>
    <inertia ixx="0.005" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>
  <joint name="wrist" type="revolute"><parent link="fore"/><child link="hand"/>
    <origin xyz="{length} 0 0"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" velocity="4" effort="25"/></joint>
</robot>
"""
TYPES = {
    "short_arm": {"upper": 8, "fore": 5, "hand": 2, "half": 0.2, "length": 0.4, "effort": 80},
    "long_arm": {"upper": 11, "fore": 7, "hand": 2, "half": 0.3, "length": 0.6, "effort": 120},
    "light_arm": {"upper": 5, "fore": 3, "hand": 1, "half": 0.15, "length": 0.3, "effort": 50},
}
FRICTION, OFFSET, MASS, ROTOR = 0.10, 0.01, 0.02, 0.02
"""Deviation from arm to arm: of a joint's friction as a whole, of its constant torque over the effort limit, of a
link's mass, of a rotor's inertia. Half of the friction's again goes to every coefficient by itself."""
N_TRAIN, N_TEST, N_UNSEEN = 2, 1, 1
"""Runs of an arm: to learn from, to test on, and one that only the campaign sees."""
RATE, SECONDS = 100.0, 8.0

BANDS = {"friction": (0.2, 1.5), "gain": (0.04, 0.3), "offset": (0.02, 0.15), "load": (0.05, 1.0)}
"""Least and greatest size of what is odd, drawn evenly in its logarithm: relative, relative, over the effort limit,
kg."""


@dataclass(frozen=True)
class Odd:
    """What is wrong with an arm: kind, joint or link, how much (relative, relative, N m, kg), and where in `BANDS`."""

    kind: str
    place: str
    size: float
    drawn: float


@dataclass(frozen=True, eq=False)
class DrawnArm:
    """An arm: its type, its truth, the gains of its torque channels (n_joints,), and what is odd about it."""

    name: str
    type: str
    arm: SimulatedArm
    gain: FloatArray
    odd: Odd | None


def robot_of(kind: str) -> RobotModel:
    """Robot of a type."""
    return RobotModel.from_urdf_string(URDF.format(name=kind, **TYPES[kind]))


def draw_arm(seed: int, number: int, kind: str, odd_share: float, planted: Odd | None = None) -> DrawnArm:
    """Draw arm `number` of a type from a seed; what is `planted` is odd about it, whatever is drawn."""
    rng = stream(seed, 60, number)
    robot = robot_of(kind)
    typical = typical_arm(robot).rigid()
    n = robot.n_joints
    common = 1 + FRICTION * rng.standard_normal((n, 1))
    friction = typical.friction * common * (1 + 0.5 * FRICTION * rng.standard_normal(typical.friction.shape))
    phi = np.asarray(robot.phi).reshape(-1, 10) * (1 + MASS * rng.standard_normal((n, 1)))
    rotor = typical.rotor_inertia * (1 + ROTOR * rng.standard_normal(n))
    effort = np.array([TYPES[kind]["effort"], TYPES[kind]["effort"], 25.0])
    offset = OFFSET * effort * rng.standard_normal(n)
    gain = np.ones(n)
    odd = planted or (_draw_odd(rng, robot, effort) if rng.uniform() < odd_share else None)
    if odd is not None:
        j = list(robot.joint_names).index(odd.place) if odd.kind != "load" else n - 1
        if odd.kind == "friction":
            friction[j] *= 1 + odd.size
        elif odd.kind == "gain":
            gain[j] = 1 + odd.size
        elif odd.kind == "offset":
            offset[j] += odd.size
        else:
            phi[-1] += point_mass(odd.size, np.array([0.12, 0.02, 0.01]))
    arm = replace(typical, phi=phi.ravel(), friction=friction, torque_offset=offset, rotor_inertia=rotor)
    return DrawnArm(f"arm_{number:04d}", kind, arm, gain, odd)


def _draw_odd(rng: np.random.Generator, robot: RobotModel, effort: FloatArray) -> Odd:
    """Kinds in equal parts, sizes from what nobody could see to what nobody could miss."""
    kind = str(rng.choice(list(BANDS)))
    j = int(rng.integers(robot.n_joints))
    sign = 1 if rng.uniform() < 0.5 else -1
    least, most = BANDS[kind]
    drawn = float(least * (most / least) ** rng.uniform())
    if kind == "load":
        return Odd(kind, robot.link_names[-1], drawn, drawn)
    size = {"friction": drawn, "gain": sign * drawn, "offset": sign * drawn * effort[j]}[kind]
    return Odd(kind, robot.joint_names[j], float(size), drawn)


def point_mass(m: float, at: FloatArray) -> FloatArray:
    """Ten parameters of a point mass: m, m r, and its inertia about the link's origin."""
    inertia = m * (at @ at * np.eye(3) - np.outer(at, at))
    upper = inertia[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]
    return np.concatenate([[m], m * at, upper])


def write_arm(folder: Path, drawn: DrawnArm, seed: int, *, n_runs: int = N_TRAIN + N_TEST + N_UNSEEN) -> list[Path]:
    """Write runs of an arm that are not there yet; every arm has motions of its own."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / f"run_{k}.parquet" for k in range(n_runs)]
    if all(path.is_file() for path in paths):
        return paths
    simulation = simulate(drawn.arm, n_runs=n_runs, duration=SECONDS, rate=RATE, seed=seed)
    for path, recording in zip(paths, simulation.recordings, strict=True):
        columns = {
            name: values
            for name, values in run_columns(recording).items()
            if not name.startswith(("dq_", "ddq_", "q_motor", "dq_motor"))
        }
        for j, gain in enumerate(drawn.gain):
            columns[f"tau_{j}"] = gain * columns[f"tau_{j}"]
        write(path, columns)
    return paths


def write_fleet(
    folder: Path,
    seed: int,
    numbers: Sequence[int],
    odd_share: float,
    *,
    kinds: Sequence[str] = tuple(TYPES),
    planted: Mapping[int, Odd] | None = None,
) -> tuple[Path, list[DrawnArm]]:
    """Write robots, runs and fleet.toml; types take turns, `planted` says by number what is odd about an arm."""
    given = planted or {}
    arms = [draw_arm(seed, number, kinds[number % len(kinds)], odd_share, given.get(number)) for number in numbers]
    for kind in {arm.type for arm in arms}:
        (folder / f"{kind}.urdf").write_text(URDF.format(name=kind, **TYPES[kind]), encoding="utf-8")
    lines = ["[defaults]", 'residual = "none"']
    for number, arm in zip(numbers, arms, strict=True):
        write_arm(folder / arm.name, arm, 1_000_000 * seed + number)
        runs = ", ".join(f'"{arm.name}/run_{k}.parquet"' for k in range(N_TRAIN))
        lines += [
            "",
            "[[robot]]",
            f'name = "{arm.name}"',
            f'robot = "{arm.type}.urdf"',
            f"runs = [{runs}]",
            f'test = "{arm.name}/run_{N_TRAIN}.parquet"',
        ]
    path = folder / "fleet.toml"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path, arms
