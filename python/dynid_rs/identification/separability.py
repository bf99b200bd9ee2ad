"""Whether this data can tell a known term from the parameters that are fitted beside it.

The term's torque t on its joint is laid beside all columns of the declared model. What the columns cannot imitate,
``t_rest = t - C x``, is all that speaks for the term. Its share of t's power, and the standard error of a factor in
front of t (the term as declared has the factor 1) that this leaves, are given for the data alone and under the prior,
where imitating t costs distance from the robot file. A term counts as separable if the factor's 95 % interval is
narrower than from 0 to 2: the data could tell the term as declared from none.

Errors on test runs are compared under three weights of the prior, because the evidence believes the model and loosens
the prior until base parameters imitate a missing term: with the term; without it under the *same* weight, which is how
wrong the model is without it; and without it under the weight that the evidence then finds, which is how well the base
parameters can imitate it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.base.findings import Finding, Severity
from dynid_rs.base.memory import column_memory, inflation
from dynid_rs.base.units import torque_of
from dynid_rs.identification.links import LinkDynamicsIdentifier
from dynid_rs.model.assembly import assemble, evaluate
from dynid_rs.model.known import KnownTerm, known_torque
from dynid_rs.regression.columns import Block, Observations
from dynid_rs.regression.evaluation import band_rmse, compare
from dynid_rs.regression.evidence import Posterior, fit_with_prior
from dynid_rs.regression.priors import declares_inertia
from dynid_rs.regression.systems import block_residuals, solve, stack
from dynid_rs.regression.uncertainty import NORMAL_95
from dynid_rs.runs.preprocessing import States

if TYPE_CHECKING:
    from dynid_rs.identification.three_loops import ThreeLoopIdentifier

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Separation:
    """What speaks for one term: share of its power that nothing imitates, standard error of its factor."""

    share: float
    std_error: float

    @property
    def separable(self) -> bool:
        """The data could tell the term as declared from none."""
        return NORMAL_95 * self.std_error < 1

    def to_json(self) -> dict[str, Any]:
        """Fields for `result.json`."""
        return {"share": self.share, "std_error": min(self.std_error, 1e300), "separable": self.separable}


def examine(identifier: ThreeLoopIdentifier, test: Sequence[States]) -> list[dict[str, Any]]:
    """Entries of `result.json` for every known term and joint; `test` are states as recorded."""
    entries = []
    for effect, coefficients in identifier.known_:
        for j in np.flatnonzero(np.any(coefficients != 0, axis=1)):
            alone = np.zeros_like(coefficients)
            alone[j] = coefficients[j]
            entries.append(_examine(identifier, (effect, alone), int(j), test))
    return entries


def _examine(identifier: ThreeLoopIdentifier, term: KnownTerm, j: int, test: Sequence[States]) -> dict[str, Any]:
    effect, coefficients = term
    observations = identifier.in_memory_.observations
    torque = [states.in_band(known_torque([term], states)) for states in identifier.runs_]
    only = _with_torque(observations, torque)
    measured = observations.by_run([np.stack([r[:, -1] for r in b.rows], axis=1) for b in observations.blocks])
    without = _with_torque(observations, [tau + t for tau, t in zip(measured, torque, strict=True)])
    known_without = [(e, c - coefficients if e is effect else c) for e, c in identifier.known_]

    residual, compliance = identifier.model_.residual, identifier.model_.compliance
    third_loop = None if residual is None or compliance is None else (*residual, compliance)

    def error(links: LinkDynamicsIdentifier, known: Sequence[KnownTerm]) -> float:
        model = assemble(
            observations.plan,
            links,
            links.own_,
            identifier.raw_runs_,
            encoder_delay=np.asarray(identifier.model_.encoder_delay),
            encoder_error=identifier.model_.encoder_error,
            torque_delay=identifier.model_.torque_delay,
            torque_unit=identifier.torque_unit_,
            third_loop=third_loop,
            residual_signals=identifier.model_.residual_signals,
            known=known,
        )
        return float(band_rmse([compare(states, evaluate(model, states)[0]) for states in test])[j])

    data = LinkDynamicsIdentifier(prior=None)
    with_it, without_it = data.fit(observations), LinkDynamicsIdentifier(prior=None).fit(without)
    entry: dict[str, Any] = {
        "kind": effect.kind,
        "joint": identifier.robot.joint_names[j],
        "shape": {name: values[j] for name, values in effect.shape},
        "coefficients": dict(zip(effect.coefficient_names, coefficients[j], strict=True)),
        "unit": torque_of(identifier.torque_unit_, identifier.robot.joint_kinds[j]),
        "torque_rms": float(np.sqrt(np.mean(np.concatenate(torque)[:, j] ** 2))),
        "data_alone": separation(only, observations, with_it, j).to_json(),
        "rmse_test_alone": {"with": error(with_it, identifier.known_), "without": error(without_it, known_without)},
    }
    if declares_inertia(identifier.robot):
        posterior = identifier.links_.posterior_ or fit_with_prior(observations)
        same, own = fit_with_prior(without, held=posterior), fit_with_prior(without)

        def links(fitted: Observations, under: Posterior) -> LinkDynamicsIdentifier:
            return LinkDynamicsIdentifier(prior="robot").use_posterior(fitted, under)

        entry["with_prior"] = separation(only, observations, links(observations, posterior), j).to_json()
        entry["rmse_test_with_prior"] = {
            "with": error(links(observations, posterior), identifier.known_),
            "without_same_weight": error(links(without, same), known_without),
            "without": error(links(without, own), known_without),
        }
        entry["relative_uncertainty"] = {
            "with": posterior.relative_uncertainty,
            "without_same_weight": same.relative_uncertainty,
            "without": own.relative_uncertainty,
        }
    return entry


def separation(only: Observations, observations: Observations, links: LinkDynamicsIdentifier, j: int) -> Separation:
    """How well joint j's term is told from the columns.

    Parameters
    ----------
    only : Observations
        The term's torque in place of the measured one.
    observations : Observations
        The measured torque less the term's.
    links : LinkDynamicsIdentifier
        Fitted to `observations`: noise, and prior if it has one.
    """
    plan, n = observations.plan, observations.plan.robot.n_joints
    weights, scale = links.weights_, links.torque_scale_
    system = stack(plan, only.factors(), weights, scale)
    pull = np.zeros((0, system.shape[1])) if links.posterior_ is None else links.posterior_.pull.copy()
    pull[:, -1] = 0.0
    x = solve(plan, np.concatenate([system, pull]), (0.0,))[0]
    rest = only.by_run(block_residuals(only, x, scale))
    noise = observations.by_run(block_residuals(observations, links.x_, scale))
    power = np.array([sum(float(run[:, i] @ run[:, i]) for run in rest) for i in range(n)])
    blown_up = [
        inflation([run[:, i] for run in noise], column_memory([run[:, i : i + 1] for run in rest])) for i in range(n)
    ]
    distance = float(np.sum((pull[:, :-1] @ x) ** 2))
    left = float(weights**2 @ power) + distance
    whole = weights[j] ** 2 * float(np.sum(only.factors()[j][:, -1] ** 2))
    variance = float(weights**4 * links.noise_std_**2 * power @ np.array(blown_up)) + distance
    return Separation(left / whole, float(np.sqrt(variance)) / left if left > 0 else np.inf)


def sentence(entry: dict[str, Any], prior_used: bool) -> str | None:
    """What the user has to know of a term that the data alone cannot tell from the parameters; None if it can."""
    alone, under = entry["data_alone"], entry.get("with_prior")
    if alone["separable"]:
        return None
    name = f"the {entry['kind'].replace('_', ' ')} of {entry['joint']}"
    text = (
        f"this data cannot separate {name} from the base parameters and friction: they imitate all of it but "
        f"{alone['share']:.1g} of its power, so its size would have a standard error of {_percent(alone)}"
    )
    if prior_used:
        end = f" (with the prior {_percent(under)})" if under else ""
        return f"without the prior, {text}{end}"
    if under and under["separable"]:
        return f"{text}; the robot file's inertials as a prior would leave {_percent(under)}: --prior robot"
    return f"{text}; a motion that takes the joint further would tell more"


def not_separable(entries: Sequence[dict[str, Any]], *, prior_used: bool) -> list[Finding]:
    """Findings on the terms that the data alone cannot tell from the parameters."""
    findings = []
    for entry in entries:
        message = sentence(entry, prior_used)
        if message is not None:
            under = entry.get("with_prior")  # none where the robot file says nothing of the links
            severity: Severity = "info" if prior_used and under and under["separable"] else "warning"
            findings.append(Finding("not_separable", severity, message))
    return findings


def _percent(separation: dict[str, Any]) -> str:
    return f"{100 * separation['std_error']:.3g} %"


def _with_torque(observations: Observations, torque: Sequence[FloatArray]) -> Observations:
    """Return the same columns with another torque, (n_rows, n_joints) per run; one block per run."""
    rows = observations.rows_with(torque)
    blocks = [Block(k, joints, [_core.triangular_factor(x) for x in joints]) for k, joints in enumerate(rows)]
    return Observations(observations.plan, blocks, observations.runs)
