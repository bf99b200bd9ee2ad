"""The linear fits once more, on all runs: baseline, friction, both loops, all three, at the sample's shapes."""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.archive.reduction import Totals
from dynid_rs.identification.links import LinkDynamicsIdentifier, baseline, own_beside
from dynid_rs.model.assembly import Regressions, assemble, with_domain
from dynid_rs.regression.columns import Observations, Plan
from dynid_rs.regression.systems import residual_power
from dynid_rs.regression.uncertainty import covariance_of_products

if TYPE_CHECKING:
    from dynid_rs.identification.three_loops import ThreeLoopIdentifier

FloatArray = NDArray[np.float64]


class Settled:
    """Fits to all runs.

    Attributes
    ----------
    observations, links : Observations, LinkDynamicsIdentifier
        Of the model, less the third loop's torque.
    stages : list of TorqueModel
        Baseline, it with the first loop's friction, both loops, all three.
    covariance, gains_known : ndarray (n_columns, n_columns)
        Of all unknowns: columns of all runs, the noise's spectrum from the sample; the same at known gains. The first
        has the logarithms of fitted gains (n_joints,) last.
    rmse : ndarray (n_joints,)
        What the model leaves of all runs [torque unit].
    """

    def __init__(self, identifier: ThreeLoopIdentifier, totals: Totals) -> None:
        self._loops, self._totals = identifier.loops_, totals
        reduction, plans = totals.reduction, totals.reduction.plans
        simple, regroup = baseline(totals.observations("baseline"))
        first = LinkDynamicsIdentifier(prior=None).fit(simple, fit_scale=self._loops.data.in_ampere)
        self.observations = totals.observations("model")
        self.links = links = self._fit(identifier.links_, self.observations)
        two_loops, two_plan, kept = self.observations, plans["model"], None
        if reduction.third is not None:
            two_loops, two_plan, third = totals.observations("two_loops"), plans["two_loops"], reduction.third
            links = self._fit(self._loops.two_loops[1], two_loops)
            kept = (third.inputs_, third.mixtures_, third.compliance_)
        own, _ = own_beside(two_loops, first.phi_base_, first.torque_scale_)
        delay = reduction.encoder_delay
        self.stages = [
            self._model(plans["baseline"], first, first.own_ @ regroup.T, np.zeros_like(delay)),
            self._model(two_plan, first, own, delay),
            self._model(two_plan, links, links.own_, delay),
            self._model(plans["model"], self.links, self.links.own_, delay, kept),
        ]
        self.rmse = self._rmse()
        factors = [_core.triangular_factor(np.ascontiguousarray(joint[:, :-1])) for joint in totals.joints("model")]
        products = totals.noise_products()
        self.covariance, self.gains_known = (
            covariance_of_products(plans["model"], self.links, factors, products, noises=reduction.noise, gains=gains)
            for gains in (self._loops.gains, None)
        )

    def _fit(self, sample: LinkDynamicsIdentifier, observations: Observations) -> LinkDynamicsIdentifier:
        links = copy(sample)
        if links.posterior_ is not None:
            # How much a row counts shows in their order, which factors have lost: the sample's holds for all.
            links.posterior_ = replace(links.posterior_, n_effective=links.worth_ * observations.n_counted)
        return links.fit(
            observations,
            fit_scale=self._loops.data.in_ampere,
            free_gains=self._loops.free_gains,
            beside=self._loops.beside(),
            again=True,
        )

    def _model(
        self,
        plan: Plan,
        links: LinkDynamicsIdentifier,
        own: FloatArray,
        delay: FloatArray,
        third_loop: tuple[str, Regressions, FloatArray] | None = None,
    ) -> _core.TorqueModel:
        data = self._loops.data
        model = assemble(
            plan,
            links,
            own,
            data.runs,
            encoder_delay=delay,
            encoder_error=self._loops.encoder_error,
            torque_delay=data.torque_delay,
            torque_unit=data.torque_unit,
            band=(data.band.cutoff, data.rate, data.standstill),
            third_loop=third_loop,
            known=data.known,
        )
        return with_domain(model, self._totals.domain)

    def _rmse(self) -> FloatArray:
        plan, observations, links = self.observations.plan, self.observations, self.links
        power = residual_power(plan, observations.factors(), links.x_, links.torque_scale_)
        error: FloatArray = np.sqrt(power / np.maximum(observations.n_counted, 1))
        return error


def settled(identifier: ThreeLoopIdentifier, totals: Totals) -> tuple[ThreeLoopIdentifier, FloatArray]:
    """Copy of an identifier that has run over a sample, its linear fits taken over from all runs; and its error."""
    fit, whole = Settled(identifier, totals), copy(identifier)
    whole.observations_, whole.links_ = fit.observations, fit.links
    whole.baseline_, whole.friction_model_, whole.two_loop_model_, whole.model_ = fit.stages
    whole.take_covariance(fit.covariance, fit.gains_known)
    return whole, fit.rmse
