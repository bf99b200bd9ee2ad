"""The section about what was declared: the robot file's inertials as a prior, and effects that are known."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from dynid_rs.report import tables
from dynid_rs.report.text import DASH, count, esc, percent, ratio, significant, with_unit, words

Result = Mapping[str, Any]
_FAR = 2.0
"""Shifts beyond this many standard deviations of the prior are counted."""


def declared(result: Result) -> str:
    """Say how far the robot file is trusted, and whether the data can tell the known terms."""
    return _prior(result) + _known(result)


def _prior(result: Result) -> str:
    prior = result.get("prior")
    if not prior:
        return ""
    off, moved = prior["relative_uncertainty"], prior.get("moved") or []
    rotors = f", those of the rotors by {percent(off['rotors'])}" if off.get("rotors") is not None else ""
    far = sum(1 for entry in moved if abs(entry["shift"]) > _FAR)
    rows = [
        [
            esc(entry["name"]),
            tables.cell(esc(entry["link"]), "text"),
            *(tables.cell(significant(entry[key])) for key in ("declared", "std", "value", "shift")),
        ]
        for entry in moved
    ]
    head = ["Parameter", "Link", "Declared", "Trusted to", "Found", "Moved by [of that]"]
    return (
        "<p>Where these runs say little, the masses and inertias of the robot file decide (they are the prior of the "
        f"fit). By the evidence they are wrong by about {percent(off['links'])}{rotors}. Of the "
        f"{count(prior['n_directions'])} combinations of them that the file knows, the runs determine "
        f"{significant(prior['n_determined'], 2)}; they moved {count(far)} of {count(len(moved))} base parameters by "
        "more than twice what the file is trusted to.</p>\n"
        "<details><summary>How far the data moved each parameter</summary>"
        f"{tables.table(head, rows, label='Prior and data')}</details>"
    )


def _known(result: Result) -> str:
    entries = result.get("known") or []
    if not entries:
        return ""
    stds = dict(zip(result["joints"], result["rmse"]["test"]["torque_std"], strict=True))
    rows = []
    for entry in entries:
        alone, under = entry["data_alone"], entry.get("with_prior")
        errors = entry.get("rmse_test_with_prior") or {}
        std = stds.get(entry["joint"])
        shares = [percent(ratio(errors.get(key), std)) for key in ("with", "without_same_weight", "without")]
        bare = [percent(ratio(entry["rmse_test_alone"][key], std)) for key in ("with", "without")]
        rows.append(
            [
                esc(words(entry["kind"])),
                tables.cell(esc(entry["joint"]), "text"),
                tables.cell(esc(with_unit(significant(entry["torque_rms"]), entry["unit"]))),
                tables.cell(percent(alone["std_error"])),
                tables.cell(percent(under["std_error"]) if under else DASH),
                *(tables.cell(share) for share in (*shares, *bare)),
            ]
        )
    head = [
        "Known term",
        "Joint",
        "Its torque (RMS)",
        "Std error of its size, data alone",
        "with the prior",
        "Test error with prior: with it",
        "without it, same weight",
        "without it, own weight",
        "Test error, data alone: with it",
        "without it",
    ]
    return (
        '<h3 class="next">Known terms</h3><p>Their coefficients were given, not fitted. A size is told from the other '
        "parameters if its standard error is below a half. Test errors are over the torque\u2019s standard deviation. "
        "Without a term the evidence holds the robot file for wrong and loosens the prior until base parameters "
        "imitate the term (own weight); under the same weight its absence shows.</p>"
        + tables.table(head, rows, label="Known terms")
    )
