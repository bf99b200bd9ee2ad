"""A recording over time, drawn by matplotlib."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from dynid_rs.base.drawing import chosen_joints, line, panels, titled, whole
from dynid_rs.base.units import angle_units, labelled, torque_of

if TYPE_CHECKING:
    from dynid_rs.runs.recording import Recording

QUANTITIES = {
    "q": ("position", "{angle}"),
    "q_motor": ("motor position", "{angle}"),
    "q_reference": ("reference", "{angle}"),
    "dq": ("speed", "{angle}/s"),
    "dq_motor": ("motor speed", "{angle}/s"),
    "ddq": ("acceleration", "{angle}/s^2"),
    "ddq_motor": ("motor acceleration", "{angle}/s^2"),
    "tau": ("torque", "{torque}"),
    "temperature": ("temperature", "degC"),
}
"""What a signal is called on an axis, and its unit."""
BESIDE = {"q": ("q_motor", "q_reference")}
"""Signals that are drawn with another one, where they were recorded."""


def plot_signals(
    recording: Recording, signals: Sequence[str], joints: Sequence[str | int] | None, axes: Any
) -> NDArray[Any]:
    """`Recording.plot`."""
    asked = [signals] if isinstance(signals, str) else list(signals)
    for signal in asked:
        if signal not in recording.signals:
            raise ValueError(f"{recording.name}: {signal!r} was not recorded; it holds {', '.join(recording.signals)}")
    if not asked:
        raise ValueError(f"signals: none is given; {recording.name} holds {', '.join(recording.signals)}")
    chosen = chosen_joints(joints, recording.joints)
    drawn = panels(len(chosen), len(asked), axes)
    for row, j in zip(drawn, chosen, strict=True):
        for panel, signal in zip(row, asked, strict=True):
            others = [other for other in BESIDE.get(signal, ()) if other in recording.signals and other not in asked]
            for name, style in zip((signal, *others), ("-", "--", ":"), strict=False):
                line(panel, recording.t, getattr(recording, name)[:, j], linestyle=style, label=QUANTITIES[name][0])
            panel.set_ylabel(axis_label(recording, signal, j))
            if others and row is drawn[0]:
                panel.legend(fontsize="small", frameon=False)
    titled(drawn, [recording.joints[j] for j in chosen])
    for panel in drawn[-1]:
        panel.set_xlabel(labelled("time", "s"))
    if axes is None:
        drawn[0, 0].figure.suptitle(recording.name, fontsize="medium")
    return whole(drawn)


def axis_label(recording: Recording, signal: str, joint: int) -> str:
    """Quantity and unit of a signal of one joint."""
    quantity, unit = QUANTITIES[signal]
    if signal == "tau" and recording.torque_unit == "A":
        quantity = "current"
    angle = angle_units(recording.kinds)[joint]
    torque = torque_of(recording.torque_unit, recording.kinds[joint])
    return labelled(quantity, unit.replace("{angle}", angle).replace("{torque}", torque))
