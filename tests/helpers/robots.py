"""Robots as URDF text: random serial chains, and edits that give every engine the same masses."""

import xml.etree.ElementTree as ET
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

MOVING = ("revolute", "continuous", "prismatic")


@dataclass(frozen=True)
class Chain:
    """A random robot: its URDF, its moving joints in order and the gravity it stands in."""

    urdf: str
    kinds: tuple[str, ...]
    gravity: tuple[float, float, float]

    @property
    def n_joints(self) -> int:
        return len(self.kinds)


def random_chain(seed: int) -> Chain:
    """Serial chain of 2-12 moving joints, with fixed joints in between, at the base and as side branches.

    Placements, axes and inertial frames are odd; some are square, as on real arms. Seeded.
    """
    rng = np.random.default_rng(seed)
    n_joints = 2 + seed % 11
    kinds = tuple(rng.choice(MOVING, size=n_joints, p=(0.5, 0.2, 0.3)).tolist())
    robot = ET.Element("robot", name=f"chain_{seed}")
    link = add_link(robot, "base", rng)
    for j, kind in enumerate(kinds):
        for k in range(rng.integers(0, 2)):
            link = add_joint(robot, f"mount_{j}_{k}", "fixed", link, rng)
        if j > 0 and rng.random() < 0.3:
            branch = add_joint(robot, f"motor_{j}", "fixed", link, rng)
            add_joint(robot, f"cover_{j}", "fixed", branch, rng)
        link = add_joint(robot, f"joint_{j}", kind, link, rng)
    add_joint(robot, "tool", "fixed", link, rng)
    gravity = rng.normal(size=3)
    gravity *= 9.81 / np.linalg.norm(gravity)
    return Chain(ET.tostring(robot, encoding="unicode"), kinds, tuple(gravity.tolist()))


def chain(kinds, limits=True):
    """A URDF chain whose axes and offsets differ from joint to joint."""
    axes = ("0 0 1", "0 1 0", "1 0 0", "0 0.6 0.8")
    parts = ['<robot name="chain"><link name="l0"/>']
    for i, kind in enumerate(kinds, start=1):
        bounds = '<limit lower="-1" upper="1.5" velocity="1.5" effort="400"/>' if limits else ""
        parts.append(
            f'<link name="l{i}"><inertial><origin xyz="0.02 0.01 {0.05 + 0.01 * i}"/><mass value="{9 / i}"/>'
            '<inertia ixx="0.05" iyy="0.06" izz="0.04" ixy="0.002" ixz="0.001" iyz="0"/></inertial></link>'
            f'<joint name="j{i}" type="{kind}"><parent link="l{i - 1}"/><child link="l{i}"/>'
            f'<origin xyz="0.03 0 0.1" rpy="0.2 0 0.1"/><axis xyz="{axes[i % 4]}"/>{bounds}</joint>'
        )
    return "".join([*parts, "</robot>"])


def add_joint(robot: ET.Element, name: str, kind: str, parent: str, rng: np.random.Generator) -> str:
    """Append a joint and the link behind it; returns the link's name."""
    link = add_link(robot, f"{name}_link", rng)
    joint = ET.SubElement(robot, "joint", name=name, type=kind)
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=link)
    square = rng.random() < 0.3
    rpy = rng.integers(-1, 3, size=3) * (np.pi / 2) if square else rng.uniform(-np.pi, np.pi, size=3)
    ET.SubElement(joint, "origin", xyz=text(rng.uniform(-0.6, 0.6, size=3)), rpy=text(rpy))
    if kind != "fixed":
        axis = np.eye(3)[rng.integers(3)] * rng.choice((-1, 1)) if rng.random() < 0.4 else rng.normal(size=3)
        ET.SubElement(joint, "axis", xyz=text(axis / np.linalg.norm(axis)))
    if kind in ("revolute", "prismatic"):
        ET.SubElement(joint, "limit", lower="-3.0", upper="3.0", velocity="5.0", effort="500.0")
    return link


def add_link(robot: ET.Element, name: str, rng: np.random.Generator) -> str:
    """Append a link with a random inertial; returns its name."""
    add_inertial(ET.SubElement(robot, "link", name=name), rng)
    return name


def add_inertial(link: ET.Element, rng: np.random.Generator) -> None:
    """A homogeneous box of 0.2-20 kg, somewhere in the link, whose frame and axes are both turned."""
    mass = float(np.exp(rng.uniform(np.log(0.2), np.log(20.0))))
    square = rng.uniform(0.05, 0.5, size=3) ** 2
    axes = Rotation.from_rotvec(rng.normal(size=3)).as_matrix()
    inertia = axes @ np.diag(mass / 12 * (square.sum() - square)) @ axes.T
    inertial = ET.SubElement(link, "inertial")
    ET.SubElement(
        inertial,
        "origin",
        xyz=text(rng.uniform(-0.3, 0.3, size=3)),
        rpy=text(rng.uniform(-np.pi, np.pi, size=3)),
    )
    ET.SubElement(inertial, "mass", value=repr(mass))
    names = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    ET.SubElement(inertial, "inertia", {name: repr(float(inertia[at])) for name, at in names.items()})


def with_inertials(urdf: str, seed: int, *, replace: bool = False) -> str:
    """The same robot with random inertials on the links that have none; on all links if `replace`."""
    rng = np.random.default_rng(seed)
    robot = ET.fromstring(urdf)
    for link in robot.iter("link"):
        for inertial in link.findall("inertial") if replace else ():
            link.remove(inertial)
        if link.find("inertial") is None:
            add_inertial(link, rng)
    return ET.tostring(robot, encoding="unicode")


def with_moved_joint(urdf: str, joint: str, offset: np.ndarray, turn: np.ndarray) -> str:
    """The same robot with one joint's frame shifted in its parent and then turned by a rotation vector."""
    robot = ET.fromstring(urdf)
    element = next(each for each in robot.iter("joint") if each.get("name") == joint)
    origin = element.find("origin")
    if origin is None:
        origin = ET.SubElement(element, "origin")
    xyz, rpy = ([float(x) for x in origin.get(name, "0 0 0").split()] for name in ("xyz", "rpy"))
    rotation = Rotation.from_euler("xyz", rpy) * Rotation.from_rotvec(turn)
    origin.set("xyz", text(np.array(xyz) + offset))
    origin.set("rpy", text(rotation.as_euler("xyz")))
    return ET.tostring(robot, encoding="unicode")


def random_states(n_samples: int, n_joints: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """q, dq, ddq (n_samples, n_joints): any angle (or up to 3.1 m), speeds to 3, accelerations to 10."""
    rng = np.random.default_rng(seed)
    size = (n_samples, n_joints)
    return rng.uniform(-3.1, 3.1, size), rng.uniform(-3, 3, size), rng.uniform(-10, 10, size)


def text(numbers: np.ndarray) -> str:
    """Numbers to the last bit, in a URDF's notation."""
    return " ".join(repr(float(x)) for x in numbers)
