"""A run on which the arm carries something that it does not carry on the others."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from dynid_rs.sensors.changes import Bench, Trial
from dynid_rs.sensors.fit import ArmFit, fit_arm


def payload_trials(bench: Bench) -> Iterator[tuple[Trial, float]]:
    """A body on the last link in one run only; with its mass [kg], negative for one that is missing there."""
    at = len(bench.prior.mean)
    for k in bench.odd:
        fit = carried(bench, (k,))
        yield Trial("payload_change", (bench.robot.n_joints - 1,), (k,), fit), float(fit.x[at])


def carried(bench: Bench, where: Sequence[int]) -> ArmFit:
    """The model with a body on the last link in these runs, whose ten numbers come behind the links'."""
    runs = [plain.with_body(carried=k in where) for k, plain in enumerate(bench.plain)]
    return fit_arm(bench.prior.with_body(), runs, bench.size)
