"""An arm of random proportions: the true one as a Pinocchio model, and the file that its maker gave out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from exam.draw import Case, log_uniform, stream

FloatArray = NDArray[np.float64]

GRAVITY = 9.81
N_POINTS = 12
"""Points of mass of which a link is made: their inertia is one that a body can have."""
PLACEHOLDER = 1e-3
"""Mass [kg] and a thousand times the inertia [kg m^2] of a file that has no useful inertials."""


@dataclass(frozen=True)
class Joint:
    """A joint in its parent's frame: offset (3,) [m], roll-pitch-yaw (3,) [rad], axis (3,) in its own frame."""

    name: str
    offset: FloatArray
    turn: FloatArray
    axis: FloatArray


@dataclass(frozen=True)
class Arm:
    """Joints, and the inertia of the link behind each: as it is, and as the file has it (None: not at all)."""

    name: str
    joints: tuple[Joint, ...]
    true: tuple[pin.Inertia, ...]
    told: tuple[pin.Inertia | None, ...]
    reach: float

    @property
    def n_joints(self) -> int:
        """Number of joints."""
        return len(self.joints)

    def model(self, shift: dict[int, FloatArray] | None = None, gravity: FloatArray | None = None) -> pin.Model:
        """Return the true arm; `shift` moves joints off their place in the file [m], `gravity` (3,) is the base's."""
        return build_model(self.joints, self.true, shift, gravity)

    def urdf(self) -> str:
        """Return the file: the geometry is right unless a case shifts it, the inertials are the maker's."""
        parts = [f'<robot name="{self.name}">', '  <link name="base"/>']
        for k, (joint, told) in enumerate(zip(self.joints, self.told, strict=True)):
            parts += _joint_lines(joint, "base" if k == 0 else f"link_{k}", f"link_{k + 1}")
            parts += _link_lines(f"link_{k + 1}", told)
        return "\n".join([*parts, "</robot>", ""])


def build_model(joints, inertias, shift=None, gravity=None) -> pin.Model:
    """Return a serial chain of revolute joints with a body behind each."""
    model = pin.Model()
    parent = 0
    for k, (joint, inertia) in enumerate(zip(joints, inertias, strict=True)):
        offset = joint.offset + (0.0 if shift is None else shift.get(k, 0.0))
        placement = pin.SE3(pin.rpy.rpyToMatrix(*joint.turn), offset)
        parent = model.addJoint(parent, pin.JointModelRevoluteUnaligned(joint.axis), placement, joint.name)
        model.appendBodyToJoint(parent, inertia, pin.SE3.Identity())
    model.gravity.linear = np.array([0.0, 0.0, -GRAVITY]) if gravity is None else gravity
    return model


def draw_arm(case: Case) -> Arm:
    """Draw lengths, axes and inertials."""
    rng = stream(case.seed, 1)
    n = case.n_joints
    reach = 0.9 * (case.mass / 20.0) ** 0.3 * log_uniform(rng, 0.75, 1.35)
    shares = np.exp(-0.3 * np.arange(n)) * log_uniform(rng, 0.5, 1.6, n)
    lengths = reach * shares / shares.sum()
    masses = np.exp(-0.35 * np.arange(n)) * log_uniform(rng, 0.6, 1.6, n)
    masses *= case.mass / masses.sum()
    joints, true, told = [], [], []
    direction = np.array([0.0, 0.0, 1.0])
    before = np.zeros(3)
    offset = np.array([0.0, 0.0, 0.3 * lengths[0]])
    for k in range(n):
        turn = _turn(rng) if k else np.zeros(3)
        frame = pin.rpy.rpyToMatrix(*turn)
        axis = np.array([0.0, 0.0, 1.0]) if k == 0 and rng.random() < 0.85 else _axis(rng, frame.T @ before, k)
        joints.append(Joint(f"joint_{k + 1}", offset, turn, axis))
        direction = frame.T @ direction
        lateral = rng.normal(0.0, 0.2, 3)
        offset = lengths[k] * (direction + lateral)
        direction = direction if rng.random() < 0.7 else _perpendicular(rng, direction)
        cloud, weights = _cloud(rng, offset, masses[k])
        true.append(_inertia(cloud, weights, 0.15 * lengths[k]))
        told.append(_told(rng, case, cloud, weights, 0.15 * lengths[k]))
        before = axis
    return Arm(f"arm_{case.seed}", tuple(joints), tuple(true), tuple(told), float(reach))


