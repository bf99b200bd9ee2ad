"""The paper's Figures 5 to 8 with our numbers, as SVG files small enough to keep."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np

mpl.use("svg")
mpl.rcParams.update(
    {
        "svg.hashsalt": "dynid",  # the same picture is the same file
        "svg.fonttype": "none",
        "font.size": 8,
        "axes.grid": True,
        "grid.alpha": 0.3,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "lines.linewidth": 1.0,
    }
)
import matplotlib.pyplot as plt  # noqa: E402  the backend is chosen first

MOST_POINTS = 400
"""Points of a curve; more cannot be seen."""


def _save(figure, path: Path, bottom: float = 0.0) -> None:
    figure.tight_layout(rect=(0, bottom, 1, 1))
    figure.savefig(path, metadata={"Date": None})
    plt.close(figure)


def _thin(t, *signals):
    step = -(-len(t) // MOST_POINTS)
    return (t[::step], *(signal[::step] for signal in signals))


def exciting_trajectory(path: Path, trajectory, joints) -> None:
    """Figure 5: position, velocity and acceleration of the designed trajectory."""
    t = np.linspace(0.0, trajectory.duration, MOST_POINTS)
    figure, axes = plt.subplots(1, 3, figsize=(9.0, 2.9))
    titles = ("position [rad]", "velocity [rad/s]", "acceleration [rad/s²]")
    for axis, signal, title in zip(axes, trajectory.evaluate(t), titles, strict=True):
        lines = axis.plot(t, signal)
        axis.set(xlabel="t [s]", title=title)
    figure.legend(lines, joints, ncols=len(joints), fontsize=7, loc="lower center", frameon=False)
    _save(figure, path, bottom=0.08)


def friction(path: Path, found, joints) -> None:
    """Figure 6: friction by the pairs of Eq. 8 with its 95 % interval, the identified law, and what was simulated."""
    figure, axes = plt.subplots(1, len(joints), figsize=(9.0, 2.8))
    for j, (axis, joint) in enumerate(zip(axes, joints, strict=True)):
        odd = found.pairs[j]
        axis.plot(found.speeds[j], found.truth[j], color="tab:orange", linewidth=2.5, alpha=0.6, label="simulated")
        axis.plot(found.speeds[j], found.law[j], "--", color="tab:blue", label="identified law")
        for kind, marker in (("leg", "o"), ("reversed", "x")):
            at = [k == kind for k in odd.kind]
            name = {"leg": "constant speed, both ways", "reversed": "time-reversed motion"}[kind]
            bars = 1.96 * odd.std_error[at]
            axis.errorbar(
                odd.speed[at], odd.tau_odd[at], bars, fmt=marker, color="0.3", markersize=3.5, linewidth=0.7, label=name
            )
        axis.set(xlabel="speed [rad/s]", ylabel="odd part of friction [N m]", title=joint, xscale="log")
    axes[0].legend(fontsize=7)
    _save(figure, path)


def torque(path: Path, t, measured, predicted, joints) -> None:
    """Figures 7 and 8: measured and predicted torque on a run that nothing was fitted to, and the rest."""
    columns = (len(joints) + 1) // 2
    figure, axes = plt.subplots(2, columns, figsize=(9.0, 4.4), sharex=True)
    t, measured, predicted = _thin(t, measured, predicted)
    for j, (axis, joint) in enumerate(zip(axes.ravel(), joints, strict=False)):
        lines = axis.plot(t, measured[:, j], color="0.6", linewidth=2.0)
        lines += axis.plot(t, predicted[:, j], "--", color="tab:blue")
        lines += axis.plot(t, measured[:, j] - predicted[:, j], color="tab:orange")
        axis.set_title(joint)
    for axis in axes[:, 0]:
        axis.set_ylabel("torque [N m]")
    for axis in axes[-1]:
        axis.set_xlabel("t [s]")
    names = ("measured", "predicted", "measured - predicted")
    figure.legend(lines, names, ncols=3, fontsize=8, loc="lower center", frameon=False)
    _save(figure, path, bottom=0.05)
