"""A load in the words of robot controllers: what their load data want, in their units and their order.

* Universal Robots, `set_target_payload(m, cog, inertia)`: kg, m, kg*m^2 about the centre along the flange's axes, in
  the order Ixx, Iyy, Izz, Ixy, Ixz, Iyz (URScript manual); the pendant shows the centre in mm.
* KUKA, `LOAD_DATA[n]`: kg; CM in mm with A, B, C [degrees] of the principal axes, Rz(A) Ry(B) Rx(C) from the flange;
  J in kg*m^2 about them (KUKA System Software, programming handbook).
* ABB, `loaddata` of RAPID: kg, mm, quaternion of the axes of moment with its real part first, kg*m^2 about them (RAPID
  reference, data types).
* Fanuc, payload schedule: kg, centre in cm, inertia in kgf*cm*s^2 about the centre along the flange's axes (payload
  setting screen).
"""

from __future__ import annotations

from itertools import permutations, product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs.reference.load import Load

FloatArray = NDArray[np.float64]

KGF_CM_S2 = 100.0 / 9.80665
"""One kg*m^2 in kgf*cm*s^2."""
QUANTITIES = ("mass", "cx", "cy", "cz", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")
MOMENTS = ("Ixx", "Iyy", "Izz")
UNITS = ("kg", "mm", "mm", "mm", "kg*m^2", "kg*m^2", "kg*m^2", "kg*m^2", "kg*m^2", "kg*m^2")
SCALES = np.array([1.0, 1e3, 1e3, 1e3, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0])
"""From SI to `UNITS`."""


def quantities(load: Load) -> list[dict[str, Any]]:
    """Name, value, unit and interval (None: not seen) of all ten numbers, the centre in mm; no moment is negative."""
    values = np.array([load.mass, *load.centre, *load.inertia]) * SCALES
    intervals = load.intervals * SCALES[:, None]
    moments = np.isin(QUANTITIES, MOMENTS)
    values[moments], intervals[moments] = np.maximum(values[moments], 0.0), np.maximum(intervals[moments], 0.0)
    return [
        {
            "name": name,
            "value": float(value),
            "interval": interval.tolist() if np.isfinite(interval).all() else None,
            "unit": unit,
        }
        for name, value, interval, unit in zip(QUANTITIES, values, intervals, UNITS, strict=True)
    ]


def vendor_words(load: Load) -> dict[str, str]:
    """One line per maker, ready to be copied."""
    from scipy.spatial.transform import Rotation

    axes, moments = principal_axes(load.inertia)
    turn = Rotation.from_matrix(axes)
    a, b, c = turn.as_euler("ZYX", degrees=True)
    x, y, z, w = turn.as_quat(canonical=True)
    metres, millimetres = load.centre, 1e3 * load.centre
    plain = KGF_CM_S2 * load.inertia[:3]
    place, turns = (
        dict(zip(keys, map(_n, values), strict=True)) for keys, values in (("XYZ", millimetres), ("ABC", (a, b, c)))
    )
    about = dict(zip("XYZ", map(_n, moments), strict=True))
    centre = ",".join(f"{key} {value}" for key, value in (place | turns).items())
    inertia = ",".join(f"{key} {value}" for key, value in about.items())
    cm, kgf = (
        " ".join(f"{key} {_n(value)}" for key, value in zip("XYZ", values, strict=True))
        for values in (100 * metres, plain)
    )
    mass = _n(load.mass)
    return {
        "ur": f"set_target_payload({mass}, [{_all(metres)}], [{_all(load.inertia)}])",
        "kuka": f"LOAD_DATA[1]={{M {mass},CM {{{centre}}},J {{{inertia}}}}}",
        "abb": (
            f"PERS loaddata load1:=[{mass},[{_all(millimetres, ',')}],[{_all([w, x, y, z], ',')}],"
            f"{_all(moments, ',')}];"
        ),
        "fanuc": f"PAYLOAD {mass} kg; CENTER {cm} cm; INERTIA {kgf} kgf*cm*s^2",
    }


def principal_axes(inertia: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Principal axes as columns of a rotation (3, 3), nearest to the frame's own, and the moments (3,) about them.

    Parameters
    ----------
    inertia : ndarray (6,)
        Ixx, Iyy, Izz, Ixy, Ixz, Iyz [kg*m^2].
    """
    xx, yy, zz, xy, xz, yz = inertia
    matrix = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    _, vectors = np.linalg.eigh(matrix)
    orders = [
        vectors[:, order] * np.array(signs)
        for order in permutations(range(3))
        for signs in product((1.0, -1.0), repeat=3)
    ]
    axes = max((m for m in orders if np.linalg.det(m) > 0), key=np.trace)
    return axes, np.diag(axes.T @ matrix @ axes).copy()


def _n(value: float) -> str:
    """Six digits, and no exponent: controllers' languages differ in it."""
    text = f"{float(value):.6f}".rstrip("0").rstrip(".")
    return "0" if text in ("-0", "") else text


def _all(values: Any, between: str = ", ") -> str:
    return between.join(_n(value) for value in values)
