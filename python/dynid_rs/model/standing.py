"""What of a model does not hold at the end of a run: changes that were said, put together.

A watch says a change twice, and a second one of the same kind beside the first, so that sizes add up; what was
withdrawn counts as none. A frozen channel is beside all that: it stands from its name until it changes again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynid_rs.base.changes import FROZEN, Change
from dynid_rs.model.watch import Tolerated, Watch, Watched
from dynid_rs.regression.uncertainty import NORMAL_95
from dynid_rs.runs.recording import FloatArray

KINDS = ("friction", "gain", "offset", "delay", "slip", "unknown", FROZEN, "load")
LAST_ROWS = 300
"""Rows of a joint that its residual at the end is of: a minute of motion at a row of a fifth of a second."""


@dataclass(frozen=True, eq=False)
class Standing:
    """State at the end of a run.

    Attributes
    ----------
    changes : tuple of Change
        What stands, one per kind and joint: the sum of what was said of it, at the time when it was said last.
    residual : ndarray (n_joints,)
        Root mean square of what is left over what is expected, over the last `LAST_ROWS` rows in which a joint was
        watched; NaN where it never was.
    watched : ndarray (n_joints,)
        Part of the run in which a joint was watched.
    """

    changes: tuple[Change, ...]
    residual: FloatArray
    watched: FloatArray

    def find(self, kind: str, joint: str | None = None) -> Change | None:
        """What stands of a kind on a joint, of a load on any; None where nothing does."""
        own = (one for one in self.changes if one.kind == kind and joint in (None, one.joint))
        return next(own, None)


def standing(watch: Watch, run: Watched) -> Standing:
    """Put together what `watch` has said of `run`."""
    said: dict[tuple[str, str], list[Change]] = {}
    frozen: dict[str, Change] = {}
    for change in (*run.before, *run.changes):
        if change.kind == FROZEN:
            frozen.pop(change.joint, None)
            if change.said != "withdrawn":
                frozen[change.joint] = change
    told = [change for change in (*run.before, *run.changes) if change.kind != FROZEN]
    for k, change in enumerate(told):
        # Between a name and what became of it nothing else is said, so that only the last name may still be open.
        if change.said == "settled" or (change.said == "named" and k == len(told) - 1):
            said.setdefault((change.kind, change.joint), []).append(change)
    judged = [parts[0] for parts in said.values() if len(parts) == 1]
    sums = [_sum(parts) for parts in said.values() if len(parts) > 1]
    kept = [*judged, *(change for change in sums if not _is_tolerated(watch, change)), *frozen.values()]
    n = run.left.shape[1]
    residual, ratio = np.full(n, np.nan), relative(run)
    for j in range(n):
        own = ratio[run.watched[:, j], j][-LAST_ROWS:]
        if own.size:
            residual[j] = np.sqrt(np.mean(own**2))
    watched = run.watched.mean(axis=0) if len(run.t) else np.zeros(n)
    return Standing(tuple(sorted(kept, key=lambda change: change.t)), residual, watched)


def relative(run: Watched) -> FloatArray:
    """What is left over what is expected of it, (n_rows, n_joints); NaN where a joint was not watched."""
    ratio: FloatArray = np.divide(run.left, run.deviation, out=np.full(run.left.shape, np.nan), where=run.watched)
    return ratio


def _sum(parts: Sequence[Change]) -> Change:
    """Sizes add up, of errors without a name their factors multiply; errors of the sizes are independent."""
    last = parts[-1]
    sizes = np.array([change.size for change in parts])
    stds = np.array([(change.interval[1] - change.interval[0]) / (2 * NORMAL_95) for change in parts])
    if last.kind == "unknown":
        size = float(np.prod(1.0 + sizes)) - 1.0
        std = (1.0 + size) * float(np.linalg.norm(stds / (1.0 + sizes)))
    else:
        size, std = float(sizes.sum()), float(np.linalg.norm(stds))
    x, y, z = (float(sum(axis)) for axis in zip(*(change.moments or (0.0,) * 3 for change in parts), strict=True))
    return replace(
        last,
        size=size,
        interval=(size - NORMAL_95 * std, size + NORMAL_95 * std),
        moments=(x, y, z) if last.kind == "load" else None,
    )


def _is_tolerated(watch: Watch, change: Change) -> bool:
    """Whether a sum may be as small as what is tolerated: a load that was put on and taken off again is none."""
    most = float(getattr(watch.tolerated or Tolerated(), change.kind))
    if change.kind == "offset":
        j = list(watch.model.robot.joint_names).index(change.joint)
        inflation = getattr(watch, "inflation_", np.ones(watch.model.robot.n_joints))
        most *= float(watch.model.noise_std[j] * np.sqrt(inflation[j]))
    half = 0.5 * (change.interval[1] - change.interval[0])
    return abs(change.size) - half <= most
