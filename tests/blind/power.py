"""What any test could find: the part of an effect inside the band that the declared model cannot absorb, and the power
of an F-test that was told where to look.

Noise is white, so a signal's evidence against it is lambda = sum of squares over the noise's variance, over all samples
in motion. The program sees the band of the motion only: what lies outside is lost to it. The power is that of a
chi-square test with as many degrees of freedom as the effect has coefficients (Kay 1998, Detection Theory, 7.7), at
the level that leaves 1 % for all candidates together.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
from arms import bare
from cases import N_TRAIN, RATIOS, SCALED, all_cases
from maker import Built, Impossible, build
from numpy.typing import NDArray
from scipy.stats import chi2, ncx2

from dynid_rs import _core
from dynid_rs.columns import Plan, run_rows
from dynid_rs.loops import declared_plan
from dynid_rs.preprocessing import choose_band, prepare
from dynid_rs.recording import Recording
from dynid_rs.simulation import SimulatedArm, equip
from dynid_rs.simulation.effects.columns import ColumnEffect

FloatArray = NDArray[np.float64]

FAMILY_LEVEL, N_CANDIDATES = 0.01, 500
"""False attributions allowed per look, and candidates in one: some 20 kinds on 6 joints with a few shapes each."""
N_COEFFICIENTS = {"gravity_tilt": 2, "kinematic_error": 6, "encoder_eccentricity": 2, "thermal_drift": 1}
_RCOND = 1e-10


def in_band(built: Built) -> list[dict[str, Any]]:
    """What each scaled effect leaves in the band: RMS over full-rate noise per joint, evidence and power."""
    return [
        _evidence(built, placed.effect, placed.reached) | {"kind": placed.effect.kind, "ratio": placed.put.ratio}
        for placed in built.placed
        if placed.put.ratio is not None
    ]


def _evidence(built: Built, effect: Any, reached: float) -> dict[str, Any]:
    arm = bare(built.case.arm)
    declared = arm.robot
    plan = declared_plan(
        declared, _core.Effect.friction(arm.velocity_threshold.tolist(), arm.transition_width.tolist())
    )
    silent = _silent(arm)
    equipped = equip(silent, [effect])
    runs = []
    for run in range(N_TRAIN):
        own = equipped.of_run(run, built.simulation.trajectories[run].duration, np.random.default_rng([0, run]))
        shown = own.record(built.simulation.trajectories[run], built.simulation.rate, np.random.default_rng(0))
        runs.append(replace(shown, q_motor=None))
    left, n_moving = _left(plan, runs, arm.noise_std)
    evidence = float(n_moving * np.sum(left**2))
    degrees = _degrees(effect)
    return {
        "rms_over_noise": left.tolist(),
        "n_moving": n_moving,
        "evidence": evidence,
        "power": power(evidence, degrees),
        "power_without_band": power(n_moving * reached**2, degrees),
    }


def power(evidence: float, degrees: int, level: float = FAMILY_LEVEL / N_CANDIDATES) -> float:
    """Probability that a chi-square test at `level` sees a noncentrality of `evidence`."""
    return float(ncx2.sf(chi2.isf(level, degrees), degrees, max(evidence, 1e-12)))


def _degrees(effect: Any) -> int:
    if isinstance(effect, ColumnEffect):
        return int(effect.coefficients.shape[1]) * len(effect.joints)
    return N_COEFFICIENTS.get(effect.kind, 1)


def _silent(arm: SimulatedArm) -> SimulatedArm:
    none = np.zeros(arm.robot.n_joints)
    return replace(arm, noise_std=none, link_resolution=none, motor_resolution=none, link_noise=none, motor_noise=none)


def _left(plan: Plan, runs: list[Recording], noise_std: FloatArray) -> tuple[FloatArray, int]:
    """RMS in the band over the noise's standard deviation that the declared model leaves, (n_joints,); samples moving.

    Joints count by their noise, as a fit of noisy data weighs them.
    """
    n = plan.robot.n_joints
    band = choose_band(runs)
    states = [prepare(run, band, runs[0].rate) for run in runs]
    blocks = [run_rows(plan, each, each.tau) for each in states]
    A, y, joint_of = [], [], []
    for joint in range(n):
        rows = np.concatenate([block[joint] for block in blocks]) / noise_std[joint]
        wide = np.zeros((len(rows), plan.n_columns))
        wide[:, plan.unknowns(joint)] = rows[:, :-1]
        A.append(wide)
        y.append(rows[:, -1])
        joint_of.append(np.full(len(rows), joint))
    flat, target, of = np.concatenate(A)[:, plan.estimable()], np.concatenate(y), np.concatenate(joint_of)
    scale = np.linalg.norm(flat, axis=0)
    scale[scale == 0] = 1.0
    residual = target - flat / scale @ np.linalg.lstsq(flat / scale, target, rcond=_RCOND)[0]
    left = np.array([np.sqrt(np.mean(residual[of == joint] ** 2)) for joint in range(n)])
    return left, int(sum(np.count_nonzero(each.moving) for each in states) * runs[0].rate / states[0].rate)


def main() -> None:
    """Print the mean power over the three arms for every kind and ratio."""
    print(
        f"power at {FAMILY_LEVEL:g} / {N_CANDIDATES} for one who knows kind, joint and shape, in the band; without it"
    )
    rows = []
    for kind in SCALED:
        row = []
        for ratio in RATIOS:
            cells = []
            for case in all_cases().values():
                if case.group == "single" and (case.puts[0].kind, case.puts[0].ratio) == (kind, ratio):
                    with suppress(Impossible):
                        cells += [(e["power"], e["power_without_band"]) for e in in_band(build(case))]
            row.append(np.mean(cells, axis=0) if cells else np.full(2, np.nan))
        rows.append(row)
        print(f"{kind:28s}" + "".join(f"  {r:g}: {a:.2f} {b:.2f}" for r, (a, b) in zip(RATIOS, row, strict=True)))
    for r, (a, b) in zip(RATIOS, np.nanmean(rows, axis=0), strict=True):
        print(f"all kinds at {r:g}: {a:.3f} {b:.3f}")


if __name__ == "__main__":
    main()
