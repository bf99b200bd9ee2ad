"""From a finished diagnosis to `result.json` and `residuals.parquet`: those of identify, and before beside after."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.findings import Finding
from dynid_rs.diagnosis.open_questions import OpenQuestions
from dynid_rs.diagnosis.plausibility import implausible
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.wording import CONSEQUENCE, next_experiments, verdict
from dynid_rs.excitation.named import NamedEffect, separate_command
from dynid_rs.identification import results
from dynid_rs.identification.results import Evaluated, Scores
from dynid_rs.identification.three_loops import ThreeLoopIdentifier
from dynid_rs.model.placed import CATALOGUE
from dynid_rs.regression.error_interval import change_interval, rmse_interval
from dynid_rs.regression.uncertainty import NORMAL_95
from dynid_rs.runs.encoders import with_fitted_delay
from dynid_rs.runs.preprocessing import States, without
from dynid_rs.runs.recording import Recording

FloatArray = NDArray[np.float64]
Entry = Mapping[str, Any]

CAUSES = ("payload_change", "mounting")
"""Warnings of the runs that explain a model which leaves as much as there is."""
N_POINTS = 400
"""Most points of a plot."""


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
    def entries(self) -> Sequence[Entry]:
        """Effects as entries of `result.json`, most useful first."""

    @property
    def left(self) -> Sequence[Entry]:
        """What is unexplained, as entries of `result.json`."""

    @property
    def steps(self) -> Sequence[Entry]:
        """What was added or dropped, in order, and the error then."""

    @property
    def asked(self) -> OpenQuestions | None:
        """What is open; None where nothing was searched."""

    @property
    def against_reference(self) -> bool:
        """Whether the models are a reference and what it is now, and not those that were fitted."""


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

    windows = outcome.setup.excluded

    def states(fit: ThreeLoopIdentifier, recording: Recording) -> States:
        return without(fit.states(recording), windows.get(recording.name, ()))

    def both(recordings: Sequence[Recording]) -> tuple[list[Evaluated], list[Evaluated]]:
        pairs = [_where_both_move(states(before, each), states(after, each)) for each in recordings]
        return (
            results.evaluate_runs(before.model_, recordings, [plain for plain, _ in pairs]),
            results.evaluate_runs(after.model_, recordings, [mended for _, mended in pairs]),
        )

    (train_before, train_after), (test_before, test_after) = both(train), both(test)
    return EvaluatedRuns(train_before, test_before, train_after, test_after)


def _where_both_move(plain: States, mended: States) -> tuple[States, States]:
    """The same run twice, without what stands still in either."""
    if len(plain.t) != len(mended.t):
        return plain, mended
    moving = plain.moving & mended.moving
    return replace(plain, moving=moving), replace(mended, moving=moving)


def summarise_diagnosis(outcome: Outcome, runs: EvaluatedRuns, findings: Sequence[Finding]) -> dict[str, Any]:
    """Content of `result.json`: what `dynid identify` says of the model with effects, and what was found on the way.

    `findings` are those on the files; the outcome's own follow them.
    """
    before, after = outcome.before, outcome.after
    comparisons = [run.comparison for run in (*runs.train_after, *runs.test_after)]
    said = list(dict.fromkeys([*findings, *outcome.findings]))  # a damaged sample is seen in the file and in the run
    said = _with_consequences(said, implausible(after.robot, comparisons)) if _not_said(said) else said
    said = with_fitted_delay(said, after.encoder_delay_)
    result = results.summarise(after, runs.train_after, runs.test_after, said)
    trained, tested = (Scores([run.comparison for run in part]) for part in (runs.train_before, runs.test_before))
    result["rmse"]["train"]["before"] = trained.rmse
    states = [run.states for run in runs.test_before]
    result["loops"] = results.loops_section(before, states, tested)
    result["rmse"]["test"] |= {
        "wls": result["loops"]["test"]["wls"],
        "before": tested.rmse,
        "before_interval": rmse_interval(tested.comparisons),
        "change_interval": change_interval([run.comparison for run in runs.test_after], tested.comparisons),
    }
    names = result["joints"]
    effects = [complete(entry, k + 1, names) for k, entry in enumerate(outcome.entries)]
    for entry, run in zip(result["rmse"]["by_run"], runs.test_before, strict=True):
        entry["before"] = results.plain(Scores([run.comparison]).rmse)
    result["data"]["excluded"] = {
        run.recording.name: [list(window) for window in outcome.setup.excluded[run.recording.name]]
        for run in (*runs.train_after, *runs.test_after)
        if outcome.setup.excluded.get(run.recording.name)
    }
    _as_told(result["parameters"]["joint"], effects)
    if outcome.against_reference:  # no loop made it, and the fit, which has no third, tells nothing of its parameters
        result["loops"]["test"]["residual"] = result["loops"]["test"]["links"]
        result["covariance"] = None
    result |= {
        "effects": effects,
        "unexplained": [_with_short_plot({"depends_on": [], **entry}) for entry in outcome.left],
        "steps": list(outcome.steps),
        "nothing_to_add": not effects and not outcome.left and all(f.severity != "error" for f in said),
    }
    result = dict(results.plain(result))
    result["next_experiment"] = [*next_experiments(result), *_one_motion(outcome.asked)]
    result["verdict"] = verdict(result)
    return result


def _as_told(rows: Sequence[dict[str, Any]], effects: Sequence[Entry]) -> None:
    """Give coefficients of effects that were found the intervals that are told of them, shapes unknown too."""
    told = {
        (entry.get("told_as") or entry["kind"], number.get("joint", entry["joints"][0]), number["name"]): number
        for entry in effects
        for number in entry["parameters"]
        if entry["joints"]
    }
    for row in rows:
        number = None if row["declared"] else told.get((row["effect"], row["joint"], row["name"]))
        if number is not None and number.get("interval") is not None:
            low, high = number["interval"]
            row |= {"interval": [low, high], "std_error": (high - low) / (2 * NORMAL_95)}


def _one_motion(asked: OpenQuestions | None) -> list[str]:
    """The command that designs one motion for all that is open; none where nothing is."""
    if asked is None or not any(question.is_open for question in asked.questions):
        return []
    return [
        "`dynid excite ROBOT -o next.csv --after DIR`, with the folder of this result, designs the one motion that "
        "decides most of what is open, and says how likely it will."
    ]


def residual_table(outcome: Outcome, runs: EvaluatedRuns) -> dict[str, NDArray[Any]]:
    """Content of `residuals.parquet`: the model with effects, and what the declared one left, `residual_before_j`."""
    table = results.residual_table(outcome.after.model_, runs.train_after, runs.test_after)
    parts = [run.comparison.error for run in (*runs.train_before, *runs.test_before)]
    left = np.concatenate(parts)
    if len(left) == len(table["t"]):
        table |= {f"residual_before_{j}": np.ascontiguousarray(column) for j, column in enumerate(left.T)}
    return table


def _with_consequences(said: Sequence[Finding], follow: Sequence[Finding]) -> list[Finding]:
    """What was said with what follows from it; another load, or another mounting, is the error, and why.

    Units, signs and the robot file, which are to be checked where a model leaves as much as there is, are right then.
    """
    causes = [finding for finding in said if finding.code in CAUSES]
    if not causes:
        return [*said, *follow]
    lost, loaded = any(f.code == CONSEQUENCE for f in follow), {f.file for f in causes if f.code == CAUSES[0]}
    told = [replace(f, severity="error") if lost and f in causes else f for f in said]
    return [*told, *(f for f in follow if f.code != CONSEQUENCE and f.file not in loaded)]


def _not_said(findings: Sequence[Finding]) -> bool:
    """Whether nothing yet says that data and robot file do not belong together; a known cause needs no consequence."""
    return all(finding.severity != "error" and finding.code != "run_unlike_others" for finding in findings)


def complete(entry: Entry, rank: int, joint_names: Sequence[str]) -> dict[str, Any]:
    """An effect's entry with everything that readers may ask for; its ties with the command that separates them."""
    own = _named({**entry, "kind": entry.get("told_as", entry["kind"])}, joint_names)
    ties = [_with_command(tie, own, joint_names) for tie in entry["ties"]]
    return _with_short_plot({"parameters": [], "told_apart_from": [], **entry, "rank": rank, "ties": ties})


def _with_command(tie: Entry, own: NamedEffect, joint_names: Sequence[str]) -> Entry:
    """A tie with the command that designs a motion which tells the two apart, where there is one."""
    command = separate_command(own, _named(tie, joint_names), joint_names)
    return {**tie, "separate": command} if command and not tie.get("same_torque") else tie


def _named(entry: Entry, joint_names: Sequence[str]) -> NamedEffect:
    """The effect as the command line takes it, with the shape that was fitted."""
    known = [parameter["name"] for parameter in CATALOGUE.get(entry["kind"], {"shape": []})["shape"]]
    shape = {p["name"]: float(p["value"]) for p in entry.get("parameters", ()) if p["name"] in known}
    shape.pop("partner", None)
    return NamedEffect(entry["kind"], tuple(joint_names.index(name) for name in entry["joints"]), shape)


def _with_short_plot(entry: dict[str, Any]) -> dict[str, Any]:
    """No more points than a picture needs: every so many of them."""
    plot = entry.get("plot")
    if not plot:
        return entry
    step = -(-len(plot["x"]) // N_POINTS) or 1
    return {**entry, "plot": plot | {key: plot[key][::step] for key in ("x", "partial")}}
