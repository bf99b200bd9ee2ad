"""A run on which the arm carries something that it does not carry on the others."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from dynid_rs.sensors.changes import Bench, Trial
from dynid_rs.sensors.fit import ArmFit, fit_arm


def payload_trials(bench: Bench) -> Iterator[Trial]:
    """A body on the last link in one run only, or one that is missing there."""
    for k in bench.odd:
        yield Trial("payload_change", (bench.robot.n_joints - 1,), (k,), carried(bench, (k,)))


def beside_a_common_load(bench: Bench, run: int) -> tuple[float, float]:
    """What another body on one run gains [nats] where all runs may carry one, and its mass [kg]."""
    prior, at = bench.prior.carrying(), len(bench.prior.mean)
    common, other = (
        fit_arm(prior, [run.with_body(bench.arm, carried=k == one) for k, run in enumerate(bench.plain)], bench.size)
        for one in (None, run)
    )
    return other.log - common.log, float(other.x[at])


def carried(bench: Bench, where: Sequence[int]) -> ArmFit:
    """The model with a body on the last link in these runs, whose ten numbers come behind the links'."""
    runs = [run.with_body(bench.arm, carried=k in where) for k, run in enumerate(bench.plain)]
    return fit_arm(bench.prior.with_body(), runs, bench.size)
