"""A load in the words of robot controllers: what their load data want, in their units and their order.

* Universal Robots, `set_target_payload(m, cog, inertia)`: kg, m, kg*m^2 about the centre along the flange's axes, in the
  order Ixx, Iyy, Izz, Ixy, Ixz, Iyz (URScript manual); the teach pendant shows the centre in mm.
* KUKA, `LOAD_DATA[n]`: kg; CM in mm with A, B, C [degrees] of the principal axes, Rz(A) Ry(B) Rx(C) from the flange; J in
  kg*m^2 about them (KUKA System Software, programming handbook).
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

from dynid_rs.diagnosis.reference.load import Load

FloatArray = NDArray[np.float64]

KGF_CM_S2 = 100.0 / 9.80665
"""One kg*m^2 in kgf*cm*s^2."""
QUANTITIES = ("mass", "cx", "cy", "cz", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")
UNITS = ("kg", "mm", "mm", "mm", "kg*m^2", "kg*m^2", "kg*m^2", "kg*m^2", "kg*m^2", "kg*m^2")
SCALES = np.array([1.0, 1e3, 1e3, 1e3, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0])
"""From SI to `UNITS`."""


def quantities(load: Load) -> list[dict[str, Any]]:
    """Name, value, interval and unit of all ten numbers, the centre in mm."""
    values = np.array([load.mass, *load.centre, *load.inertia]) * SCALES
    intervals = load.intervals * SCALES[:, None]
    return [
        {"name": name, "value": float(value), "interval": interval.tolist(), "unit": unit}
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
    return {
        "ur": f"set_target_payload({_n(load.mass)}, [{_all(metres)}], [{_all(load.inertia)}])",
        "kuka": (
            f"LOAD_DATA[1]={{M {_n(load.mass)},CM {{X {_n(millimetres[0])},Y {_n(millimetres[1])},Z {_n(millimetres[2])},"
            f"A {_n(a)},B {_n(b)},C {_n(c)}}},J {{X {_n(moments[0])},Y {_n(moments[1])},Z {_n(moments[2])}}}}}"
        ),
        "abb": (
            f"PERS loaddata load1:=[{_n(load.mass)},[{_all(millimetres, ',')}],[{_all([w, x, y, z], ',')}],"
            f"{_all(moments, ',')}];"
        ),
        "fanuc": (
            f"PAYLOAD {_n(load.mass)} kg; CENTER X {_n(metres[0] * 100)} Y {_n(metres[1] * 100)} Z "
            f"{_n(metres[2] * 100)} cm; INERTIA X {_n(plain[0])} Y {_n(plain[1])} Z {_n(plain[2])} kgf*cm*s^2"
        ),
    }


def principal_axes(inertia: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Principal axes as columns of a rotation (3, 3), nearest to the frame's own, and the moments (3,) about them.

    Parameters
    ----------
    inertia : ndarray (6,)
        Ixx, Iyy, Izz, Ixy, Ixz, Iyz [kg*m^2].
    """
    xx, yy, zz, xy, xz, yz = inertia
    moments, vectors = np.linalg.eigh(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
    orders = [
        vectors[:, order] * np.array(signs) for order in permutations(range(3)) for signs in product((1.0, -1.0), repeat=3)
    ]
    axes = max((m for m in orders if np.linalg.det(m) > 0), key=np.trace)
    matrix = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return axes, np.diag(axes.T @ matrix @ axes).copy()


def _n(value: float) -> str:
    """Six digits, and no exponent: controllers' languages differ in it."""
    text = f"{float(value):.6f}".rstrip("0").rstrip(".")
    return "0" if text in ("-0", "") else text


def _all(values: Any, between: str = ", ") -> str:
    return between.join(_n(value) for value in values)
