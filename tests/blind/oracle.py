"""Error of a model that was told the truth: what remains if nothing has to be found, only fitted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from cases import N_TRAIN
from maker import Built
from numpy.typing import NDArray

from dynid_rs.assembly import evaluate
from dynid_rs.identification import ThreeLoopIdentifier
from dynid_rs.placed import PlacedEffect
from dynid_rs.recording import Recording
from dynid_rs.results import score
from dynid_rs.simulation.effects.columns import ColumnEffect
from dynid_rs.simulation.effects.sensors import EncoderEccentricity, TorqueDelay, TorqueGain
from dynid_rs.simulation.effects.structure import GravityTilt, KinematicError
from dynid_rs.simulation.effects.thermal import ThermalDrift

FloatArray = NDArray[np.float64]

FIXED_POINTS = 50
WARM_ROUNDS, WARM_AGREED = 40, 0.05
"""Most fits until what warmth takes and the friction that it is taken from agree, and the change at which they do, over
the torque's noise."""
_STRUCTURE = (GravityTilt, KinematicError)


def oracle_error(built: Built) -> FloatArray:
    """Error on the test runs (n_joints,) [N m], in the band, of a model that knows what is there.

    Columns of the catalogue are fitted with their true shapes; the robot is the true one; channels are corrected
    by their true faults; of warmth the course and the share of friction that it takes are known, friction itself is
    fitted; torque of anything else is taken off. What is free in the declared model stays free.
    """
    shown = [_told(built, run) for run in range(len(built.simulation.recordings))]
    model = _fitted(built, shown)
    if any(isinstance(placed.effect, ThermalDrift) for placed in built.placed):
        model, shown = _warm(built, shown, model)
    error = score(model.model_, [model.states(recording) for recording in shown[N_TRAIN:]]).rmse
    return np.asarray(error * _gain(built))


def _fitted(built: Built, shown: list[Recording]) -> ThreeLoopIdentifier:
    model = ThreeLoopIdentifier(built.simulation.arm.robot, residual=None, effects=_columns(built))
    return model.fit(shown[:N_TRAIN])


def _warm(
    built: Built, shown: list[Recording], model: ThreeLoopIdentifier
) -> tuple[ThreeLoopIdentifier, list[Recording]]:
    """A model of friction that the true warmth lessens, and the runs without what it takes; both by turns."""
    shares = [_warm_share(built, run, recording) for run, recording in enumerate(shown)]
    taken = [np.zeros_like(recording.tau) for recording in shown]
    near = WARM_AGREED * built.simulation.arm.noise_std
    for _ in range(WARM_ROUNDS):
        before, taken = (
            taken,
            [share * _friction(model, recording) for share, recording in zip(shares, shown, strict=True)],
        )
        without = [replace(r, tau=r.tau - torque) for r, torque in zip(shown, taken, strict=True)]
        model = _fitted(built, without)
        if all(np.all(np.abs(now - then) < near) for now, then in zip(taken, before, strict=True)):
            return model, without
    raise RuntimeError(f"{built.case.label}: what warmth takes and the friction that it is taken from do not agree")


def _warm_share(built: Built, run: int, recording: Recording) -> FloatArray:
    """Part of friction that warmth adds along a run, (n, n_joints)."""
    drifts = [effect for effect in built.simulation.arms[run].effects if isinstance(effect, ThermalDrift)]
    return np.asarray(sum(drift.change * drift.warmth(recording.t)[:, None] for drift in drifts))


def _friction(model: ThreeLoopIdentifier, recording: Recording) -> FloatArray:
    """Torque of the declared friction at the samples of a run, (n, n_joints)."""
    states = model.states(recording)
    torque = evaluate(model.model_, states)[1][:, model.model_.term_names.index("friction")]
    return np.stack([np.interp(recording.t, states.t, column) for column in torque.T], axis=1)


def _columns(built: Built) -> list[PlacedEffect]:
    return [
        PlacedEffect(
            effect.kind,
            effect.joints,
            tuple((name, tuple(values[list(effect.joints)].tolist())) for name, values in effect.shape.items()),
        )
        for effect in (placed.effect for placed in built.placed)
        if isinstance(effect, ColumnEffect)
    ]


def _gain(built: Built) -> FloatArray:
    gain = np.ones(built.simulation.arm.robot.n_joints)
    for placed in built.placed:
        if isinstance(placed.effect, TorqueGain):
            gain = gain * (1 + placed.effect.gain)
    return gain


def _told(built: Built, run: int) -> Recording:
    """A run as it would have been without what the model cannot hold."""
    recording = built.shown(run)
    for placed in built.placed:
        effect = placed.effect
        if isinstance(effect, TorqueDelay):
            recording = replace(recording, tau=_earlier(recording, effect.delays))
        elif isinstance(effect, EncoderEccentricity):
            recording = replace(recording, q=_centred(recording.q, effect))
    recording = replace(recording, tau=recording.tau / _gain(built))
    return replace(recording, tau=recording.tau - _foreign(built, run, recording))


def _foreign(built: Built, run: int, recording: Recording) -> FloatArray:
    """Torque (n, n_joints) [N m] that neither a column nor the robot explains: strangers, contacts, gears."""
    arm, total = built.simulation.arms[run], np.zeros_like(recording.tau)
    gears = bool((arm.hysteresis_loss * arm.hysteresis).any())
    known = (ColumnEffect, TorqueDelay, TorqueGain, EncoderEccentricity, ThermalDrift, *_STRUCTURE)
    if not gears and all(isinstance(effect, known) for effect in arm.effects):
        return total
    motion = arm.motion(built.simulation.motions[run], np.arange(recording.n_samples) / built.simulation.rate)
    for effect, torque in zip(arm.effects, motion.effects, strict=True):
        if not isinstance(effect, known):
            total += torque
    return total + arm.hysteresis_loss * motion.hysteresis


def _earlier(recording: Recording, delays: FloatArray) -> FloatArray:
    from scipy.interpolate import CubicSpline

    late = [(j, delay) for j, delay in enumerate(delays.tolist()) if delay]
    tau = recording.tau.copy()
    for j, delay in late:
        tau[:, j] = CubicSpline(recording.t, tau[:, j])(np.minimum(recording.t + delay, recording.t[-1]))
    return tau


def _centred(shown: FloatArray, effect: EncoderEccentricity) -> FloatArray:
    """Solve `shown = q + amplitude sin(q + phase)` for q; the amplitude is far below 1."""
    q = shown.copy()
    for _ in range(FIXED_POINTS):
        q = shown - effect.amplitude * np.sin(q + effect.phase)
    return q
