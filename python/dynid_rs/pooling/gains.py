"""Gains of one arm's torque channels: those that were fitted, and what a wrong one would do to all estimates."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dynid_rs.regression.systems import stack
from dynid_rs.regression.uncertainty import prior_rows

if TYPE_CHECKING:
    from dynid_rs.identification.three_loops import ThreeLoopIdentifier

FloatArray = NDArray[np.float64]


def log_gains(identifier: ThreeLoopIdentifier) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Logarithms of all joints' gains, and which of them were fitted, (n_joints,) each; none where all are given."""
    gains = identifier.loops_.gains
    if gains is None:
        return np.zeros(0), np.zeros(0, dtype=bool)
    return np.log(identifier.links_.torque_scale_), gains.joints


def gain_response(identifier: ThreeLoopIdentifier) -> FloatArray:
    """What the estimate does when one joint's torque channel shows more: (n_joints, p), per relative change.

    The fit solves ``H x = sum_j w_j^2 C_j' tau_j + P'b`` with ``H = sum_j w_j^2 C_j' C_j + P'P`` (P, b the prior's
    rows), a friction experiment's rows among the joints'. A channel that shows ``(1 + g) tau_j`` adds ``g r_j`` to x,
    ``r_j = H^-1 w_j^2 C_j' tau_j``, weights and prior held. The rows of all joints and the prior's part add up to x
    itself. Gains that were fitted are among the unknowns, their logarithms last: C_j holds the torque's change with
    them, P what is known of them, and of the unit of b.
    """
    links, observations, gains = identifier.links_, identifier.observations_, identifier.loops_.gains
    plan, factors, scale = observations.plan, observations.factors(), links.torque_scale_
    n = len(factors)
    groups = [(factors, links.weights_), *((beside.rows, np.ones(n)) for beside in links.beside_)]
    whose = np.concatenate([np.repeat(np.arange(n), [len(rows) for rows in group]) for group, _ in groups])
    system = np.concatenate([stack(plan, group, weights, scale) for group, weights in groups])
    columns, estimable = system[:, :-1], plan.estimable()
    prior = prior_rows(links, np.ones(len(estimable), dtype=bool), len(estimable), gains)
    if gains is not None:
        of_links = columns[:, : plan.n_base] @ links.phi_base_
        columns = np.column_stack([columns, np.where(whose == np.arange(n)[:, None], of_links, 0.0).T, 0.0 * of_links])
        estimable = np.concatenate([estimable, gains.joints, [gains.unit]])
    rows = np.concatenate([columns, prior])
    norms = np.linalg.norm(rows, axis=0)
    used = estimable & (norms > 0)
    rows = rows[:, used] / norms[used]
    inverse = np.linalg.pinv(rows.T @ rows, hermitian=True)
    response = np.zeros((n, len(estimable)))
    for j in range(n):
        own = whose == j
        response[j, used] = inverse @ (columns[own][:, used] / norms[used]).T @ system[own, -1] / norms[used]
    return response if gains is None else response[:, :-1]
