"""What has changed: one row per change, with when, where, how much, what became of it, and what to do."""

from __future__ import annotations

import re
from collections.abc import Sequence

from dynid_rs.base.changes import FROZEN, WITHDRAWN, Change, advice, interval_words, kind_words, size_words
from dynid_rs.base.clock import is_wall_clock, time_words
from dynid_rs.report.health_source import Episode, Health
from dynid_rs.report.health_trend import COLORS, Axis
from dynid_rs.report.tables import cell, table
from dynid_rs.report.text import NBSP, breakable, capital, esc, significant, typeset, with_code, with_unit

WHOLE_ARM = "the last link"
"""Where a load is."""


def size_of(change: Change) -> str:
    """HTML of a size: `+21 %`, `0.244 kg`."""
    if change.kind == "delay":  # which words give in ms
        return esc(typeset(size_words(change.kind, change.size, "")))
    return esc(with_unit(typeset(size_words(change.kind, change.size, "")), change.unit))


def named(change: Change) -> str:
    """HTML of a change in a sentence: `friction of joint_2 +21 %`."""
    where = "" if change.kind == "load" else f" of {esc(change.joint)}"
    what = "unknown error" if change.kind == "unknown" else kind_words(change.kind)
    return f"{what}{where} {size_of(change)}"


def changes_table(health: Health, found: Sequence[Episode], axis: Axis) -> str:
    """HTML of all changes, in the order in which they were said."""
    if not found:
        return "<p>Nothing.</p>"
    head = ["No.", "When", "What", "Size <small>95 % interval</small>", "State", "What to do"]
    return table(head, [_row(health, one, axis) for one in found], kind="stack", label="What has changed")


def _row(health: Health, one: Episode, axis: Axis) -> list[str]:
    now = one.now
    kind = "soft" if one.is_withdrawn else "main"
    bounds = "" if now.kind == FROZEN else f"<br><small>{typeset(interval_words(now.kind, now.interval))}</small>"
    return [
        str(one.number),
        cell(_when(health, one, axis), "place"),
        cell(_what(one), "what"),
        cell(f'<span class="{kind}">{size_of(now)}</span>{bounds}{_moments(now)}', "size"),
        cell(_state(one), "place"),
        cell(with_code(WITHDRAWN if one.is_withdrawn else advice(now.kind, now.size)), "text"),
    ]


def _when(health: Health, one: Episode, axis: Axis) -> str:
    t = one.named.t
    text = f"<code>{esc(health.runs[one.run].name)}</code><br>{_time(t)}"
    if len(axis.order) > 1 and not (axis.is_clock and is_wall_clock(t)):
        text += f'<br><span class="soft">at {typeset(f"{axis.at(one.run, t):.4g}")} {axis.word} on the charts</span>'
    return text


def _what(one: Episode) -> str:
    now, first = one.now, one.named
    where = WHOLE_ARM if now.kind == "load" else breakable(now.joint)
    what = esc(capital(kind_words(now.kind))) if now.kind != "unknown" else "Unknown: the error has grown"
    text = f"{what}<br><b>{where}</b>"
    if now.either:
        text += f"<br>or {esc(now.either)}: these data cannot tell"
    if (first.kind, first.joint) != (now.kind, now.joint):
        text += f'<br><span class="soft">named first as {named(first)}</span>'
    return text


def _moments(change: Change) -> str:
    if change.kind != "load" or change.moments is None:
        return ""
    listed = ", ".join(significant(m, 2) for m in change.moments)
    unit = change.unit.replace("kg", "kg*m", 1)
    return f"<br><small>first moments {with_unit(listed, unit)}</small>"


def _state(one: Episode) -> str:
    color = COLORS[one.now.said]
    dot = f'<span class="swatch" style="border-color:var(--{color})" aria-hidden="true"></span> '
    if one.outcome is None:
        return f"{dot}named; the run ends before it settles"
    return f"{dot}{one.outcome.said}, {_time(one.outcome.t)}"


def _time(t: float) -> str:
    """HTML of a time; seconds stay with their unit."""
    return esc(re.sub(" s$", f"{NBSP}s", time_words(t)))
