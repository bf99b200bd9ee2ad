"""What is left, as `result.json` and the report tell it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from dynid_rs.diagnosis.patchwork import Nameless
from dynid_rs.diagnosis.picture import Picture
from dynid_rs.diagnosis.remainder import Remainder
from dynid_rs.diagnosis.unknown import Unexplained, names


def remainder_entries(remainder: Remainder, joint_names: Sequence[str]) -> list[dict[str, Any]]:
    """Entries of `unexplained` in `result.json`."""
    return [
        {
            "joint": joint_names[u.joint],
            "share": u.share,
            "p_value": u.p_value,
            "depends_on": _depends_on(u, joint_names),
            **({} if u.term is None else {"term": {"kind": "gmr", "kept": u.term in remainder.terms}}),
            **({} if u.picture is None else {"plot": _plot(u.picture, joint_names, u.joint)}),
        }
        for u in remainder.unexplained
    ]


def unknown_entries(remainder: Remainder, joint_names: Sequence[str]) -> list[dict[str, Any]]:
    """Effects that have no name but a term in the model."""
    return [
        {
            "kind": "unknown",
            "joints": [joint_names[u.joint]],
            "parameters": [],
            "p_value": u.p_value,
            "ties": [],
            "depends_on": _depends_on(u, joint_names),
            "note": "nothing in the catalogue explains it; "
            + (
                "a regression on these signals is in the model"
                if u.term in remainder.terms
                else "a regression on these signals does not carry over to runs left out, so it is not in the model"
            ),
        }
        for u in remainder.unexplained
        if u.term is not None and u.depends_on and u.joint not in remainder.nearest
    ]


def nearest_names(remainder: Remainder, joint_names: Sequence[str]) -> list[Nameless]:
    """Names that come nearest to what has none: they are told as unknown."""
    return [
        Nameless(
            remainder.nearest[u.joint],
            _depends_on(u, joint_names),
            "nothing in the catalogue explains it"
            + (" and a regression on these signals is in the model" if u.term in remainder.terms else ""),
        )
        for u in remainder.unexplained
        if u.joint in remainder.nearest
    ]


def _depends_on(u: Unexplained, joint_names: Sequence[str]) -> list[dict[str, Any]]:
    return [{"signal": name, "strength": strength, "direct": True} for name, strength in names(u, joint_names)]


def _plot(picture: Picture, joint_names: Sequence[str], joint: int) -> dict[str, Any] | None:
    """Mean partial residual over the strongest signal."""
    name, j = picture.signals[0]
    centres = (picture.edges[0][1:] + picture.edges[0][:-1]) / 2
    count, partial, curve = picture.count, picture.partial, picture.fitted
    if partial.ndim == 2:
        count = np.where(np.isfinite(partial), count, 0.0)
        total = np.maximum(count.sum(axis=1), 1.0)
        partial, curve = ((np.nan_to_num(x) * count).sum(axis=1) / total for x in (partial, curve))
        count = count.sum(axis=1)
    seen = (count > 0) & np.isfinite(partial) & np.isfinite(curve)
    if not seen.any():
        return None
    unit = {"q": "rad", "dq": "rad/s", "ddq": "rad/s^2", "tau_link": "N*m"}.get(name.replace("_motor", ""), "1")
    return {
        "joint": joint_names[joint],
        "signal": name if j < 0 else f"{name}_{joint_names[j]}",
        "unit": unit,
        "x": centres[seen].tolist(),
        "partial": partial[seen].tolist(),
        "curve_x": centres[seen].tolist(),
        "curve": curve[seen].tolist(),
    }
