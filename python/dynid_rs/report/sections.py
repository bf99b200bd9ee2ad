"""The sections about errors, torque and friction: each returns its HTML, or nothing to show."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from dynid_rs.base.wording import NO_INTERVAL, lacks_interval
from dynid_rs.report import error_table, plots, tables
from dynid_rs.report.figures import Figures
from dynid_rs.report.source import Source
from dynid_rs.report.text import (
    DASH,
    count,
    esc,
    file_names,
    geometric_mean,
    median,
    percent,
    plural,
    ratio,
    significant,
    unit_text,
    with_unit,
)

Result = Mapping[str, Any]


def head(result: Result) -> str:
    """Robot, verdict, warnings and the four numbers of the first glance."""
    findings = result["data"].get("findings") or []
    bad = [f for f in findings if f["severity"] != "info"]
    alert = (
        f'<p class="alert"><b>\u25b2 {plural(len(bad), "warning")} about the data:</b> '
        f"{esc(bad[0]['message'])} "
        f'<a href="#data">{"All of them" if len(bad) > 1 else "More"}</a></p>'
        if bad
        else ""
    )
    verdict = result.get("verdict") or _verdict(result)
    return (
        f'<p class="eyebrow">Identified torque model, {plural(len(result["joints"]), "joint")}</p>\n'
        f'<h1>{esc(result["robot"])}</h1>\n<p class="verdict">{esc(verdict)}</p>\n{alert}{_tiles(result)}\n'
    )


def _verdict(result: Result) -> str:
    share, wls = _median_errors(result)
    return (
        f"The model leaves {percent(share)} of the torque's spread on the test runs; "
        f"least squares leaves {percent(wls)}."
    )


def _median_errors(result: Result) -> tuple[float | None, float | None]:
    test = result["rmse"]["test"]
    shares = [
        median([ratio(value, std) for value, std in zip(test[key], test["torque_std"], strict=True)])
        for key in ("after", "wls")
    ]
    return shares[0], shares[1]


def _tiles(result: Result) -> str:
    test, data = result["rmse"]["test"], result["data"]
    joints = result["joints"]
    share, wls = _median_errors(result)
    left = geometric_mean([ratio(after, base) for after, base in zip(test["after"], test["wls"], strict=True)])
    unknown = [None] * len(joints)
    floors, bounds = test.get("floor") or unknown, test.get("after_interval") or unknown
    reached = [error_table.at_floor(*row) for row in zip(test["after"], bounds, floors, strict=True)]
    samples = data.get("n_samples") or {}
    tiles = [
        ("Error on test runs", percent(share), f"of torque std, median joint; least squares {percent(wls)}"),
        (
            "Against least squares",
            DASH if left is None else f"{percent(abs(1 - left))} {'less' if left <= 1 else 'more'}",
            "error, average over joints",
        ),
        (
            "Joints at the floor",
            f"{sum(map(bool, reached))} of {len(joints)}" if any(r is not None for r in reached) else DASH,
            "no model could do better there",
        ),
        (
            "Runs",
            f"{len(data['train'])} + {len(data['test'])}",
            f"train + test; {count(samples.get('train'))} + {count(samples.get('test'))} samples",
        ),
    ]
    return (
        '<div class="tiles">'
        + "".join(
            f'<dl class="tile"><dt>{name}</dt><dd>{value}</dd><dd class="under">{under}</dd></dl>'
            for name, value, under in tiles
        )
        + "</div>"
    )


def errors(result: Result) -> str:
    """Error table with its key."""
    data = result["data"]
    model = "model with effects" if error_table.has_effects(result) else "three loops"
    marks = (
        ('<circle class="baseline" cx="9" cy="9" r="4"/>', "weighted least squares"),
        ('<circle class="model" cx="9" cy="9" r="4.5"/>', model),
        ('<line class="bar" x1="0" x2="18" y1="9" y2="9"/>', "95 % interval"),
        ('<rect class="floor" y="2" width="18" height="14"/>', "floor"),
    )
    key = "".join(f"<li>{_key_mark(mark)} {word}</li>" for mark, word in marks)
    method = f" Floor: {esc(result['floor_method'])}." if result.get("floor_method") else ""
    missing = f" {DASH} {NO_INTERVAL}." if lacks_interval(result) else ""
    key = f'<ul class="key" aria-label="Key">{key}</ul>'
    return (
        "<p>Root-mean-square torque error on the test runs only, in "
        f"{esc(unit_text(result['torque_unit']))} and in percent "
        f"of that joint's torque standard deviation. Nothing here was used for fitting.</p>\n"
        f"{error_table.error_table(result)}\n{key}\n"
        '<p class="note next">Weighted least squares: rigid body, Coulomb and viscous friction, fitted once. '
        "Three loops: friction, link dynamics and residual, repeated until nothing changes. The floor is "
        "the part that no model "
        f"can remove; the interval allows for errors that depend on their neighbours in time.{method}{missing}</p>\n"
        f'<p class="note">Test: {file_names(data["test"])}. Train: {file_names(data["train"])}.</p>'
    )


def _key_mark(marks: str) -> str:
    return f'<svg width="18" height="18" viewBox="0 0 18 18" aria-hidden="true">{marks}</svg>'


def effects(result: Result) -> str:
    """Say what was found beyond the declared model, and what stays unexplained."""
    body = ""
    if result.get("effects"):
        body += "<p>Added because they lower the error on runs that were left out, most useful first.</p>\n"
        body += tables.effects_table(result)
    if result.get("unexplained"):
        body += '<h3 class="next">Not explained yet</h3>' if body else ""
        body += tables.unexplained_table(result)
    return body


def torque(figures: Figures, source: Source) -> str:
    """Measured against predicted torque, one plot per joint, with shared switches."""
    result, signals = source.result, source.signals
    shown = plots.add_time_plots(figures, source)
    colors = {
        "measured": "$measured",
        "predicted": "$blue",
        "residual": "$red",
        plots.BEFORE: "$faint",
        **plots.term_colors(shown.terms),
    }
    on = ("measured", "predicted", "residual", *shown.before)
    boxes = "".join(
        f'<label><input type="checkbox" data-term="{esc(term)}"{" checked" if term in on else ""}>'
        '<span class="swatch" '
        f'style="border-color:var(--{colors[term][1:]})"></span>{esc(plots.term_words(term))}</label>'
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
    grid = _grid(result, "time", lambda j: _error_words(result, j))
    return (
        f"<p>{name}, filtered to the band that was identified."
        f'<span class="mouse"> Drag to zoom all joints together, double-click to go back.</span>'
        f"{hidden}{short}</p>\n"
        f'<fieldset class="terms"><legend>Curves</legend>{boxes}{picker}</fieldset>\n{grid}'
    )


def _error_words(result: Result, j: int) -> str:
    test = result["rmse"]["test"]
    value, std = test["after"][j], test["torque_std"][j]
    error = esc(with_unit(significant(value), result["torque_unit"]))
    return f"test error {error} ({percent(ratio(value, std))})"


def _grid(result: Result, key: str, note: Any, kind: str = "") -> str:
    """One captioned plot per joint."""
    cells = "".join(
        f"<figure><figcaption><h3>{esc(joint)}</h3><span>{note(j)}</span></figcaption>"
        f'<div class="plot" data-figure="{key}-{j}" role="img" aria-label="{esc(joint)}: {key} '
        'plot"></div></figure>\n'
        for j, joint in enumerate(result["joints"])
    )
    return f'<div class="grid {kind}">{cells}</div>'


def velocity(figures: Figures, source: Source) -> str:
    """Friction and residual over velocity, and whether the residual is noise."""
    result = source.result
    n_points, n_samples = plots.add_velocity_plots(figures, source)
    plots.add_noise_plots(figures, source)
    few = f" Dots: {count(n_points)} of {count(n_samples)} samples, chosen at random." if n_points < n_samples else ""
    return (
        "<p>Above: measured torque minus everything but friction (dots), and the identified friction "
        "(blue, mean per velocity bin). "
        "Below: the residual (dots) and its mean (red). A red line that leaves zero, most often near "
        "zero velocity, is friction "
        f"that the model lacks.{few}</p>\n"
        f"{_grid(result, 'velocity', lambda j: '', 'small')}\n"
        "<details><summary>Is the residual noise? Its memory and its distribution</summary>\n"
        "<p>Noise forgets at once: its autocorrelation drops to zero within the filter's own memory, and "
        "its distribution follows the dotted "
        "normal curve. A slow decay or a wave is something a model could still learn.</p>\n"
        f"{_grid(result, 'noise', lambda j: '', 'small low')}</details>"
    )
