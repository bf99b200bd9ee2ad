"""`terms.toml`: effects whose coefficients the user knows.

```toml
[[term]]
kind = "counterbalance"    # a kind of the catalogue of effects
joint = "joint_2"          # its name, or its index from 0
a = 0.8                    # its shape parameters; a sharpness may be left out
b = 0.2
phase = -1.48
gas_length = 0.575
counterbalance = 15000.0   # and its coefficients [N m]
```
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dynid_rs import _core
from dynid_rs.base.errors import DataError
from dynid_rs.base.quoting import file_name, shown, shown_value
from dynid_rs.base.toml import read_toml
from dynid_rs.model.known import KnownTerm


def read_terms(path: str | Path, robot: _core.RobotModel) -> list[KnownTerm]:
    """Read a `terms.toml`; terms of one kind on several joints become one effect.

    Raises
    ------
    DataError
        Not TOML, a kind, joint or key that is not known, a number that is missing or out of its range; names file,
        term and key.
    OSError
        The file cannot be opened.
    """
    return _Parser(file_name(path), robot).terms(read_toml(path, "bad_terms"))


@dataclass(frozen=True)
class _Term:
    """One entry: shape and coefficients of one kind on one joint."""

    joint: int
    shape: dict[str, float]
    coefficients: list[float]


@dataclass(frozen=True)
class _Parser:
    file: str
    robot: _core.RobotModel

    def fault(self, key: str, text: str) -> DataError:
        return DataError(
            f"{self.file}, {shown(key, 80)}: {text}", code="bad_terms", file=self.file, column=shown(key, 80)
        )

    def terms(self, content: dict[str, Any]) -> list[KnownTerm]:
        entries = content.get("term")
        if set(content) != {"term"} or not isinstance(entries, list) or not all(isinstance(e, dict) for e in entries):
            raise self.fault(next(iter(content.keys() - {"term"}), "term"), "every term must be a table [[term]]")
        by_kind: dict[str, list[_Term]] = {}
        for k, entry in enumerate(entries):
            kind, term = self.term(f"term {k + 1}", entry)
            if any(other.joint == term.joint for other in by_kind.setdefault(kind, [])):
                joint = self.robot.joint_names[term.joint]
                raise self.fault(f"term {k + 1}", f"the {kind} of {joint} is there twice; keep one")
            by_kind[kind].append(term)
        return [self.effect(kind, terms) for kind, terms in by_kind.items()]

    def term(self, where: str, entry: dict[str, Any]) -> tuple[str, _Term]:
        catalogue = {kind["kind"]: kind for kind in _core.effect_catalogue() if not kind["declared"]}
        kind = entry.get("kind")
        if not isinstance(kind, str) or kind not in catalogue:
            found = "is missing" if kind is None else f"{shown_value(kind)} is not known"
            raise self.fault(f"{where}, kind", f"{found}; {_hint(str(kind), catalogue)}")
        where = f"{where} ({kind})"
        shape = {parameter["name"]: parameter["absent"] for parameter in catalogue[kind]["shape"]}
        coefficients = {coefficient["name"]: coefficient for coefficient in catalogue[kind]["coefficients"]}
        for key in entry.keys() - {"kind", "joint", *shape, *coefficients}:
            raise self.fault(f"{where}, {key}", f"this key is not known; {_hint(key, [*shape, *coefficients])}")
        joint = self.joint(where, entry.get("joint"))
        absent = {name: value for name, value in shape.items() if value is not None}
        values = {name: self.number(where, name, absent | entry) for name in [*shape, *coefficients]}
        for name, coefficient in coefficients.items():
            if not coefficient["lower"] <= values[name] <= coefficient["upper"]:
                sign = "at least 0" if coefficient["lower"] == 0 else "at most 0"
                raise self.fault(f"{where}, {name}", f"must be {sign}, found {values[name]:g}")
        term = _Term(joint, {name: values[name] for name in shape}, [values[name] for name in coefficients])
        try:
            self.effect(kind, [term])
        except ValueError as error:
            raise self.fault(where, str(error)) from None
        return kind, term

    def joint(self, where: str, joint: object) -> int:
        names = self.robot.joint_names
        if isinstance(joint, str) and joint in names:
            return names.index(joint)
        if isinstance(joint, int) and not isinstance(joint, bool) and 0 <= joint < len(names):
            return joint
        expected = f"expected one of {', '.join(shown(name) for name in names)}, or an index from 0 to {len(names) - 1}"
        found = "is missing" if joint is None else f"{shown_value(joint)} is no joint of {shown(self.robot.name)}"
        raise self.fault(f"{where}, joint", f"{found}; {expected}")

    def number(self, where: str, name: str, entry: dict[str, Any]) -> float:
        value = entry.get(name)
        if value is None:
            raise self.fault(f"{where}, {name}", "is missing; shape parameters and coefficients are all needed")
        if not isinstance(value, int | float) or isinstance(value, bool) or abs(value) >= 1e300 or math.isnan(value):
            raise self.fault(f"{where}, {name}", f"must be a finite number, found {shown_value(value)}")
        return float(value)

    def effect(self, kind: str, terms: list[_Term]) -> KnownTerm:
        """One effect; joints without the term get the first one's shape, which its zeros make void."""
        n = self.robot.n_joints
        shapes = {name: np.full(n, value) for name, value in terms[0].shape.items()}
        coefficients = np.zeros((n, len(terms[0].coefficients)))
        for term in terms:
            coefficients[term.joint] = term.coefficients
            for name, value in term.shape.items():
                shapes[name][term.joint] = value
        return _core.Effect.of(kind, **shapes), coefficients


def _hint(name: str, names: Iterable[str]) -> str:
    names = list(names)
    close = difflib.get_close_matches(name, names, n=1)
    return f"did you mean {close[0]}?" if close else f"expected one of {', '.join(names)}"
