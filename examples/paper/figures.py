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

MOST_POINTS = 600
"""Points of a curve; more cannot be seen."""


def _save(figure, path: Path) -> None:
    figure.tight_layout()
    figure.savefig(path, metadata={"Date": None})
    plt.close(figure)


def _thin(t, *signals):
    step = max(1, len(t) // MOST_POINTS)
    return (t[::step], *(signal[::step] for signal in signals))


def exciting_trajectory(path: Path, trajectory, joints) -> None:
    """Figure 5: position, velocity and acceleration of the designed trajectory."""
    t = np.linspace(0.0, trajectory.duration, MOST_POINTS)
    figure, axes = plt.subplots(1, 3, figsize=(9.0, 2.4))
    for axis, signal, unit in zip(axes, trajectory.evaluate(t), ("rad", "rad/s", "rad/s$^2$"), strict=True):
        axis.plot(t, signal, label=joints)
        axis.set(xlabel="t [s]", title=unit)
    axes[0].legend(joints, ncols=2, fontsize=6)
    _save(figure, path)


def friction(path: Path, panels) -> None:
    """Figure 6: friction measured by pairs and the fitted law; panels are (joint, speed, tau, speeds, law, truth)."""
    figure, axes = plt.subplots(1, len(panels), figsize=(9.0, 2.6))
    for axis, (joint, speed, tau, speeds, law, truth) in zip(axes, panels, strict=True):
        axis.plot(speed, tau, ".", markersize=2.5, color="0.6", label="pairs (Eq. 8)")
        axis.plot(speeds, truth, color="tab:orange", label="simulated")
        axis.plot(speeds, law, "--", color="tab:blue", label="identified")
        axis.set(xlabel="velocity [rad/s]", ylabel="friction [N m]", title=joint)
    axes[0].legend(fontsize=6)
    _save(figure, path)


def torque(path: Path, t, measured, predicted, joints) -> None:
    """Figures 7 and 8: measured and predicted torque on a run that nothing was fitted to, and the rest."""
    columns = (len(joints) + 1) // 2
    figure, axes = plt.subplots(2, columns, figsize=(9.0, 4.0), sharex=True)
    t, measured, predicted = _thin(t, measured, predicted)
    for j, (axis, joint) in enumerate(zip(axes.ravel(), joints, strict=False)):
        axis.plot(t, measured[:, j], color="0.5", label="measured")
        axis.plot(t, predicted[:, j], "--", color="tab:blue", label="predicted")
        axis.plot(t, measured[:, j] - predicted[:, j], color="tab:orange", label="left")
        axis.set_title(joint)
    for axis in axes[:, 0]:
        axis.set_ylabel("torque [N m]")
    for axis in axes[-1]:
        axis.set_xlabel("t [s]")
    axes[0, 0].legend(fontsize=6)
    _save(figure, path)
