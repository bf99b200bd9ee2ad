"""Effects that were found, family by family, and what is left. Every text from a file goes through `esc`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from dynid_rs.base.mattering import measured
from dynid_rs.base.units import torques_told, unit_text
from dynid_rs.base.wording import ANOTHER_FUNCTION, kinds_said, under_words
from dynid_rs.report import curves
from dynid_rs.report.axes import signal_words
from dynid_rs.report.families import Family, Member, families, where_of
from dynid_rs.report.figures import Figures
from dynid_rs.report.meanings import meaning
from dynid_rs.report.tables import cell, table
from dynid_rs.report.text import (
    DASH,
    NBSP,
    breakable,
    capital,
    change,
    esc,
    interval,
    join_words,
    percent,
    plural,
    significant,
    with_unit,
    words,
)

Result = Mapping[str, Any]

LEFT_OUT = (
    "<i>Without it</i>: this effect alone is taken out and all coefficients are fitted again. Both errors are of one "
    "linear fit with all shapes as they were found, so they differ a little from the chart above."
)
LEAST_P = 1e-9
"""Smaller ones are not told apart."""


def effect_cards(figures: Figures, result: Result) -> str:
    """One card per family that matters, and those that lower no error by more than the noise folded away."""
    found, small = families(result)
    plots = [member.entry.get("plot") for family in [*found, *small] for member in family.members]
    body = curves.key(plots) if any(plots) else ""
    entries = [member.entry for family in [*found, *small] for member in family.members]
    alone = any(measured(entry) and entry.get("rmse_test_change_interval") for entry in entries)
    body += f'<p class="note">{LEFT_OUT}</p>\n' if alone else ""
    body += "".join(_family(figures, result, family) for family in found)
    if not small:
        return body
    number = sum(len(family.members) for family in small)
    inside = "".join(_family(figures, result, family) for family in small)
    return (
        f'{body}<details class="small-effects"><summary><b>{plural(number, "effect")} that lower'
        f"{'s' if number == 1 else ''} no error by more than the noise</b></summary>\n"
        "<p>The data shows them, but on the test runs the error is as large without them, as far as one can tell; or "
        f"they lie above the band of frequencies in which errors are compared.</p>\n{inside}</details>"
    )


def _family(figures: Figures, result: Result, family: Family) -> str:
    kinds = list(dict.fromkeys(kind for m in family.members for kind in kinds_said(m.entry)))
    several = len(family.members) > 1
    members = "".join(_member(figures, result, family, member, several=several) for member in family.members)
    return (
        f'<article class="family">\n<h3>{esc(capital(family.name))} '
        f'<span class="soft">on {esc(where_of(family, result))}</span></h3>\n'
        f'<p class="meaning">{meaning(kinds)}{_either(kinds, family.places)}</p>\n'
        f'<div class="members{"" if several else " one"}">{members}</div></article>\n'
    )


def _either(kinds: Sequence[str], places: Sequence[Sequence[str]]) -> str:
    if len(kinds) > 1:
        return " It is one or the other: these data cannot tell."
    return " It acts at one place or the other: these data cannot tell." if len(places) > 1 else ""


def _member(figures: Figures, result: Result, family: Family, member: Member, *, several: bool) -> str:
    entry, k = member.entry, member.rank - 1
    joints = ", ".join(breakable(joint) for joint in entry["joints"])
    head = f"<h4>{joints}</h4>\n" if several else ""
    notes = [entry.get("note"), under_words(entry, result["joints"])]
    note = "".join(f'<p class="note">{esc(capital(text))}.</p>' for text in notes if text)
    name = family.name if not family.unknown else "what is found"
    where_ = entry["joints"][0] if several else ""
    drawn = curves.curve(figures, f"effect-{k}", entry.get("plot"), result, capital(name), where_)
    figure = f"<figure>{drawn}</figure>" if drawn else f'<p class="note no-curve">{_no_curve(entry)}</p>'
    figure += _shown_on(entry) if drawn else ""
    return (
        f'<section class="member" aria-label="{esc(capital(family.name))}, {esc(", ".join(entry["joints"]))}">{head}'
        f'<div class="sure">{_gain(result, member)}</div>{figure}\n<div class="facts">{_parameters(entry)}'
        f"{_depends(entry, result)}{_neighbours(entry)}{note}</div></section>\n"
    )


def _shown_on(entry: Result) -> str:
    """Which joint a curve is of, where the effect is not that joint's alone."""
    joint = entry["plot"].get("joint")
    if joint is None or entry["joints"] == [joint] or len(entry["joints"]) == 2:
        return ""
    own = entry["kind"] in ("encoder_delay", "torque_delay")  # of which every joint's curve is its own
    also = "" if own else "; the other joints\u2019 angles count too, so points scatter"
    return f'<p class="note">Drawn on {breakable(joint)}, which shows most of it{also}.</p>'