def _turn(rng: np.random.Generator) -> FloatArray:
    """Frames are given straight, at right angles, or at any angle."""
    habit = rng.random()
    if habit < 0.4:
        return np.zeros(3)
    if habit < 0.85:
        turn = np.zeros(3)
        turn[rng.integers(3)] = rng.choice([-1.0, 1.0]) * np.pi / 2
        return turn
    return rng.uniform(-0.6, 0.6, 3)


def _axis(rng: np.random.Generator, before: FloatArray, k: int) -> FloatArray:
    """One of the frame's axes; two in a row are parallel now and then (upper arm and forearm)."""
    parallel = k in (2, 3) and rng.random() < 0.5
    candidates = np.vstack([np.eye(3), -np.eye(3)])
    lean = np.abs(candidates @ before)
    good = candidates[lean > 0.7] if parallel else candidates[lean < 0.75]
    return good[rng.integers(len(good))] if len(good) else candidates[rng.integers(6)]


def _perpendicular(rng: np.random.Generator, direction: FloatArray) -> FloatArray:
    other = np.cross(direction, rng.normal(size=3))
    return other / np.linalg.norm(other)


def _cloud(rng: np.random.Generator, along: FloatArray, mass: float) -> tuple[FloatArray, FloatArray]:
    """Points (n, 3) along a link and around it, and their masses (n,)."""
    length = np.linalg.norm(along)
    cloud = rng.beta(1.3, 1.8, N_POINTS)[:, None] * along + rng.normal(0.0, 0.12 * length, (N_POINTS, 3))
    return cloud, mass * rng.dirichlet(np.full(N_POINTS, 3.0))


def _inertia(cloud: FloatArray, weights: FloatArray, radius: float) -> pin.Inertia:
    """Points that are small balls."""
    mass = weights.sum()
    centre = weights @ cloud / mass
    arm = cloud - centre
    tensor = np.eye(3) * (weights @ np.sum(arm**2, axis=1)) - (weights[:, None] * arm).T @ arm
    return pin.Inertia(mass, centre, tensor + 0.4 * mass * radius**2 * np.eye(3))


def _told(rng: np.random.Generator, case: Case, cloud, weights, radius: float) -> pin.Inertia | None:
    """What the file says of a link: off by the case's share in mass, in place and in extent, up or down."""
    off = case.file_error * rng.choice([-1.0, 1.0], 7) * rng.uniform(0.7, 1.3, 7)
    if case.file_inertials == "missing":
        return None
    if case.file_inertials == "placeholder":
        return pin.Inertia(PLACEHOLDER, np.zeros(3), 1e-3 * PLACEHOLDER * np.eye(3))
    centre = weights @ cloud / weights.sum()
    moved = centre * (1 + off[1:4]) + (cloud - centre) * (1 + off[4:7])
    return _inertia(moved, weights * (1 + off[0]), radius)


def _numbers(values) -> str:
    return " ".join(repr(float(v)) for v in values)


def _joint_lines(joint: Joint, parent: str, child: str) -> list[str]:
    return [
        f'  <joint name="{joint.name}" type="revolute">',
        f'    <parent link="{parent}"/><child link="{child}"/>',
        f'    <origin xyz="{_numbers(joint.offset)}" rpy="{_numbers(joint.turn)}"/>',
        f'    <axis xyz="{_numbers(joint.axis)}"/>',
        '    <limit lower="-3.1" upper="3.1" velocity="4" effort="10000"/>',
        "  </joint>",
    ]


def _link_lines(name: str, told: pin.Inertia | None) -> list[str]:
    if told is None:
        return [f'  <link name="{name}"/>']
    tensor = told.inertia
    entries = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    inertia = " ".join(f'{entry}="{float(tensor[place])!r}"' for entry, place in entries.items())
    return [
        f'  <link name="{name}">',
        "    <inertial>",
        f'      <origin xyz="{_numbers(told.lever)}" rpy="0 0 0"/>',
        f'      <mass value="{float(told.mass)!r}"/>',
        f"      <inertia {inertia}/>",
        "    </inertial>",
        "  </link>",
    ]
