"""The three questions of the first screen: how good the model is, what was missing, what to do next."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from dynid_rs.base.wording import ANOTHER_FUNCTION, against_reference, before_words, concluded, is_better, kinds_said
from dynid_rs.report.axes import signal_words
from dynid_rs.report.families import Family, families, said, sentence
from dynid_rs.report.text import NBSP, capital, esc, join_words, percent, plural, ratio, short_names, with_code, words

Result = Mapping[str, Any]

MOST_NAMED = 3
"""Families that the first screen names; the others are counted."""
WORSE = 1.05
"""Ratio of two errors from which one is said to be worse."""
LONGEST = 170
"""Letters of a sentence from elsewhere that the first screen holds; the whole of it stands in its section."""


def answer(result: Result, *, diagnosis: bool) -> str:
    """HTML: the three questions with an answer each."""
    missing = _missing(result) if diagnosis else _not_asked(result)
    rows = (
        ("How good is the model?", _good(result)),
        ("What was missing?" if diagnosis else "What is missing?", missing),
        ("What to do next?", _next(result, diagnosis=diagnosis)),
    )
    body = "".join(f"<div><dt>{question}</dt><dd>{text}</dd></div>" for question, text in rows)
    return f'<dl class="answer">{body}</dl>'


def _good(result: Result) -> str:
    if bad := _errors(result):
        return f"<b>Not known.</b> The data has an error: {esc(_cut(_finding(bad[0])))}"
    test = result["rmse"]["test"]
    left = _range(test["after"], test["torque_std"])
    if left is None:
        return "<b>Not known.</b> There is no test run with torque to measure it on."
    with_effects = test["before"] != test["after"]
    others = [(name, _range(test[key], test["torque_std"])) for name, key in _rivals(result, with_effects)]
    compared = "; ".join(f"{name} {span}" for name, span in others if span)
    text = f"On unseen runs it leaves <b>{left}</b> of a joint\u2019s torque ({compared})."
    return text + _where_worse(result, with_effects)


def _rivals(result: Result, with_effects: bool) -> list[tuple[str, str]]:
    before = "the reference" if against_reference(result) else "declared"
    rivals = [(before, "before")] if with_effects else []
    return [*rivals, ("least squares", "wls")]


def _where_worse(result: Result, with_effects: bool) -> str:
    """Where the simpler model would be the better one."""
    test, names = result["rmse"]["test"], short_names(result["joints"])
    for name, key in ((f"the {before_words(result)}", "before"), ("least squares", "wls")):
        pairs = zip(names, test["after"], test[key], strict=True)
        worse = [joint for joint, new, old in pairs if (share := ratio(new, old)) is not None and share > WORSE]
        if worse and (with_effects or key == "wls"):
            return f" {esc(capital(name))} is better on {esc(join_words(worse))}."
    if not is_better(dict(result)) and None not in test["after"]:
        return " It is no better than least squares."
    return ""


def _range(errors: Sequence[float | None], stds: Sequence[float | None]) -> str | None:
    shares = [share for error, std in zip(errors, stds, strict=True) if (share := ratio(error, std)) is not None]
    if not shares:
        return None
    low, high = percent(min(shares)), percent(max(shares))
    return low if low == high else f"{low.removesuffix(f'{NBSP}%')} to {high}"


def _missing(result: Result) -> str:
    if not concluded(result):
        return "Nothing is concluded: an error in the data comes first."
    found, small = families(result)
    left = _unknown_left(result)
    if not found:
        text = "<b>Nothing that lowers the error</b> by more than the noise."
        text = text if small or not result.get("nothing_to_add") else "<b>Nothing:</b> what is left is noise."
        return text + left
    return f"{_named(found, result)}{_few(small)}{left}"


def _named(found: Sequence[Family], result: Result) -> str:
    names = [said(family, result) for family in found[:MOST_NAMED]]
    text = "; ".join(
        f"<b>{esc(family.name)}</b>{esc(name.removeprefix(family.name))}"
        for family, name in zip(found, names, strict=False)
    )
    more = len(found) - len(names)
    others = f"; {plural(more, 'more kind')} below" if more else ""
    return f"{capital_html(text)}{others}."


def capital_html(text: str) -> str:
    """Capital letter of a sentence that begins in bold."""
    return f"<b>{capital(text[3:])}" if text.startswith("<b>") else capital(text)


def _few(small: Sequence[Family]) -> str:
    number = sum(len(family.members) for family in small)
    return (
        f" {plural(number, 'small effect')} lower{'s' if number == 1 else ''} no error by more than the noise."
        if number
        else ""
    )


def _unknown_left(result: Result) -> str:
    worst = max(result.get("unexplained") or [], key=lambda entry: entry.get("share") or 0.0, default=None)
    if worst is None:
        return ""
    joint = dict(zip(result["joints"], short_names(result["joints"]), strict=True)).get(worst["joint"], worst["joint"])
    return f" <b>Unknown:</b> {percent(worst.get('share'))} of the error\u2019s power on {esc(joint)}."


def _not_asked(result: Result) -> str:
    if result.get("effects"):
        return _named(families(result)[0], result)
    left = [entry["joint"] for entry in result.get("unexplained") or []]
    where = f" The residual on {esc(join_words(left))} is not noise." if left else ""
    return f"Not looked for: <code>dynid identify</code> fits what was declared.{where}"


def _next(result: Result, *, diagnosis: bool) -> str:
    """The one step that helps most: mend the data, then the experiment that decides, then the use of the model."""
    if bad := _errors(result):
        return f"Mend the data: {esc(_cut(bad[0]['message']))}"
    sentences = _experiments(result)
    if sentences:
        more = f' <a href="#next">{len(sentences) - 1} more</a>' if len(sentences) > 1 else ""
        return sentences[0] + more
    if not diagnosis:
        return "Look for what the model lacks: <code>dynid diagnose</code> with the same robot and runs."
    missing = [f for f in result["data"].get("findings") or [] if f.get("code") == "signal_missing"]
    if missing:
        signals = _wished(missing)
        wish = f" To test more effects, record <b>{esc(join_words(signals))}</b> too." if signals else ""
        return f'Use the model: <code>model.json</code>.{wish} <a href="#sensors">Details</a>'
    return "Nothing more to record: use <code>model.json</code> in the control loop."


_WISHED = {"q_motor": "motor positions", "temperature": "joint temperatures"}


def _wished(findings: Sequence[Result]) -> list[str]:
    columns = dict.fromkeys(f.get("column") for f in findings)
    return [_WISHED[column] for column in columns if column in _WISHED]


def _experiments(result: Result) -> list[str]:
    """Experiments as the first screen says them, the most telling first; commands stand in their section."""
    others = [with_code(_plain(text, result)) for text in result.get("next_experiment") or []]
    short = dict(zip(result["joints"], short_names(result["joints"]), strict=True))
    ties = []
    for entry in result.get("effects") or []:
        told_by_motion = [tie for tie in entry.get("ties") or () if not tie.get("same_torque")]
        if told_by_motion and kinds_said(entry):
            pair = (words(entry.get("told_as") or entry["kind"]), words(told_by_motion[0]["kind"]))
            joint = short.get(entry["joints"][0], entry["joints"][0])
            beyond = ", beyond the positions seen so far" if told_by_motion[0]["kind"] == ANOTHER_FUNCTION else ""
            text = "Record a run that separates <b>{}</b> from <b>{}</b> on {}{}."
            ties.append(text.format(*map(esc, (*pair, joint, beyond))))
    return [ties[0], *others[1:]] if ties else others


def _plain(text: str, result: Result) -> str:
    """A sentence with signals as people call them."""
    for entry in result.get("unexplained") or []:
        for d in entry.get("depends_on") or []:
            text = text.replace(
                f"depends on {d['signal']}:", f"depends on the {signal_words(d['signal'], result['joints'])}:"
            )
    return text


def _errors(result: Result) -> list[Result]:
    return [f for f in result["data"].get("findings") or [] if f["severity"] == "error"]


def _finding(finding: Result) -> str:
    return sentence(finding["message"])


def _cut(text: str) -> str:
    return text if len(text) <= LONGEST else text[:LONGEST].rpartition(" ")[0] + " \u2026"
