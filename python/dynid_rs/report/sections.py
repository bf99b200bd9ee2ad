"""The sections about errors, torque and friction: each returns its HTML, or nothing to show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from dynid_rs.base.units import torques_said, torques_told, unit_text
from dynid_rs.base.wording import NO_INTERVAL, lacks_interval
from dynid_rs.report import bars, effect_cards, plots
from dynid_rs.report.answer import answer
from dynid_rs.report.figures import Figures, place
from dynid_rs.report.source import Source
from dynid_rs.report.text import (
    DASH,
    breakable,
    count,
    esc,
    file_names,
    percent,
    plural,
    ratio,
    significant,
    urgent_words,
    with_unit,
)

Result = Mapping[str, Any]


def head(result: Result, *, diagnosis: bool) -> str:
    """Robot, the three questions with their answers, and what the runs were."""
    data, samples = result["data"], result["data"].get("n_samples") or {}
    what = "What the torque model lacks" if diagnosis else "Identified torque model"
    train, test = plural(len(data["train"]), "training run"), plural(len(data["test"]), "test run")
    runs = (
        f"{plural(len(result['joints']), 'joint')}, {train} ({count(samples.get('train'))} samples), "
        f"{test} ({count(samples.get('test'))})"
    )
    bad = alert(data.get("findings") or [], "data")
    return (
        f'<p class="eyebrow">{what}</p>\n<h1>{esc(result["robot"])}</h1>\n'
        f'{answer(result, diagnosis=diagnosis)}\n<p class="note runs">{runs}</p>\n{bad}'
    )


def alert(findings: Sequence[Result], section: str) -> str:
    """The worst finding about the data, where there is one, and a link to the section of all."""
    bad = [f for f in findings if f["severity"] != "info"]
    if not bad:
        return ""
    worst = next((f for f in bad if f["severity"] == "error"), bad[0])
    more = "All of them" if len(bad) > 1 else "More"
    return (
        f'<p class="alert"><b><span aria-hidden="true">\u25b2</span> {urgent_words(bad)} about the data:</b> '
        f'{esc(worst["message"])} <a href="#{section}">{more}</a></p>\n'
    )


def errors(result: Result) -> str:
    """Errors per joint, with the key."""
    data = result["data"]
    method = f" The noise is {esc(result['floor_method'])}." if result.get("floor_method") else ""
    missing = f" {DASH}: {NO_INTERVAL}." if lacks_interval(result) else ""
    verdict = f'<p class="verdict">{esc(result["verdict"])}</p>\n' if result.get("verdict") else ""
    return (
        "<p>Root-mean-square torque error in percent of how much that joint\u2019s torque varies (its standard "
        "deviation), on the test runs only. Nothing here was used for fitting. Shorter is better.</p>\n"
        f"{bars.bar_chart(result)}\n{verdict}"
        '<p class="note">Weighted least squares: rigid body, Coulomb and viscous friction, fitted once. '
        "Three loops: friction, link dynamics and residual, repeated until nothing changes. The interval allows for "
        f"errors that depend on their neighbours in time.{method}{missing}</p>\n"
        f'<p class="note">Test: {file_names(data["test"])}. Train: {file_names(data["train"])}.</p>'
    )


def effects(figures: Figures, result: Result) -> str:
    """Say what was found beyond the declared model, and what stays unexplained."""
    body = ""
    if result.get("effects"):
        body += "<p>Added because they lower the error on runs that were left out, most useful first.</p>\n"
        body += effect_cards.effect_cards(figures, result)
    if result.get("unexplained"):
        body += '<h3 class="next">Not explained yet</h3>' if body else ""
        body += effect_cards.leftovers(figures, result)
    return body


def torque(figures: Figures, source: Source) -> str:
    """Measured against predicted torque, one plot per joint, with shared switches."""
    result, signals = source.result, source.signals
    shown = plots.add_time_plots(figures, source)
    colors = {
        "measured": "measured",
        "predicted": "blue",
        "residual": "red",
        plots.BEFORE: "faint",
        **plots.term_colors(shown.terms),
    }
    on = ("measured", "predicted", "residual", *shown.before)
    boxes = "".join(
        f'<label><input type="checkbox" data-term="{esc(term)}"{" checked" if term in on else ""}>'
        '<span class="swatch" '
        f'style="border-color:var(--{colors[term]})"></span>{esc(plots.term_words(term))}</label>'
        for term in (*on, *shown.terms)
    )
    options = "".join(f'<option value="{r}">{esc(name)}</option>' for r, name in enumerate(shown.run_names))
    picker = (
        f'<label>Run <select data-run autocomplete="off">{options}</select></label>' if len(shown.run_names) > 1 else ""
    )
    which = "test run" if signals.is_test.any() else "training run (there is no test run in the table)"
    name = f"The {which} <code>{esc(shown.run_names[0])}</code>" if not picker else f"One {which} at a time"
    hidden = (
        f" The first {len(shown.run_names)} of {shown.n_runs} runs can be chosen."
        if shown.n_runs > len(shown.run_names)
        else ""
    )
    short = (
        f" Curves are the smallest and largest value in each of about {count(shown.n_points // 2)} time "
        "slices, so no peak is lost."
        if shown.shortened
        else ""
    )
    units = [unit_text(unit) for unit in torques_told(result)]
    grid = _grid(
        result,
        "time",
        lambda j: _error_words(result, j),
        lambda j: (
            f"measured and predicted torque and the residual [{units[j]}] over time [s], {_plain_error(result, j)}"
        ),
    )
    return (
        f"<p>{name}, filtered to the band that was identified."
        '<span class="mouse"> Drag to zoom all joints together, double-click to go back; '
        "or the keys + \u2212 0 and the arrows.</span>"
        f"{hidden}{short}</p>\n"
        f'<fieldset class="terms"><legend>Curves</legend>{boxes}{picker}</fieldset>\n{grid}'
    )


def _error_words(result: Result, j: int) -> str:
    return esc(_plain_error(result, j))


def _plain_error(result: Result, j: int) -> str:
    test = result["rmse"]["test"]
    value, std = test["after"][j], test["torque_std"][j]
    return f"test error {with_unit(significant(value), torques_told(result)[j])} ({percent(ratio(value, std))})"


def _grid(result: Result, key: str, note: Any, said: Any, kind: str = "") -> str:
    """One captioned plot per joint; `said` is its text alternative."""
    cells = "".join(
        f"<figure><figcaption><h3>{breakable(joint)}</h3><span>{note(j)}</span></figcaption>"
        f"{place(f'{key}-{j}', esc(f'{joint}: {said(j)}'))}</figure>\n"
        for j, joint in enumerate(result["joints"])
    )
    return f'<div class="grid {kind}">{cells}</div>'


def velocity(figures: Figures, source: Source) -> str:
    """Friction and residual over velocity, and whether the residual is noise."""
    result = source.result
    n_points, n_samples = plots.add_velocity_plots(figures, source)
    plots.add_noise_plots(figures, source)
    speed = f"friction and residual [{unit_text(torques_said(torques_told(result)))}] over joint velocity"
    memory = "autocorrelation of the residual over lag, and its distribution"
    above, below = (
        _grid(result, key, lambda j: "", lambda j, text=text: text, "small")
        for key, text in (("velocity", speed), ("noise", memory))
    )
    few = f" Dots: at most {count(n_points)} samples of a joint, chosen at random." if n_points < n_samples else ""
    return (
        "<p>Above: measured torque minus everything but friction (dots), and the identified friction "
        "(blue, mean per velocity bin; all its terms together). "
        "Below: the residual (dots) and its mean (red). A red line that leaves zero, most often near "
        "zero velocity, is friction "
        f"that the model lacks. Where a joint stands still nothing is shown, as it is not scored.{few}</p>\n"
        f"{above}\n"
        "<details><summary>Is the residual noise? Its memory and its distribution</summary>\n"
        "<p>Noise forgets at once: its autocorrelation drops to zero within the filter's own memory, and "
        "its distribution follows the dotted "
        "normal curve. A slow decay or a wave is something a model could still learn.</p>\n"
        f"{below}</details>"
    )
