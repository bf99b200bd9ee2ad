"""A run on which the arm carries something that it does not carry on the others."""

from __future__ import annotations

from collections.abc import Iterator

from dynid_rs.sensors.changes import Bench, Trial
from dynid_rs.sensors.fit import fit_arm


def payload_trials(bench: Bench) -> Iterator[tuple[Trial, float]]:
    """A body on the last link in one run only; with its mass [kg], negative for one that is missing there."""
    prior = bench.prior.with_body()
    at = len(bench.prior.mean)
    for k in bench.odd:
        runs = [plain.with_body(carried=other == k) for other, plain in enumerate(bench.plain)]
        fit = fit_arm(prior, runs, bench.size)
        yield Trial("payload_change", (bench.robot.n_joints - 1,), (k,), fit), float(fit.x[at])
