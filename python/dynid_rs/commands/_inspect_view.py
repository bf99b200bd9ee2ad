"""How `dynid inspect` looks on a terminal."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from rich.box import SIMPLE_HEAD
from rich.table import Table
from rich.text import Text

from dynid_rs.base.findings import Finding, told_once
from dynid_rs.base.quoting import shown, shown_names
from dynid_rs.base.units import angle_units, torque_of, torques_said
from dynid_rs.commands._console import console
from dynid_rs.commands._inspection import Inspection, joint_velocity
from dynid_rs.runs.checks import gaps, relative_jitter
from dynid_rs.runs.readers import Run

if TYPE_CHECKING:
    from rich.console import Console

BARS = "▁▂▃▄▅▆▇█"
PLOT_WIDTH = 14
_STYLES = {"error": "bold red", "warning": "yellow", "info": "cyan"}


def show(inspections: Sequence[Inspection], of_robot: Sequence[Finding] = ()) -> None:
    """Write what was found in the robot file, and in each readable run."""
    out = console()
    if of_robot:
        out.print(Text(shown(of_robot[0].file or "robot", 100)), style="bold", soft_wrap=True)
        _show_findings(out, of_robot)
    for inspection in inspections:
        if inspection.run is None:
            out.print(Text(f"{inspection.path}: not readable"), style="bold red", soft_wrap=True)
            continue
        _show_run(out, inspection.run)
        _show_findings(out, inspection.findings)


def _show_run(out: Console, run: Run) -> None:
    rec, columns = run.recording, run.columns
    n_gaps = len(gaps(rec))
    torque = torques_said([torque_of(rec.torque_unit, kind) for kind in rec.kinds])
    encoders = "motor and link encoders" if rec.has_motor_encoder else "one encoder per joint"
    out.print(Text(shown(rec.name, 100)), style="bold", soft_wrap=True)
    lines = [
        f"{run.kind}, {rec.n_samples} rows, {rec.duration:.4g} s at {rec.rate:.4g} Hz, jitter "
        f"{100 * relative_jitter(rec):.0f} %, {n_gaps or 'no'} gap{'' if n_gaps == 1 else 's'}",
        f"{rec.n_joints} joint{'' if rec.n_joints == 1 else 's'}, {encoders}, "
        f"{f'torque in {torque}' if run.has_torque else 'no torque'}",
        "read: " + ", ".join([shown(columns.time), *(_span(names) for names in columns.signals.values())]),
    ]
    if columns.ignored:
        lines.append(f"ignored: {shown_names(_collapse(columns.ignored))}")
    for line in lines:
        out.print(Text("  " + line), soft_wrap=True)
    out.print(_joints(run))


def _collapse(names: Sequence[str]) -> list[str]:
    """``q_0, q_1, q_2`` becomes ``q_0 ... q_2``: one entry per signal."""
    signals: dict[str, list[str]] = {}
    for name in names:
        signals.setdefault(name.rstrip("0123456789"), []).append(name)
    return [_span(group) for group in signals.values()]


def _span(names: Sequence[str]) -> str:
    """``q_0 ... q_5``: the first and the last column of a signal."""
    return shown(names[0]) if len(names) == 1 else f"{shown(names[0])} ... {shown(names[-1])}"


def drawn(values: NDArray[np.float64], width: int = PLOT_WIDTH) -> str:
    """A channel (n,) as a row of bars, the mean of each stretch between its smallest and its largest."""
    pieces = [float(piece.mean()) for piece in np.array_split(values, min(width, len(values)))]
    low, high = min(pieces), max(pieces)
    span = high - low
    if not span > 0:
        return BARS[0] * len(pieces)
    return "".join(BARS[round((piece - low) / span * (len(BARS) - 1))] for piece in pieces)


def _joints(run: Run) -> Table:
    rec = run.recording
    table = Table(box=SIMPLE_HEAD, collapse_padding=True)
    table.add_column("joint", overflow="fold")  # on narrow terminals names break, numbers never
    angles, torques = angle_units(rec.kinds), [torque_of(rec.torque_unit, kind) for kind in rec.kinds]
    alike = len(set(rec.kinds)) == 1
    angle, torque = (angles[0], torques[0]) if alike else ("", "")
    if not alike:
        table.add_column("unit", no_wrap=True)
    titles = {"q min": angle, "q max": angle, "speed": f"{angle}/s"}
    table.add_column("motion\nq over t", no_wrap=True)
    if run.has_torque:
        table.add_column(f"torque\n{torque} over t".replace("\n ", "\n"), no_wrap=True)
        titles |= {"tau min": torque, "tau max": torque, "tau std": torque}
    if rec.has_motor_encoder:
        titles["motor - link"] = angle
    for title, of in titles.items():
        table.add_column(f"{title}\n{of}", justify="right", no_wrap=True)
    for joint, name in enumerate(rec.joints):
        q, tau = rec.q[:, joint], rec.tau[:, joint]
        dq = joint_velocity(rec, joint)
        cells = [q.min(), q.max(), np.percentile(np.abs(dq), 99)]
        if run.has_torque:
            cells += [tau.min(), tau.max(), tau.std()]
        if rec.q_motor is not None:
            cells.append(np.max(np.abs(rec.q_motor[:, joint] - q)))
        units = [] if alike else [f"{angles[joint]}, {torques[joint]}" if run.has_torque else angles[joint]]
        plots = [drawn(q), drawn(tau)] if run.has_torque else [drawn(q)]
        table.add_row(Text(shown(name)), *units, *plots, *(f"{cell:.4g}" for cell in cells))
    return table


def _show_findings(out: Console, findings: Sequence[Finding]) -> None:
    if not findings:
        out.print("  nothing wrong found\n")
        return
    table = Table(box=None, show_header=False, pad_edge=True)
    table.add_column(no_wrap=True)
    table.add_column(no_wrap=True)
    table.add_column(ratio=1)
    for first, text in told_once(findings):
        table.add_row(Text(first.severity, style=_STYLES[first.severity]), Text(first.code), Text(text))
    out.print(table)
    out.print()
