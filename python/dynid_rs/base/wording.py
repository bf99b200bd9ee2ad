"""What the numbers mean, in plain words."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.quoting import shown

NO_BETTER = 1.02
"""Ratio of an error to the baseline's from which a model is no better than it."""
NO_INTERVAL = (
    "no interval can be said where the test runs are too short for how long the errors remember each other, or for how "
    "much their size varies"
)
"""Why there is a dash in the place of a 95 % interval."""

QUANTITY_WORDS = {
    "torque": "torque",
    "friction_torque": "friction torque",
    "deflection": "motor minus link angle",
}
"""What a curve shows, by the word that ``result.json`` has for it."""

ANOTHER_FUNCTION = "another_function_of_the_position"
"""Kind of a tie: what a law of a joint's position is not told from where a function without a name does as well."""


def kind_words(kind: str) -> str:
    """``load_dependent_friction`` as people write it."""
    return kind.replace("_dependent_", "-dependent ").replace("_", " ")


def under_words(effect: Mapping[str, Any], joints: Sequence[str]) -> str:
    """``under the torque of joint_2`` where an effect is made of a neighbour's load; empty of all others."""
    side = next((p["value"] for p in effect.get("parameters") or () if p["name"] == "side"), None)
    return "" if side is None else f"under the torque of {joints[joints.index(effect['joints'][0]) + int(side)]}"


def is_friction(kind: str) -> bool:
    """Whether a kind of torque brakes the motion: friction by any law, and what is lost where a motion turns round."""
    return kind.startswith("stribeck") or any(word in kind for word in ("friction", "hysteresis"))


def kinds_said(effect: Mapping[str, Any]) -> list[str]:
    """What an effect may be: its kind; of one that is one kind or another, all of them; of one without a name, none."""
    if effect["kind"] != "unknown":
        return [effect["kind"]]
    ties = effect.get("ties") or ()
    return list(dict.fromkeys([effect["told_as"], *(tie["kind"] for tie in ties)])) if ties else []


