"""Pinocchio and MuJoCo behind the signature of `RobotModel`: URDF text and samples in, samples out."""

import xml.etree.ElementTree as ET

import mujoco
import numpy as np
import pinocchio as pin


class Pinocchio:
    """Inverse dynamics and regressor by Pinocchio."""

    def __init__(self, urdf, gravity):
        self.model = pin.buildModelFromXML(urdf)
        self.model.gravity.linear = np.asarray(gravity, dtype=float)
        self.data = self.model.createData()

    @property
    def phi(self):
        """Ten parameters per link, in order."""
        return np.concatenate([inertia.toDynamicParameters() for inertia in list(self.model.inertias)[1:]])

    def configurations(self, q):
        """Pinocchio's q: a continuous joint is stored as (cos, sin)."""
        columns = []
        for j, joint in enumerate(list(self.model.joints)[1:]):
            columns += [np.cos(q[:, j]), np.sin(q[:, j])] if joint.nq == 2 else [q[:, j]]
        return np.stack(columns, axis=1)

    def inverse_dynamics(self, q, dq, ddq):
        """(n_samples, n_joints)."""
        states = zip(self.configurations(q), dq, ddq, strict=True)
        return np.array([pin.rnea(self.model, self.data, *state) for state in states])

    def joint_torque_regressor(self, q, dq, ddq):
        """(n_samples, n_joints, 10 n_links)."""
        states = zip(self.configurations(q), dq, ddq, strict=True)
        return np.array([pin.computeJointTorqueRegressor(self.model, self.data, *state) for state in states])


class MuJoCo:
    """Inverse dynamics by MuJoCo, everything but the rigid bodies switched off."""

    def __init__(self, urdf, gravity):
        robot = ET.fromstring(urdf)
        for joint in robot.iter("joint"):
            for origin in joint.findall("origin")[1:]:  # the first counts, as in ROS; MuJoCo refuses two
                joint.remove(origin)
        extension = ET.SubElement(robot, "mujoco")
        ET.SubElement(extension, "compiler", fusestatic="true", discardvisual="true", balanceinertia="false")
        model = mujoco.MjModel.from_xml_string(ET.tostring(robot, encoding="unicode"))
        model.opt.gravity[:] = gravity
        flags = mujoco.mjtDisableBit
        model.opt.disableflags |= flags.mjDSBL_CONSTRAINT | flags.mjDSBL_CONTACT | flags.mjDSBL_LIMIT
        for other in (model.dof_armature, model.dof_damping, model.dof_frictionloss, model.jnt_stiffness):
            assert not other.any()
        self.model, self.data = model, mujoco.MjData(model)

    def inverse_dynamics(self, q, dq, ddq):
        """(n_samples, n_joints)."""
        data, tau = self.data, np.empty_like(q)
        for k in range(len(q)):
            data.qpos[:], data.qvel[:], data.qacc[:] = q[k], dq[k], ddq[k]
            mujoco.mj_inverse(self.model, data)
            tau[k] = data.qfrc_inverse
        return tau


def accepted_by_pinocchio(urdf, n_joints):
    """Bodies of a URDF (bytes) that Pinocchio finds physical: mass, inertia about the centre, pseudo-inertia."""
    model = pin.buildModelFromXML(urdf.decode())
    assert model.nv == n_joints
    good = 0
    for inertia in list(model.inertias)[1:]:
        moments = np.linalg.eigvalsh(inertia.inertia)
        pseudo = pin.PseudoInertia.FromInertia(inertia).toMatrix()
        triangle = moments[0] + moments[1] > moments[2]
        good += inertia.mass > 0 and moments[0] > 0 and triangle and np.linalg.eigvalsh(pseudo)[0] > 0
    return good


def accepted_by_mujoco(urdf):
    """Moving bodies of a URDF (bytes) after MuJoCo's compiler, which refuses what is not physical, has taken them."""
    robot = ET.fromstring(urdf)
    extension = ET.SubElement(robot, "mujoco")
    ET.SubElement(extension, "compiler", fusestatic="true", discardvisual="true", balanceinertia="false")
    model = mujoco.MjModel.from_xml_string(ET.tostring(robot, encoding="unicode"))
    moving = model.body_mass[1:]
    assert np.all(moving > 0)
    return len(moving)
