"""Random restarts of an SQP search, in parallel, reproducible by seed, resumable."""

from __future__ import annotations

import json
import os
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.errors import DataError
from dynid_rs.base.files import check_readable, write_json
from dynid_rs.excitation.problem import LEAST_SHARE, Problem

FloatArray = NDArray[np.float64]

N_DRAWS = 20
"""Random motions per restart; the search starts from the best of them."""
TOLERANCE = 1e-4
"""Change of the logarithm of the objective at which a search has converged."""
START_SHARE = 0.95
"""Of the limits, used by the motion a search starts from."""
STATE_FORMAT = "dynid-excite-state"


@dataclass(frozen=True)
class Restart:
    """One finished search.

    Parameters
    ----------
    index : int
        Which one; with the seed, it decides everything.
    start_objective, objective : float
        Before and after, in the criterion's own units; None where no motion keeps the constraints.
    x : list of lists, optional
        Free coefficients (n_free, n_joints) [rad/s, m/s].
    n_iter, n_evaluations : int
        Steps, and evaluations of the objective with its gradient.
    converged : bool
        The search stopped by itself, not by `max_iter` or time.
    cpu_s : float
        Processor time [s].
    """

    index: int
    start_objective: float | None
    objective: float | None
    x: list[list[float]] | None
    n_iter: int
    n_evaluations: int
    converged: bool
    cpu_s: float


class _Stopped(Exception):
    """Time is over, or somebody interrupted."""


class _Lost(Exception):
    """A step of the search led nowhere."""


def run_restart(
    problem: Problem, index: int, seed: np.random.SeedSequence, max_iter: int, stop: Callable[[], bool]
) -> tuple[Restart, bool]:
    """Search from the best of some random motions; also whether it was left to finish."""
    from scipy.optimize import minimize

    began = time.thread_time()
    first, start_objective = _random_start(problem, np.random.default_rng(seed))
    reached = [first.ravel()]
    n_evaluations = n_steps = 0

    def objective(x: FloatArray) -> tuple[float, FloatArray]:
        nonlocal n_evaluations
        if stop():
            raise _Stopped
        if not np.isfinite(x).all():
            raise _Lost
        n_evaluations += 1
        value, slope = problem.smooth(x.reshape(problem.shape))
        return value, slope.ravel()

    def kept(x: FloatArray) -> None:
        nonlocal n_steps
        n_steps += 1
        reached.append(x.copy())

    rooms = {
        "type": "ineq",
        "fun": lambda x: problem.rooms(x.reshape(problem.shape)),
        "jac": lambda x: problem.room_slopes(x.reshape(problem.shape)).reshape(-1, x.size),
    }
    settings: Any = {
        "jac": True,
        "method": "SLSQP",
        "constraints": [rooms],
        "callback": kept,
        "options": {"maxiter": max_iter, "ftol": TOLERANCE},
    }
    finished, converged = True, False
    try:
        result = minimize(objective, first.ravel() * START_SHARE, **settings)
        reached.append(result.x)
        converged = bool(result.success)
    except _Stopped:
        finished = False
    except _Lost:
        pass  # the last step before it counts
    x, value = _best_of(problem, first, reached[-1].reshape(problem.shape))
    restart = Restart(
        index=index,
        start_objective=start_objective,
        objective=value,
        x=None if x is None else x.tolist(),
        n_iter=n_steps,
        n_evaluations=n_evaluations,
        converged=converged,
        cpu_s=time.thread_time() - began,
    )
    return restart, finished


def _random_start(problem: Problem, rng: np.random.Generator) -> tuple[FloatArray, float | None]:
    """Return the best of some random motions, and its objective; something small where none keeps the constraints."""
    drawn = [x for x in (problem.drawn(rng) for _ in range(N_DRAWS)) if x is not None]
    if not drawn:
        return LEAST_SHARE * problem.bounds.roughly_scaled(rng.standard_normal(problem.shape)), None
    values = [problem.value(x) for x in drawn]
    best = int(np.argmin(values))
    return drawn[best], values[best]


