"""What is learned from and what is kept aside, decided before anything is filtered."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynid_rs.base.errors import DataError
from dynid_rs.base.findings import Finding
from dynid_rs.runs.checks.clocks import Clock, check_clocks
from dynid_rs.runs.checks.repeats import Keys, common_rows, row_keys
from dynid_rs.runs.facts import RunFacts
from dynid_rs.runs.parts import whole_name
from dynid_rs.runs.recording import Recording

LAST_PART = 1 / 3
"""Part of a lone run's motion that is kept aside."""
AT_REST, GLANCE = 0.02, 0.1
"""Speed over the greatest below which an arm rests, and the time [s] over which it is told, so that noise is none."""


@dataclass(frozen=True)
class Split:
    """Training and test runs; `finding` says how they were chosen where the user did not."""

    train: list[Recording]
    test: list[Recording]
    finding: Finding | None = None


def split_runs(runs: Sequence[Recording], test: Sequence[Recording], test_from: float | None = None) -> Split:
    """Split by the user's word, else keep the last whole run aside, else the last third of a lone run's motion.

    Parameters
    ----------
    runs, test : sequence of Recording
        Runs to learn from, and runs to test on (may be empty).
    test_from : float, optional
        With one run and no test run: seconds after its start from which it is kept aside.

    Raises
    ------
    ValueError
        There is no run to learn from; `test_from` with several runs or with test runs, or outside of the run.
    DataError
        The time of a run is in another unit; a run is there twice, under whatever name; or a test run holds other
        signals than the training runs.
    """
    if not runs:
        raise ValueError("no run is given to learn from; give at least one")
    if test_from is not None and (test or len(runs) != 1):
        raise ValueError(
            "--test-from cuts a lone run; with --test or several runs there is nothing to cut, leave it out"
        )
    check_clocks([Clock.of(recording) for recording in (*runs, *test)])
    refuse_repeats(runs, test)
    if test:
        for recording in test:
            refuse_another_kind(runs[0], recording)
        return Split(list(runs), list(test))
    if len(runs) > 1:
        *train, last = runs
        refuse_another_kind(train[0], last)
        return Split(train, [last], last_run_kept(last.name))
    return _cut(runs[0], test_from)


def _cut(run: Recording, test_from: float | None) -> Split:
    start = _last_part(run) if test_from is None else test_from
    if not 0 < start < run.duration:
        raise ValueError(
            f"{run.name}: --test-from must lie inside the run (0 to {run.duration:.3g} s), found {start:g}"
        )
    row = int(np.searchsorted(run.t, run.t[0] + start))
    message = (
        f"there is one run; its first {start:.3g} s were learned from and the rest was kept aside for "
        "testing. A second run would test more"
    )
    first = replace(run, name=f"{run.name} (first {start:.3g} s)").slice(None, row)
    rest = replace(run, name=f"{run.name} (after {start:.3g} s)", before=first).slice(row, None)
    return Split([first], [rest], Finding("test_part_chosen", "info", message, file=run.name, value=start, unit="s"))


def _last_part(run: Recording) -> float:
    """Seconds after its start from which the last part of a run is, or of its motion: an end at rest tests nothing."""
    half, row = max(1, round(GLANCE * run.rate / 2)), np.arange(run.n_samples)
    ahead, behind = np.minimum(row + half, run.n_samples - 1), np.maximum(row - half, 0)
    speed = np.linalg.norm(run.q[ahead] - run.q[behind], axis=1)
    moves = np.cumsum(speed > AT_REST * speed.max(initial=0.0))
    start = run.duration * (1 - LAST_PART)
    last = moves[-1] - moves[np.searchsorted(run.t, run.t[0] + start)]
    if last >= LAST_PART / 2 * moves[-1]:
        return start
    return float(run.t[np.searchsorted(moves, moves[-1] * (1 - LAST_PART))] - run.t[0])


def refuse_repeats(runs: Sequence[Recording], test: Sequence[Recording]) -> None:
    """Refuse samples that are there twice: the test would be an exam with known answers, intervals too narrow."""
    seen: list[tuple[Recording, bool, Keys]] = []
    for recording, is_test in [*((run, False) for run in runs), *((run, True) for run in test)]:
        keys = row_keys(recording)
        for earlier, was_test, of_earlier in seen:
            rows = common_rows(earlier, recording, (of_earlier, keys))
            if rows is not None:
                if recording.name != earlier.name and whole_name(recording.name) == whole_name(earlier.name):
                    raise written_twice(recording, rows)
                part = None if rows[1] - rows[0] >= recording.n_samples else rows
                raise repeated(recording.name, earlier.name, is_test=is_test, was_test=was_test, rows=part)
        seen.append((recording, is_test, keys))


def written_twice(part: Recording, rows: tuple[int, int]) -> DataError:
    """Error that `rows` of a part of a run are in an earlier part of it too."""
    first, last = (part.first_row + row for row in rows)
    return DataError(
        f"{whole_name(part.name)}: time goes back, and what follows was written before: rows {first + 1} to {last} are "
        "there twice; cut them out",
        code="time_stands_still",
        file=whole_name(part.name),
        column="t",
        row=first,
    )


def repeated(
    name: str, earlier: str, *, is_test: bool, was_test: bool, rows: tuple[int, int] | None = None
) -> DataError:
    """Error that the run `name`, or these `rows` of it, holds samples of the run `earlier`."""
    names = name if name == earlier else f"{name} ({earlier})"
    if rows is not None:
        names = f"{name}, rows {rows[0] + 1} to {rows[1]} (of {earlier})"
    if is_test and not was_test:
        text = "is both learned from and tested on; name it once, and test on another run"
    else:
        text = f"is given twice {'to test on' if is_test else 'to learn from'}; name it once"
    return DataError(f"{names} {text}", code="run_twice", file=name, row=None if rows is None else rows[0])


def last_run_kept(name: str) -> Finding:
    """Say that the last run is not learned from."""
    message = f"no test run was named; {name}, the last one, was kept aside for testing"
    return Finding("test_run_chosen", "info", message, file=name)


def refuse_another_kind(train: Recording | RunFacts, test: Recording) -> None:
    """Refuse to test a model in ampere on newton metres, or one of two encoders on one."""
    if train.torque_unit != test.torque_unit:
        raise DataError(
            f"{test.name} holds torque in {test.torque_unit} and {train.name} in {train.torque_unit}; "
            "test on runs of one kind, or give the drive gains",
            code="mixed_runs",
            file=test.name,
        )
    if train.has_motor_encoder != test.has_motor_encoder:
        both, one = (train, test) if train.has_motor_encoder else (test, train)
        raise DataError(
            f"{both.name} holds motor and link positions and {one.name} only one of them; "
            "test on runs of one kind, or leave q_motor out in dynid.toml: [columns] q_motor = false",
            code="mixed_runs",
            file=test.name,
        )
