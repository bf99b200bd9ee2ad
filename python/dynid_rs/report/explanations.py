"""The sections about the model behind the errors: parameters, loops, data, and where all of it comes from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from dynid_rs.report import parameter_plots, tables
from dynid_rs.report.figures import Figures, place
from dynid_rs.report.source import RESIDUALS_FILE, RESULT_FILE, Source
from dynid_rs.report.text import (
    count,
    esc,
    file_names,
    join_words,
    percent,
    plural,
    ratio,
    significant,
    urgent_words,
    with_unit,
    words,
)

Result = Mapping[str, Any]
_PRECISE = 0.2


def parameters(figures: Figures, result: Result) -> str:
    """Say how well each base parameter, joint parameter and shape of friction is known."""
    found = result.get("parameters") or {}
    size = result.get("base_parameters") or {}
    body = ""
    if found.get("base"):
        body += f"<p>{_base_words(found['base'], size)}</p>" + _parameter_part(
            figures, "base", "Link dynamics: base parameters", found["base"], ("link", "Link")
        )
    if found.get("joint"):
        body += _parameter_part(
            figures, "joint", "Joint parameters: friction, offset, rotor", found["joint"], ("joint", "Joint")
        )
    if found.get("friction_shape"):
        body += (
            "<details><summary>Shape of friction around zero velocity</summary>"
            f"{tables.shape_table(found['friction_shape'])}</details>"
        )
    return body


def _base_words(base: Sequence[Result], size: Result) -> str:
    sure = sum(
        1 for p in base if (share := ratio(p.get("std_error"), abs(p["value"]))) is not None and share <= _PRECISE
    )
    zero = sum(map(tables.holds_zero, base))
    sentences = []
    if size.get("n_base") is not None and size.get("n_standard") is not None:
        sentences.append(
            f"Of {count(size['n_standard'])} inertial parameters, the torque shows "
            f"{count(size['n_base'])} combinations (base parameters)."
        )
    sentences.append(
        f"{count(sure)} of {count(len(base))} are known to {percent(_PRECISE)} or better (standard error)."
    )
    if zero:
        sentences.append(
            f"{count(zero)} cannot be told from zero and are shown in grey; that is usual for small links."
        )
    if size.get("condition_number") is not None:
        sentences.append(f"Condition number of the data: {significant(size['condition_number'])}.")
    if size.get("gap") is not None:
        sentences.append(f"The count of combinations is clear by a factor of {significant(size['gap'], 2)}.")
    return " ".join(sentences)


def _parameter_part(figures: Figures, key: str, title: str, found: Sequence[Result], group: tuple[str, str]) -> str:
    plot = ""
    if parameter_plots.add_parameter_plot(figures, f"parameters-{key}", found, group[0]):
        label = f"{title}: 95 % interval of each in percent of its estimate"
        plot = (
            f"<figure>{place(f'parameters-{key}', label, kind='wide', numbers=False)}</figure>"
            '<p class="note">Estimate at 100 %, whisker: 95 % interval relative to it. Whiskers that '
            "cross 0 are grey.</p>"
        )
    return (
        f'<h3 class="next">{title}</h3>{plot}<details><summary>{plural(len(found), "parameter")} in a '
        "table</summary>"
        f"{tables.parameter_table(found, *group)}</details>\n"
    )


def loops(figures: Figures, result: Result) -> str:
    """Third loop, encoder delay and convergence, in plain words."""
    body = _residual_words(result) + _delay_words(result) + _convergence_words(figures, result)
    return _stages(result) + (f'<div class="columns">{body}</div>' if body else "")


def _stages(result: Result) -> str:
    """What each loop gave on runs that none of them has seen."""
    stages = (result.get("loops") or {}).get("test") or {}
    if not all(stages.get(loop) for loop in ("wls", "friction", "links", "residual")):
        return ""
    return (
        "<h3>What each loop gave on the test runs</h3><p>Each column is a model with one loop more than the column "
        "before: the baseline; its links with the friction of the first loop; links fitted beside that friction; the "
        "third loop where it is kept.</p>" + tables.stages_table(result, stages)
    )


def _convergence_words(figures: Figures, result: Result) -> str:
    passes, settled = result.get("n_iter"), result.get("converged")
    plot = ""
    if lines := parameter_plots.add_history_plot(figures, result):
        key = "".join(
            f'<li><i class="stroke" style="border-color:var(--{c})"></i>{esc(name)}</li>' for c, name in lines
        )
        label = "Training error per pass, in percent of the first, one line per joint"
        plot = f'<figure><ul class="key" aria-label="Key">{key}</ul>{place("history", label, kind="wide")}</figure>'
    said = [] if passes is None else [f"The loops ran {plural(int(passes), 'pass', 'passes')}."]
    if settled is not None:
        said.append(
            "They stopped because nothing changed any more." if settled else "They stopped before they settled."
        )
    return f"<div><h3>Convergence</h3><p>{' '.join(said)}</p>{plot}</div>" if said or plot else ""


def _residual_words(result: Result) -> str:
    residual = result.get("residual")
    if not residual:
        return ""
    if residual.get("switched_off"):
        return "<div><h3>Third loop: the residual</h3><p>It was switched off.</p></div>"
    joints = result["joints"]
    kept = residual.get("kept")
    per_joint = [bool(k) for k in kept] if isinstance(kept, list) else [bool(kept)] * len(joints)
    if isinstance(residual.get("kept_on"), list):
        per_joint = [joint in residual["kept_on"] for joint in joints]
    names = [joint for joint, k in zip(joints, per_joint, strict=True) if k]
    if not names:
        decision = "It was left out of the model: on runs that it had not seen it did not pay."
    elif len(names) == len(joints):
        decision = "It pays on every joint and is part of the model."
    else:
        decision = f"It pays on {esc(join_words(names))} and is part of the model there; elsewhere it is left out."
    kind = {"gmr": "a Gaussian mixture regression", "rbf": "a sum of normalised radial basis functions"}.get(
        residual.get("kind") or "", esc(words(residual.get("kind") or "a regression"))
    )
    inputs = f" of {esc(words(residual['inputs']))}" if residual.get("inputs") else ""
    reason = f" <b>Reason:</b> {esc(residual['reason'])}" if residual.get("reason") else ""
    return (
        f"<div><h3>Third loop: the residual</h3><p>{kind[0].upper() + kind[1:]}{inputs} learns what "
        f"friction and links leave. {decision}{reason}</p>"
        f"{tables.residual_table(result, residual, per_joint)}</div>"
    )


def _delay_words(result: Result) -> str:
    delay = result.get("encoder_delay")
    if not delay:
        return ""
    return (
        "<div><h3>Delay between the two encoders</h3><p>Motor and link encoder are not read at the same "
        "instant. The delay was estimated "
        "and removed before the deflection between them was used. Positive: the link encoder's value "
        "comes late.</p>"
        f"{tables.delay_table(result, delay)}</div>"
    )


def data(result: Result) -> str:
    """List the findings about the runs, worst first."""
    findings = result["data"].get("findings") or []
    if not findings:
        return "<p>No findings: nothing in the runs looked wrong.</p>"
    urgent = [f for f in findings if f["severity"] != "info"]
    calm = [f for f in findings if f["severity"] == "info"]
    said = f"<p>{urgent_words(urgent)}, {plural(len(calm), 'note')}.</p>\n"
    body = tables.findings_table(urgent) if urgent else ""
    if calm:
        unfolded = "" if urgent and len(calm) > 3 else " open"
        title = f"<summary>{plural(len(calm), 'note')}</summary>"
        body += f"<details{unfolded}>{title}{tables.findings_table(calm)}</details>"
    return said + body


def provenance(source: Source) -> str:
    """Files, band, rows and versions."""
    result = source.result
    found = result["data"]
    samples, dropped = found.get("n_samples") or {}, found.get("n_dropped") or {}
    facts = [("Training runs", file_names(found["train"])), ("Test runs", file_names(found["test"]))]
    facts.append(("Samples", f"{count(samples.get('train'))} train, {count(samples.get('test'))} test"))
    if dropped:
        facts.append(
            (
                "Of these at standstill",
                f"{count(dropped.get('train'))} train, {count(dropped.get('test'))} test, neither fitted nor scored",
            )
        )
    if found.get("rate_hz") is not None:
        facts.append(("Recorded at", with_unit(significant(found["rate_hz"]), "Hz")))
    if found.get("cutoff_hz") is not None:
        facts.append(
            (
                "Band",
                f"up to {with_unit(significant(found['cutoff_hz']), 'Hz')}; torque and model pass the same filter",
            )
        )
    facts.append(("Samples in the plots", count(source.signals.run.size)))
    facts.append(
        (
            "Files read",
            f"<code>{RESULT_FILE}</code> (version {result['version']}), <code>{RESIDUALS_FILE}</code>",
        )
    )
    facts.append(("Written by", esc(versions())))
    rows = "".join(f"<dt>{name}</dt><dd>{value}</dd>" for name, value in facts)
    return f'<dl class="facts">{rows}</dl>'


def versions() -> str:
    """Name and version of the package."""
    try:
        return f"dynid-rs {version('dynid-rs')}"
    except PackageNotFoundError:
        return "dynid-rs (version unknown)"
