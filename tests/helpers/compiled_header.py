"""A model's C header with a driver around it, as a library; held against the estimator, term by term."""

import ctypes
import functools
import itertools
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from helpers.data import ROOT
from helpers.whole_model import SIGNALS

STRICT = ["-Wall", "-Wextra", "-Wpedantic", "-Werror", "-O2", "-ffp-contract=off", "-fPIC", "-shared"]
COMPILERS = {
    "c99": ("gcc", ["-std=c99"]),
    "c++17": ("g++", ["-std=c++17", "-x", "c++"]),
    "contracted": ("gcc", ["-std=gnu11", "-O3", "-march=native", "-ffp-contract=fast"]),
}
PLAIN = "plain"
"""Not optimised, in a fifth of the time: for headers whose code another test compiles with all of a compiler's care."""
OF_THE_SIZE = 1e-11
"""Another order of operations, other functions for sine, tanh and exponential: of the largest torque of the term."""

DRIVER = ROOT / "tests/c/header_driver.c"

counter = itertools.count()


@functools.cache
def compiled(header, standard="c99"):
    """The header with a driver around it, as a library; it remembers nothing from one run to the next."""
    folder = Path(_keep().name)
    compiler, flags = ("gcc", ["-std=c99", "-O0"]) if standard == PLAIN else COMPILERS[standard]
    assert shutil.which(compiler), (
        f"{compiler} is not on the path; these tests compile C (Debian: apt install {compiler})"
    )
    (folder / "arm.h").write_text(header, encoding="ascii")
    target = folder / f"driver_{next(counter)}.so"
    command = [compiler, *STRICT, *flags, f"-I{folder}", str(DRIVER), "-o", str(target), "-lm"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[:4000]
    library = ctypes.CDLL(str(target))
    library.name.restype = ctypes.c_char_p
    return library


def run(library, states, step=0.0):
    """Torque, terms, standard deviation and status of every state, by C."""
    n, n_terms = library.sizes(0), library.sizes(1)
    arrays = [np.ascontiguousarray(states[name]) if name in states else None for name in SIGNALS]
    double = ctypes.POINTER(ctypes.c_double)
    pointers = (double * 7)(*(double() if a is None else a.ctypes.data_as(double) for a in arrays))
    n_samples = len(states["q"])
    tau, terms = np.empty((n_samples, n)), np.empty((n_samples, n_terms, n))
    std, status = np.empty((n_samples, n)), np.empty(n_samples, dtype=np.uint32)
    out = [array.ctypes.data_as(double) for array in (tau, terms, std)]
    library.run(n_samples, ctypes.c_double(step), pointers, *out, status.ctypes.data_as(ctypes.POINTER(ctypes.c_uint)))
    return tau, terms, std, status


def difference(actual, expected):
    """Largest difference over the largest torque of that term and joint: (n_terms, n_joints)."""
    size = np.abs(expected).max(axis=0)
    return np.abs(actual - expected).max(axis=0) / np.where(size > 0, size, 1.0)


def assert_same(model, library, states, said=""):
    """C gives what the estimator gives, term by term."""
    total, terms, status = model.evaluate(**states)
    tau, c_terms, std, c_status = run(library, states)
    np.testing.assert_array_equal(c_status, status)
    off = difference(c_terms, terms)
    for name, row in zip(model.term_names, off, strict=True):
        assert row.max() <= OF_THE_SIZE, f"{said} {name}: off by {row.max():.1e} of its size"
    size = np.abs(terms).max(axis=0).sum(axis=0)
    assert np.all(np.abs(tau - total) <= OF_THE_SIZE * size)
    motion = {name: values for name, values in states.items() if name != "temperature"}
    np.testing.assert_allclose(std, model.predicted_std(**motion), rtol=1e-9)
    return off


@functools.cache
def _keep():
    return tempfile.TemporaryDirectory(prefix="dynid-header-", ignore_cleanup_errors=True)
