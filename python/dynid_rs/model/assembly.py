"""From fitted loops to a `TorqueModel`, and from a model to torques along a run."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.model.known import KnownTerm
from dynid_rs.regression.columns import Plan
from dynid_rs.regression.fitted import FittedLinks
from dynid_rs.runs.preprocessing import States
from dynid_rs.runs.recording import Delay

FloatArray = NDArray[np.float64]
Regressions = Sequence[_core.GaussianMixtureRegression | _core.NormalisedRbf | None]
Signals = Sequence[Sequence[tuple[str, int]]]
"""Per joint: name and joint of what its regression sees."""


def assemble(
    plan: Plan,
    links: FittedLinks,
    own: FloatArray,
    runs: Sequence[States],
    *,
    encoder_delay: FloatArray,
    encoder_error: FloatArray | None = None,
    torque_delay: Delay = 0.0,
    torque_unit: str,
    band: tuple[float, float, bool] | None = None,
    third_loop: tuple[str, Regressions, FloatArray] | None = None,
    residual_signals: Signals | None = None,
    known: Sequence[KnownTerm] = (),
) -> _core.TorqueModel:
    """Model of the fitted numbers.

    Parameters
    ----------
    plan : Plan
        Effects with their shapes, and where base parameters stand in phi.
    links : FittedLinks
        Fitted; gives base parameters, torque scales and noise.
    own : ndarray (n_joints, n_own)
        Own coefficients in the order of the plan's effects.
    runs : sequence of States
        Training runs; their extremes become the model's domain.
    encoder_delay : ndarray (n_joints,)
        Delay of the link channel [s].
    encoder_error : ndarray (n_joints, 2), optional
        Cosine and sine part of what the link encoder shows too much [rad].
    torque_delay : float or ndarray (n_joints,)
        How late the torque channels are [s], all or each.
    torque_unit : {"N*m", "A"}
        Unit of the torques.
    band : (cutoff, rate, standstill), optional
        Where errors are told: cutoff [Hz], rate of the grid [Hz], whether standstill is scored.
    third_loop : (inputs, regressions, compliance), optional
        One regression or None per joint; compliance (n_joints,) of the gears [rad per torque unit].
    residual_signals : sequence of sequence of (str, int), optional
        What the regressions of a third loop on `"signals"` see, per joint.
    known : sequence of (Effect, ndarray (n_joints, n_columns))
        Effects that were not fitted; they stand behind the plan's.
    """
    phi = np.zeros(10 * plan.robot.n_joints)
    phi[plan.pivots] = links.phi_base_
    effects = [*plan.terms(own), *known]
    q, dq, ddq = (np.concatenate([getattr(states, name) for states in runs]) for name in ("q", "dq", "ddq"))
    counts = bool(np.any(torque_delay)) or any("step" in effect.signals for effect in plan.effects)
    kept = third_loop is not None and any(regression is not None for regression in third_loop[1])
    return _core.TorqueModel(
        plan.robot,
        phi,
        effects,
        residual=(third_loop[0], list(third_loop[1])) if third_loop is not None and kept else None,
        residual_signals=residual_signals if kept else None,
        compliance=third_loop[2].tolist() if third_loop is not None and kept else None,
        torque_scale=links.torque_scale_.tolist(),
        encoder_delay=encoder_delay.tolist(),
        encoder_error=encoder_error,
        encoder_error_sides="link" if all(states.two_encoders for states in runs) else "both",
        torque_delay=torque_delay,
        noise_std=links.noise_std_.tolist(),
        domain=(
            np.stack([q.min(axis=0), q.max(axis=0)], axis=1).tolist(),
            np.abs(dq).max(axis=0).tolist(),
            np.abs(ddq).max(axis=0).tolist(),
        ),
        torque_unit=torque_unit,
        step=1 / runs[0].rate if counts else None,
        band=band,
    )


def with_parts(
    model: _core.TorqueModel, phi: FloatArray, effects: Sequence[tuple[_core.Effect, FloatArray]]
) -> _core.TorqueModel:
    """Return `model` with other inertial parameters (10 n_links,) and effects; everything else stays."""
    return with_changes(model, phi=phi, effects=effects)


def with_band(model: _core.TorqueModel, band: tuple[float, float, bool]) -> _core.TorqueModel:
    """Return `model` with its errors told in another band: (cutoff [Hz], rate [Hz], whether standstill is scored)."""
    other = with_changes(model, band=band)
    return other if model.physical is None else other.with_physical(model.physical)


def with_domain(
    model: _core.TorqueModel, domain: tuple[list[list[float]], list[float], list[float]]
) -> _core.TorqueModel:
    """Return `model` trained within other extremes: [lowest, highest] of q, greatest |dq| and |ddq|, per joint."""
    return with_changes(model, domain=domain)


def with_changes(model: _core.TorqueModel, **parts: Any) -> _core.TorqueModel:
    """Return `model` with some parts exchanged, in the words of its constructor."""
    given = {
        "robot": model.robot,
        "phi": model.phi,
        "effects": model.effects,
        "residual": model.residual,
        "residual_signals": model.residual_signals,
        "compliance": None if model.compliance is None else model.compliance.tolist(),
        "torque_scale": model.torque_scale.tolist(),
        "encoder_delay": model.encoder_delay.tolist(),
        "encoder_error": model.encoder_error,
        "encoder_error_sides": model.encoder_error_sides,
        "torque_delay": model.torque_delay,
        "noise_std": model.noise_std.tolist(),
        "domain": model.domain,
        "torque_unit": model.torque_unit,
        "step": model.step,
        "band": model.band,
    }
    return _core.TorqueModel(**(given | parts))


def evaluate(model: _core.TorqueModel, states: States) -> tuple[FloatArray, FloatArray, NDArray[np.uint32]]:
    """Total (n, n_joints), terms (n, n_terms, n_joints) and status bits (n,) along a run, on the clock of its torque.

    A part of a run begins with what the model remembers of the run before it.
    """
    if states.torque_delay.any():
        model = model.with_torque_delay(model.torque_delay - states.torque_delay)
    run, step = states.in_step(model.encoder_delay), 1 / states.rate
    if states.before is None:
        return model.evaluate(*run.signals(), step=step, temperature=run.temperature)
    before = states.before.in_step(model.encoder_delay)
    signals = [np.concatenate(parts) for parts in zip(before.signals(), run.signals(), strict=True)]
    temperature = None
    if before.temperature is not None and run.temperature is not None:
        temperature = np.concatenate([before.temperature, run.temperature])
    total, terms, status = model.evaluate(*signals, step=step, temperature=temperature)
    first = len(before.t)
    return total[first:], terms[first:], status[first:]


def declared_temperature(effects: Iterable[_core.Effect], q: FloatArray) -> FloatArray | None:
    """The temperature (n, n_joints) that friction is declared at, where one of the effects follows it."""
    for effect in effects:
        if "temperature" in effect.signals:
            reference: FloatArray = np.broadcast_to(np.asarray(dict(effect.shape)["reference_temperature"]), q.shape)
            return reference.copy()
    return None
