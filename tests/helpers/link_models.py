"""Models of links alone, and with random bodies that can exist."""

import numpy as np

import dynid_rs as dyn


def bare_model(robot, phi):
    """A model of links alone, without a physical set."""
    n = robot.n_joints
    return dyn.TorqueModel(
        robot,
        phi,
        [],
        encoder_delay=[0.0] * n,
        noise_std=[0.0] * n,
        domain=([[-1.0, 1.0]] * n, [1.0] * n, [1.0] * n),
    )


def model_of(robot, seed=0):
    """A model of `robot` with random bodies as its physical set."""
    rng = np.random.default_rng(seed)
    n = robot.n_joints
    roots = 0.3 * rng.standard_normal((n, 4, 4))
    phi = dyn._core.phi_from_pseudo_inertia(roots @ roots.transpose(0, 2, 1) + 1e-3 * np.eye(4))
    damping, friction, rotor = rng.uniform(0.1, 2.0, (3, n))
    return bare_model(robot, phi).with_physical(
        dyn.PhysicalSet(phi, rotor, damping=damping, friction=friction, drive_gain=np.ones(n))
    )