def _best_of(problem: Problem, first: FloatArray, last: FloatArray) -> tuple[FloatArray | None, float | None]:
    """Return the best valid motion: the search's answer, stretched to the limits or not, or what it began with."""
    tried = [problem.bounds.scaled(last), last, first] if np.isfinite(last).all() else [first]
    valid = [x for x in map(problem.repaired, tried) if x is not None]
    if not valid:
        return None, None
    values = [problem.value(x) for x in valid]
    best = int(np.argmin(values))
    return valid[best], values[best]


@dataclass(frozen=True)
class Plan:
    """How a problem is searched.

    Parameters
    ----------
    n_restarts, max_iter : int
        Searches, and most steps of each.
    seed : int
        Repeats everything, on any number of threads.
    n_jobs : int, optional
        Threads; as many as there are processors by default or with -1.
    time_limit : float, optional
        No search begins after it, and running ones stop [s]. What comes out then depends on the machine.
    state_file : path, optional
        Finished searches are kept here.
    resume : bool
        Take finished searches from there, if it is there.
    """

    n_restarts: int
    max_iter: int
    seed: int
    n_jobs: int | None = None
    time_limit: float | None = None
    state_file: Path | None = None
    resume: bool = True


def search(
    problem: Problem, plan: Plan, callback: Callable[[Sequence[Restart]], object] | None = None
) -> list[Restart]:
    """Run all restarts and return them by index; `callback` hears of every finished one, from this thread.

    Raises
    ------
    DataError
        The state file is broken or belongs to another problem.
    """
    identity = f"{problem.identity()}:{plan.seed}:{plan.max_iter}"
    done = _read_state(plan.state_file, identity) if plan.state_file and plan.resume else {}
    done = {index: restart for index, restart in done.items() if index < plan.n_restarts}
    seeds = np.random.SeedSequence(plan.seed).spawn(plan.n_restarts)
    deadline = None if plan.time_limit is None else time.monotonic() + plan.time_limit
    interrupted = threading.Event()

    def stop() -> bool:
        return interrupted.is_set() or (deadline is not None and time.monotonic() > deadline)

    waiting = [index for index in range(plan.n_restarts) if index not in done]
    if done and callback is not None:
        callback(_by_index(done))
    wanted = os.cpu_count() if plan.n_jobs in (None, -1) else plan.n_jobs
    n_jobs = min(wanted or 1, max(len(waiting), 1))
    with ThreadPoolExecutor(max_workers=n_jobs) as pool:
        running: set[Future[tuple[Restart, bool]]] = set()
        try:
            while waiting or running:
                while waiting and len(running) < n_jobs and not (stop() and (done or running)):
                    index = waiting.pop(0)
                    running.add(pool.submit(run_restart, problem, index, seeds[index], plan.max_iter, stop))
                if not running:
                    break  # out of time
                finished, running = wait(running, return_when=FIRST_COMPLETED)
                for future in finished:
                    restart, complete = future.result()
                    done[restart.index] = restart
                    if complete and plan.state_file is not None:
                        _write_state(plan.state_file, identity, done)
                    if callback is not None:
                        callback(_by_index(done))
        finally:
            interrupted.set()  # threads end at their next evaluation
    return _by_index(done)


def _by_index(done: dict[int, Restart]) -> list[Restart]:
    return [done[index] for index in sorted(done)]


def _write_state(path: Path, identity: str, done: dict[int, Restart]) -> None:
    restarts = [asdict(restart) for restart in _by_index(done)]
    write_json(path, {"format": STATE_FORMAT, "version": 1, "problem": identity, "restarts": restarts})


def _read_state(path: Path, identity: str) -> dict[int, Restart]:
    """Finished searches of the same problem; none where there is no file."""
    if not path.exists():
        return {}

    def fault(text: str) -> DataError:
        return DataError(f"{path}: {text}", code="bad_state", file=str(path))

    try:
        content: Any = json.loads(check_readable(path).read_text(encoding="utf-8"))
        known = content["format"] == STATE_FORMAT and content["version"] == 1
        restarts = [Restart(**fields) for fields in content["restarts"]] if known else []
        problem = content["problem"]
    except (ValueError, TypeError, KeyError, RecursionError):
        known = False
    if not known:
        raise fault("is not a list of finished searches; remove it and search again")
    if problem != identity:
        raise fault("belongs to another problem (robot, limits, settings or seed differ); remove it and search again")
    return {restart.index: restart for restart in restarts}
