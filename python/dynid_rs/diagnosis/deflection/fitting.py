"""From signals to a gear with its shapes: compliance, the load's spread, width, distance and orders in turn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.deflection.gear import Gear
from dynid_rs.diagnosis.deflection.lines import find_orders
from dynid_rs.diagnosis.deflection.shapes import find_distance, find_width, rotor_share
from dynid_rs.diagnosis.deflection.signals import GearSignals
from dynid_rs.diagnosis.deflection.system import System, centred
from dynid_rs.diagnosis.deflection.terms import PLAY, Shapes

FloatArray = NDArray[np.float64]

ROUNDS = 3
"""Fits after each other in which compliance, the load's spread and the shapes settle."""
SEARCH_RATE = 50.0
"""Shapes are searched on samples thinned to about this rate [Hz]."""
LEAST_COMPLIANCE = 1e-3
"""Of deflection over load: a gear is softer than this where a number above zero is needed to begin with."""
WIDEST_SPREAD = 100.0
"""The load is at most so many times as far off as the covariance of its parameters says."""
POLISHES = 2
"""Steps of the shapes' last refinement."""
BOLDEST = 0.3
"""Longest of these steps, in the logarithm of a width or a distance; of an order in cycles."""
FIRST_WIDTH, FIRST_DISTANCE = 0.02, 0.1
"""Of the load's greatest value, and of the wind-up's range."""


def search_gear(runs: Sequence[GearSignals], turning: bool) -> Gear:
    """Look for the shapes of a gear on thinned samples; kinematic errors come later.

    Parameters
    ----------
    runs : sequence of GearSignals
        Training runs.
    turning : bool
        Whether the joint turns.
    """
    gear = _first(runs, turning).thinned(max(1, int(runs[0].rate / SEARCH_RATE)))
    if np.any(runs[0].load_error[:, -1:]):
        gear = gear.without_rotor(rotor_share(gear))
    for k in range(ROUNDS):
        names = [name for name in gear.names if k > 0 or name not in ("hysteresis", *PLAY)]
        gear = settled(gear, gear.system(names))
        gear = find_width(find_distance(gear))
    return gear


def finished_gear(gear: Gear, runs: Sequence[GearSignals]) -> Gear:
    """Return the gear of a search with a better load, every sample, refined shapes and its kinematic errors."""
    step = max(1, round(runs[0].rate / gear.runs[0].rate))
    coarse = replace(gear, runs=[run.thinned(step) for run in runs], rotor=0.0).without_rotor(gear.rotor)
    # A load that is better known begins with what its own covariance says.
    coarse = coarse.believing(1.0, coarse.noise_power)
    coarse = polished(settled(coarse, coarse.system()), coarse.names)
    whole = on_all_samples(coarse, runs)
    if whole.turning:
        system = whole.system()
        orders = find_orders(whole.runs, system.left(whole.names))
        if orders:
            coarse = replace(coarse, shapes=replace(coarse.shapes, orders=orders))
            whole = on_all_samples(polished(coarse, coarse.names), runs)
    return whole


def on_all_samples(gear: Gear, runs: Sequence[GearSignals]) -> Gear:
    """Return the gear of thinned runs on all samples."""
    system = gear.system()
    u, x = system.coefficients(gear.names)
    whole = replace(gear, runs=runs, rotor=0.0, late=float(x[system.among(gear.names, "delay")[0]]))
    whole = whole.without_rotor(gear.rotor)
    return whole.on(whole.runs, gear.names, u, x)


def polished(gear: Gear, names: Sequence[str]) -> Gear:
    """Return the gear with the shapes of `names` at their best: Gauss-Newton from the search's end."""
    for _ in range(POLISHES):
        u, x = gear.system(names).coefficients(names)
        changes = gear.shape_columns(names, u, x)
        system = gear.system(names, changes)
        every = [*names, *changes]
        u, x = system.coefficients(every)
        shapes = gear.shapes
        for change in changes:
            shapes = shapes.bent(change[:-1], float(np.clip(x[system.among(every, change)[0]], -BOLDEST, BOLDEST)))
        gear = replace(gear, shapes=shapes)
        if "hysteresis" in names:
            gear = gear.remembering(gear.path(names, u, x[: len(x) - len(changes)]))
        gear = settled(gear, system)
    return gear


def _first(runs: Sequence[GearSignals], turning: bool) -> Gear:
    top = max(float(np.abs(run.load).max()) for run in runs)
    least = _least_compliance(runs)
    reach = least * max(float(np.ptp(run.load)) for run in runs)
    size = float(np.var(np.concatenate([centred(run, run.deflection - run.shift) for run in runs])))
    turn = np.zeros((runs[0].load_error.shape[1], 0))
    gear = Gear(runs, turning, Shapes(FIRST_WIDTH * top, FIRST_DISTANCE * reach), least, 1.0, size, turn, [])
    return gear.remembering([run.load * least for run in runs])


def _least_compliance(runs: Sequence[GearSignals]) -> float:
    size = float(np.std(np.concatenate([centred(run, run.deflection - run.shift) for run in runs])))
    load = float(np.std(np.concatenate([centred(run, run.load) for run in runs])))
    return LEAST_COMPLIANCE * size / max(load, 1e-300)


def settled(gear: Gear, system: System) -> Gear:
    """Compliance, noise and the load's spread after a fit."""
    names = list(system.columns)
    u, x = system.coefficients(names)
    compliance = max(float(x[system.among(names, "compliance")[0]]), _least_compliance(gear.runs))
    half_gap = max(float(x[system.among(names, "backlash")[0]]), 0.0) if "backlash" in names else 0.0
    cubic = float(x[system.among(names, "cubic")[0]]) if "cubic" in names else 0.0
    spread = gear.spread
    n_known = len(u) - (bool(np.any(gear.turn[-1])) if gear.turn.size else 0)
    if n_known > 0:
        known = np.concatenate([errors[:, :n_known] for errors in system.errors])
        powers = np.linalg.eigvalsh(known.T @ known)
        determined = float(np.sum(powers / (powers + system.noise_power)))
        # MacKay's fixed point: the parameters' mean square over how many of them the data determine.
        spread *= float(np.sqrt(np.sum(u[:n_known] ** 2) / max(determined, 1e-3)))
    lost = max(-float(x[system.among(names, "hysteresis")[0]]) / compliance, 0.0) if "hysteresis" in names else 0.0
    bent = replace(gear, compliance=compliance, half_gap=half_gap, cubic=cubic, lost=lost)
    return bent.believing(float(np.clip(spread, 1.0, WIDEST_SPREAD)), system.slow_noise)
