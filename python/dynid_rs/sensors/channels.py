"""Channels that are not what they are called, and arms that are not what their file says: the likeliest change of all.

Runs are explained as they stand, and with one thing changed: a sign, two joints exchanged, a unit, a late or filtered
torque, gravity from another side, a body that is carried on one run. The change under which they are most probable is
said where its odds leave no doubt. None of them is mended here.

What one run shows by itself (degrees, derivatives, motor against link encoder) is found by `runs/checks`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.base.findings import Finding
from dynid_rs.base.threads import side_by_side
from dynid_rs.regression.priors import declares_inertia
from dynid_rs.runs.preprocessing import States
from dynid_rs.sensors import words
from dynid_rs.sensors.arm import Arm
from dynid_rs.sensors.changes import Bench, Trial, wiring_trials
from dynid_rs.sensors.fit import ArmFit
from dynid_rs.sensors.gravity import gravity_trial, is_another
from dynid_rs.sensors.lag import Lag, lags
from dynid_rs.sensors.payload import beside_a_common_load, carried, payload_trials
from dynid_rs.sensors.rows import ArmRows
from dynid_rs.sensors.units import unit_fits, unit_trials

FloatArray = NDArray[np.float64]

ENOUGH = 30.0
"""Nats by which a change has to make runs more probable. If nothing is wrong, a change gains k nats with a chance of
exp(-k) at most (Markov's inequality on a ratio of likelihoods): a thousand changes of ten billion sets, one alarm."""
CLEARLY = 4.0
"""Residual power on some joint it concerns over that with the change: a missing effect is no wrong channel."""
EXPLAINED = 0.3
"""Share of the torque's power that may be left on the joints of a change."""
UNEXPLAINED = 0.003
"""Share of a joint's torque on a run from which on changes are looked for, but for clocks: 5 % of its size."""
CLEARLY_LATE = 1.5
"""The same as `CLEARLY` of a clock that all joints share, on the median of the joints."""
LEAST_LATE = 0.006
"""Shorter delays [s] than this hide in what friction does at reversals."""
STEEP = 0.35
"""Density of a channel's noise in the last octave over that in the octave before: it is 1 if white, 1/4 or less
behind a slow filter; 0.45 and more where a noise of two kinds passes its corner."""
UNIT = 3.0
"""Gains of a torque channel that are no longer what robot files are wrong by."""


def channel_findings(robot: _core.RobotModel, runs: Sequence[States], torque_unit: str = "N*m") -> list[Finding]:
    """Look for channels that are not what they are called.

    Parameters
    ----------
    robot : RobotModel
        As declared.
    runs : sequence of States
        Runs of one arm, all joints of which move.
    torque_unit : {"N*m", "A"}
        Currents have gains of their own, which are estimated first: units are not judged then.

    Returns
    -------
    list of Finding
        At most one, an error or a warning; `file` is a run's name.
    """
    from threadpoolctl import threadpool_limits

    with threadpool_limits(limits=1, user_api="blas"):
        bench = Bench(Arm.of(robot), tuple(ArmRows.of(states) for states in runs))
        declared, names = declares_inertia(robot), [states.name for states in runs]
        if torque_unit == "N*m":
            return _likeliest(_candidates(bench, names, gravity_trial, sized=True, declared=declared))
        if not declared:
            return []  # neither gains nor links are known: nothing says how large, or of what sign, a torque has to be
        [(fit, gains)] = unit_fits([bench])
        scaled = Bench(bench.arm, tuple(replace(rows, tau=rows.tau * gains) for rows in bench.rows))

        def turned(_: Bench) -> tuple[Trial, FloatArray]:
            # Under another gravity other gains are likely; densities are those of the scaled torque, like the others'.
            return gravity_trial(bench, lambda others: [_less(own, fit, scaled.fit) for own, _ in unit_fits(others)])

        return _likeliest(_candidates(scaled, names, turned, sized=False, declared=True))


def _less(fit: ArmFit, recorded: ArmFit, scaled: ArmFit) -> ArmFit:
    """A fit whose density is brought from the unit that was recorded to another: one fit has been made in both."""
    return replace(fit, log=fit.log - recorded.log + scaled.log)


def _likeliest(candidates: Iterable[tuple[Trial, Finding]]) -> list[Finding]:
    said = [(trial.fit.log, finding) for trial, finding in candidates]
    best = max((log for log, _ in said), default=0.0)
    return [finding for log, finding in said if log == best]


def _candidates(
    bench: Bench,
    names: Sequence[str],
    turned: Callable[[Bench], tuple[Trial, FloatArray]],
    *,
    sized: bool,
    declared: bool,
) -> Iterator[tuple[Trial, Finding]]:
    """Changes that leave no doubt that the runs are not what they are called, each with its finding.

    `sized`: torques are in N m, or so it is said. `declared`: the robot file says what the links are like.
    """
    judged = sized and declared
    changes: list[Callable[[], Iterator[tuple[Trial, Finding]]]] = [lambda: _late(bench, names)]
    # Gains that the runs themselves tell say nothing of a unit: a run of little motion would have another one.
    if sized and (declared or len(names) > 1):
        changes.insert(0, lambda: _units(bench, names, judged=declared))
    if float(np.max(bench.fit.run_shares)) > UNEXPLAINED:
        changes[:0] = [
            lambda: _wired(bench, names),
            lambda: _loaded(bench, names, judged=judged),
            lambda: _mounted(bench, names, turned, signed=declared),
        ]
    return chain.from_iterable(side_by_side(lambda change: list(change()), changes))


def _loaded(bench: Bench, names: Sequence[str], *, judged: bool) -> Iterator[tuple[Trial, Finding]]:
    for trial in payload_trials(bench) if len(names) > 1 else ():
        if not _clear(bench, trial):
            continue
        # A load of all runs that the robot file lacks is no difference between them.
        gained, mass = beside_a_common_load(bench, trial.runs[0])
        if gained > ENOUGH and (len(names) > 2 or mass > 0):
            yield trial, words.payload(trial, names, mass if judged else None)


def _mounted(
    bench: Bench, names: Sequence[str], turned: Callable[[Bench], tuple[Trial, FloatArray]], *, signed: bool
) -> Iterator[tuple[Trial, Finding]]:
    trial, gravity = turned(bench)
    if _clear(bench, trial) and is_another(gravity, np.asarray(bench.robot.gravity)):
        yield trial, words.mounting(bench, trial, names, gravity, signed=signed)


def _wired(bench: Bench, names: Sequence[str]) -> Iterator[tuple[Trial, Finding]]:
    trials = [trial for trial in wiring_trials(bench) if _clear(bench, trial) and _makes_sense(trial)]
    if trials:
        best = max(trials, key=lambda trial: trial.fit.log)
        for finding in words.wiring(bench, best, names):
            yield best, finding


def _units(bench: Bench, names: Sequence[str], *, judged: bool) -> Iterator[tuple[Trial, Finding]]:
    for trial, gains, alone in unit_trials(bench):
        whole = len(trial.runs) == len(names)
        if whole and not judged:
            continue
        # Whether one gain for all is a unit, only the robot file's masses say: no likelihood does.
        typical = float(np.median(gains))
        explained = bool(np.median(trial.fit.share) < EXPLAINED)
        if not explained or 1 / UNIT < typical < UNIT:
            continue
        # Of one joint a load may be the reason as well: what slides has inertia as of a rotor, and says neither.
        if not alone or trial.fit.log - carried(bench, trial.runs).log > ENOUGH:
            yield trial, words.unit(bench, trial, names, gains)


def _late(bench: Bench, names: Sequence[str]) -> Iterator[tuple[Trial, Finding]]:
    steepness = np.median([rows.steepness for rows in bench.rows], axis=0)
    found = []
    for lag in lags(bench, ENOUGH):
        late = np.isin(np.arange(len(steepness)), lag.trial.joints)
        # A sensor's noise may fall off by itself: that of channels in time says how much.
        usual = min(1.0, float(np.median(steepness[~late]))) if not late.all() else 1.0
        steep = bool(np.median(steepness[late]) < STEEP * usual)
        if _clearly_late(lag, steep=steep):
            # Where all are late nothing says how their noise falls off: what they make of the motion has to.
            filtered = steep and (not late.all() or lag.filter_gain() > ENOUGH)
            found.append((lag, steep, filtered))
    if not found:
        return
    best, steep, filtered = max(found, key=lambda one: one[0].trial.fit.log)
    # Other changes are tried without losses of gears: what a delay gains counts, on the scale of theirs.
    fit = replace(best.trial.fit, log=bench.fit.log + best.trial.fit.log - best.in_time.log)
    yield replace(best.trial, fit=fit), words.late(bench, best, names, steep=steep, filtered=filtered)


def _clearly_late(lag: Lag, *, steep: bool) -> bool:
    joints, gained = list(lag.trial.joints), lag.trial.fit.log - lag.in_time.log
    ratio = lag.in_time.share[joints] / np.maximum(lag.trial.fit.share[joints], 1e-300)
    # Drives share a clock; what lags on one joint alone is rather a gear that yields.
    clearly = CLEARLY_LATE if len(joints) > 1 else CLEARLY
    if gained <= ENOUGH or abs(lag.delay) <= LEAST_LATE or float(np.median(ratio)) <= clearly:
        return False
    # Friction that remembers looks late too, but its noise does not fall off.
    return steep or lag.links_log() - lag.in_time.log > ENOUGH


def _makes_sense(trial: Trial) -> bool:
    """Whether a change explains its own joints: one that it makes unlike any torque leaves the links to the others."""
    own = trial.fit.run_shares[np.ix_(trial.runs, trial.joints)]
    return bool(np.median(own) < EXPLAINED)


def _clear(bench: Bench, trial: Trial) -> bool:
    """Whether a change explains most of what is not explained without it in the runs it is of, and is worth it."""
    rows = list(trial.runs)
    before, after = bench.fit.run_shares[rows], trial.fit.run_shares[rows]
    ratio = before / np.maximum(after, 1e-300)
    concerned = before > UNEXPLAINED
    gained = trial.fit.log - bench.fit.log > ENOUGH
    return bool(gained and np.any(ratio[concerned] > CLEARLY) and np.median(after) < EXPLAINED)
