"""What the `result.json` beside a model says of it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynid_rs.base.findings import Finding

if TYPE_CHECKING:
    from dynid_rs import _core
    from dynid_rs.identification.doubt import Doubt


def result_beside(path: Path) -> dict[str, Any] | None:
    """Content of the result whose folder, or model, `path` is; None of a model alone, or beside something else."""
    from dynid_rs.report.source import RESULT_FILE, read_result

    try:
        return read_result((path if path.is_dir() else path.parent) / RESULT_FILE)
    except (OSError, ValueError):
        return None


def doubt_of(result: dict[str, Any] | None, model: _core.TorqueModel) -> Doubt | None:
    """How well a model's parameters are known; None where its result does not say, or is another model's."""
    import numpy as np

    from dynid_rs.base.errors import DataError
    from dynid_rs.identification.doubt import Doubt

    said = None if result is None else result.get("covariance")
    if result is None or said is None:
        return None
    try:
        doubt = Doubt.from_json(said, model)
        base = np.array([entry["value"] for entry in result["parameters"]["base"]], dtype=np.float64)
    except (DataError, KeyError, TypeError, ValueError):
        return None
    return doubt if doubt.is_of(model, base) else None


def not_known(doubt: Doubt | None, runs: str) -> list[Finding]:
    """The word on a reference of which nothing says how well it is known; `runs` are what it is held against."""
    if doubt is not None:
        return []
    return [
        Finding(
            "reference_alone",
            "info",
            "no `covariance` beside the model says how well its parameters are known; intervals are as wide as if it "
            f"had been learned from as much as {runs}; identify again where its result.json has none, and leave both "
            "in one folder",
        )
    ]