def _no_curve(entry: Result) -> str:
    if entry["kind"] == "torque_gain":
        return "It scales the whole torque of the joint: a curve would be a straight line; its size is below."
    if entry["kind"] == "torque_delay":
        return "It shifts the whole torque in time: it is no torque over a signal; its size is below."
    if len(entry["joints"]) > 1:
        return "It acts on several joints at once: no single signal shows it as a curve."
    return "It changes what the model is made of; its size is below, what it brings is in the chart of errors."


def _gain(result: Result, member: Member) -> str:
    """How sure it is and what it brings: error without and with it, on the joints that it acts on."""
    entry = member.entry
    facts = []
    if measured(entry):
        before, after = entry["rmse_test_before"], entry["rmse_test_after"]
        names = result["joints"] if len(after) == len(result["joints"]) else entry["joints"]
        units, several = dict(zip(result["joints"], torques_told(result), strict=True)), len(entry["joints"]) > 1
        for joint, old, new in zip(names, before, after, strict=False):
            if joint in entry["joints"]:
                place = f"{breakable(joint)}: " if several else "Test error: "
                unit = esc(unit_text(units[joint]))
                with_it = f"with it <b>{significant(new)}{NBSP}{unit}</b>, {change(new, old)}"
                facts.append(f"{place}without it {significant(old)}, {with_it}")
    elif member.entry.get("above_band"):
        facts.append("Above the band of the errors")
    else:
        facts.append("Its own part of the change was not measured")
    if entry.get("share_explained") is not None:
        facts.append(f"explains {percent(entry['share_explained'])} of what could be explained")
    if entry.get("p_value") is not None:
        facts.append(f"by chance: {_p(entry['p_value'])}")
    return f'<p class="gain">{"; ".join(facts)}</p>\n'


def _parameters(entry: Result) -> str:
    """Numbers of an effect; of one without a name none, as they would be those of the law that stands in for it."""
    several = len(entry["joints"]) > 1
    rows = [
        [
            esc(words(p["name"])) + (f" ({breakable(p['joint'])})" if several and p.get("joint") else ""),
            cell(esc(with_unit(significant(p["value"]), p.get("unit"))), "num main"),
            cell(interval(p.get("interval")), "num soft"),
        ]
        for p in (entry.get("parameters") or [] if kinds_said(entry) else [])
        if p["name"] != "side"  # the note below says it by the neighbour's name
    ]
    head = ["Size", "Value", "95 % interval"]
    return table(head, rows, kind="tight", label="Sizes of this effect") if rows else ""


def _neighbours(entry: Result) -> str:
    """What it was told apart from, and what it was not."""
    body = ""
    for tie in entry.get("ties") or []:
        there = _there(tie, entry["joints"])
        errors = tie.get("rmse_test_after") or []
        with_it = f" (test error {' / '.join(significant(e) for e in errors)})" if 0 < len(errors) <= 2 else ""
        how = f" To separate them:<br><code>{esc(tie['separate'])}</code>" if tie.get("separate") else ""
        body += (
            f'<p class="tie"><b>Not told apart from {esc(words(tie["kind"]))}</b>{there}, which '
            f"{_as_well(tie)}{with_it}{_on_any_motion(tie)}.{how}</p>\n"
        )
    apart = [_apart(other, entry["joints"]) for other in entry.get("told_apart_from") or []]
    body += f'<p class="note">Told apart from {join_words(apart)}.</p>\n' if apart else ""
    return body


