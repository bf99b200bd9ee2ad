"""An arm whose torque is its model's and noise that lasts, and what may change of it."""

from functools import cache

import numpy as np
from scipy.signal import lfilter

from dynid_rs import Recording, RobotModel, Watch, _core
from dynid_rs.simulation import bundled_robot
from helpers.run_files import write

STEP, NOISE = 0.002, 0.5
WORTH = 0.2
"""Time over which the noise forgets [s]."""


@cache
def model(torque_unit="N*m"):
    """The bundled arm with rotors and smooth friction."""
    robot = RobotModel.from_urdf(bundled_robot())
    n = robot.n_joints
    friction = _core.Effect.of("smooth_friction", transition_width=[0.01] * n, sharpness=[2.5] * n)
    sizes = np.zeros((n, friction.n_columns))
    sizes[:, 0], sizes[:, 2] = 8.0, 4.0
    return _core.TorqueModel(
        robot,
        robot.phi,
        [(_core.Effect.rotor_inertia(), np.full((n, 1), 0.5)), (friction, sizes)],
        encoder_delay=[0.0] * n,
        noise_std=[NOISE] * n,
        domain=([[-4.0, 4.0]] * n, [6.0] * n, [60.0] * n),
        torque_unit=torque_unit,
    )


def motion(seconds, seed=0):
    """q, dq, ddq of three waves per joint, (n, n_joints) each."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, seconds, STEP)
    n = model().robot.n_joints
    signals = np.zeros((3, len(t), n))
    for _ in range(3):
        size, rate, phase = rng.uniform(0.2, 0.6, n), rng.uniform(0.5, 2.5, n), rng.uniform(0, 6, n)
        angle = rate * t[:, None] + phase
        signals += [size * np.sin(angle), size * rate * np.cos(angle), -size * rate**2 * np.sin(angle)]
    return t, signals


def recorded(seconds, seed=0, *, unit="N*m", change=None, at=0.0):
    """A run of the model with coloured noise; from `at` on with the torque that `change(terms, load)` adds."""
    t, (q, dq, ddq) = motion(seconds, seed)
    total, terms, _ = model(unit).evaluate(q, dq, ddq)
    rng = np.random.default_rng(seed + 1000)
    keep = np.exp(-STEP / WORTH)
    noise = rng.normal(size=total.shape) * NOISE * np.sqrt(1 - keep**2)
    tau = total + lfilter([1.0], [1.0, -keep], noise, axis=0)
    if change is not None:
        load = model().robot.joint_torque_regressor(q, dq, ddq)[:, :, -10:-6]
        tau[t >= at] += change(terms, load)[t >= at]
    return Recording(t, q, dq, ddq=ddq, tau=tau, joints=model().robot.joint_names, torque_unit=unit)


def write_runs(folder, runs):
    """One Parquet file per name."""
    for name, run in runs.items():
        columns = {"t": run.t}
        for j in range(run.n_joints):
            signals = {"q": run.q, "dq": run.dq, "ddq": run.ddq, "tau": run.tau}
            columns |= {f"{signal}_{j}": values[:, j] for signal, values in signals.items()}
        write(folder / f"{name}.parquet", columns)


@cache
def watching():
    return Watch(model()).fit([recorded(60.0, seed) for seed in (1, 2)])


def on_joint(j, torque):
    only = np.zeros(model().robot.n_joints)
    only[j] = 1.0
    return lambda terms, load: torque(terms) * only


def later(torque, n=7):
    """What a channel shows more that is n samples late."""
    return np.vstack([torque[:n], torque[:-n]]) - torque


LOAD = np.array([2.0, 0.1, -0.05, 0.24])
CHANGES = {
    "friction grown": (on_joint(1, lambda terms: 0.2 * terms[:, 2]), "friction", 1, 0.2),
    "friction fallen": (on_joint(4, lambda terms: -0.25 * terms[:, 2]), "friction", 4, -0.25),
    "gain": (on_joint(1, lambda terms: 0.12 * terms.sum(axis=1)), "gain", 1, 0.12),
    "offset": (on_joint(2, lambda terms: np.full(terms[:, 0].shape, 3.0)), "offset", 2, 3.0),
    "delay": (on_joint(1, lambda terms: later(terms.sum(axis=1))), "delay", 1, 7 * STEP),
    "load": (lambda terms, load: load @ LOAD, "load", 5, LOAD[0]),
    "load lost": (lambda terms, load: -load @ LOAD, "load", 5, -LOAD[0]),
}
