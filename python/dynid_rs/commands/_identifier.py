"""From options to an identifier, and its fit: what `dynid identify` and `dynid diagnose` share."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from dynid_rs.base.findings import Finding
    from dynid_rs.runs.preprocessing import States
    from dynid_rs.runs.recording import Recording

MODEL_FILE, RESULT_FILE, RESIDUALS_FILE, OPEN_FILE = "model.json", "result.json", "residuals.parquet", "open.json"


def check_places(output: Path, inputs: list[Path | None], *, force: bool = False, more: Sequence[str] = ()) -> None:
    """Refuse before any work is done: a folder that cannot be written, results that would replace what is read.

    A finished result is replaced with `force` only. `more`: names of further files that will be written.
    """
    from dynid_rs.commands._output import check_folder, check_not_read, check_unfinished
    from dynid_rs.report import REPORT_FILE

    results = (MODEL_FILE, RESULT_FILE, RESIDUALS_FILE, REPORT_FILE, *more)
    check_folder(output, results)
    check_not_read([output / name for name in results], [path for path in inputs if path is not None])
    if not force:
        check_unfinished(output, RESULT_FILE)


def known_terms(path: Path | None, robot: Any) -> list[Any]:
    """Terms of `--known`; none where there is no file."""
    if path is None:
        return []
    from dynid_rs.model.terms import read_terms

    return list(read_terms(path, robot))


def identifier_options(weighting: str, prior: str, cutoff: float | None, friction_law: str | None) -> dict[str, Any]:
    """Arguments of `ThreeLoopIdentifier` for the first two loops.

    Raises
    ------
    ValueError
        A word that is not known, or two that contradict each other; names the option.
    """
    from dynid_rs.identification.friction_laws import LAWS
    from dynid_rs.identification.links import LinkDynamicsIdentifier

    choices: dict[str, Literal["joint_variance", "full_covariance"] | None] = {
        "joint_variance": "joint_variance",
        "full_covariance": "full_covariance",
        "none": None,
    }
    if weighting not in choices:
        raise ValueError(f"--weighting must be one of {', '.join(choices)}, found {weighting!r}")
    priors: dict[str, Literal["auto", "robot"] | None] = {"auto": "auto", "robot": "robot", "none": None}
    if prior not in priors:
        raise ValueError(f"--prior must be auto, robot or none, found {prior!r}")
    if prior == "robot" and choices[weighting] is None:
        raise ValueError(
            "--prior robot is weighed against the noise, which --weighting none leaves out; choose another"
        )
    if friction_law not in (None, *LAWS, "auto"):
        raise ValueError(f"--friction-law must be {', '.join(LAWS)} or auto, found {friction_law!r}")
    return {
        "friction_law": None if friction_law == "auto" else friction_law,
        "links": LinkDynamicsIdentifier(choices[weighting], prior=priors[prior]),
        "cutoff": cutoff,
    }


def chosen_laws(identifier: Any, train: list[Recording], slow: list[Recording] | None = None) -> tuple[str, ...]:
    """Law of every joint, by a training run that is left out for it; the test runs stay untouched."""
    from threadpoolctl import threadpool_limits

    from dynid_rs.identification.law_comparison import choose_friction_laws

    options = {
        "links": identifier.links,
        "known": identifier.known,
        "cutoff": identifier.cutoff,
        "friction_recording": slow,
    }
    with threadpool_limits(limits=1, user_api="blas"):
        return choose_friction_laws(identifier.robot, train, **options)


@contextmanager
def convergence_findings() -> Iterator[Callable[[], list[Finding]]]:
    """What does not converge in the body is a finding, as everything else that the user should know.

    Yields a function that lists them, to be called after the body.
    """
    from dynid_rs.base.findings import Finding

    caught: list[warnings.WarningMessage]

    def findings() -> list[Finding]:
        messages = dict.fromkeys(str(w.message) for w in caught if _of_convergence(w))
        return [Finding("not_converged", "warning", message) for message in messages]

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        yield findings
    others = {(str(w.message), w.category, w.filename, w.lineno): w for w in caught if not _of_convergence(w)}
    for warning in others.values():
        warnings.warn_explicit(warning.message, warning.category, warning.filename, warning.lineno)


def _of_convergence(warning: warnings.WarningMessage) -> bool:
    """Whether it is scikit-learn's warning, which nobody can have given before that is imported."""
    exceptions = sys.modules.get("sklearn.exceptions")
    return exceptions is not None and issubclass(warning.category, exceptions.ConvergenceWarning)


def scored_states(identifier: Any, test: list[Recording]) -> list[States]:
    """States of the test runs; refuses one that stands still or whose torque does: there would be nothing to score."""
    from dynid_rs.identification.training import check_motion
    from dynid_rs.runs.facts import check_torque

    check_torque(test)
    runs: list[States] = [identifier.states(recording) for recording in test]
    check_motion(runs)
    return runs


def write_results(
    output: Path,
    model: Any,
    result: dict[str, Any],
    table: dict[str, Any],
    more: Mapping[str, Any] | None = None,
    *,
    force: bool,
) -> None:
    """Fill the folder: model, residuals, result and report, and JSON files `more` by name; all of them or none.

    What another command has finished there since `check_places` is replaced with `force` only.
    """
    from dynid_rs.base.files import filled_together, write_json, write_table
    from dynid_rs.report import write_report
    from dynid_rs.report.source import source_of

    with filled_together(output, None if force else RESULT_FILE) as folder:
        model.save(folder / MODEL_FILE)
        write_table(folder / RESIDUALS_FILE, table)
        write_json(folder / RESULT_FILE, result)
        for name, content in (more or {}).items():
            write_json(folder / name, content)
        write_report(folder, source_of(result, table))
    if OPEN_FILE not in (more or {}):
        (output / OPEN_FILE).unlink(missing_ok=True)  # of an earlier diagnosis, whose result is gone
