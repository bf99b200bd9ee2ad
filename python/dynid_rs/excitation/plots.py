"""The page of plots beside a trajectory: position, velocity, acceleration, limits, and what the searches did."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs.excitation.limits import MOTIONS
from dynid_rs.excitation.output import Playable
from dynid_rs.excitation.separation_view import section
from dynid_rs.report.figures import Figures, label, panel, place, series
from dynid_rs.report.page import shell
from dynid_rs.report.tables import cell, table
from dynid_rs.report.text import esc, significant

FloatArray = NDArray[np.float64]

N_POINTS = 1000


def page(result: dict[str, Any], trajectory: Playable, decided: str = "") -> str:
    """Return the whole page: `decided` (HTML) if given, figures of merit, extremes, one plot per joint and quantity."""
    figures = Figures()
    t = np.linspace(0.0, trajectory.duration, N_POINTS)
    figures.array("t", t)
    motion = trajectory.evaluate(t)
    rows = []
    for j, joint in enumerate(result["joints"]):
        plots = "".join(
            _plot(figures, f"{name}-{j}", joint, name, signal[:, j], result, j)
            for name, signal in zip(MOTIONS, motion, strict=True)
        )
        rows.append(f"<h3>{esc(joint)}</h3>\n{plots}")
    separation = ""
    if "separation" in result:
        separation = f'<section id="separation"><h2>Separation</h2>\n{section(result["separation"])}</section>\n'
    if decided:
        separation = f'<section id="next"><h2>What it will decide</h2>\n{decided}</section>\n'
    title = "Next experiment on" if decided else f"{'Separating' if separation else 'Exciting'} trajectory of"
    body = (
        f"<header><h1>{title} {esc(result['robot'])}</h1>"
        f"<p>{result['duration_s']:g} s, {result['n_harmonics']} harmonics, criterion "
        f"{esc(result['criterion'])}, seed {result['seed']}.</p></header>\n"
        f'<main>{separation}<section id="merit"><h2>Figures of merit</h2>\n{_merit(result)}</section>\n'
        f'<section id="extremes"><h2>Extremes beside the limits</h2>\n{_extremes(result)}</section>\n'
        f'<section id="motion"><h2>Motion</h2>\n{"".join(rows)}</section></main>\n'
    )
    return shell(title=f"{result['robot']} \u2013 exciting trajectory", body=body, figures=figures)


def _plot(figures: Figures, key: str, joint: str, name: str, signal: FloatArray, result: dict[str, Any], j: int) -> str:
    values = result["motion"][name]
    unit = result["units"][j] + {"position": "", "velocity": "/s", "acceleration": "/s\u00b2"}[name]
    ends = figures.array("ends", np.array([0.0, result["duration_s"]]))
    drawn = [series("line", "t", "blue", name, y=figures.array(key, signal))]
    for side in ("lower_limit", "upper_limit"):
        limit = figures.array(f"{key}/{side}", np.full(2, values[side][j]))
        drawn.append(series("line", ends, "red", side.replace("_", " "), y=limit, width=1.0, dash=True))
    figures.add(key, [panel("time [s]", label(name, unit), drawn, height=180)], "time")
    limits = f"between {significant(values['lowest'][j])} and {significant(values['highest'][j])} {unit}"
    return f"<figure>{place(key, esc(f'{joint}: {name} over time, {limits}'), kind='wide')}</figure>\n"


def _merit(result: dict[str, Any]) -> str:
    rows = [["condition number of the base regressor", cell(significant(result["condition_number"]))]]
    if result["whitened_condition_number"] is not None:
        rows.append(["the same, whitened", cell(significant(result["whitened_condition_number"]))])
    for block, value in result["block_condition_numbers"].items():
        rank = result["block_ranks"][block]
        rows.append([f"of its {block} block, rank {rank}", cell(significant(value))])
    rows.append(["log det of the information matrix", cell(significant(result["log_det"]))])
    rows.append(["trace of its inverse", cell(significant(result["variance_trace"]))])
    rows.append([f"objective ({esc(result['criterion'])})", cell(significant(result["objective"]))])
    return table(["figure", "value"], rows, label="Figures of merit")


def _extremes(result: dict[str, Any]) -> str:
    head = ["joint", "quantity", "lowest", "highest", "lower limit", "upper limit", "bound of Eq. 17"]
    keys = ("lowest", "highest", "lower_limit", "upper_limit", "eq17_bound")
    rows = [
        [esc(joint), name, *(cell(significant(result["motion"][name][key][j], 4)) for key in keys)]
        for j, joint in enumerate(result["joints"])
        for name in MOTIONS
    ]
    return table(head, rows, label="Extremes beside the limits")
