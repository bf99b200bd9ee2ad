"""What the report needs of ``result.json``: keys, kinds and lengths, checked before anything is drawn."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

# The shape of result.json as far as the report reads it. A key with "?" may be absent or null;
# "per joint" is a list along `joints`, its entries may be null.
_PARAMETER = {"name": str, "value": float, "joint?": str, "unit?": str, "std_error?": float, "interval?": "interval"}
_AFTER = {loop: ("per joint", float) for loop in ("friction?", "links?", "residual?")}
_STAGES = {"wls?": ("per joint", float), **_AFTER}
_SEPARATION = {"share": float, "std_error": float}
_DEPENDENCE = {"signal": str, "strength?": float, "direct?": bool}
_PLOT = {"signal": str, "unit?": str, "x": [float], "partial": [float], "curve_x?": [float], "curve?": [float]}
RESULT_SHAPE: Mapping[str, Any] = {
    "robot": str,
    "joints": [str],
    "torque_unit": str,
    "torque_units?": ("per joint", str),
    "data": {
        "train": [str],
        "test": [str],
        "n_samples?": {"train?": float, "test?": float},
        "n_dropped?": {"train?": float, "test?": float},
        "rate_hz?": float,
        "cutoff_hz?": float,
        "findings?": [
            {
                "severity": str,
                "message": str,
                "code?": str,
                "file?": str,
                "column?": str,
                "rows?": [float],
                "value?": float,
                "unit?": str,
            }
        ],
    },
    "rmse": {
        "test": {
            "torque_std": ("per joint", float),
            "wls": ("per joint", float),
            "before": ("per joint", float),
            "before_interval?": ("per joint", "interval"),
            "after": ("per joint", float),
            "after_interval?": ("per joint", "interval"),
            "change_interval?": ("per joint", "interval"),  # of after over before, less one
            "floor?": ("per joint", float),
            "floor_interval?": ("per joint", "interval"),
        },
    },
    "prior?": {
        "relative_uncertainty": {"links": float, "rotors?": float},
        "n_directions": float,
        "n_determined": float,
        "moved?": [{"name": str, "link": str, "declared": float, "value": float, "std": float, "shift": float}],
    },
    "known?": [
        {
            "kind": str,
            "joint": str,
            "unit": str,
            "torque_rms": float,
            "data_alone": _SEPARATION,
            "with_prior?": _SEPARATION,
            "rmse_test_alone": {"with": float, "without": float},
            "rmse_test_with_prior?": {"with": float, "without_same_weight": float, "without": float},
        }
    ],
    "effects?": [
        {
            "kind": str,
            "joints": [str],
            "rank?": float,
            "parameters?": [_PARAMETER],
            "rmse_test_before?": [float],
            "rmse_test_after?": [float],
            "rmse_test_after_interval?": ["interval"],
            "p_value?": float,
            "share_explained?": float,
            "ties?": [
                {"kind": str, "joints?": [str], "rmse_test_after?": [float], "separate?": str, "same_torque?": bool}
            ],
            "told_apart_from?": [{"kind": str, "joints?": [str], "log_evidence?": float, "p?": float}],
            "depends_on?": [_DEPENDENCE],
            "plot?": _PLOT,
            "note?": str,
            "told_as?": str,
        }
    ],
    "residual?": {
        "kind?": str,
        "inputs?": str,
        "reason?": str,
        "kept?": "kept",
        "rmse_test_without?": ("per joint", float),
        "rmse_test_with?": ("per joint", float),
        "n_components?": ("per joint", float),
    },
    "unexplained?": [
        {
            "joint": str,
            "share?": float,
            "p_value?": float,
            "depends_on?": [_DEPENDENCE],
            "term?": {"kind?": str, "kept?": bool, "rmse_test_with?": float},
            "plot?": _PLOT,
        }
    ],
    "steps?": [{"action": str, "kind?": str, "joints?": [str], "rmse_train?": ("per joint", float)}],
    "nothing_to_add?": bool,
    "next_experiment?": [str],
    "parameters?": {
        "base?": [{"link?": str, **_PARAMETER}],
        "joint?": [{"joint": str, **_PARAMETER}],
        "friction_shape?": [
            {
                "joint": str,
                "velocity_threshold?": float,
                "transition_width?": float,
                "sharpness?": float,
                "unit?": str,
            }
        ],
    },
    "encoder_delay?": {"value": ("per joint", float), "interval?": ("per joint", "interval"), "unit?": str},
    "base_parameters?": {"n_base?": float, "n_standard?": float, "gap?": float, "condition_number?": float},
    "history?": [
        {"iteration?": float, "rmse_train?": ("per joint", float), "rmse_train_after?": _AFTER},
    ],
    "loops?": {"test?": _STAGES},
    "converged?": bool,
    "n_iter?": float,
    "floor_method?": str,
    "verdict?": str,
}
DIAGNOSIS_SHAPE: Mapping[str, Any] = {"data": {"findings": [{}]}, "effects": [{}], "unexplained": [{}]}
"""What a diagnosis holds besides, for its answer to be told from none."""


def is_diagnosis(result: Mapping[str, Any]) -> bool:
    """Whether `dynid diagnose` wrote it."""
    return result.get("steps") is not None
