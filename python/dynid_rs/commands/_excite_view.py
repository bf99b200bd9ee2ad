"""The tables that `dynid excite` ends with."""

from __future__ import annotations

from typing import Any

from rich.table import Table
from rich.text import Text

from dynid_rs.base.quoting import shown
from dynid_rs.commands._console import console

_QUANTITIES = {"position": "", "velocity": "/s", "acceleration": "/s^2"}


def show(result: dict[str, Any]) -> None:
    """Print figures of merit, extremes beside limits, notes, and where the files are."""
    out = console()
    if "separation" in result:
        from dynid_rs.excitation.separation_view import sentences

        for sentence in sentences(result["separation"]):
            out.print(Text(sentence), soft_wrap=True)
    if "next" in result:
        from dynid_rs.commands._excite_after import show_next

        show_next(result["next"], result["joints"], out)
    blocks = ", ".join(
        f"{name} {'-' if value is None else f'{value:.4g}'} (rank {result['block_ranks'][name]})"
        for name, value in result["block_condition_numbers"].items()
    )
    out.print(f"condition number of the base regressor: {result['condition_number']:.4g}")
    if result["whitened_condition_number"] is not None:
        out.print(f"whitened: {result['whitened_condition_number']:.4g}")
    out.print(f"blocks: {blocks}")
    out.print(f"log det: {result['log_det']:.4g}; trace of the inverse: {result['variance_trace']:.4g}")
    out.print(
        f"objective ({result['criterion']}): {result['objective']:.5g}, best of {len(result['restarts'])} searches"
    )
    out.print(_extremes(result))
    for name, report in result["constraints"].items():
        out.print(Text(f"{name}: {_constraint(name, report)}"))
    for note in result["notes"]:
        out.print(Text(f"note: {note}"))
    for label, path in result["files"].items():
        out.print(Text(f"{label}: {path}"), soft_wrap=True)
    if "friction" in result:
        friction = result["friction"]
        label = f"friction experiment: {friction['file']} ({friction['duration_s']:.0f} s)"
        out.print(Text(label), soft_wrap=True)


def _extremes(result: dict[str, Any]) -> Table:
    title = f"extremes on a {1e3 * result['grid_s']:g} ms grid, limits, and the bound of Eq. 17"
    table = Table(title=Text(title), title_justify="left")
    table.add_column("joint")
    table.add_column("")
    for heading in ("lowest", "highest", "lower limit", "upper limit", "Eq. 17"):
        table.add_column(heading, justify="right")
    for j, joint in enumerate(result["joints"]):
        for name, per_second in _QUANTITIES.items():
            values = (column[j] for column in result["motion"][name].values())
            label = Text(shown(joint)) if name == "position" else ""
            table.add_row(label, f"{name} [{result['units'][j]}{per_second}]", *(f"{value:.4f}" for value in values))
    return table


def _constraint(name: str, report: dict[str, Any]) -> str:
    kept = "kept" if report["kept"] else "violated"
    if name == "torque":
        spans = zip(report["least"], report["greatest"], report["units"], strict=True)
        return f"{kept}; " + ", ".join(f"{low:.3g} .. {high:.3g} {unit}" for low, high, unit in spans)
    nearest = report["nearest"]
    who = nearest if isinstance(nearest, str) else " and ".join(nearest)
    return f"{kept}; least distance {report['least_distance_m']:.3g} m ({who})"