def _as_well(tie: Result) -> str:
    if tie["kind"] == ANOTHER_FUNCTION:
        return "may go on otherwise beyond the positions that the runs have shown"
    return "explains the data equally well"


def _on_any_motion(tie: Result) -> str:
    return ", and would on any motion: beside the declared model both are the same torque" * bool(
        tie.get("same_torque")
    )


def _p(value: float) -> str:
    """What a p-value says; how far below certainty it lies says nothing more."""
    if value < LEAST_P:
        return f"p{NBSP}<{NBSP}{significant(LEAST_P, 1)}"
    return f"p{NBSP}={NBSP}{significant(value, 2)}"


def _there(other: Result, joints: Sequence[str]) -> str:
    """Where it acts, if that is not where the effect itself does."""
    places = other.get("joints") or []
    return f" on {esc(', '.join(places))}" if places and list(places) != list(joints) else ""


def _apart(other: Result, joints: Sequence[str]) -> str:
    return f"{esc(words(other['kind']))}{_there(other, joints)}"


def _depends(entry: Result, result: Result) -> str:
    return _dependence(entry["depends_on"], result) if entry.get("depends_on") else ""


def leftovers(figures: Figures, result: Result) -> str:
    """One card per joint on which something stays that is not noise."""
    entries = result.get("unexplained") or []
    cards = "".join(_leftover(figures, result, entry, k) for k, entry in enumerate(entries))
    return f'<div class="members">{cards}</div>'


def _leftover(figures: Figures, result: Result, entry: Result, k: int) -> str:
    facts = [f"{percent(entry.get('share'))} of the error\u2019s power is not noise"]
    facts += [f"by chance: {_p(entry['p_value'])}"] if entry.get("p_value") is not None else []
    term = entry.get("term") or {}
    said = ""
    if term.get("kept") is not None:
        with_it = term.get("rmse_test_with")
        error = "" if with_it is None else f" (test error with it {significant(with_it)})"
        decision = "pays on runs left out and is in the model" if term["kept"] else "did not pay on runs left out"
        said = f'<p class="note">A data-driven term on these signals {decision}{error}.</p>'
    drawn = curves.curve(figures, f"left-{k}", entry.get("plot"), result, f"What is left on {entry['joint']}")
    figure = f"<figure>{drawn}</figure>" if drawn else ""
    return (
        f'<section class="member" aria-label="Unknown on {esc(entry["joint"])}"><h3>{breakable(entry["joint"])} '
        f'<span class="soft">unknown</span></h3>\n<p class="gain">{"; ".join(facts)}</p>\n'
        f"{figure}{_dependence(entry.get('depends_on') or [], result)}{said}</section>\n"
    )


def _dependence(depends: Sequence[Result], result: Result) -> str:
    """Strengths as bars, direct dependence told from what only comes along."""
    if not depends:
        return '<p class="note">It depends on no single signal that is known.</p>'
    top = max((abs(d.get("strength") or 0.0) for d in depends), default=0.0) or 1.0
    rows = []
    for d in depends:
        strength, direct = d.get("strength"), d.get("direct", True)
        width = round(100 * abs(strength or 0.0) / top)
        bar = (
            f'<span class="track"><i class="fill {"after" if direct else "before"}" style="width:{width}%"></i></span>'
        )
        rows.append(
            [
                esc(signal_words(d["signal"], result["joints"])),
                cell(DASH if strength is None else significant(strength, 2)),
                cell(bar, "strip"),
                cell("directly" if direct else "through the others", "word" if direct else "soft word"),
            ]
        )
    head = ["Depends on", "Strength", '<th scope="col" class="strip"><span class="hidden">as a bar</span></th>', "How"]
    return table(head, rows, kind="tight", label="Signals that it depends on")
