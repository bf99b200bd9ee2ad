"""Compares one `result.json` with the truth. Plain data in, plain data out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from synonyms import AS_FINDING, COMPANIONS, CONTACT, LOUD, WHOLE_ROBOT, accepted, expected, signal_name

Json = Mapping[str, Any]
Place = tuple[str, str]
"""Kind and joint; the joint of a whole-robot kind is "*"."""

UNKNOWN = "unknown"
OWN_DEFINITION = ("transition_torque",)
"""Numbers of the laboratory's own curve (a polynomial step) under a name that the report uses for another (a hyperbolic
tangent)."""
WIDER = 0.3
"""Seconds by which a window may reach beyond the push: filters spread it."""


def score(truth: Json, result: Json, seconds: float, oracle: Sequence[float]) -> dict[str, Any]:
    """Judge a diagnosis.

    Parameters
    ----------
    truth : mapping
        `maker.truth_of`.
    result : mapping
        Content of `result.json`.
    seconds : float
        That the diagnosis took.
    oracle : sequence of float
        Error on the test runs of a model that was told the truth, per joint [N m].

    Returns
    -------
    dict
        `named`, `false`: places; `effects`: what became of each true effect; `top1`, `top1_or_tie`;
        `parameters`; `after_over_oracle`, `before_over_oracle` per joint; `unknown`, `contact` where they apply.
    """
    named = list(_named(truth, result))
    ties = {place for effect in result["effects"] for tie in effect.get("ties") or () for place in _places(tie)}
    right = {place for told in truth["effects"] for place in _right_places(told)}
    by_effects = [place for place, by_effect in named if by_effect]
    told_effects = [_became(told, {place for place, _ in named}, ties) for told in truth["effects"]]
    false = sorted({place for place, _ in named} - right)
    first = by_effects[0] if by_effects else (named[0][0] if named else None)
    test = result["rmse"]["test"]
    before, after = _numbers(test["before"]), _numbers(test["after"])
    return {
        "named": sorted({place for place, _ in named}),
        "false": false,
        "false_or_untied": sorted(place for place in false if not _tied_right(place, result, right)),
        "effects": told_effects,
        "top1": first in right,
        "top1_or_tie": first in right or (first is not None and _tied_right(first, result, right)),
        "parameters": list(_parameters(truth, result)),
        "before_over_oracle": _plain(before / np.asarray(oracle)),
        "after_over_oracle": _plain(after / np.asarray(oracle)),
        "unknown": _unknown(truth, result, before, after, np.asarray(oracle)) if truth["strangers"] else None,
        "says_unknown": any(e["kind"] == UNKNOWN for e in result["effects"]) or bool(result.get("unexplained")),
        "contact": _contacts(truth, result),
        "seconds": seconds,
    }


def _places(effect: Json) -> list[Place]:
    if effect["kind"] in WHOLE_ROBOT:
        return [(effect["kind"], "*")]
    return [(effect["kind"], joint) for joint in effect["joints"]]


def _named(truth: Json, result: Json) -> Iterator[tuple[Place, bool]]:
    """Places that a report names, best first, and whether as an effect; loud findings of sensors count as well."""
    for effect in sorted(result["effects"], key=lambda e: e.get("rank") or 0):
        if effect["kind"] != UNKNOWN:
            yield from ((place, True) for place in _places(effect))
    put_in = {name for told in truth["effects"] for name in accepted(told["kind"])}
    for finding in result["data"]["findings"]:
        code = finding["code"]
        if code in AS_FINDING and (finding["severity"] in LOUD or code in put_in):
            yield (code, _joint_of(finding, truth, code)), False


def _joint_of(finding: Json, truth: Json, code: str) -> str:
    """Joint of a finding about a column such as `tau_2`; "*" of one about the whole robot."""
    end = str(finding.get("column") or "").rpartition("_")[2]
    if code in WHOLE_ROBOT or not end:
        return "*"
    return truth["joints"][int(end)] if end.isdigit() else end


def _right_places(told: Json) -> set[Place]:
    """Everything that is true of an effect: its own places, and what comes with it."""
    kinds = (*accepted(told["kind"]), *COMPANIONS.get(told["kind"], ()))
    return {place for kind in kinds for place in _places({"kind": kind, "joints": told["joints"]})}


def _became(told: Json, named: set[Place], ties: set[Place]) -> dict[str, Any]:
    """What became of one true effect: `found` at every joint that counts, `partly` at some; `or_tied` as a tie."""
    right = accepted(told["kind"])

    def at(pool: set[Place]) -> list[bool]:
        joints = {joint for kind, joint in pool if kind in right}
        return ["*" in joints or joint in joints for joint in told["required"]]

    return {
        "kind": told["kind"],
        "joints": told["joints"],
        "ratio": told["ratio"],
        "reached": told["reached"],
        "found": all(at(named)),
        "partly": any(at(named)),
        "or_tied": all(at(named | ties)),
        "right_kind": any(kind in right for kind, _ in named),
    }


def _tied_right(place: Place, result: Json, right: set[Place]) -> bool:
    """Whether a place was named together with a true one as a tie."""
    return any(
        place in _places(effect) and any(set(_places(tie)) & right for tie in effect.get("ties") or ())
        for effect in result["effects"]
    )


def _parameters(truth: Json, result: Json) -> Iterator[dict[str, Any]]:
    """Reported parameters of effects that were rightly named and whose truth has a number under that name."""
    for effect in result["effects"]:
        for told in truth["effects"]:
            if effect["kind"] != told["kind"]:
                continue
            joints = [joint for joint in effect["joints"] if joint in told["joints"]]
            if not joints:
                continue
            numbers = [p["name"] for p in effect["parameters"]]
            for at, parameter in enumerate(effect["parameters"]):
                name, interval = parameter["name"], parameter.get("interval")
                # A name that comes once per joint comes in the order of the joints.
                repeated = numbers.count(name) == len(effect["joints"])
                joint = effect["joints"][numbers[:at].count(name)] if repeated else joints[0]
                true = expected(told, parameter.get("joint") or joint)
                if parameter.get("unit", "").startswith("N*m"):  # of the torque channel, as its gain shows it
                    true = {key: number * _gain(truth, parameter.get("joint") or joint) for key, number in true.items()}
                if name not in true or name in OWN_DEFINITION or not interval or None in interval:
                    continue
                low, high = interval
                if name == "phase":  # whole turns are nothing
                    value = true[name]
                    true[name] = value + 2 * np.pi * np.round(((low + high) / 2 - value) / (2 * np.pi))
                yield {
                    "kind": told["kind"],
                    "ratio": told["ratio"],
                    "name": name,
                    "true": true[name],
                    "value": parameter["value"],
                    "interval": [low, high],
                    "covered": bool(low <= true[name] <= high),
                    "error_over_half_width": float((parameter["value"] - true[name]) / max((high - low) / 2, 1e-300)),
                }


def _gain(truth: Json, joint: str) -> float:
    """What the torque channel of a joint shows of one N m."""
    gains = [told for told in truth["effects"] if told["kind"] == "torque_gain" and joint in told["joints"]]
    return float(np.prod([1 + expected(told, joint)["gain"] for told in gains]))


def _unknown(truth: Json, result: Json, before: np.ndarray, after: np.ndarray, oracle: np.ndarray) -> dict[str, Any]:
    """Of effects outside the catalogue: said, with the right signals, how much of it removed, nothing forced."""
    told = truth["strangers"][0]
    pushed = [truth["joints"].index(joint) for joint in told["pushed"]]
    strengths: dict[str, float] = {}
    entries = [e for e in result["effects"] if e["kind"] == UNKNOWN] + list(result.get("unexplained") or ())
    for entry in entries:
        joints = entry.get("joints") or [entry.get("joint")]
        if not set(joints) & set(told["pushed"]):
            continue
        for part in entry.get("depends_on") or ():
            name = signal_name(part["signal"])
            strengths[name] = max(strengths.get(name, 0.0), float(part.get("strength") or 0.0))
    ranked = sorted(strengths, key=lambda name: -strengths[name])
    groups = told["depends_on"]
    leading = ranked[: len(groups) + 1]
    hit = [any(name in leading for name in group) for group in groups]
    explainable = float(np.sum((before - oracle)[pushed] / np.asarray(truth["noise_std"])[pushed]))
    removed = float(np.sum((before - after)[pushed] / np.asarray(truth["noise_std"])[pushed]))
    return {
        "kind": told["kind"],
        "ratio": told["ratio"],
        "said": bool(entries),
        "signals": ranked,
        "wanted": groups,
        "hit": float(np.mean(hit)),
        "right_signals": all(hit),
        "first_is_right": bool(ranked) and any(ranked[0] in group for group in groups),
        "share_removed": removed / explainable if explainable > 0 and np.isfinite(removed) else None,
    }


def _contacts(truth: Json, result: Json) -> dict[str, Any] | None:
    """Windows found over pushes there were, in training and in test runs; windows without any push."""
    windows: dict[str, list[tuple[float, float]]] = {}
    for finding in result["data"]["findings"]:
        if CONTACT in finding["code"] and finding.get("file") and finding.get("rows"):
            name = str(finding["file"]).rpartition("/")[2]
            first, last = (row / truth["rate"] for row in finding["rows"])
            windows.setdefault(name, []).append((first, last))
    if not truth["contacts"] and not windows:
        return None
    train = set(truth["train"])
    found: dict[str, list[bool]] = {"train": [], "test": []}
    beyond = inside = 0.0
    false = 0
    for name in {*truth["contacts"], *windows}:
        pushes, own = truth["contacts"].get(name, []), windows.get(name, [])
        kind = "train" if name in train else "test"
        found[kind] += [any(_overlap(push, window) > 0 for window in own) for push in pushes]
        for window in own:
            near = max((_overlap((a - WIDER, b + WIDER), window) for a, b in pushes), default=0.0)
            false += near == 0
            inside += near
            beyond += window[1] - window[0] - near
    return {"found": found, "false_windows": false, "seconds_beyond": beyond, "seconds_inside": inside}


def _overlap(one: Sequence[float], other: Sequence[float]) -> float:
    return max(0.0, min(one[1], other[1]) - max(one[0], other[0]))


def _numbers(values: Sequence[float | None]) -> np.ndarray:
    return np.array([np.nan if value is None else value for value in values])


def _plain(values: np.ndarray) -> list[float | None]:
    return [float(value) if np.isfinite(value) else None for value in values]
