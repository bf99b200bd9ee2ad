"""Drake reads the URDF that we write: the torque of its bodies and rotors is the estimator's."""

import numpy as np
import pytest
from helpers.link_models import bare_model, model_of
from helpers.robots import random_chain
from numpy.testing import assert_allclose
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import MultibodyForces

from dynid_rs import RobotModel
from dynid_rs.model.export import urdf

SAME_TORQUE = 1e-9
N_STATES = 20


def torque_in_drake(text, robot, states):
    """Torque (n_samples, n_joints) of Drake's own inverse dynamics, in the order of our joints."""
    plant = MultibodyPlant(time_step=0.0)
    Parser(plant).AddModelsFromString(text, "urdf")
    base = plant.get_body(min(plant.GetBodyIndices(plant.GetModelInstanceByName(robot.name)), key=int))
    plant.WeldFrames(plant.world_frame(), base.body_frame())
    plant.mutable_gravity_field().set_gravity_vector(robot.gravity)
    plant.Finalize()
    context, torques = plant.CreateDefaultContext(), []
    at = [plant.GetJointByName(name).velocity_start() for name in robot.joint_names]
    for q, dq, ddq in zip(*states, strict=True):
        every = np.zeros((3, plant.num_velocities()))
        every[:, at] = q, dq, ddq
        plant.SetPositions(context, every[0])
        plant.SetVelocities(context, every[1])
        forces = MultibodyForces(plant)
        plant.CalcForceElementsContribution(context, forces)
        # Damping is a joint's own force in Drake; bodies and rotors alone are compared.
        dampers = [plant.GetJointByName(name).default_damping_vector()[0] for name in robot.joint_names]
        torques.append((plant.CalcInverseDynamics(context, every[2], forces)[at]) - np.asarray(dampers) * dq)
    return np.array(torques)


@pytest.mark.parametrize("seed", range(6))
def test_the_exported_urdf_has_the_estimators_torque(seed):
    chain = random_chain(seed)
    robot = RobotModel.from_urdf_string(chain.urdf, gravity=chain.gravity)
    model = model_of(robot, seed)
    physical = model.physical
    states = np.random.default_rng(seed).uniform(-2, 2, (3, N_STATES, robot.n_joints))
    expected = bare_model(robot, physical.phi).evaluate(*states)[0] + np.asarray(physical.rotor_inertia) * states[2]
    found = torque_in_drake(urdf(model).decode(), robot, states)
    assert_allclose(found, expected, rtol=0, atol=SAME_TORQUE * np.abs(expected).max())
