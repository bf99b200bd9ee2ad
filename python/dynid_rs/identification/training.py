"""What is learned from: the states of runs with enough motion in them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.errors import DataError
from dynid_rs.base.findings import Finding
from dynid_rs.model.known import KnownTerm
from dynid_rs.regression.kept_columns import kept_answer
from dynid_rs.runs.parts import is_part
from dynid_rs.runs.preprocessing import TOO_LITTLE, Band, States, choose_band, common_rate, prepare, without
from dynid_rs.runs.recording import Delay, Recording

FloatArray = NDArray[np.float64]

LEAST_TEST_ROWS = 20
"""Fewer rows of a test run say nothing."""
Excluded = Mapping[str, Sequence[tuple[float, float]]]
"""Name of a run to the windows (start, end) [s] in which something from outside acts."""
LEAST_ROWS = 20
"""Rows of the fit that a run has to have in motion."""


@dataclass(frozen=True, eq=False)
class TrainingData:
    """What is learned from: states of the training runs as recorded, of slow runs, and what is known beside them.

    `torque_delay` [s] of the torque channels was taken out of the runs; `standstill`: pauses are fitted too. `known`
    terms (`model/known.py`); `torque_unit` of all runs; `rate` [Hz] of the grid that `band` is applied on.
    """

    runs: list[States]
    slow_runs: list[States]
    known: list[KnownTerm]
    torque_unit: str
    rate: float
    band: Band
    torque_delay: Delay = 0.0
    standstill: bool = False

    @property
    def in_ampere(self) -> bool:
        """Whether the joints' relative drive gains are unknowns too."""
        return self.torque_unit == "A"


def prepare_training_data(
    recordings: Sequence[Recording],
    slow: Sequence[Recording],
    known: list[KnownTerm],
    cutoff: float | None,
    excluded: Excluded | None = None,
    *,
    torque_delay: Delay = 0.0,
    standstill: bool = False,
) -> TrainingData:
    """States of checked runs in one band: `cutoff` [Hz], or chosen from the motion; `excluded` windows by run name.

    Torque is brought to the encoders' clock: `torque_delay` [s] earlier.

    Raises
    ------
    DataError
        Too little motion is left in a training run after standstill is taken out.
    """
    rate = common_rate(list(recordings))
    band = Band(cutoff) if cutoff is not None else choose_band(list(recordings))
    runs = prepare_training_runs(recordings, band, rate, excluded, torque_delay=torque_delay, standstill=standstill)
    slow_runs = [on_time(recording, band, rate, torque_delay) for recording in slow]
    return TrainingData(
        runs, slow_runs, known, recordings[0].torque_unit, rate, band, torque_delay=torque_delay, standstill=standstill
    )


def check_motion(runs: Sequence[States]) -> None:
    """Refuse test runs with hardly any motion.

    Raises
    ------
    DataError
        A run of which next to nothing is left after standstill is taken out.
    """
    for states in runs:
        if len(states.rows) < LEAST_TEST_ROWS:
            seconds = len(states.rows) * states.step / states.rate
            raise states.band.too_little(
                states.name,
                f"only {seconds:.3g} s of motion are left to test on after standstill is taken out",
                "test on a longer motion",
            )


def parts_in_motion(
    train: Sequence[Recording], test: Sequence[Recording], cutoff: float | None
) -> tuple[list[Recording], list[Recording], list[Finding]]:
    """Runs without the parts (`runs/parts.py`) in which too little moves to learn from or to test on; which were left.

    Whole runs stay, and where nothing else would be left parts do too: for them it is said as an error.
    """
    if not any(is_part(recording.name) for recording in (*train, *test)):
        return list(train), list(test), []
    rate = common_rate(list(train))
    band = Band(cutoff) if cutoff is not None else choose_band(list(train))
    said: list[Finding] = []

    def moving(recordings: Sequence[Recording], look: Callable[[Recording], object]) -> list[Recording]:
        kept = []
        for recording in recordings:
            try:
                if is_part(recording.name):
                    look(recording)
            except DataError as error:
                if error.code != TOO_LITTLE:
                    raise
                said.append(part_left_out(str(error), recording.name))
            else:
                kept.append(recording)
        return kept or list(recordings)

    learned = moving(train, lambda recording: prepare_training_run(recording, band, rate))
    tested = moving(test, lambda recording: check_motion([prepare(recording, band, rate)]))
    return learned, tested, [f for f in said if f.file not in {r.name for r in (*learned, *tested)}]


def part_left_out(why: str, name: str) -> Finding:
    """Say that nothing is learned from a part of a run, or tested on it."""
    return Finding("long_gap", "info", f"{why}; this part is left out", name)


def prepare_training_runs(
    recordings: Sequence[Recording],
    band: Band,
    rate: float,
    excluded: Excluded | None = None,
    *,
    torque_delay: Delay = 0.0,
    standstill: bool = False,
) -> list[States]:
    """States of the runs in `band` at `rate` [Hz], without the windows [s] of `excluded`.

    Torque is brought to the encoders' clock, `torque_delay` [s] earlier.

    Raises
    ------
    DataError
        Too little motion is left in a run after standstill is taken out.
    """
    windows = excluded or {}
    return [
        prepare_training_run(
            recording,
            band,
            rate,
            windows.get(recording.name, ()),
            torque_delay=torque_delay,
            standstill=standstill,
        )
        for recording in recordings
    ]


def prepare_training_run(
    recording: Recording,
    band: Band,
    rate: float,
    excluded: Sequence[tuple[float, float]] = (),
    *,
    torque_delay: Delay = 0.0,
    standstill: bool = False,
) -> States:
    """`prepare_training_runs` of one run, less its `excluded` windows [s]; while a diagnosis goes on it is kept."""
    made_of = band.cutoff, rate, tuple(excluded), tuple(np.atleast_1d(torque_delay).tolist()), standstill
    states = kept_answer(
        ("states", recording),
        made_of,
        lambda: without(on_time(recording, band, rate, torque_delay, standstill=standstill), excluded),
    )
    if len(states.rows) < LEAST_ROWS:
        raise band.too_little(
            states.name,
            f"only {len(states.rows) * states.step / states.rate:.3g} s of motion are left "
            f"after standstill {'and what was excluded ' if excluded else ''}and "
            f"{1 / band.cutoff:.2g} s (1/cutoff) beside it and at both ends are taken out",
            "record a longer motion, or raise the cutoff",
        )
    return states


def on_time(recording: Recording, band: Band, rate: float, torque_delay: Delay, *, standstill: bool = False) -> States:
    """States of a run whose torque channels are `torque_delay` [s] late, with its torque on the encoders' clock."""
    states = prepare(recording.less_torque_delay(torque_delay), band, rate, standstill=standstill)
    return states.less_delay(torque_delay)
