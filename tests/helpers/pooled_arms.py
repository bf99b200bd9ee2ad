"""Small fleets, drawn and identified once per session: one of simulated arms, and any number in closed form."""

from __future__ import annotations

import functools
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from campaigns.fleet_arms import DrawnArm, Odd, write_fleet

from dynid_rs import Fleet, identify_fleet
from dynid_rs.pooling.arm import ArmEstimate

N_ARMS = 24
PLANTED = {
    3: Odd("friction", "elbow", 1.2, 1.2),
    8: Odd("gain", "wrist", 0.3, 0.3),
    13: Odd("load", "hand", 0.8, 0.8),
    18: Odd("offset", "shoulder", 9.0, 0.18),
}
"""What is odd, by the number of the arm."""


@dataclass(frozen=True, eq=False)
class Identified:
    """Folder of the runs, its `fleet.toml`, the truth, and the pooled fleet."""

    folder: Path
    toml: Path
    arms: list[DrawnArm]
    fleet: Fleet

    @property
    def output(self) -> Path:
        return self.folder / "out"

    @property
    def estimates(self) -> list[ArmEstimate]:
        return [arm for one in self.fleet.types_ for arm in one.arms]


@functools.cache
def identified() -> Identified:
    """Twenty-four arms of one type, four of them odd."""
    folder = Path(_keep().name)
    toml, arms = write_fleet(folder, 7, range(N_ARMS), 0.0, kinds=("light_arm",), planted=PLANTED)
    return Identified(folder, toml, arms, identify_fleet(toml, folder / "out", n_jobs=1))


@functools.cache
def _keep() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory(prefix="dynid-fleet-", ignore_cleanup_errors=True)


def drawn(rng: np.random.Generator, n: int, *, name: str = "arm") -> list[ArmEstimate]:
    """Estimates of `n` arms without anything odd, drawn from the identified type: nothing is fitted."""
    (one,) = identified().fleet.types_
    made = []
    for k in range(n):
        arm = one.arms[k % one.n_arms]
        root = np.linalg.cholesky(arm.covariance + 1e-12 * np.diag(np.diag(arm.covariance) + 1e-12))
        noise = root @ rng.standard_normal(len(arm.x))
        x = np.where(arm.estimable, one.mean + np.sqrt(one.power) * rng.standard_normal(len(arm.x)) + noise, 0.0)
        usual, seen = rng.standard_normal((2, arm.n_joints))
        error = arm.torque_std * 0.03 * np.exp(0.2 * usual + arm.error_spread * seen)
        made.append(replace(arm, name=f"{name}_{k}", x=x, error=error))
    return made
