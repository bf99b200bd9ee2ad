"""Every URDF of `example-robot-data`, torque beside Pinocchio: ``python tests/robot_files.py`` prints a table."""

import sys
import warnings
from importlib.metadata import distribution
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio

from dynid_rs import RobotModel, UrdfError

FOLDER = "cmeel.prefix/share/example-robot-data/robots"
N_STATES = 20


def robot_files():
    """Paths of all URDFs, by their name below the package's folder."""
    root = Path(str(distribution("example-robot-data").locate_file(FOLDER)))
    return {str(path.relative_to(root)): path for path in sorted(root.rglob("*.urdf"))}


def held_positions(path):
    """Where joints stand that are no part of a chain, read once more: zero, or as near as limits allow."""
    positions, followers = {}, {}
    for joint in ElementTree.parse(path).getroot().findall("joint"):
        limit, mimic = joint.find("limit"), joint.find("mimic")
        positions[joint.get("name")] = 0.0
        if joint.get("type") in ("revolute", "prismatic") and limit is not None:
            lower, upper = (float(limit.get(name, 0.0)) for name in ("lower", "upper"))
            positions[joint.get("name")] = min(max(0.0, lower), upper)
        if mimic is not None and joint.get("type") != "fixed":
            followers[joint.get("name")] = mimic
    for name, mimic in followers.items():
        if mimic.get("joint") not in positions:  # no such joint: it follows none
            continue
        factor, offset = float(mimic.get("multiplier", 1.0)), float(mimic.get("offset", 0.0))
        positions[name] = factor * positions[mimic.get("joint")] + offset
    return positions


def pinocchio_torque(path, robot, q, dq, ddq):
    """Torque (n_samples, n_joints) of the chain by Pinocchio's whole robot, all other joints standing still."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = pinocchio.buildModelFromUrdf(str(path))
    model.gravity.linear = robot.gravity
    model.armature = np.zeros(model.nv)
    data, stand = model.createData(), pinocchio.neutral(model)
    joints = dict(zip(list(model.names)[1:], list(model.joints)[1:], strict=True))
    for name, position in held_positions(path).items():
        if name in joints and name not in robot.joint_names:
            _put(stand, joints[name], position)
    chain = [joints[name] for name in robot.joint_names]
    torque = np.empty_like(q)
    for k in range(len(q)):
        everywhere, speed, acceleration = stand.copy(), np.zeros(model.nv), np.zeros(model.nv)
        for j, joint in enumerate(chain):
            _put(everywhere, joint, q[k, j])
            speed[joint.idx_v], acceleration[joint.idx_v] = dq[k, j], ddq[k, j]
        tau = pinocchio.rnea(model, data, everywhere, speed, acceleration)
        torque[k] = [tau[joint.idx_v] for joint in chain]
    return torque


def difference(path, robot):
    """Largest difference from Pinocchio's torque over the largest torque, at random states."""
    q, dq, ddq = np.random.default_rng(0).uniform(-2.0, 2.0, (3, N_STATES, robot.n_joints))
    ours, theirs = robot.inverse_dynamics(q, dq, ddq), pinocchio_torque(path, robot, q, dq, ddq)
    return float(np.abs(ours - theirs).max() / max(np.abs(theirs).max(), 1e-300))


def _put(configuration, joint, position):
    """A joint without limits is a point on the unit circle in Pinocchio; a floating one stays where it is."""
    if (joint.nq, joint.nv) == (2, 1):
        position = [np.cos(position), np.sin(position)]
    if joint.nv == 1:
        configuration[joint.idx_q : joint.idx_q + joint.nq] = position


def main():
    loaded, files = 0, robot_files()
    for name, path in files.items():
        try:
            robot = RobotModel.from_urdf(path)
        except UrdfError as error:
            print(f"refused  {name}: {str(error).replace(str(path), '')}")
            continue
        loaded += 1
        print(f"{difference(path, robot):7.0e}  {name}: {robot.n_joints} joints, {robot.choice or 'one way only'}")
    print(f"{loaded} of {len(files)} load; the number is the largest difference from Pinocchio over the largest torque")


if __name__ == "__main__":
    sys.exit(main())
