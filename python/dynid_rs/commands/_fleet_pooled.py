"""What a fleet's arms say of each other: columns of the table, content of `fleet.json`, and the table of quantities."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs.commands._fleet_rows import STATUS
from dynid_rs.pooling.arm import ArmEstimate
from dynid_rs.pooling.fleet import ArmVerdict, Fleet
from dynid_rs.pooling.hierarchy import shrunken
from dynid_rs.regression.uncertainty import NORMAL_95

if TYPE_CHECKING:
    from dynid_rs.commands._fleet_file import FleetRobot

PERCENTILES = (5.0, 25.0, 50.0, 75.0, 95.0)
"""Of a type's estimates, as `fleet.json` has them."""
OPINION = {True: "yes", False: "no", None: "unknown"}


def taken_estimate(row: dict[str, Any], robot: FleetRobot) -> ArmEstimate | None:
    """Take the estimate out of a robot's row; None where it failed."""
    content = row.pop("estimate", None)
    if content is None:
        return None
    estimate = ArmEstimate.from_json(content)
    return estimate if robot.type is None else replace(estimate, type=robot.type, kinematics="")


def pooled(arms: Sequence[ArmEstimate], false_alarms: float) -> Fleet | None:
    """Pool the arms; None where there is none."""
    return Fleet(false_alarms).fit(arms) if arms else None


def with_verdicts(rows: Sequence[dict[str, Any]], fleet: Fleet | None) -> list[dict[str, Any]]:
    """Rows with the columns `type`, `odd`, `deviations` and `why`, and the causes in numbers."""
    verdicts: dict[str, ArmVerdict] = {} if fleet is None else fleet.verdicts_
    done = []
    for row in rows:
        verdict = verdicts.get(row["name"])
        if verdict is None:
            done.append(row | {"type": None, "odd": None, "deviations": None, "why": None})
            continue
        own = {
            "type": verdict.type,
            "odd": OPINION[verdict.odd],
            "deviations": verdict.deviations,
            "why": "; ".join(verdict.why) or None,
            "p_value": verdict.p_value,
            "causes": [asdict(cause) for cause in verdict.causes],
        }
        done.append(row | own)
    return done


def as_json(robots: Sequence[FleetRobot], rows: Sequence[dict[str, Any]], fleet: Fleet | None) -> dict[str, Any]:
    """Content of `fleet.json`."""
    counts = {status: sum(row["status"] == status for row in rows) for status in STATUS}
    shared = {} if fleet is None else _shared(fleet)
    head = {"format": "dynid-fleet", "version": 1, "n_robots": len(robots), **counts}
    return head | {"odd": sum(row["odd"] == "yes" for row in rows), "pooling": shared or None, "robots": list(rows)}


def _shared(fleet: Fleet) -> dict[str, Any]:
    types = []
    for one in fleet.types_:
        quantities = [
            {
                "kind": quantity.kind,
                "name": quantity.name,
                "place": quantity.place,
                "unit": quantity.unit,
                "at": quantity.at,
                "at_unit": quantity.at_unit,
                "mean": judged.shared.mean,
                "mean_std_error": judged.shared.mean_std_error,
                "deviation": judged.shared.deviation,
                "n_usual": judged.shared.n_usual,
                "percentiles": np.percentile(quantity.y, PERCENTILES).tolist(),
            }
            for quantity, judged in zip(one.quantities, one.judged, strict=True)
        ]
        enough = one.n_arms >= fleet.least_arms_
        types.append({"name": one.name, "n_arms": one.n_arms, "judged": enough, "quantities": quantities})
    return {
        "false_alarms": fleet.false_alarms,
        "n_tests": fleet.n_tests_,
        "limit": fleet.limit_,
        "least_arms": fleet.least_arms_,
        "types": types,
    }


def quantity_table(fleet: Fleet | None) -> dict[str, NDArray[Any]]:
    """Columns of `quantities.parquet`: one row per arm and quantity, with what pooling makes of it.

    Odd arms keep their own estimates.
    """
    texts: dict[str, list[str]] = {key: [] for key in ("type", "arm", "kind", "place", "name", "unit")}
    keys = ("estimate", "std_error", "type_mean", "type_deviation", "deviations", "pooled", "pooled_low", "pooled_high")
    numbers: dict[str, list[NDArray[np.float64]]] = {key: [] for key in keys}
    for one in [] if fleet is None else fleet.types_:
        n, names = one.n_arms, [arm.name for arm in one.arms]
        odd = np.array([fleet is not None and bool(fleet.verdicts_[name].odd) for name in names])
        for quantity, judged in zip(one.quantities, one.judged, strict=True):
            shared = judged.shared
            best, error = shrunken(quantity.y, quantity.s, shared)
            best, error = np.where(odd, quantity.y, best), np.where(odd, quantity.s, error)
            texts["arm"] += names
            for key, value in (
                ("type", one.name),
                ("kind", quantity.kind),
                ("place", quantity.place),
                ("name", quantity.name),
                ("unit", quantity.unit),
            ):
                texts[key] += n * [value]
            values = (
                *(quantity.y, quantity.s, np.full(n, shared.mean), np.full(n, shared.deviation), judged.deviations),
                *(best, best - NORMAL_95 * error, best + NORMAL_95 * error),
            )
            for key, column in zip(keys, values, strict=True):
                numbers[key].append(column)
    columns: dict[str, NDArray[Any]] = {key: np.array(values, dtype=object) for key, values in texts.items()}
    return columns | {key: np.concatenate(parts) if parts else np.zeros(0) for key, parts in numbers.items()}
