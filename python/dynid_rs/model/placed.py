"""Effects at their places: what a fit has beside the declared model, in the words of the catalogue."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynid_rs import _core
from dynid_rs.model.known import KnownTerm

CATALOGUE = {entry["kind"]: entry for entry in _core.effect_catalogue()}
FRICTION_SIGN = {"friction_width": 0, "friction_sharpness": 1}
"""References of shapes that are those of the sign of friction on the effect's first joint: width, sharpness."""
ANYWHERE = {"held_from": -1e9, "held_to": 1e9}
"""Ends of a function of a joint's angle that holds at any, beside one on another joint that ends [rad, m]."""


@dataclass(frozen=True)
class PlacedEffect:
    """A kind of the catalogue on one joint, or on the two joints of a pair.

    Parameters
    ----------
    kind : str
        Name in `effect_catalogue()`.
    joints : tuple of int
        Where it acts; every joint has coefficients of its own.
    shape : tuple of (str, tuple of float)
        Shape parameters by name, one value per joint of `joints`; `held_from` and `held_to` of a function of the
        angle that ends there. What may be absent is there in the end.
    silent : tuple of int
        Joints of it where it adds nothing: its unknowns there keep their places and are zero.
    """

    kind: str
    joints: tuple[int, ...]
    shape: tuple[tuple[str, tuple[float, ...]], ...] = ()
    silent: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        given = {name for name, _ in self.shape}
        absent = {p["name"]: p["absent"] for p in CATALOGUE[self.kind]["shape"] if p["absent"] is not None}
        more = ((name, (value,) * len(self.joints)) for name, value in absent.items() if name not in given)
        object.__setattr__(self, "shape", (*self.shape, *more))

    @staticmethod
    def at(kind: str, joint: int, **shape: float) -> PlacedEffect:
        """Place `kind` on one joint."""
        return PlacedEffect(kind, (joint,), tuple((name, (float(value),)) for name, value in shape.items()))

    def held(self, ends: Sequence[float]) -> PlacedEffect:
        """Return it, on its only joint, with the value beyond these angles that it has there."""
        own = tuple((name, values) for name, values in self.shape if name not in ANYWHERE)
        return replace(self, shape=(*own, *zip(ANYWHERE, ((end,) for end in ends), strict=True)))

    @property
    def acting(self) -> tuple[int, ...]:
        """Its joints without those where it adds nothing."""
        return tuple(j for j in self.joints if j not in self.silent)

    def shape_at(self, joint: int) -> dict[str, float]:
        """Shape parameters on one of its joints."""
        at = self.joints.index(joint)
        return {name: values[at] for name, values in self.shape}


def shapes_of_sign(kind: str) -> dict[str, int]:
    """Shape parameters of a kind that are those of friction's sign: 0 for its width, 1 for its sharpness."""
    shape = CATALOGUE[kind]["shape"]
    return {p["name"]: FRICTION_SIGN[p["relative_to"]] for p in shape if p["relative_to"] in FRICTION_SIGN}


@dataclass(frozen=True)
class HeldEffect:
    """An effect on one joint with coefficients that were fitted elsewhere, in the unit of the torque channel."""

    effect: PlacedEffect
    coefficients: tuple[float, ...]


def held_terms(held: Sequence[HeldEffect], n_joints: int) -> list[KnownTerm]:
    """Terms of a model, coefficients (n_joints, n_columns) zero where an effect does not act."""
    placed = [one.effect for one in held]
    terms: list[KnownTerm] = []
    for group in _groups(placed):
        effect = _together([placed[k] for k in group], n_joints)
        coefficients = np.zeros((n_joints, effect.n_columns))
        for k in group:
            coefficients[placed[k].joints[0]] = held[k].coefficients
        terms.append((effect, coefficients))
    return terms


def effects_of(placed: Sequence[PlacedEffect], n_joints: int) -> list[tuple[_core.Effect, tuple[int, ...]]]:
    """Effects of the core and the joints that each acts on.

    Places of one kind share an effect as long as they lie on different joints, so a model has few terms.
    """
    groups = _groups(placed)
    together = [[placed[k] for k in group] for group in groups]
    acting = [tuple(sorted(j for e in group for j in e.acting)) for group in together]
    return [(_together(group, n_joints), joints) for group, joints in zip(together, acting, strict=True)]


def own_columns(placed: Sequence[PlacedEffect], first: int) -> list[list[tuple[int, int]]]:
    """Joint and own column of every coefficient of every placed effect, `first` the first column of `effects_of`."""
    columns: list[list[tuple[int, int]]] = [[] for _ in placed]
    for group in _groups(placed):
        width = len(CATALOGUE[placed[group[0]].kind]["coefficients"])
        for k in group:
            columns[k] = [(j, first + c) for j in placed[k].joints for c in range(width)]
        first += width
    return columns


def _groups(placed: Sequence[PlacedEffect]) -> list[list[int]]:
    """Indices of places that share an effect."""
    groups: list[list[int]] = []
    for k, effect in enumerate(placed):
        for group in groups:
            taken = {j for other in group for j in placed[other].joints}
            if placed[group[0]].kind == effect.kind and not taken & set(effect.joints):
                group.append(k)
                break
        else:
            groups.append([k])
    return groups


def _together(group: Sequence[PlacedEffect], n_joints: int) -> _core.Effect:
    """One effect; joints where it does not act get a valid shape that means nothing."""
    shape: dict[str, np.ndarray] = {}
    for parameter in CATALOGUE[group[0].kind]["shape"]:
        name = parameter["name"]
        idle = -1.0 if name == "partner" else dict(group[0].shape)[name][0]
        values = np.full(n_joints, idle)
        for effect in group:
            values[list(effect.joints)] = dict(effect.shape)[name]
        shape[name] = values
    if any(set(ANYWHERE) & {name for name, _ in effect.shape} for effect in group):
        for name, idle in ANYWHERE.items():
            shape[name] = np.full(n_joints, idle)
            for effect in group:
                shape[name][list(effect.joints)] = dict(effect.shape).get(name, (idle,))
    return _core.Effect.of(group[0].kind, **shape)
