"""One case from its number to its score; results are kept, so that a broken-off run goes on where it was."""

from __future__ import annotations

import hashlib
import json
import shutil
import tempfile
import traceback
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict
from functools import cache
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from cases import SEED, Case, all_cases
from examiner import examine

from dynid_rs.files import write_json

ROOT = Path(__file__).resolve().parents[2]
KEPT = ROOT / "target" / "blind" / str(SEED)
"""Results by seed and case; built things live in `target/`, which is no part of the repository."""

Examiner = Callable[[Path, Path], tuple[dict[str, Any], float]]


def run_case(case: Case, folder: Path, examiner: Examiner = examine) -> dict[str, Any]:
    """Make a case in `folder`, examine it, score it.

    Returns
    -------
    dict
        `case`, `truth`, and `score`; or `impossible` or `error`, a sentence, instead of the score.
    """
    import numpy as np
    from maker import Impossible, build, truth_of, write_seen, write_truth
    from oracle import oracle_error
    from power import in_band
    from scorer import score

    outcome: dict[str, Any] = {"case": asdict(case), "label": case.label}
    try:
        built = build(case)
    except Impossible as error:
        return outcome | {"impossible": str(error)}
    truth = truth_of(built)
    write_seen(built, folder / "seen")
    write_truth(truth, folder / "hidden")
    outcome |= {"truth": truth, "in_band": in_band(built), "oracle": np.asarray(oracle_error(built)).tolist()}
    try:
        result, seconds = examiner(folder / "seen", folder / "result")
        return outcome | {"score": score(truth, result, seconds, outcome["oracle"])}
    except Exception as error:  # whatever happens to the program under examination is its result
        text = " ".join(str(error).split()) or type(error).__name__
        return outcome | {"error": f"{type(error).__name__}: {text}", "traceback": traceback.format_exc()}


def kept_result(case: Case, kept: Path) -> dict[str, Any] | None:
    """Earlier outcome of the same case with the same code; None if there is none."""
    path = _path(case, kept)
    if not path.is_file():
        return None
    outcome: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    same = outcome["code"] == code_digest() and outcome["outcome"]["case"] == json.loads(json.dumps(asdict(case)))
    return outcome["outcome"] if same else None


def run_cases(
    cases: Iterable[Case], *, kept: Path = KEPT, jobs: int = 1, fresh: bool = False, keep_files: bool = False
) -> Iterator[dict[str, Any]]:
    """Outcomes as they come; those that are kept first.

    Parameters
    ----------
    cases : iterable of Case
        Which.
    kept : Path
        Folder of results.
    jobs : int
        Processes.
    fresh : bool
        Do not use what is kept.
    keep_files : bool
        Leave runs, truth and reports under `kept/files/NUMBER`.
    """
    left = []
    for case in cases:
        outcome = None if fresh else kept_result(case, kept)
        if outcome is None or (keep_files and not (kept / "files" / str(case.number)).is_dir()):
            left.append(case)
        else:
            yield outcome
    if jobs == 1:
        for case in left:
            yield _run_and_keep(case.number, kept, keep_files)
        return
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        futures = [pool.submit(_run_and_keep, case.number, kept, keep_files) for case in left]
        for future in as_completed(futures):
            yield future.result()


def _run_and_keep(number: int, kept: Path, keep_files: bool) -> dict[str, Any]:
    case = all_cases()[number]
    if keep_files:
        folder = kept / "files" / str(number)
        shutil.rmtree(folder, ignore_errors=True)
        outcome = run_case(case, folder)
    else:
        with tempfile.TemporaryDirectory(prefix="blind-") as temporary:
            outcome = run_case(case, Path(temporary))
    kept.mkdir(parents=True, exist_ok=True)
    write_json(_path(case, kept), {"code": code_digest(), "outcome": outcome})
    return outcome


def _path(case: Case, kept: Path) -> Path:
    return kept / f"{case.number:04d}.json"


@cache
def code_digest() -> str:
    """Digest of the package and of this suite: results of other code are not results."""
    import dynid_rs

    package = Path(dynid_rs.__file__).parent
    digest = hashlib.sha256()
    for path in sorted([*package.rglob("*.py"), *package.glob("_core*.so"), *Path(__file__).parent.glob("*.py")]):
        digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()[:16]
