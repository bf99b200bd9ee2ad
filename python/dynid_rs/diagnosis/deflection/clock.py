"""Two channels on two clocks: one delay for all joints where they agree, else one each."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dynid_rs.diagnosis.deflection.examined import Examined, kinds_of
from dynid_rs.diagnosis.deflection.findings import DeflectionFinding
from dynid_rs.diagnosis.deflection.parameters import Parameter
from dynid_rs.diagnosis.deflection.tested import Tested, rms
from dynid_rs.uncertainty import NORMAL_95

FINEST = 1e-4
"""Of a sample: what interpolation and smoothing leave of a clock, one standard deviation."""
ALIKE = 0.05
"""Delays that differ by less than this part of themselves are one."""


def delay_findings(gears: Sequence[tuple[Examined, Tested]]) -> list[DeflectionFinding]:
    """Findings `encoder_delay`: of all joints together where their delays agree, of every joint alone elsewhere."""
    late = [(gear, tested) for gear, tested in gears if gear.is_late]
    if not late:
        return []
    values, stds = (np.array(x) for x in zip(*(gear.delay for gear, _ in late), strict=True))
    weights = 1 / np.maximum(stds, 1e-300) ** 2
    mean = float(weights @ values / weights.sum())
    off = np.abs(values - mean)
    if len(late) == 1 or np.any((off > ALIKE * abs(mean)) & (off > 3 * stds)):
        return [_finding([pair], *pair[0].delay) for pair in late]
    # Joints differ by more than their own errors say where something is left in them: no better than their spread.
    between = float(np.sqrt(np.mean((values - mean) ** 2) / len(late)))
    return [_finding(late, mean, max(float(1 / np.sqrt(weights.sum())), between))]


def _finding(gears: Sequence[tuple[Examined, Tested]], value: float, std: float) -> DeflectionFinding:
    from scipy.stats import norm

    spread = NORMAL_95 * float(np.hypot(std, FINEST / gears[0][0].gear.runs[0].rate))
    ties = {other for gear, _ in gears for other in gear.choice.ties.get("delay", ())}
    return DeflectionFinding(
        kind="encoder_delay",
        joints=tuple(gear.joint for gear, _ in gears),
        parameters=(Parameter("delay", value, "s", (value - spread, value + spread)),),
        p_value=float(min(2 * norm.sf(abs(gear.delay[0]) / max(gear.delay[1], 1e-300)) for gear, _ in gears)),
        rms_test_before=tuple(rms(tested.raw()) for _, tested in gears),
        rms_test_after=tuple(rms(tested.left(["delay"])) for _, tested in gears),
        ties=tuple(kind for kind in kinds_of(sorted(ties)) if kind != "encoder_delay"),
        plot=gears[0][1].picture(["delay"], "dq"),
        signal="dq",
    )
