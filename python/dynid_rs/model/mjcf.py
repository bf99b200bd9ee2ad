"""A MuJoCo model as a URDF, so that one loader reads both: MuJoCo itself reads the file."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.errors import MissingLibraryError
from dynid_rs.base.quoting import NO_UTF_8, as_text

FloatArray = NDArray[np.float64]

DRAKE = "http://drake.mit.edu"


def urdf_of(path: Path) -> tuple[str, FloatArray]:
    """Return the URDF text of a MuJoCo model, and its gravity (3,) [m/s^2] in the world's frame.

    Bodies become links; a body of several joints becomes one link per joint. Joint angles are MuJoCo's, less their
    reference: zero is where `qpos0` is. ``armature`` becomes the rotor inertia; ``damping`` and ``frictionloss`` become
    ``<dynamics>``; one joint that an equality constraint ties to another in proportion becomes a follower.

    Parameters
    ----------
    path : Path
        The model.

    Raises
    ------
    MissingLibraryError
        MuJoCo is not installed.
    ValueError
        MuJoCo refuses the model, or a joint is a ball; names the file.
    """
    try:
        import mujoco
    except ImportError:
        raise MissingLibraryError("mujoco", extra="mujoco", purpose="robots out of MuJoCo models") from None
    try:
        if as_text(str(path)) != str(path):
            raise ValueError(NO_UTF_8)
        model = mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        raise ValueError(f"{path}: MuJoCo cannot read it: {' '.join(str(error).split())}") from None
    return _Writer(mujoco, model, path).urdf(), np.array(model.opt.gravity, dtype=np.float64)


class _Writer:
    """One model on its way to URDF."""

    def __init__(self, mujoco: Any, model: Any, path: Path) -> None:
        self.mujoco, self.model, self.path = mujoco, model, path
        self.kinds = mujoco.mjtJoint
        self.robot = ElementTree.Element("robot", {"name": _text(model.names, 0) or path.stem, "xmlns:drake": DRAKE})
        self.followers = self._followers()
        self.offset = [np.zeros(3)] * model.nbody
        """From a link's frame to its body's: MuJoCo's joints may stand beside the body's origin."""

    def urdf(self) -> str:
        ElementTree.SubElement(self.robot, "link", name=self._body(0))
        for body in range(1, self.model.nbody):
            self._add(body)
        for joint in range(self.model.njnt):
            self._add_rotor(joint)
        return ElementTree.tostring(self.robot, encoding="unicode")

    def _add(self, body: int) -> None:
        model = self.model
        parent = int(model.body_parentid[body])
        above, place = self._body(parent), model.body_pos[body] - self.offset[parent]
        rotation = _matrix(model.body_quat[body])
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        anchor = np.zeros(3)
        for k, joint in enumerate(range(first, first + count)):
            # In the body's axes: from the last link's origin to this joint's.
            step = model.jnt_pos[joint] - anchor
            place, anchor = place + rotation @ step, model.jnt_pos[joint].copy()
            last = k == count - 1
            name = self._body(body) if last else f"{self._body(body)}/{self._joint(joint)}"
            self._add_link(name, body if last else None, anchor)
            self._add_joint(joint, above, name, place, rotation)
            above, place, rotation = name, np.zeros(3), np.eye(3)
        self.offset[body] = anchor
        if not count:
            self._add_link(self._body(body), body, anchor)
            joined = ElementTree.SubElement(self.robot, "joint", name=f"{self._body(body)}_fixed", type="fixed")
            _place(joined, above, self._body(body), place, rotation)

    def _add_link(self, name: str, body: int | None, anchor: FloatArray) -> None:
        link = ElementTree.SubElement(self.robot, "link", name=name)
        if body is None or self.model.body_mass[body] == 0:
            return
        model = self.model
        inertial = ElementTree.SubElement(link, "inertial")
        turned = _matrix(model.body_iquat[body])
        # Along the link's axes: angles would cost digits.
        inertia = turned @ np.diag(model.body_inertia[body]) @ turned.T
        ElementTree.SubElement(inertial, "origin", xyz=_numbers(model.body_ipos[body] - anchor))
        ElementTree.SubElement(inertial, "mass", value=_numbers([model.body_mass[body]]))
        entries = zip(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), inertia[np.triu_indices(3)], strict=True)
        ElementTree.SubElement(inertial, "inertia", {key: _numbers([value]) for key, value in entries})

    def _add_joint(self, joint: int, above: str, link: str, place: FloatArray, rotation: FloatArray) -> None:
        model, name = self.model, self._joint(joint)
        kind = self._kind(joint)
        if kind == self.kinds.mjJNT_BALL:
            raise ValueError(
                f"{self.path}: the joint {name} is a ball, which no serial chain of single axes has; write three hinges"
            )
        bounded, floats = bool(model.jnt_limited[joint]), kind == self.kinds.mjJNT_FREE
        words = {self.kinds.mjJNT_FREE: "floating", self.kinds.mjJNT_SLIDE: "prismatic"}
        word = words.get(kind, "revolute" if bounded else "continuous")
        element = ElementTree.SubElement(self.robot, "joint", name=name, type=word)
        _place(element, above, link, place, rotation)
        if floats:
            return
        dof, zero = int(model.jnt_dofadr[joint]), float(model.qpos0[model.jnt_qposadr[joint]])
        ElementTree.SubElement(element, "axis", xyz=_numbers(model.jnt_axis[joint]))
        limits = {}
        if bounded:
            limits = dict(zip(("lower", "upper"), map(_number, model.jnt_range[joint] - zero), strict=True))
        if model.jnt_actfrclimited[joint]:
            limits["effort"] = _number(np.abs(model.jnt_actfrcrange[joint]).max())
        if limits:
            ElementTree.SubElement(element, "limit", limits)
        friction = {"damping": np.ravel(model.dof_damping[dof])[0], "friction": model.dof_frictionloss[dof]}
        ElementTree.SubElement(element, "dynamics", {key: _number(value) for key, value in friction.items()})
        if joint in self.followers:
            master, multiplier, offset = self.followers[joint]
            ElementTree.SubElement(
                element, "mimic", joint=self._joint(master), multiplier=_number(multiplier), offset=_number(offset)
            )

    def _add_rotor(self, joint: int) -> None:
        if self._kind(joint) not in (self.kinds.mjJNT_HINGE, self.kinds.mjJNT_SLIDE):
            return
        armature, name = float(self.model.dof_armature[self.model.jnt_dofadr[joint]]), self._joint(joint)
        if armature == 0:
            return
        transmission = ElementTree.SubElement(self.robot, "transmission", name=f"{name}_transmission")
        ElementTree.SubElement(transmission, "joint", name=name)
        actuator = ElementTree.SubElement(transmission, "actuator", name=f"{name}_motor")
        ElementTree.SubElement(actuator, "drake:rotor_inertia", value=_number(armature))

    def _followers(self) -> dict[int, tuple[int, float, float]]:
        """Per tied joint the one that it follows, factor and offset [rad, m]: ``polycoef`` of two terms."""
        model, found = self.model, {}
        for k in range(model.neq):
            one, two = int(model.eq_obj1id[k]), int(model.eq_obj2id[k])
            kind = self.mujoco.mjtEq(int(model.eq_type[k]))
            tied = kind == self.mujoco.mjtEq.mjEQ_JOINT and two >= 0 and model.eq_active0[k]
            if tied and not np.any(model.eq_data[k, 2:5]):
                # Both sides are counted from their reference, as the URDF's angles are.
                found[one] = (two, float(model.eq_data[k, 1]), float(model.eq_data[k, 0]))
        return found

    def _kind(self, joint: int) -> Any:
        return self.kinds(int(self.model.jnt_type[joint]))

    def _body(self, body: int) -> str:
        return self.model.body(body).name or f"body_{body}"

    def _joint(self, joint: int) -> str:
        return self.model.joint(joint).name or f"joint_{joint}"


def _place(joint: ElementTree.Element, above: str, link: str, place: FloatArray, rotation: FloatArray) -> None:
    ElementTree.SubElement(joint, "parent", link=above)
    ElementTree.SubElement(joint, "child", link=link)
    ElementTree.SubElement(joint, "origin", xyz=_numbers(place), rpy=_numbers(_roll_pitch_yaw(rotation)))


def _roll_pitch_yaw(rotation: FloatArray) -> FloatArray:
    """Fixed-axis angles [rad] of a rotation (3, 3), exact beside a pitch of 90 degrees too."""
    yaw = np.arctan2(rotation[1, 0], rotation[0, 0])
    pitch = np.arctan2(-rotation[2, 0], np.hypot(rotation[0, 0], rotation[1, 0]))
    sine, cosine = np.sin(yaw), np.cos(yaw)
    roll = np.arctan2(sine * rotation[0, 2] - cosine * rotation[1, 2], cosine * rotation[1, 1] - sine * rotation[0, 1])
    return np.array([roll, pitch, yaw])


def _matrix(quaternion: FloatArray) -> FloatArray:
    """Rotation (3, 3) of a unit quaternion, its real part first."""
    from scipy.spatial.transform import Rotation

    matrix: FloatArray = Rotation.from_quat(np.roll(quaternion, -1)).as_matrix()
    return matrix


def _number(value: Any) -> str:
    return repr(float(value))


def _numbers(values: Any) -> str:
    return " ".join(_number(value) for value in np.ravel(values))


def _text(names: bytes, start: int) -> str:
    """The zero-terminated text at a place of MuJoCo's names; the first is the model's."""
    return names[start : names.index(b"\0", start)].decode(errors="replace")
