"""A recording in one line, and as a table in a notebook."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dynid_rs.base.notebook import html_table
from dynid_rs.base.quoting import shown, shown_names
from dynid_rs.base.units import angle_units, torque_of, unit_text

if TYPE_CHECKING:
    from dynid_rs.runs.recording import Recording


def said_of(recording: Recording) -> str:
    """Name, length, rate, joints and signals: ``'run.csv': 8 s at 200 Hz, 3 joints (...), q, tau [N*m]``."""
    signals = ", ".join(
        f"{signal} [{recording.torque_unit}]" if signal == "tau" else signal for signal in recording.signals
    )
    noun = "joint" if recording.n_joints == 1 else "joints"
    return (
        f"{shown(recording.name)!r}: {recording.duration:.4g} s at {recording.rate:.4g} Hz, "
        f"{recording.n_samples} samples of {recording.n_joints} {noun} ({shown_names(recording.joints)}); {signals}"
    )


def html_of(recording: Recording) -> str:
    """Facts of the run, and the extent of position, speed and torque of every joint."""
    units = angle_units(recording.kinds)
    speed = np.gradient(recording.q, recording.t, axis=0) if recording.dq is None else recording.dq
    torques = [unit_text(torque_of(recording.torque_unit, kind)) for kind in recording.kinds]
    rows = [
        [
            joint,
            f"{_between(recording.q[:, j])} {units[j]}",
            f"{np.abs(speed[:, j]).max():.3g} {units[j]}/s",
            f"{_between(recording.tau[:, j])} {torques[j]}",
        ]
        for j, joint in enumerate(recording.joints)
    ]
    title = (
        f"{recording.name}: {recording.duration:.4g} s at {recording.rate:.4g} Hz, {recording.n_samples} samples, "
        f"t from {recording.t[0]:.4g} s to {recording.t[-1]:.4g} s"
    )
    head = ("joint", "position", "greatest speed", "torque" if recording.torque_unit == "N*m" else "current")
    return html_table(head, rows, title=title, note=f"signals: {', '.join(recording.signals)}")


def _between(values: np.ndarray) -> str:
    return f"{values.min():.3g} to {values.max():.3g}"
