"""Sums over cases: the figures that the goals are about, by kind and ratio, and the page that shows them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

Json = Mapping[str, Any]
Outcomes = Sequence[Json]

RATIOS = (2.0, 0.3, 0.1, 0.05)
GEARS = "two encoders"


def tally(outcomes: Iterable[Json]) -> dict[str, Any]:
    """Every figure of the suite.

    Parameters
    ----------
    outcomes : iterable of dict
        Of `suite.run_case`.
    """
    all_of = sorted(outcomes, key=lambda o: o["case"]["number"])
    possible = [o for o in all_of if "impossible" not in o]
    by_group = {group: [o for o in possible if o["case"]["group"] == group] for group in _GROUPS}
    singles = by_group["single"]
    return {
        "n_cases": len(possible),
        "impossible": [[o["label"], o["impossible"]] for o in all_of if "impossible" in o],
        "errors": [[o["label"], o["error"]] for o in possible if "error" in o],
        "goals": _goals(by_group),
        "single": [
            {"kind": kind, "ratio": ratio, **_singles_row(cell)}
            for kind in dict.fromkeys(_kinds(o)[0] for o in singles)
            for ratio in RATIOS
            if (cell := [o for o in singles if _kinds(o) == (kind,) and _ratio(o) == ratio])
        ],
        "groups": {group: _group_row(cases) for group, cases in by_group.items() if cases},
        "gear": [
            {"kind": " + ".join(kinds), **_singles_row([o for o in by_group["gear"] if _kinds(o) == kinds])}
            for kinds in dict.fromkeys(map(_kinds, by_group["gear"]))
        ],
        "outside": [
            {"kind": kind, "ratio": ratio, **_unknown_row(cell)}
            for kind in dict.fromkeys(_kinds(o)[0] for o in by_group["outside"])
            for ratio in RATIOS
            if (cell := [o for o in by_group["outside"] if _kinds(o) == (kind,) and _ratio(o) == ratio])
        ],
        "coverage": _coverage(possible),
        "misses": [_miss(o) for o in possible if _is_miss(o)],
    }


_GROUPS = ("single", "gear", "reference", "mixture", "clean", "outside", "contact")


def _goals(groups: Mapping[str, Outcomes]) -> list[dict[str, Any]]:
    """Goals with what was reached: name, figure, wanted, `least` or `most`, number of cases."""
    singles, gears = groups["single"], groups["gear"]
    goals = []

    def goal(name: str, value: float | None, sense: str, wanted: float, n: int) -> None:
        met = None if value is None else bool(value >= wanted if sense == "at least" else value <= wanted)
        goals.append({"goal": name, "value": value, "sense": sense, "wanted": wanted, "met": met, "n": n})

    for ratio, wanted in zip(RATIOS, (0.99, 0.99, 0.95, 0.8), strict=True):
        at = [o for o in singles if _ratio(o) == ratio]
        goal(f"recall at {ratio:g}", _recall(at), "at least", wanted, len(at))
    goal(f"recall, {GEARS}", _recall(gears), "at least", 0.99, len(gears))
    mixtures = groups["mixture"]
    goal("mixtures: recall", _recall(mixtures), "at least", 0.95, len(mixtures))
    goal("mixtures: precision", _precision(mixtures), "at least", 0.97, len(mixtures))
    clean = groups["clean"]
    goal("clean: cases with a false attribution", _share(clean, _accuses), "at most", 0.01, len(clean))
    strong = [ratio for o in singles if _ratio(o) == RATIOS[0] for ratio in _score(o).get("after_over_oracle", ())]
    goal("after / oracle at 2, median", _stat(np.median, strong), "at most", 1.02, len(strong))
    goal("after / oracle at 2, worst", _stat(np.max, strong), "at most", 1.05, len(strong))
    parameters = [p for group in groups.values() for o in group for p in _score(o).get("parameters", ())]
    covered = _stat(np.mean, [p["covered"] for p in parameters])
    goal("intervals that cover", covered, "at least", 0.93, len(parameters))
    goal("intervals that cover", covered, "at most", 0.97, len(parameters))
    outside = groups["outside"]
    goal("outside: unknown with the right signals", _share(outside, _unknown_right), "at least", 0.9, len(outside))
    removed = [_score(o)["unknown"]["share_removed"] for o in outside if _score(o).get("unknown")]
    removed = [share for share in removed if share is not None]
    goal("outside: share removed, median", _stat(np.median, removed), "at least", 0.7, len(removed))
    contacts = groups["contact"]
    goal("contacts: windows found", _windows(contacts), "at least", 0.9, len(contacts))
    goal("contacts: cases with a false attribution", _share(contacts, _accuses), "at most", 0.01, len(contacts))
    return goals


def _singles_row(cell: Outcomes) -> dict[str, Any]:
    effects = [effect for o in cell for effect in _effects(o)]
    ratios = [ratio for o in cell for ratio in _score(o).get("after_over_oracle", ())]
    parameters = [p for o in cell for p in _score(o).get("parameters", ())]
    power = [e["power"] for o in cell for e in o.get("in_band", ())]
    return {
        "n": len(cell),
        "recall": _recall(cell),
        "or_tie": _stat(np.mean, [e["or_tied"] for e in effects]),
        "right_kind": _stat(np.mean, [e["right_kind"] for e in effects]),
        "top1": _stat(np.mean, [_score(o).get("top1", False) for o in cell]),
        "false": sum(len(_score(o).get("false", ())) for o in cell),
        "after_over_oracle": _stat(np.median, ratios),
        "after_over_oracle_worst": _stat(np.max, ratios),
        "error_over_half_width": _stat(lambda x: np.sqrt(np.mean(np.square(x))), _errors(parameters)),
        "covered": _stat(np.mean, [p["covered"] for p in parameters]),
        "least_reached": _stat(np.min, [e["reached"] for e in effects if e["reached"] is not None]),
        "power": _stat(np.mean, power),
        "seconds": _stat(np.median, [_score(o)["seconds"] for o in cell if "score" in o]),
    }


def _group_row(cases: Outcomes) -> dict[str, Any]:
    return {
        "n": len(cases),
        "recall": _recall(cases),
        "precision": _precision(cases),
        "top1": _stat(np.mean, [_score(o).get("top1", False) for o in cases if _effects(o)]),
        "top1_or_tie": _stat(np.mean, [_score(o).get("top1_or_tie", False) for o in cases if _effects(o)]),
        "cases_with_false": sum(map(_has_false, cases)),
        "errors": sum("error" in o for o in cases),
        "seconds": _stat(np.median, [_score(o)["seconds"] for o in cases if "score" in o]),
        "seconds_worst": _stat(np.max, [_score(o)["seconds"] for o in cases if "score" in o]),
    }


def _unknown_row(cell: Outcomes) -> dict[str, Any]:
    unknown = [_score(o)["unknown"] for o in cell if _score(o).get("unknown")]
    return {
        "n": len(cell),
        "said": _stat(np.mean, [u["said"] for u in unknown]),
        "right": _share(cell, _unknown_right),
        "right_signals": _stat(np.mean, [u["right_signals"] for u in unknown]),
        "forced": sum(map(_has_false, cell)),
        "share_removed": _stat(np.median, [u["share_removed"] for u in unknown if u["share_removed"] is not None]),
    }


def _coverage(cases: Outcomes) -> list[dict[str, Any]]:
    rows: dict[tuple[str, str], list[Json]] = {}
    for o in cases:
        for p in _score(o).get("parameters", ()):
            rows.setdefault((p["kind"], p["name"]), []).append(p)
    return [
        {
            "kind": kind,
            "parameter": name,
            "n": len(ps),
            "covered": float(np.mean([p["covered"] for p in ps])),
            "error_over_half_width": float(np.sqrt(np.mean(np.square(_errors(ps))))),
        }
        for (kind, name), ps in rows.items()
    ]


def _is_miss(o: Json) -> bool:
    if "error" in o or _has_false(o):
        return True
    return any(not effect["found"] for effect in _effects(o)) or (
        o["case"]["group"] == "outside" and not _unknown_right(o)
    )


def _miss(o: Json) -> dict[str, Any]:
    lost = [f"{e['kind']} at {', '.join(e['joints'])}" for e in _effects(o) if not e["found"]]
    false = [f"{kind} at {joint}" for kind, joint in _score(o).get("false", ())]
    unknown = _score(o).get("unknown")
    return {
        "label": o["label"],
        "not_found": lost,
        "false": false,
        "unknown": unknown and {"wanted": unknown["wanted"], "signals": unknown["signals"]},
        "error": o.get("error"),
    }


def _score(o: Json) -> Json:
    score: Json = o.get("score", {})
    return score


def _effects(o: Json) -> list[Json]:
    """What became of the true effects; an examined program that gave up has found none."""
    if "score" in o:
        return list(o["score"]["effects"])
    lost = {"found": False, "partly": False, "or_tied": False, "right_kind": False}
    return [{k: told[k] for k in ("kind", "joints", "ratio", "reached")} | lost for told in o["truth"]["effects"]]


def _kinds(o: Json) -> tuple[str, ...]:
    return tuple(put["kind"] for put in o["case"]["puts"])


def _ratio(o: Json) -> float | None:
    ratio: float | None = o["case"]["puts"][0]["ratio"]
    return ratio


def _recall(cases: Outcomes) -> float | None:
    return _stat(np.mean, [effect["found"] for o in cases for effect in _effects(o)])


def _precision(cases: Outcomes) -> float | None:
    named = sum(len(_score(o).get("named", ())) for o in cases)
    false = sum(len(_score(o).get("false", ())) for o in cases)
    return 1 - false / named if named else None


def _has_false(o: Json) -> bool:
    return bool(_score(o).get("false"))


def _accuses(o: Json) -> bool:
    """Whether something is named wrongly; who gives up has not said that nothing is there."""
    return _has_false(o) or "error" in o


def _unknown_right(o: Json) -> bool:
    unknown = _score(o).get("unknown")
    return bool(unknown and unknown["said"] and unknown["right_signals"] and not _has_false(o))


def _windows(cases: Outcomes) -> float | None:
    return _stat(
        np.mean, [x for o in cases if _score(o).get("contact") for x in o["score"]["contact"]["found"]["train"]]
    )


def _errors(parameters: Sequence[Json]) -> list[float]:
    return [p["error_over_half_width"] for p in parameters]


def _share(cases: Outcomes, which: Callable[[Json], bool]) -> float | None:
    return _stat(np.mean, [which(o) for o in cases])


def _stat(of: Callable[[Any], Any], values: Sequence[Any]) -> float | None:
    finite = [float(v) for v in values if v is not None and np.isfinite(v)]
    return float(of(finite)) if finite else None
