"""What a recording shows: encoders with steps, torque channels with noise and steps, stamps, thermometers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from exam.declared import Band, at_rows
from exam.draw import stream
from exam.world import AMBIENT, States, World, inverse_dynamics

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Sensors:
    """Steps of encoders (n_joints,) [rad], and noise and step of the torque channels (n_joints,) [N m]."""

    link_step: FloatArray
    motor_step: FloatArray
    noise: FloatArray
    quantum: FloatArray


def make_sensors(world: World) -> Sensors:
    """Draw what the sensors of a case are like; noise is a share of each joint's torque."""
    case, rng = world.case, stream(world.case.seed, 6)
    n = case.n_joints
    gear = rng.uniform(50.0, 160.0, n)
    motor = 2 * np.pi / 2**case.motor_bits / gear
    link = 2 * np.pi / 2**case.encoder_bits / (1.0 if case.at_joint else gear)
    noise = case.noise * rng.uniform(0.7, 1.3, n) * world.torque_std
    return Sensors(link * np.ones(n), motor * np.ones(n), noise, case.quantum * noise)


def torque_noise(world: World, sensors: Sensors, s: States) -> FloatArray:
    """Noise (n, n_joints) [N m] of the torque channels at the samples of a run, drawn by the run's number."""
    case, rng = world.case, stream(world.case.seed, 7, s.run)
    shape = s.q.shape
    white = rng.normal(size=shape)
    if case.noise_corner:
        keep = np.exp(-2 * np.pi * case.noise_corner / case.rate)
        slow = lfilter([np.sqrt(1 - keep**2)], [1.0, -keep], rng.normal(size=(shape[0] + 1000, shape[1])), axis=0)
        white = 0.9 * slow[1000:] + np.sqrt(1 - 0.9**2) * white
    return sensors.noise * white


def stepped(x: FloatArray, step: FloatArray) -> FloatArray:
    """Round to whole steps; a step of zero leaves as it is."""
    return np.where(step > 0, np.round(x / np.where(step > 0, step, 1.0)) * step, x)


def shown_positions(world: World, sensors: Sensors, s: States, error: FloatArray | float = 0.0):
    """Link and motor positions that a recording has; with one encoder the first is the motor's and there is no other.

    `error` (n, n_joints) [rad] is what an encoder that is not centred shows too much.
    """
    if world.case.n_encoders == 1:
        return stepped(s.q_motor + error, sensors.link_step), None
    return stepped(s.q + error, sensors.link_step), stepped(s.q_motor, sensors.motor_step)


def noise_rows(world: World, sensors: Sensors) -> FloatArray:
    """Noise in the band on the rows of the training runs (n_rows, n_joints) [N m]: channels, and encoders' steps.

    A model that is right in everything leaves this much: it is fed with positions that have steps.
    """
    band, rows = Band(world.case.rate), []
    for dense in world.train:
        s = dense.recorded
        channel = torque_noise(world, sensors, s)
        torque = world.motor_torque(s)
        channel = stepped(torque + channel, sensors.quantum) - torque
        link, motor = shown_positions(world, sensors, s)
        there = at_rows(world, dense)
        if motor is None:
            wrong_link = wrong_motor = _derivatives(band, s, link - s.q_motor)
        else:
            wrong_link, wrong_motor = _derivatives(band, s, link - s.q), _derivatives(band, s, motor - s.q_motor)
        n = min(len(there.t), len(wrong_link[0]), len(wrong_motor[0]))
        there = there.at(slice(n))
        link_error = _moved_torque(world, there, [x[:n] for x in wrong_link])
        _, speed, push = (x[:n] for x in wrong_motor)
        motor_error = world.rotor * push + world.friction(there.dq_motor + speed) - world.friction(there.dq_motor)
        rows.append(band.rows(channel)[: len(band.instants(len(s.t)))] - link_error - motor_error)
    return np.vstack(rows)


def _moved_torque(world: World, s: States, wrong) -> FloatArray:
    """Rigid torque at positions, speeds and accelerations that are wrong by this, less the right one."""
    shown = inverse_dynamics(world.model, s.q + wrong[0], s.dq + wrong[1], s.ddq + wrong[2])
    return shown - inverse_dynamics(world.model, s.q, s.dq, s.ddq)


def _derivatives(band: Band, s: States, x: FloatArray):
    """A small error of position in the band at the rows, its speed and its acceleration."""
    slow = band.coarse(x)
    step = band.step * float(np.mean(np.diff(s.t)))
    speed = np.gradient(slow, step, axis=0)
    push = np.gradient(speed, step, axis=0)
    return [y[:: band.rows_step] for y in (slow, speed, push)]


def deflection_noise(world: World, sensors: Sensors) -> FloatArray:
    """RMS (n_joints,) [rad] in the band of what steps of two encoders do to their difference."""
    band, rows = Band(world.case.rate), []
    for dense in world.train:
        s = dense.recorded
        link, motor = shown_positions(world, sensors, s)
        rows.append(band.rows((motor - s.q_motor) - (link - s.q)))
    return np.sqrt(np.mean(np.vstack(rows) ** 2, axis=0))


def table_of_run(world: World, sensors: Sensors, s: States, torque: FloatArray, error: FloatArray | float) -> dict:
    """Columns of one recording: stamps, positions, torque or current, temperature; some rows are missing."""
    case, rng = world.case, stream(world.case.seed, 8, s.run)
    n = case.n_joints
    shown = stepped(torque + torque_noise(world, sensors, s), sensors.quantum) * world.amperes
    link, motor = shown_positions(world, sensors, s, error)
    channels = {"q": link, "q_motor": motor, ("current" if case.current else "tau"): shown}
    if case.temperature:
        rise = stream(case.seed, 9).uniform(5.0, 15.0, n)
        channels["temperature"] = np.round(AMBIENT + rise * s.warm + rng.normal(0.0, 0.05, s.warm.shape), 1)
    kept = np.ones(len(s.t), dtype=bool)
    for _ in range(int(case.missing * len(s.t) / 2)):
        first = int(rng.integers(1, len(s.t) - 4))
        kept[first : first + int(rng.integers(1, 4))] = False
    columns = {"t": s.t[kept]}
    for name, values in channels.items():
        if values is not None:
            columns |= {f"{name}_{j}": values[kept, j] for j in range(n)}
    return columns
