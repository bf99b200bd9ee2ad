"""The sections of the page: each returns its HTML, or nothing where the result has nothing to say."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from dynid_rs.report import plots, tables
from dynid_rs.report.plots import Figures
from dynid_rs.report.source import RESIDUALS_FILE, RESULT_FILE, Source
from dynid_rs.report.text import (
    DASH,
    count,
    esc,
    join_words,
    median,
    percent,
    plural,
    ratio,
    significant,
    unit_text,
    with_unit,
    words,
)

Result = Mapping[str, Any]
_PRECISE = 0.2


def head(result: Result) -> str:
    """Robot, verdict, warnings and the four numbers of the first glance."""
    findings = result["data"].get("findings") or []
    bad = [f for f in findings if f["severity"] != "info"]
    alert = (
        f'<p class="alert"><b>\u25b2 {plural(len(bad), "warning")} about the data:</b> {esc(bad[0]["message"])} '
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
    return f"The model leaves {percent(share)} of the torque's spread on the test runs; least squares leaves {percent(wls)}."


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
    left = median([ratio(after, base) for after, base in zip(test["after"], test["wls"], strict=True)])
    unknown = [None] * len(joints)
    floors, bounds = test.get("floor") or unknown, test.get("after_interval") or unknown
    reached = [tables.at_floor(*row) for row in zip(test["after"], bounds, floors, strict=True)]
    samples = data.get("n_samples") or {}
    tiles = [
        ("Error on test runs", percent(share), f"of torque std, median joint; least squares {percent(wls)}"),
        ("Against least squares", DASH if left is None else f"{percent(abs(1 - left))} {'less' if left <= 1 else 'more'}",
         "error, median joint"),
        ("Joints at the floor", f"{sum(map(bool, reached))} of {len(joints)}" if any(r is not None for r in reached) else DASH,
         "no model could do better there"),
        ("Runs", f"{len(data['train'])} + {len(data['test'])}",
         f"train + test; {count(samples.get('train'))} + {count(samples.get('test'))} samples"),
    ]  # fmt: skip
    return '<div class="tiles">' + "".join(
        f'<dl class="tile"><dt>{name}</dt><dd>{value}</dd><dd class="under">{under}</dd></dl>'
        for name, value, under in tiles
    ) + "</div>"  # fmt: skip


def errors(result: Result) -> str:
    """Error table with its key."""
    data = result["data"]
    model = "model with effects" if tables.has_effects(result) else "three loops"
    marks = (
        ('<circle class="baseline" cx="9" cy="9" r="4"/>', "weighted least squares"),
        ('<circle class="model" cx="9" cy="9" r="4.5"/>', model),
        ('<line class="bar" x1="0" x2="18" y1="9" y2="9"/>', "95 % interval"),
        ('<rect class="floor" y="2" width="18" height="14"/>', "floor"),
    )
    key = "".join(f"<li>{_key_mark(mark)} {word}</li>" for mark, word in marks)
    method = f" Floor: {esc(result['floor_method'])}." if result.get("floor_method") else ""
    key = f'<ul class="key" aria-label="Key">{key}</ul>'
    return (
        f"<p>Root-mean-square torque error on the test runs only, in {esc(unit_text(result['torque_unit']))} and in percent "
        f"of that joint's torque standard deviation. Nothing here was used for fitting.</p>\n"
        f"{tables.error_table(result)}\n{key}\n"
        '<p class="note next">Weighted least squares: rigid body, Coulomb and viscous friction, fitted once. '
        "Three loops: friction, link dynamics and residual, repeated until nothing changes. The floor is the part that no model "
        f"can remove; the interval allows for errors that depend on their neighbours in time.{method}</p>\n"
        f'<p class="note">Test: {_files(data["test"])}. Train: {_files(data["train"])}.</p>'
    )


def _key_mark(marks: str) -> str:
    return f'<svg width="18" height="18" viewBox="0 0 18 18" aria-hidden="true">{marks}</svg>'


def _files(names: Sequence[str]) -> str:
    return ", ".join(f"<code>{esc(name)}</code>" for name in names) or "none"


def effects(result: Result) -> str:
    """What was found beyond the declared model, and what stays unexplained."""
    body = ""
    if result.get("effects"):
        body += "<p>Added to the model because they lower the error on runs that were left out, most useful first.</p>\n"
        body += tables.effects_table(result)
    if result.get("unexplained"):
        body += '<h3 class="next">Not explained yet</h3>' if body else ""
        body += tables.unexplained_table(result)
    return body


def torque(figures: Figures, source: Source) -> str:
    """Measured against predicted torque, one plot per joint, with shared switches."""
    result, signals = source.result, source.signals
    shown = plots.add_time_plots(figures, source)
    colors = {"measured": "$measured", "predicted": "$blue", "residual": "$red", **plots.term_colors(shown.terms)}
    on = ("measured", "predicted", "residual")
    boxes = "".join(
        f'<label><input type="checkbox" data-term="{esc(term)}"{" checked" if term in on else ""}>'
        f'<span class="swatch" style="border-color:var(--{colors[term][1:]})"></span>{esc(plots.term_words(term))}</label>'
        for term in (*on, *shown.terms)
    )
    options = "".join(f'<option value="{r}">{esc(name)}</option>' for r, name in enumerate(shown.run_names))
    picker = f'<label>Run <select data-run autocomplete="off">{options}</select></label>' if len(shown.run_names) > 1 else ""
    which = "test run" if signals.is_test.any() else "training run (there is no test run in the table)"
    name = f"The {which} <code>{esc(shown.run_names[0])}</code>" if not picker else f"One {which} at a time"
    hidden = f" The first {len(shown.run_names)} of {shown.n_runs} runs can be chosen." if shown.n_runs > len(shown.run_names) else ""
    short = (
        f" Curves are the smallest and largest value in each of about {count(shown.n_points // 2)} time slices, so no peak is lost."
        if shown.shortened
        else ""
    )
    grid = _grid(result, "time", lambda j: _error_words(result, j))
    return (
        f"<p>{name}, filtered to the band that was identified. Drag to zoom all joints together, double-click to go back.{hidden}{short}</p>\n"
        f'<fieldset class="terms"><legend>Curves</legend>{boxes}{picker}</fieldset>\n{grid}'
    )


def _error_words(result: Result, j: int) -> str:
    test = result["rmse"]["test"]
    value, std = test["after"][j], test["torque_std"][j]
    return f"test error {esc(with_unit(significant(value), result['torque_unit']))} ({percent(ratio(value, std))})"


def _grid(result: Result, key: str, note: Any, kind: str = "") -> str:
    """One captioned plot per joint."""
    cells = "".join(
        f'<figure><figcaption><h3>{esc(joint)}</h3><span>{note(j)}</span></figcaption>'
        f'<div class="plot" data-figure="{key}-{j}" role="img" aria-label="{esc(joint)}: {key} plot"></div></figure>\n'
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
        "<p>Above: measured torque minus everything but friction (dots), and the identified friction (blue, mean per velocity bin). "
        "Below: the residual (dots) and its mean (red). A red line that leaves zero, most often near zero velocity, is friction "
        f"that the model lacks.{few}</p>\n"
        f"{_grid(result, 'velocity', lambda j: '', 'small')}\n"
        "<details><summary>Is the residual noise? Its memory and its distribution</summary>\n"
        "<p>Noise forgets at once: its autocorrelation drops to zero within the filter's own memory, and its distribution follows the dotted "
        "normal curve. A slow decay or a wave is something a model could still learn.</p>\n"
        f"{_grid(result, 'noise', lambda j: '', 'small low')}</details>"
    )


def parameters(figures: Figures, result: Result) -> str:
    """Base parameters, joint parameters and the shape of friction."""
    found = result.get("parameters") or {}
    size = result.get("base_parameters") or {}
    body = ""
    if found.get("base"):
        body += f"<p>{_base_words(found['base'], size)}</p>" + _parameter_part(
            figures, "base", "Link dynamics: base parameters", found["base"], ("link", "Link")
        )
    if found.get("joint"):
        body += _parameter_part(figures, "joint", "Joint parameters: friction, offset, rotor", found["joint"], ("joint", "Joint"))
    if found.get("friction_shape"):
        body += (
            "<details><summary>Shape of friction around zero velocity</summary>"
            f"{tables.shape_table(found['friction_shape'])}</details>"
        )
    return body


def _base_words(base: Sequence[Result], size: Result) -> str:
    sure = sum(1 for p in base if (share := ratio(p.get("std_error"), abs(p["value"]))) is not None and share <= _PRECISE)
    zero = sum(map(tables.holds_zero, base))
    sentences = []
    if size.get("n_base") is not None and size.get("n_standard") is not None:
        sentences.append(
            f"Of {count(size['n_standard'])} inertial parameters, the torque shows {count(size['n_base'])} combinations (base parameters)."
        )
    sentences.append(f"{count(sure)} of {count(len(base))} are known to {percent(_PRECISE)} or better (standard error).")
    if zero:
        sentences.append(f"{count(zero)} cannot be told from zero and are shown in grey; that is usual for small links.")
    if size.get("condition_number") is not None:
        sentences.append(f"Condition number of the data: {significant(size['condition_number'])}.")
    if size.get("gap") is not None:
        sentences.append(f"The count of combinations is clear by a factor of {significant(size['gap'], 2)}.")
    return " ".join(sentences)


def _parameter_part(
    figures: Figures, key: str, title: str, found: Sequence[Result], group: tuple[str, str]
) -> str:
    plot = ""
    if plots.add_parameter_plot(figures, f"parameters-{key}", found, group[0]):
        plot = (
            f'<div class="plot wide low" data-figure="parameters-{key}" role="img" aria-label="{title}, relative intervals"></div>'
            '<p class="note">Estimate at 100 %, whisker: 95 % interval relative to it. Whiskers that cross 0 are hollow and grey.</p>'
        )
    return (
        f'<h3 class="next">{title}</h3>{plot}<details><summary>{plural(len(found), "parameter")} in a table</summary>'
        f"{tables.parameter_table(found, *group)}</details>\n"
    )


def loops(figures: Figures, result: Result) -> str:
    """Third loop, encoder delay and convergence, in plain words."""
    body = _residual_words(result) + _delay_words(result) + _convergence_words(figures, result)
    return f'<div class="columns">{body}</div>' if body else ""


def _convergence_words(figures: Figures, result: Result) -> str:
    passes, settled = result.get("n_iter"), result.get("converged")
    plot = ""
    if plots.add_history_plot(figures, result):
        plot = '<div class="plot low" data-figure="history" role="img" aria-label="training error per pass"></div>'
    said = [] if passes is None else [f"The loops ran {plural(int(passes), 'pass', 'passes')}."]
    if settled is not None:
        said.append("They stopped because nothing changed any more." if settled else "They stopped before they settled.")
    return f"<div><h3>Convergence</h3><p>{' '.join(said)}</p>{plot}</div>" if said or plot else ""


def _residual_words(result: Result) -> str:
    residual = result.get("residual")
    if not residual:
        return ""
    joints = result["joints"]
    kept = residual.get("kept")
    per_joint = [bool(k) for k in kept] if isinstance(kept, list) else [bool(kept)] * len(joints)
    names = [joint for joint, k in zip(joints, per_joint, strict=True) if k]
    if not names:
        decision = "It was left out of the model: on runs that it had not seen it did not pay."
    elif len(names) == len(joints):
        decision = "It pays on every joint and is part of the model."
    else:
        decision = f"It pays on {esc(join_words(names))} and is part of the model there; elsewhere it is left out."
    kind = {"gmr": "a Gaussian mixture regression"}.get(residual.get("kind") or "", esc(words(residual.get("kind") or "a regression")))
    inputs = f" of {esc(words(residual['inputs']))}" if residual.get("inputs") else ""
    reason = f" <b>Reason:</b> {esc(residual['reason'])}." if residual.get("reason") else ""
    return (
        f"<div><h3>Third loop: the residual</h3><p>{kind[0].upper() + kind[1:]}{inputs} learns what friction and links leave. {decision}{reason}</p>"
        f"{tables.residual_table(result, residual, per_joint)}</div>"
    )


def _delay_words(result: Result) -> str:
    delay = result.get("encoder_delay")
    if not delay:
        return ""
    return (
        "<div><h3>Delay between the two encoders</h3><p>Motor and link encoder are not read at the same instant. The delay was estimated "
        "and removed before the deflection between them was used. Positive: the link encoder's value comes late.</p>"
        f"{tables.delay_table(result, delay)}</div>"
    )


def data(result: Result) -> str:
    """Findings about the runs, worst first."""
    findings = result["data"].get("findings") or []
    if not findings:
        return "<p>No findings: nothing in the runs looked wrong.</p>"
    urgent = [f for f in findings if f["severity"] != "info"]
    calm = [f for f in findings if f["severity"] == "info"]
    said = f"<p>{plural(len(urgent), 'warning')}, {plural(len(calm), 'note')}.</p>\n"
    body = tables.findings_table(urgent) if urgent else ""
    if calm:
        unfolded = "" if urgent and len(calm) > 3 else " open"
        body += f"<details{unfolded}><summary>{plural(len(calm), 'note')}</summary>{tables.findings_table(calm)}</details>"
    return said + body


def provenance(source: Source) -> str:
    """Files, band, rows and versions."""
    result = source.result
    found = result["data"]
    samples, dropped = found.get("n_samples") or {}, found.get("n_dropped") or {}
    facts = [("Training runs", _files(found["train"])), ("Test runs", _files(found["test"]))]
    facts.append(("Samples used", f"{count(samples.get('train'))} train, {count(samples.get('test'))} test"))
    if dropped:
        facts.append(("Rows dropped", f"{count(dropped.get('train'))} train, {count(dropped.get('test'))} test (ends of runs, gaps)"))
    if found.get("rate_hz") is not None:
        facts.append(("Recorded at", with_unit(significant(found["rate_hz"]), "Hz")))
    if found.get("cutoff_hz") is not None:
        facts.append(("Band", f"up to {with_unit(significant(found['cutoff_hz']), 'Hz')}; torque and model pass the same filter"))
    facts.append(("Samples in the plots", count(source.signals.run.size)))
    facts.append(("Files read", f"<code>{RESULT_FILE}</code> (version {result['version']}), <code>{RESIDUALS_FILE}</code>"))
    facts.append(("Written by", esc(_versions())))
    rows = "".join(f"<dt>{name}</dt><dd>{value}</dd>" for name, value in facts)
    return f'<dl class="facts">{rows}</dl>'


def _versions() -> str:
    said = []
    for package in ("dynid-rs", "plotly"):
        try:
            said.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            said.append(f"{package} (version unknown)")
    return ", ".join(said)
