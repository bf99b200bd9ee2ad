"""The states of a run, as `dynid-estimator` takes them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from dynid_rs.runs.recording import FloatArray, Recording

SIGNALS = ("q", "dq", "ddq", "q_motor", "dq_motor", "ddq_motor")


def states_of(
    recording: Recording, cutoff: float | None, encoder_delay: FloatArray
) -> tuple[FloatArray, tuple[FloatArray, ...], FloatArray, FloatArray | None]:
    """Time (n,), the six signals of the states, measured torque and, if any, temperature, (n, n_joints) each.

    Where they are made of positions, the links' acceleration is on the motor's clock, as in `dynid identify`.
    """
    from dynid_rs.runs.preprocessing import Band, choose_band, common_rate, prepare

    q, dq, ddq = recording.q, recording.dq, recording.ddq
    if dq is not None and ddq is not None and cutoff is None:
        # What the motor side lacks it has from the link side, signal by signal, as in `dynid-estimator`.
        motor = (recording.q_motor, recording.dq_motor, recording.ddq_motor)
        given = [x if own is None else own for own, x in zip(motor, (q, dq, ddq), strict=True)]
        return recording.t, (q, dq, ddq, *given), recording.tau, recording.temperature
    band = choose_band([recording]) if cutoff is None else Band(cutoff)
    states = prepare(recording, band, common_rate([recording])).in_step(encoder_delay)
    return states.t, states.signals(), states.tau, states.temperature


def write_states(
    path: Path,
    t: FloatArray,
    signals: tuple[FloatArray, ...],
    temperature: FloatArray | None,
    measured: Mapping[str, FloatArray],
) -> None:
    """Write states as CSV, and what was measured by name; numbers in the shortest form that reads back bit for bit."""
    import numpy as np

    from dynid_rs.base.files import write_text

    n = signals[0].shape[1]
    columns = dict(zip(SIGNALS, signals, strict=True))
    if temperature is not None:
        columns["temperature"] = temperature
    columns |= measured
    header = ["t", *(f"{name}_{j}" for name in columns for j in range(n))]
    rows = np.concatenate([t[:, None], *columns.values()], axis=1).tolist()
    lines = [",".join(header), *(",".join(map(repr, row)) for row in rows)]
    write_text(path, "\n".join(lines) + "\n")
