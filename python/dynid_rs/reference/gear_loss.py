"""What gears that lose torque with memory hide in a change that was fitted without them.

Teeth of elastic gears rub: the motor feels a torque that turns round with the load over some way (`gear_hysteresis` of
the catalogue). A reference that lacks it has taken a part of it for masses, as far as it went with the load on its own
runs; here it would be taken for a change, by `GearLoss.shift`. The two cancel if both motions are alike, and nothing
says how much they are. So what is left counts as a bias between none of that shift and all of it, either way: the
reference had taken anything from nothing to twice as much. A covariance does not hold it, for it is no noise: it
follows the load, on all joints at once.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.base.findings import Finding, joint_words
from dynid_rs.model.gear_loss import gear_losses
from dynid_rs.model.units import load_unit
from dynid_rs.reference.change_search import LEAST_GAIN, ChangeSearch
from dynid_rs.reference.weighing import Weighing

FloatArray = NDArray[np.float64]
Places = NDArray[np.intp]

LEVEL = 0.95
"""Of an interval, two-sided."""
ONE_SIDED = 1.6448536269514722
"""95 % of the normal distribution on one side [standard deviations]."""


@dataclass(frozen=True, eq=False)
class GearLoss:
    """`joints` whose gears lose torque with memory, and what that is taken for: `shift` (len(free),) of `free`."""

    joints: tuple[int, ...]
    shift: FloatArray

    def finding(self, reference: _core.TorqueModel, mass: float) -> Finding:
        """What there is to say where `mass`, the shift of a load's, is the largest part of its interval."""
        names, unit = reference.robot.joint_names, load_unit(reference.torque_unit)
        where = joint_words(*(names[j] for j in self.joints))
        return Finding(
            "gear_loss",
            "info",
            f"the gears of {where} lose torque by the way that their load takes, which the model does not know: up to "
            f"{abs(mass):.2g} {unit} of the load may be that; a model that `dynid diagnose` made of the arm without "
            "it, with gear_hysteresis among its effects, weighs it more closely",
            value=abs(mass),
            unit=unit,
        )


def gear_loss(search: ChangeSearch, weighing: Weighing, free: Places, held: Places) -> GearLoss:
    """Look for losses of gears beside the changes at `free`, joint by joint, as told by parts that were left out.

    Parameters
    ----------
    weighing : Weighing
        Of `search`, linear about what is believed.
    free, held : ndarray
        Places of what has changed and of the day-to-day freedom.
    """
    n = len(weighing.weights)
    first = len(weighing.precision)
    own = np.arange(first, first + n)
    bare = weighing.left_out_power(free, held).sum(axis=0)
    tried = []
    for columns, precision in _losses(search):
        wide = weighing.beside(columns, precision)
        power = wide.left_out_power(free, np.append(held, own)).sum(axis=0)
        tried.append((np.sqrt(power / np.maximum(bare, 1e-300)), wide))
    ratio, wide = min(tried, key=lambda each: float(np.sum(np.log(np.maximum(each[0], 1e-12)))))
    size = wide.solve(free, np.append(held, own))[own]
    # What gains energy is no loss.
    lossy = np.flatnonzero((ratio < 1 - LEAST_GAIN) & (size > 0))
    with_it = wide.solve(free, np.concatenate([held, own[lossy]]))
    return GearLoss(tuple(lossy.tolist()), wide.solve(free, held)[free] - with_it[free])


def _losses(search: ChangeSearch) -> Iterator[tuple[list[FloatArray], FloatArray]]:
    """Columns per run (n_rows, n_joints, n_joints) and their precision, for every way in the catalogue's grid."""
    model = search.believed.model()
    runs = [states.aligned(model.encoder_delay, model.encoder_error) for states in search.runs]
    loads = [np.asarray(model.robot.inverse_dynamics(s.q, s.dq, s.ddq, model.phi)) for s in runs]
    for effect in gear_losses(loads):
        columns = []
        for states, seen, load in zip(search.runs, runs, loads, strict=True):
            torque = _core.effect_columns(effect, *seen.signals(), tau_link=load)[:, :, 0]
            rows = states.counted * states.in_band(torque)
            columns.append(rows[:, :, None] * np.eye(rows.shape[1]))
        size = np.sqrt(np.mean(np.concatenate(columns).sum(axis=2) ** 2, axis=0))
        # A gear loses no more than its joint's friction.
        yield columns, (size / search.friction) ** 2


def reach(std: FloatArray, bias: FloatArray) -> FloatArray:
    """Half-widths of 95 % intervals of estimates with standard deviation `std` and a bias of at most `bias`.

    The quantile of a folded normal variable (Armstrong and Kolesar 2018, Econometrica 86): 1.96 `std` without bias.
    """
    from scipy.special import chndtrix

    std = np.maximum(std, 1e-300)
    # Far out the two tails are one.
    far = np.abs(bias) > 3 * std
    near = np.where(far, 0.0, bias / std)
    folded = std * np.sqrt(chndtrix(LEVEL, 1, near**2))
    half: FloatArray = np.where(far, np.abs(bias) + ONE_SIDED * std, folded)
    return half
