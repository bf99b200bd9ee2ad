"""More runs than memory holds: survey, sample, loops on the sample, reduction of all, linear fits on all."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.archive.overlaps import marks_of, suspects
from dynid_rs.archive.reduction import LEFT_OUT, Reduced, Reduction, Totals, reduce_run
from dynid_rs.archive.runs import RunSource, signals_of
from dynid_rs.archive.sample import choose_pieces, cut_out, recording_bytes, work_space
from dynid_rs.archive.settle import settled
from dynid_rs.archive.survey import Survey, check_surveys, gathered_findings, survey_run
from dynid_rs.archive.work import Work
from dynid_rs.base.errors import DataError
from dynid_rs.base.findings import Finding
from dynid_rs.identification.three_loops import ThreeLoopIdentifier
from dynid_rs.identification.training import LEAST_ROWS, part_left_out, prepare_training_run
from dynid_rs.runs.preprocessing import Band, choose_band, common_rate
from dynid_rs.runs.recording import Recording
from dynid_rs.runs.splitting import refuse_repeats

FloatArray = NDArray[np.float64]


def _silent(words: str) -> None:
    """Say nothing."""


@dataclass(frozen=True, eq=False)
class Learned:
    """What an archive gave.

    `identifier`: fitted; linear parts to all runs, shapes and third loop to `sample`. `n_dropped`, `rmse` (n_joints,)
    [torque unit]: samples at rest in all runs, and the model's error on all of them. `findings`: on the work itself.
    """

    identifier: ThreeLoopIdentifier
    sample: list[Recording]
    n_dropped: int
    rmse: FloatArray
    findings: list[Finding]


class Archive:
    """Training runs that are read when they are needed.

    Parameters
    ----------
    robot : RobotModel
        The arm.
    sources : sequence of RunSource
        One per run; their order is that of the sums.
    memory : int
        Bytes that identification may take: what the sample is cut to. A run that alone needs more is refused.
    work : Work, optional
        Where units of work are done and kept; one after the other and nowhere by default.
    on_progress : callable
        Called with a few words while it works.

    Attributes
    ----------
    surveys : list of Survey
        What every run holds.
    """

    def __init__(
        self,
        robot: _core.RobotModel,
        sources: Sequence[RunSource],
        *,
        memory: int,
        work: Work | None = None,
        on_progress: Callable[[str], None] = _silent,
    ) -> None:
        if not sources:
            raise ValueError("no run to learn from; give at least one")
        self.robot, self.sources, self.memory = robot, list(sources), memory
        self._work = Work() if work is None else work
        self._say = on_progress
        units = self._work.map(survey_run, self.sources)
        self.surveys: list[Survey] = []
        for entry in units:
            self.surveys.append(Survey.from_entry(entry))
            self._say(f"reading: {len(self.surveys)} of {len(self.sources)} runs")
        self._check_sizes()

    def _check_sizes(self) -> None:
        for survey in self.surveys:
            if survey.work_space > self.memory:
                raise DataError(
                    f"{survey.facts.name}: this run alone needs {survey.work_space / 1e9:.2g} GB of work "
                    f"space and the limit is {self.memory / 1e9:.2g} GB; raise --memory, or split the run",
                    code="run_too_large",
                    file=survey.facts.name,
                )

    def check(self, tested: Mapping[str, str] | None = None) -> None:
        """Refuse runs that do not belong together; `tested`: content key to name of the test runs.

        Raises
        ------
        DataError
            As `check_training_runs`; a run that is there twice.
        """
        check_surveys(self.robot, self.surveys, tested or {})

    def refuse_overlaps(self, test: Sequence[Recording]) -> None:
        """Refuse samples that are there twice, in these runs and the test runs; two runs that seem to are read again.

        Raises
        ------
        DataError
            As `refuse_repeats`.
        """
        refuse_repeats([], test)
        n = len(self.surveys)
        for pair in suspects([*(survey.marks for survey in self.surveys), *map(marks_of, test)]):
            runs = [signals_of(self.sources[k]) for k in pair if k < n]
            refuse_repeats(runs, [test[k - n] for k in pair if k >= n])

    @property
    def names(self) -> list[str]:
        """Of all runs."""
        return [survey.facts.name for survey in self.surveys]

    @property
    def n_samples(self) -> int:
        """Of all runs."""
        return sum(survey.n_samples for survey in self.surveys)

    def findings(self) -> list[Finding]:
        """What the checks found, the first of every kind and how many more."""
        return gathered_findings([finding for survey in self.surveys for finding in survey.findings])

    def sample(self, cutoff: float | None = None, *, standstill: bool = False) -> list[Recording]:
        """Pieces of runs for what needs samples (`sample.py`), half of the memory at most; at least one.

        Raises
        ------
        DataError
            No piece holds motion.
        """
        places = [(k, piece) for k, survey in enumerate(self.surveys) for piece in survey.pieces]
        chosen = choose_pieces([piece for _, piece in places], self.memory // 2)
        recordings: list[Recording] = []
        for k, group in groupby((places[i] for i in chosen), key=lambda place: place[0]):
            self._say(f"sample: {self.surveys[k].facts.name}")
            recording = signals_of(self.sources[k])
            whole = len(self.surveys[k].pieces) == 1
            recordings += [recording if whole else cut_out(recording, piece) for _, piece in group]
        band = Band(cutoff) if cutoff is not None else choose_band(recordings)
        moving = [part for part in recordings if _moves(part, band, common_rate(recordings), standstill)]
        if not moving:
            raise DataError(
                f"{self.names[0]} and {len(self.names) - 1} more runs: no part of them holds enough motion to learn "
                "from; record a longer motion, or raise the cutoff",
                code="too_little_motion",
                file=self.names[0],
            )
        return moving

    def fit(self, identifier: ThreeLoopIdentifier, sample: list[Recording], slow: list[Recording] | None) -> Learned:
        """Run the loops over the sample, then fit all that is linear to all runs.

        Parts of runs (`runs/parts.py`) with too little motion are left out, of `surveys` too.

        Parameters
        ----------
        identifier : ThreeLoopIdentifier
            Not fitted yet.
        sample : list of Recording
            As `sample` gave it.
        slow : list of Recording or None
            The friction experiment; held in memory.

        Raises
        ------
        DataError
            As `ThreeLoopIdentifier.fit`; a run with too little motion.
        ValueError
            A prior, which is weighed against rows in time.
        """
        self._refuse_prior(identifier)
        identifier.fit(sample, slow, on_progress=lambda words: self._say(f"sample, {words}"))
        reduction = Reduction.of(identifier)
        totals, kept, left_out = Totals(reduction), list[int](), list[Finding]()
        for k, entry in enumerate(self._work.map(reduce_run, self.sources, reduction)):
            if (why := entry[0].get(LEFT_OUT)) is None:
                totals.add(Reduced.from_entry(entry))
                kept.append(k)
            else:
                left_out.append(part_left_out(why, self.names[k]))
            self._say(f"reducing: {k + 1} of {len(self.sources)} runs")
        self.surveys, self.sources = [self.surveys[k] for k in kept], [self.sources[k] for k in kept]
        whole, rmse = settled(identifier, totals)
        return Learned(whole, sample, totals.n_dropped, rmse, gathered_findings(left_out) + self._work.findings())

    def _refuse_prior(self, identifier: ThreeLoopIdentifier) -> None:
        if identifier.links is not None and identifier.links.prior == "robot":
            raise ValueError(
                "a prior is weighed against rows in time, and these runs are more than memory holds; leave --prior "
                "robot out (so much data speaks for itself), or raise --memory"
            )

    def described(self, sample: Sequence[Recording]) -> Finding:
        """One sentence on what was fitted to what."""
        held = sum(recording_bytes(recording) for recording in sample)
        total = sum(survey.n_bytes for survey in self.surveys)
        message = (
            f"{len(self.surveys)} runs ({total / 1e9:.3g} GB of signals) are more than the memory limit of "
            f"{self.memory / 1e9:.3g} GB holds: all linear coefficients and their standard errors come from all of "
            f"them, the shapes of friction, the third loop, the delay of the encoders and the test for bias from a "
            f"sample of {100 * held / total:.3g} % ({len(sample)} pieces)"
        )
        return Finding("streamed", "info", message, value=100 * held / total, unit="%")


def fits(recordings: Sequence[Recording], memory: int) -> bool:
    """Whether identification from these runs stays within `memory` [bytes]."""
    return sum(work_space(recording) for recording in recordings) <= memory


def _moves(recording: Recording, band: Band, rate: float, standstill: bool) -> bool:
    try:
        states = prepare_training_run(recording, band, rate, standstill=standstill)
    except ValueError:  # too short for the band, or too little motion
        return False
    return len(states.rows) >= LEAST_ROWS
