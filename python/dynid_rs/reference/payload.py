"""A payload that a body can have: positive mass, pseudo-inertia positive definite."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.base.errors import MissingLibraryError
from dynid_rs.base.findings import Finding
from dynid_rs.model.bodies import UNKNOWN_RADIUS, Bodies, Program, Terms
from dynid_rs.reference.changes import Believed
from dynid_rs.reference.weighing import Weighing

FloatArray = NDArray[np.float64]

PULL = 1e-6
"""Weight of the body that stands for "as far as known", in rows: it decides only what no torque shows."""
MARGIN = 1e-4
"""Least eigenvalue of the pseudo-inertia over that body's."""
UNSEEN = 1e-8
"""Eigenvalue of the payload's normal matrix over the largest below which a direction is not seen at all..."""
ROUNDING = 1e-12
"""...and size of a parameter's column over the largest below which it is rounding."""
LEAST_SLOPE = 1e-6
"""Slopes along a hidden direction below this over the largest are rounding."""


def physical_payload(
    believed: Believed,
    weighing: Weighing,
    places: NDArray[np.intp],
    free: NDArray[np.intp],
    held: NDArray[np.intp],
) -> tuple[Believed, list[Finding]]:
    """Return what is believed with the nearest payload to the torque that is a body, and what there is to say.

    A payload of negative mass is one that the reference had and that was taken off: then its opposite is a body.

    Parameters
    ----------
    weighing : Weighing
        Linearised about `believed`.
    places : ndarray (10,)
        Of the payload's columns.
    free, held : ndarray
        Places of all that was fitted beside it, without and with a prior.
    """
    findings: list[Finding] = []
    payload = believed.payload
    sign = 1.0 if payload[0] >= 0 else -1.0
    if believed.reference.torque_unit == "A":
        findings.append(
            Finding(
                "payload_in_ampere",
                "info",
                "the torque is in ampere, so the payload's mass is known up to the drive gains; give them for kg",
            )
        )
    if np.linalg.eigvalsh(_core.pseudo_inertia(sign * payload)[0])[0] > 0:
        return believed, findings
    try:
        nearest = sign * _nearest(sign * payload, weighing, places, free, held)
    except (MissingLibraryError, ValueError) as error:
        message = (
            f"no body has the payload's ten parameters as they were estimated, and none nearby was found ({error})"
        )
        return believed, [*findings, Finding("payload_not_physical", "warning", message)]
    return replace(believed, payload=nearest), findings


def hidden_directions(
    weighing: Weighing, places: NDArray[np.intp], free: NDArray[np.intp], held: NDArray[np.intp]
) -> FloatArray:
    """Changes (10, k) of a payload's parameters of which the torque says nothing."""
    values, vectors, scale = _seen_directions(weighing, places, free, held)
    hidden: FloatArray = vectors[:, values <= UNSEEN * values[-1]] / scale[:, None]
    return hidden


def moved(slopes: FloatArray, hidden: FloatArray) -> NDArray[np.bool_]:
    """Quantities (n,) with `slopes` (n, 10) by the parameters that change along `hidden` directions (10, k)."""
    if not hidden.shape[1]:
        return np.zeros(len(slopes), dtype=bool)
    largest = np.outer(np.abs(slopes).max(axis=1), np.abs(hidden).max(axis=0))
    change: NDArray[np.bool_] = np.any(np.abs(slopes @ hidden) > LEAST_SLOPE * largest, axis=1)
    return change


def _seen_directions(
    weighing: Weighing, places: NDArray[np.intp], free: NDArray[np.intp], held: NDArray[np.intp]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """What the torque says of a payload beside all else: eigenvalues (10,), eigenvectors (10, 10) and scale (10,).

    Of the payload's normal matrix, everything else eliminated, each parameter over `scale`.
    """
    beside = np.concatenate([np.setdiff1d(free, places), held]).astype(np.intp)
    gram = weighing.gram(np.concatenate([places, beside]))
    prior = np.where(np.isin(beside, held), weighing.precision[beside], weighing.weak[beside])
    gram[range(10, len(gram)), range(10, len(gram))] += prior
    own = gram[:10, :10]
    if len(beside):
        own = own - gram[:10, 10:] @ np.linalg.pinv(gram[10:, 10:], hermitian=True) @ gram[10:, :10]
    size = np.sqrt(np.maximum(np.diag(own), 0.0))
    shown = size > ROUNDING * size.max()
    # Of the others' order, also where there is nothing: what is hidden would else be that parameter alone.
    scale = np.where(shown, size, max(float(size.max()), 1e-300))
    values, vectors = np.linalg.eigh(np.where(np.outer(shown, shown), own, 0.0) / np.outer(scale, scale))
    return values, vectors, scale


def _nearest(
    payload: FloatArray,
    weighing: Weighing,
    places: NDArray[np.intp],
    free: NDArray[np.intp],
    held: NDArray[np.intp],
) -> FloatArray:
    """Body (10,) whose torque is nearest to the estimate's, everything else fitted beside it."""
    # With less its centre would lie further than a metre away, where no tool ends.
    mass = max(float(payload[0]), float(np.abs(payload[1:4]).max()), 1e-3)
    root = np.sqrt(mass) * np.diag([UNKNOWN_RADIUS, UNKNOWN_RADIUS, UNKNOWN_RADIUS, 1.0])
    root[:3, 3] = np.sqrt(mass) * payload[1:4] / mass
    values, vectors, scale = _seen_directions(weighing, places, free, held)
    matrix = np.zeros((10, 11))
    matrix[:, :10] = (np.sqrt(np.maximum(values, 0.0)) * vectors).T * scale
    terms = Terms(matrix, matrix[:, :10] @ payload, np.zeros(1), np.ones(1))
    bodies = Bodies(root[None], np.array([mass]), np.zeros(1, dtype=bool))
    return Program(terms, bodies, margin=MARGIN, mass_range=(0.0, np.inf)).solve(PULL)[0]
