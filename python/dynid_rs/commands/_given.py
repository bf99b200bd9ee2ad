"""Training and test runs of a command: in memory where they fit, as an archive where they do not."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynid_rs.commands._inputs import check_cutoff, parted_sources, split_read

if TYPE_CHECKING:
    from dynid_rs.archive import Archive, RunFile
    from dynid_rs.archive.work import Work
    from dynid_rs.base.findings import Finding
    from dynid_rs.identification.results import LearnedFrom
    from dynid_rs.runs.readers import Config
    from dynid_rs.runs.recording import Recording


@dataclass
class Given:
    """What a command learns from and tests on.

    `train`: the training runs; with an `archive`, the sample of them that memory holds.
    """

    train: list[Recording]
    test: list[Recording]
    findings: list[Finding] = field(default_factory=list)
    archive: Archive | None = None

    def fit(
        self, identifier: Any, slow: list[Recording] | None, say: Callable[[str], None]
    ) -> tuple[Any, LearnedFrom | None]:
        """Fitted identifier, and what it has learned from where that is more than `train`; adds to the findings."""
        if self.archive is None:
            return identifier.fit(self.train, slow, on_progress=say), None
        from dynid_rs.identification.results import LearnedFrom

        learned = self.archive.fit(identifier, self.train, slow)
        self.findings += learned.findings
        whole = LearnedFrom(self.archive.names, self.archive.n_samples, learned.n_dropped, learned.rmse)
        return learned.identifier, whole


def opened_work(cache: Path | None, jobs: int) -> Work:
    """Where units of work are done and kept; refuses a folder that cannot be written before any work is done."""
    from dynid_rs.archive.cache import Cache
    from dynid_rs.archive.work import Work
    from dynid_rs.commands._output import check_folder

    if jobs < 1 and jobs != -1:
        raise ValueError(f"--jobs must be at least 1, or -1 for one per core, found {jobs}")
    if cache is None:
        return Work(n_jobs=jobs)
    check_folder(cache, [])
    held = Cache(cache)
    held.sweep()
    return Work(held, jobs)


def read_given(
    runs: list[Path],
    test: list[Path],
    test_from: float | None,
    robot: Any,
    settings: Config,
    *,
    memory: int,
    cutoff: float | None,
    say: Callable[[str], None],
    work: Work,
) -> Given:
    """Read, check and split; runs that do not fit into `memory` [bytes] are surveyed and sampled.

    Raises
    ------
    DataError, OSError, ValueError
        As `split_runs` and `Archive` do; a lone run or test runs that do not fit.
    """
    train, tested = parted_sources(runs, test, robot, settings)
    sources = [*train, *tested]
    held = _read_within(sources, memory)
    if held is None:
        return _survey(sources, len(train), test_from, memory, cutoff, say, work)
    recordings, findings = held
    split, said = split_read(recordings[: len(train)], recordings[len(train) :], test_from, cutoff)
    return Given(split.train, split.test, findings + said)


def _read_within(sources: Sequence[RunFile], memory: int) -> tuple[list[Recording], list[Finding]] | None:
    """All runs and their findings; None as soon as identification from them would take more than `memory`."""
    from dynid_rs.archive.archive import fits

    recordings: list[Recording] = []
    findings: list[Finding] = []
    for source in sources:
        recording, found = source.read()
        recordings.append(recording)
        findings += found
        if not fits(recordings, memory):
            return None
    return recordings, findings


def _survey(
    sources: list[RunFile],
    n_runs: int,
    test_from: float | None,
    memory: int,
    cutoff: float | None,
    say: Callable[[str], None],
    work: Work,
) -> Given:
    from dynid_rs.archive import Archive
    from dynid_rs.archive.archive import fits
    from dynid_rs.archive.sample import content_key
    from dynid_rs.identification.training import parts_in_motion
    from dynid_rs.runs.checks.clocks import Clock, check_clocks
    from dynid_rs.runs.splitting import last_run_kept, refuse_another_kind

    train, tests = sources[:n_runs], sources[n_runs:]
    if not tests and n_runs == 1:
        raise ValueError(
            f"{train[0].name}: this run alone needs more work space than --memory allows; raise --memory, or split "
            "it into several files"
        )
    if test_from is not None:
        raise ValueError(
            "--test-from cuts a lone run; with --test or several runs there is nothing to cut, leave it out"
        )
    chosen = []
    if not tests:
        *train, last = train
        tests, chosen = [last], [last_run_kept(last.name)]
    read = [source.read() for source in tests]
    test = [recording for recording, _ in read]
    if not fits(test, memory):
        raise ValueError(
            "the test runs need more work space than --memory allows, and they are not streamed; test on fewer runs, "
            "or raise --memory"
        )
    check_cutoff(cutoff, test)
    archive = Archive(train[0].robot, train, memory=memory, work=work, on_progress=say)
    archive.check({content_key(recording): recording.name for recording in test})
    archive.refuse_overlaps(test)
    check_clocks([*(survey.facts.clock for survey in archive.surveys), *map(Clock.of, test)])
    for recording in test:
        refuse_another_kind(archive.surveys[0].facts, recording)
    sample = archive.sample(cutoff)
    found = [finding for _, findings in read for finding in findings]
    # Of the training runs every part is looked at when it is reduced.
    names = {recording.name for recording in test}
    _, test, said = parts_in_motion(sample, test, cutoff)
    found += [finding for finding in said if finding.file in names]
    return Given(sample, test, [*archive.findings(), *found, *chosen, archive.described(sample)], archive)
