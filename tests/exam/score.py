"""What `dynid diagnose` got right in one case: names, errors, intervals, time. Reads result.json and the truth only."""

from __future__ import annotations

from typing import Any

UNKNOWN = "unknown"
"""A kind that accuses nobody: never a false name."""
SAME = (
    # The same warmth, told by a clock or by a thermometer.
    frozenset({"thermal_friction", "temperature_friction", "thermal_drift"}),
    # They differ within a few milliradians after a reversal only.
    frozenset({"load_dependent_friction", "load_hysteresis"}),
)
"""Kinds that are one thing in physics."""
PLACELESS = ("gravity_tilt",)
"""Kinds of the whole arm: no joint is a wrong one."""
ORDER = 0.02
"""Orders of ripple that differ by less than this are one; a ripple may be told by its first or second harmonic."""


def score(truth: dict[str, Any], result: dict[str, Any] | None, seconds: float, failure: str | None) -> dict[str, Any]:
    """Compare the result of one case (None: there is none) with its truth.

    `failure` is None, "traceback", "timeout" or "refused".
    """
    effects = [] if result is None else result["effects"]
    named = [effect for effect in effects if effect["kind"] != UNKNOWN]
    matches = [_match(effect, truth) for effect in named]
    excused = {
        _key(tie) for effect, match in zip(named, matches, strict=True) if match is not None for tie in effect["ties"]
    }
    false = [e for e, match in zip(named, matches, strict=True) if match is None and _key(e) not in excused]
    by_name = {match for match in matches if isinstance(match, int)}
    by_tie = {match for e in effects for other in _others(e) if isinstance(match := _match(other, truth), int)}
    found = [k in by_name or k in by_tie for k in range(len(truth["effects"]))]
    return {
        "seed": truth["seed"],
        "group": truth["group"],
        "case": truth["case"],
        "seconds": seconds,
        "failure": failure,
        "named": [_words(effect) for effect in named],
        "right": sum(isinstance(match, int) for match in matches),
        "false": [_words(effect) for effect in false],
        "unknown": [] if result is None else [entry["joint"] for entry in result["unexplained"]],
        "effects": [
            {key: told[key] for key in ("kind", "joints", "named", "ratio", "seen")} | {"found": was, "tie": by_only}
            for k, (told, was) in enumerate(zip(truth["effects"], found, strict=True))
            for by_only in [k in by_tie and k not in by_name]
        ],
        "harm": harm(result),
        "intervals": [
            told for effect, match in zip(named, matches, strict=True) for told in _intervals(effect, match, truth)
        ],
    }


def _others(effect: dict[str, Any]) -> list[dict[str, Any]]:
    """What an effect may be instead; of one that is either one or the other, and has no name for it, all of them."""
    undecided = effect["kind"] == UNKNOWN and effect["ties"]
    return [*effect["ties"], *([effect | {"kind": effect["told_as"]}] if undecided else [])]


def harm(result: dict[str, Any] | None) -> list[float] | None:
    """Error after over before, joint by joint, on the test runs; None where nothing was tested."""
    if result is None:
        return None
    test = result["rmse"]["test"]
    pairs = [(a, b) for a, b in zip(test["after"], test["before"], strict=True) if a is not None and b]
    return [a / b for a, b in pairs] or None


def _match(effect: dict[str, Any], truth: dict[str, Any]) -> int | str | None:
    """Which of the hidden effects a name means; "fact": something else that is true of the arm; None: neither."""
    for k, told in enumerate(truth["effects"]):
        if told["named"] and same_thing(effect, told):
            return k
    facts = truth["facts"].get(effect["kind"], [])
    if facts and set(effect["joints"]) <= set(facts):
        return "fact"
    elastic = truth["elastic"] is not None and effect["kind"] == "joint_elasticity"
    return "fact" if elastic else None


def same_thing(effect: dict[str, Any], told: dict[str, Any]) -> bool:
    """Whether a name with its place is that of a hidden effect."""
    kind, true = effect["kind"], told["kind"]
    first = told["joints"][:1]
    if {kind, true} == {"gravity_tilt", "kinematic_error"}:
        # A first joint whose frame is turned stands on a tilted base: nothing that is measured differs.
        return true == "gravity_tilt" and effect["joints"] == first
    if kind != true and not any({kind, true} <= same for same in SAME):
        return False
    if kind in PLACELESS:
        return True
    if not effect["joints"] or not set(effect["joints"]) <= set(told["joints"]):
        return False
    if kind == "bearing_friction" and not _same_side(effect, told):
        return False
    return kind != "torque_ripple" or _same_order(effect, told)


def _same_order(effect: dict[str, Any], told: dict[str, Any]) -> bool:
    """A ripple is right at its order, and at twice that; a tie tells none."""
    orders = [p["value"] for p in effect.get("parameters", []) if p["name"].startswith("cycles")]
    true = told["shape"]["cycles"]
    return not orders or any(abs(order / (true * n) - 1) < ORDER for order in orders for n in (1, 2))


def _same_side(effect: dict[str, Any], told: dict[str, Any]) -> bool:
    """A bearing is right under the neighbour that tilts it; a tie tells none."""
    sides = [p["value"] for p in effect.get("parameters", []) if p["name"] == "side"]
    return not sides or sides == [told["shape"]["side"]]


def _key(effect: dict[str, Any]) -> tuple[str, tuple[str, ...]]:
    return effect["kind"], tuple(effect["joints"])


def _words(effect: dict[str, Any]) -> str:
    orders = [f"{p['value']:.4g}" for p in effect.get("parameters", []) if p["name"] == "cycles"]
    order = f" of order {orders[0]}" if orders and effect["kind"] == "torque_ripple" else ""
    joints = effect["joints"]
    return f"{effect['kind']}{order} at {', '.join(joints) if len(joints) < 4 else 'all joints'}"


def _intervals(effect: dict[str, Any], match: int | str | None, truth: dict[str, Any]) -> list[dict[str, Any]]:
    """Return which intervals hold the truth, where a parameter means the same here and there."""
    if not isinstance(match, int) or truth["effects"][match]["kind"] != effect["kind"]:
        return []
    told = truth["effects"][match]
    if effect["kind"] == "position_dependent_friction" and not _same_cycles(effect, told):
        return []
    out = []
    for parameter in effect["parameters"]:
        name, interval = parameter["name"], parameter["interval"]
        at = parameter.get("joint", told["joints"][0])
        if name not in told["parameters"] or interval is None or at not in told["joints"]:
            continue
        value = told["parameters"][name]
        if name in ("cycles", "amplitude") and not _first_harmonic(effect, told):
            continue
        covered = bool(interval[0] <= value <= interval[1])
        out.append({"kind": effect["kind"], "parameter": name, "covered": covered})
    return out


def _same_cycles(effect: dict[str, Any], told: dict[str, Any]) -> bool:
    """Cosine and sine of other cycles per turn are other numbers."""
    return any(p["name"] == "cycles" and p["value"] == told["shape"]["cycles"] for p in effect["parameters"])


def _first_harmonic(effect: dict[str, Any], told: dict[str, Any]) -> bool:
    orders = [p["value"] for p in effect["parameters"] if p["name"] == "cycles"]
    return bool(orders) and abs(orders[0] / told["shape"]["cycles"] - 1) < ORDER
