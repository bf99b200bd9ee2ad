"""Fingerprints of content: the same for the same bytes on every machine, and nothing else goes in."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from dynid_rs import _core

_COMPILED = (_core.RobotModel, _core.Effect, _core.TorqueModel, _core.GaussianMixtureRegression, _core.NormalisedRbf)


def fingerprint(*parts: object) -> str:
    """SHA-256 of nested data, 64 hexadecimal digits.

    Numbers, text, bytes, arrays, sequences, mappings, data classes, estimators and the compiled module's objects.

    Raises
    ------
    TypeError
        Something else: its address would end up in the hash.
    """
    state = hashlib.sha256()
    _feed(state, parts)
    return state.hexdigest()


def _feed(state: Any, value: object) -> None:
    """Every value with its type and length before it, so that no two contents look alike."""
    if value is None or isinstance(value, bool | int | float | str):
        text = value.hex() if isinstance(value, float) else str(value)
        _put(state, type(value).__name__, text.encode(errors="surrogatepass"))
    elif isinstance(value, bytes):
        _put(state, "bytes", value)
    elif isinstance(value, np.ndarray):
        _put(state, f"array {value.dtype.str} {value.shape}", np.ascontiguousarray(value).tobytes())
    elif isinstance(value, np.generic):
        _feed(state, value.item())
    elif isinstance(value, list | tuple):
        _put(state, "sequence", str(len(value)).encode())
        for item in value:
            _feed(state, item)
    elif isinstance(value, Mapping):
        _put(state, "mapping", str(len(value)).encode())
        for key in sorted(value, key=repr):
            _feed(state, (key, value[key]))
    elif is_dataclass(value):
        _put(state, "object", type(value).__name__.encode())
        _feed(state, [(field.name, getattr(value, field.name)) for field in fields(value)])
    elif isinstance(value, _COMPILED):
        _put(state, "compiled", type(value).__name__.encode())
        _feed(state, value.__reduce__()[1])
    elif hasattr(value, "__dict__") and type(value).__module__.startswith("dynid_rs"):
        _put(state, "object", type(value).__name__.encode())
        _feed(state, vars(value))
    else:
        raise TypeError(f"{type(value).__name__} has no fingerprint")


def _put(state: Any, kind: str, content: bytes) -> None:
    state.update(f"{kind} {len(content)}\n".encode())
    state.update(content)