def other_places(effect: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Joints at which an effect may act in the place of its own, where the data do not tell."""
    if effect["kind"] != "unknown":
        return []
    own = effect["joints"]
    return [tuple(tie["joints"]) for tie in effect.get("ties") or () if tie.get("joints", own) != own]


def family_of(effect: Mapping[str, Any]) -> tuple[Any, ...]:
    """What effects of one family have in common: their name, and where it is not settled on which joints, those."""
    others = other_places(effect)
    return (*sorted(kinds_said(effect)), *([tuple(effect["joints"]), *others] if others else ()))


def in_families(effects: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """One entry per family, in the order of its first: that one, with every joint on which another of it acts."""
    found: dict[tuple[Any, ...], list[Mapping[str, Any]]] = {}
    for effect in effects:
        found.setdefault(family_of(effect), []).append(effect)
    return [_as_one(family) if len(family) > 1 else dict(family[0]) for family in found.values()]


def _as_one(family: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The first of several effects whose ties are at their own joints, on all joints."""
    ties = [{"kind": tie["kind"]} for tie in family[0].get("ties") or ()]
    joints = dict.fromkeys(joint for effect in family for joint in effect["joints"])
    return {**family[0], "joints": list(joints), "ties": ties}


def against_reference(result: Mapping[str, Any]) -> bool:
    """Whether a diagnosis asked what has changed against a reference, of whose parameters its fit tells nothing."""
    return result.get("steps") is not None and result.get("covariance", {}) is None


def before_words(result: Mapping[str, Any]) -> str:
    """What the errors `before` are of."""
    return "reference" if against_reference(result) else "declared model"


def lacks_interval(result: Mapping[str, Any]) -> bool:
    """Whether a joint has no interval of its error or of the change, although intervals were asked for."""
    test = result["rmse"]["test"]
    return any(pair is None for key in ("after_interval", "change_interval") for pair in test.get(key) or ())


def verdict(result: dict[str, Any]) -> str:
    """One or two sentences for an engineer who has a minute."""
    test = result["rmse"]["test"]
    change = 100 * (1 - _mean_ratio(test["after"], test["wls"]))
    errors = _relative_errors(np.asarray(test["after"]), np.asarray(test["torque_std"]))
    if abs(change) < 1:
        against = "as much as weighted least squares leaves"
    elif change > 0:
        against = f"{change:.0f} % less than weighted least squares leaves"
    else:
        against = f"{-change:.0f} % MORE than weighted least squares leaves; the simple model is the better one here"
    summary = f"On runs that it has not seen the model leaves {errors}, on average {against}."
    third, declared = result["residual"]["reason"], _prior(result) + _not_separable(result)
    return f"{summary}{_worse_joints(result)}{_bias(result)} {third}{declared}"


def _prior(result: dict[str, Any]) -> str:
    """How far the data trusts the robot file's inertials, where they are in the fit."""
    prior = result.get("prior")
    if prior is None:
        return ""
    off = prior["relative_uncertainty"]
    rotors = "" if off["rotors"] is None else f" (rotors: {_percent(off['rotors'])})"
    combinations = f"{prior['n_directions']} combination{'' if prior['n_directions'] == 1 else 's'}"
    return (
        " Where these runs say little, the masses and inertias of the robot file decide; by the evidence they are "
        f"wrong by about {_percent(off['links'])}{rotors}. Of {combinations} of them the runs determine "
        f"{prior['n_determined']:.0f}."
    )


def _percent(share: float) -> str:
    """With two digits, and never as a power of ten."""
    return f"{float(f'{100 * share:.2g}'):g} %"


def _not_separable(result: dict[str, Any]) -> str:
    messages = [f["message"] for f in result.get("data", {}).get("findings", ()) if f["code"] == "not_separable"]
    return "".join(f" {message[0].upper()}{message[1:]}." for message in messages)


def _bias(result: dict[str, Any]) -> str:
    """Say that least squares is biased where the test with instruments finds it."""
    found = result.get("endogeneity")
    if not found or not found["biased"]:
        return ""
    account = {
        "reference": "the reference trajectory",
        "second_encoder": "the other encoders",
        "smooth": "the smooth part of the motion",
    }[found["instruments"]]
    worst = found["largest_shift"]
    return (
        f" Least squares is biased: with instruments from {account}, {worst['parameter']} moves by "
        f"{worst['standard_errors']:.1f} standard errors (Durbin-Wu-Hausman p = {found['p_value']:.1g}); noise of the "
        "positions, or an effect that the model lacks, is in the regressor."
    )


def _worse_joints(result: dict[str, Any]) -> str:
    """Name the joints on which the simple model is clearly better, and those on which no model helps."""
    test = result["rmse"]["test"]
    joints, after = result["joints"], np.asarray(test["after"])
    ratio = after / np.maximum(test["wls"], 1e-300)
    words = ""
    worse = [f"{joints[j]} ({100 * (ratio[j] - 1):+.0f} %)" for j in np.flatnonzero(ratio > 1.1)]
    if worse:
        words += f" Least squares is better on {', '.join(worse)}."
    lost = [joints[j] for j in np.flatnonzero(_lost(test))]
    if lost:
        words += f" On {', '.join(lost)} the error is as large as the torque itself: look at the data first."
    return words


def is_better(result: dict[str, Any]) -> bool:
    """Whether the model explains every joint's torque, and does it better than the baseline on average over the joints.

    A model that leaves nothing is good whatever the baseline leaves.
    """
    test = result["rmse"]["test"]
    if np.any(_lost(test)):
        return False
    nothing_left = np.all(np.asarray(test["after"]) <= 1e-6 * np.asarray(test["torque_std"]))
    return bool(nothing_left or _mean_ratio(test["after"], test["wls"]) < NO_BETTER)


def worse_than_least_squares(result: Mapping[str, Any]) -> str:
    """One sentence on joints where a model leaves more than weighted least squares; empty where there are none."""
    test, joints = result["rmse"]["test"], result["joints"]
    said = []
    with_effects = test["before"] != test["after"]
    mended = "the reference with what has changed" if against_reference(result) else "the model with effects"
    names = ((f"the {before_words(result)}", "before"), (mended, "after")) if with_effects else (("it", "after"),)
    for name, key in names:
        errors, baseline = (np.asarray(values, dtype=float) for values in (test[key], test["wls"]))  # None is NaN
        ratios = errors / np.where(baseline > 0, baseline, np.nan)
        worse = np.flatnonzero(ratios > NO_BETTER)
        if len(worse):
            where = ", ".join(f"{shown(joints[j])} ({100 * (ratios[j] - 1):+.0f} %)" for j in worse)
            said.append(f"{name} leaves more than weighted least squares on {where}")
    return f"Worse than the simplest model: {'; '.join(said)}." if said else ""


def _lost(test: dict[str, Any]) -> NDArray[np.bool_]:
    """Joints whose torque changes and whose error is no smaller than that, (n_joints,)."""
    std = np.asarray(test["torque_std"])
    lost: NDArray[np.bool_] = (std > 0) & (np.asarray(test["after"]) >= std)
    return lost


def residual_reason(result: dict[str, Any]) -> str:
    """Whether the third loop paid, and where, with the figures."""
    residual = result["residual"]
    if residual.get("switched_off"):
        return "The third loop was switched off."
    method = {"gmr": "mixture regression", "rbf": "radial basis functions"}[residual["kind"]]
    signals = {
        "deflection": "the gears' deflection",
        "joint_state": "joint position and velocity",
        "load_free_deflection": "the gears' deflection without the load's share",
    }[residual["inputs"]]
    kept = np.isin(result["joints"], residual["kept_on"])
    change = 100 * (np.asarray(residual["rmse_test_with"]) / np.maximum(residual["rmse_test_without"], 1e-300) - 1)
    fitted = np.asarray(residual["n_components"]) > 0
    if not fitted.any():
        return "The third loop had nothing to learn from: no joint has two different encoder signals."
    if not kept.any():
        return (
            f"The third loop ({method} on {signals}) did not pay on training runs left out and is not in the "
            f"model; on the test runs it would have changed the error by {_range(change[fitted])}."
        )
    names = ", ".join(np.asarray(result["joints"])[kept])
    words = f"The third loop ({method} on {signals}) paid on {names} and is in the model there: "
    words += f"it changed the error on the test runs by {_range(change[kept])}."
    if not kept.all():
        words += " On the other joints it did not pay on training runs left out."
    return words


def _relative_errors(error: Any, std: Any) -> str:
    """Smallest and largest error over the joints whose torque changes at all; a dead channel has no scale."""
    alive = std > 0
    if not alive.any():
        return "errors that have no scale, because no torque changes on the test runs,"
    relative = 100 * error[alive] / std[alive]
    ends = dict.fromkeys(f"{end:.1f}" for end in (relative.min(), relative.max()))
    return f"{' to '.join(ends)} % of the torque's standard deviation"


def _mean_ratio(after: Any, before: Any) -> float:
    """Geometric mean over the joints, so that none counts for its size."""
    floor = 1e-300
    return float(np.exp(np.mean(np.log(np.maximum(after, floor)) - np.log(np.maximum(before, floor)))))


def _range(percent: Any) -> str:
    low, high = round(float(np.min(percent))), round(float(np.max(percent)))
    if low == high:
        return f"{low:+d} %" if low else "less than 1 %"
    return f"{low:+d} to {high:+d} %"


def concluded(result: Mapping[str, Any]) -> bool:
    """Whether the answer stands: an error in the data ends the diagnosis before there is one."""
    errors = any(finding["severity"] == "error" for finding in result["data"]["findings"])
    return not errors or bool(result["effects"] or result["unexplained"])
