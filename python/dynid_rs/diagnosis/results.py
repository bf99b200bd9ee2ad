"""From a finished diagnosis to `result.json` and `residuals.parquet`: those of identify, and before beside after."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from dynid_rs import results
from dynid_rs.diagnosis.plausibility import implausible
from dynid_rs.diagnosis.setup import Setup, Windows
from dynid_rs.diagnosis.wording import next_experiments, verdict
from dynid_rs.encoders import with_fitted_delay
from dynid_rs.evaluation import rmse_interval
from dynid_rs.findings import Finding
from dynid_rs.identification import ThreeLoopIdentifier
from dynid_rs.preprocessing import States
from dynid_rs.recording import Recording
from dynid_rs.results import Evaluated, Scores

FloatArray = NDArray[np.float64]
Entry = Mapping[str, Any]


class FloorEstimate(Protocol):
    """What no model of the states can remove, per joint."""

    @property
    def values(self) -> FloatArray:
        """Root mean square in the band, (n_joints,) [torque unit]; NaN where it cannot be seen."""

    @property
    def intervals(self) -> FloatArray:
        """95 %, (n_joints, 2)."""

    @property
    def method(self) -> str | Sequence[str]:
        """How it was measured, in a few words; for all joints or one per joint."""


class Outcome(Protocol):
    """What the search for effects leaves behind."""

    @property
    def setup(self) -> Setup:
        """The declared model with what was found."""

    @property
    def before(self) -> ThreeLoopIdentifier:
        """Fitted as `dynid identify` does."""

    @property
    def after(self) -> ThreeLoopIdentifier:
        """Fitted with the effects; its model is saved."""

    @property
    def findings(self) -> Sequence[Finding]:
        """On sensors, clocks and contact."""

    @property
    def effects(self) -> Sequence[Entry]:
        """Entries of `result.json`, most useful first."""

    @property
    def unknown_effects(self) -> Sequence[Entry]:
        """Entries of kind `unknown`, with `depends_on`."""

    @property
    def unexplained(self) -> Sequence[Entry]:
        """Entries of `result.json`."""

    @property
    def floor(self) -> FloorEstimate:
        """Of the test runs."""

    @property
    def steps(self) -> Sequence[Entry]:
        """What was added or dropped, in order, and the error then."""


@dataclass(frozen=True, eq=False)
class EvaluatedRuns:
    """Every run under the declared model and under the one with effects, at the same rows."""

    train_before: list[Evaluated]
    test_before: list[Evaluated]
    train_after: list[Evaluated]
    test_after: list[Evaluated]


def evaluated(outcome: Outcome, train: Sequence[Recording], test: Sequence[Recording]) -> EvaluatedRuns:
    """Predict every run with both models; what lies in an excluded window is scored by neither."""
    before, after = outcome.before, outcome.after

    def both(recordings: Sequence[Recording]) -> tuple[list[Evaluated], list[Evaluated]]:
        corrected = [outcome.setup.corrected(recording) for recording in recordings]
        plain = [before.states(recording) for recording in recordings]
        mended = [after.states(recording) for recording in corrected]
        for k, recording in enumerate(recordings):
            windows = outcome.setup.excluded.get(recording.name, ())
            plain[k], mended[k] = _outside(plain[k], mended[k], windows)
        return (
            results.evaluate_runs(before.model_, recordings, plain),
            results.evaluate_runs(after.model_, corrected, mended),
        )

    (train_before, train_after), (test_before, test_after) = both(train), both(test)
    return EvaluatedRuns(train_before, test_before, train_after, test_after)


def _outside(plain: States, mended: States, windows: Windows) -> tuple[States, States]:
    """The same run twice, without what lies in the windows [s] or stands still in either."""
    moving = plain.moving & mended.moving if len(plain.t) == len(mended.t) else mended.moving
    for start, end in windows:
        moving = moving & ~((mended.t >= start) & (mended.t <= end))
    plain = replace(plain, moving=moving) if len(plain.t) == len(moving) else plain
    return plain, replace(mended, moving=moving)


def summarise_diagnosis(outcome: Outcome, runs: EvaluatedRuns, findings: Sequence[Finding]) -> dict[str, Any]:
    """Content of `result.json`: what `dynid identify` says of the model with effects, and what was found on the way.

    `findings` are those on the files; the outcome's own follow them.
    """
    before, after = outcome.before, outcome.after
    comparisons = [run.comparison for run in (*runs.train_before, *runs.test_before)]
    said = [*findings, *outcome.findings]
    said += implausible(after.robot, comparisons) if _not_said(said) else []
    said = with_fitted_delay(said, after.encoder_delay_)
    result = results.summarise(after, runs.train_after, runs.test_after, said)
    trained, tested = (Scores([run.comparison for run in part]) for part in (runs.train_before, runs.test_before))
    result["rmse"]["train"]["before"] = trained.rmse
    states = [run.states for run in runs.test_before]
    result["loops"] = results.loops_section(before, states, tested)
    floor = outcome.floor
    result["rmse"]["test"] |= {
        "wls": result["loops"]["test"]["wls"],
        "before": tested.rmse,
        "before_interval": rmse_interval(tested.comparisons),
        "floor": _or_none(floor.values),
        "floor_interval": [None if np.isnan(pair).any() else pair for pair in np.asarray(floor.intervals, float)],
    }
    result["floor_method"] = _method(floor.method)
    effects = [_complete(entry, k + 1) for k, entry in enumerate((*outcome.effects, *outcome.unknown_effects))]
    result |= {
        "effects": effects,
        "unexplained": [{"depends_on": [], **entry} for entry in outcome.unexplained],
        "steps": list(outcome.steps),
        "nothing_to_add": not effects and not outcome.unexplained,
    }
    result = results.plain(result)
    result["next_experiment"] = next_experiments(result)
    result["verdict"] = verdict(result)
    return result


def residual_table(outcome: Outcome, runs: EvaluatedRuns) -> dict[str, NDArray[Any]]:
    """Content of `residuals.parquet`: the model with effects, and what the declared one left, `residual_before_j`."""
    table = results.residual_table(outcome.after.model_, runs.train_after, runs.test_after)
    parts = [run.comparison.error for run in (*runs.train_before, *runs.test_before)]
    left = np.concatenate(parts)
    if len(left) == len(table["t"]):
        table |= {f"residual_before_{j}": np.ascontiguousarray(column) for j, column in enumerate(left.T)}
    return table


def _not_said(findings: Sequence[Finding]) -> bool:
    return all(finding.code not in ("residual_exceeds_torque", "run_unlike_others") for finding in findings)


def _or_none(values: FloatArray) -> list[float | None]:
    return [None if np.isnan(value) else float(value) for value in values]


def _method(method: str | Sequence[str]) -> str:
    """One text; where joints differ, every way once."""
    return method if isinstance(method, str) else "; ".join(dict.fromkeys(method))


def _complete(entry: Entry, rank: int) -> dict[str, Any]:
    """An effect's entry with everything that readers may ask for."""
    return {"parameters": [], "ties": [], "told_apart_from": [], **entry, "rank": rank}
