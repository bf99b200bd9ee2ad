"""Tolerances are claims: each has a name and a reason."""

import numpy as np

EXACT = {"rtol": 0, "atol": 0}
"""Same code, same machine: wheel and binary, saved and loaded."""
ALGEBRAIC = {"rtol": 1e-10, "atol": 1e-10}
"""Same mathematics, other order of operations, numbers of order one."""
COMPLEX_STEP = {"rtol": 1e-9, "atol": 1e-9}
"""A derivative without cancellation."""
FINITE_DIFFERENCE = {"rtol": 1e-5, "atol": 1e-6}
"""A derivative by differences."""
CENTRAL_DIFFERENCE = {"rtol": 2e-6, "atol": 1e-9}
"""A central difference with a step of 1e-6 on functions of order one."""
PINOCCHIO = 1e-12
"""Same mathematics in double precision, relative to the largest magnitude of the sample."""
LAST_DIGITS = 1e-14
"""The same robot written in another format, relative to the largest torque of the joint."""
MUJOCO = 1e-9
"""The same, through an engine that turns inertias into principal axes and back."""


def statistical(std_error, n_sigma=5):
    """Recovery from noise: seeded, so that it cannot flake."""
    return {"rtol": 0, "atol": n_sigma * std_error}


def relative_error(actual, expected):
    """Largest difference of a sample over its largest magnitude: (n_samples, ...) each, one number."""
    axes = tuple(range(1, np.ndim(expected)))
    size = np.max(np.abs(expected), axis=axes)
    return float(np.max(np.max(np.abs(actual - expected), axis=axes) / np.maximum(size, 1e-300)))
