"""A fit as a linear model that hypotheses stand beside, at the priors that its data may prefer with them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.base.memory import residual_memory, returning
from dynid_rs.diagnosis.hypotheses import Hypothesis
from dynid_rs.diagnosis.shaped import Place
from dynid_rs.diagnosis.structural.about import About
from dynid_rs.identification.loads import link_load, load_rows
from dynid_rs.identification.smooth_friction import shape_slopes, tanh_widths
from dynid_rs.identification.three_loops import ThreeLoopIdentifier
from dynid_rs.regression.kept_columns import effect_rows
from dynid_rs.regression.linear_model import Columns, Fit, LinearModel, Score, fits, sign_cost
from dynid_rs.regression.priors import declares_inertia
from dynid_rs.regression.scales import SCALE_SPREAD
from dynid_rs.runs.preprocessing import States
from dynid_rs.runs.slope import slope

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

TRUSTING = ((0.3, 1.0), (1.0, 1.0))
"""Width and centre of priors under which the robot file is believed: what an effect is told from that base parameters
could imitate."""
SHAPE_SPREAD = 0.3
"""How far the logarithm of a shape of friction may be off where the fit has it."""


FAR = 20.0
"""Nats that the noise, estimated anew, does not make up for between two priors."""
FORGETS = 1.2
"""Factor by which samples have to be worth more with a hypothesis for both models to be fitted anew."""
WIDER = (0.7, 1.0, 1.4)
"""Widths of a tanh beside a fitted sign, over its own: between them and the fitted one lies any sign that is round."""
YIELDS = 1e-3
"""Usual yielding of a gear [rad]: three arc minutes under the load that it usually has."""
NEVER = 1e9
"""Velocity [rad/s] at which a Stribeck part falls that is a rounded sign alone."""


@dataclass(frozen=True, eq=False)
class Beside:
    """A model, and its fits at the priors in question; the first is the one that the data prefer without more."""

    model: LinearModel
    fits: tuple[Fit, ...]

    @staticmethod
    def of(fit: ThreeLoopIdentifier) -> Beside:
        """Model of a fit, the shapes of its friction and the gains that it estimated among the unknowns."""
        posterior, observations = fit.links_.posterior_, fit.observations_
        assert posterior is not None  # every fit that is diagnosed has the weak prior
        plan, n = observations.plan, fit.robot.n_joints
        model = posterior.model(plan, observations.joint_rows())
        load = load_rows(observations, fit.links_)
        further: list[Columns] = [
            {j: SCALE_SPREAD * load[j][:, None]} for j in np.flatnonzero(posterior.scale != 1.0).tolist()
        ]
        sooner = other_time(fit)
        for j in range(n):
            further.append({j: SHAPE_SPREAD * shape_slopes(plan, fit.links_, fit.runs_, j)})
            further.append({j: SHAPE_SPREAD * other_roundings(fit, j)})
            further.append({j: SHAPE_SPREAD * sooner[j]})
        between = between_encoders(fit)
        if between.size:
            further += [{j: float(np.sqrt(np.mean(model.rows[j][:, -1] ** 2))) * between} for j in range(n)]
        model = replace(model.beside(*further, *yielding(fit, About.of(fit))), phase=observations.phase)
        priors = [posterior.choice]
        if declares_inertia(fit.robot):
            trusting = [posterior.choice._replace(width=width, centre=centre) for width, centre in TRUSTING]
            priors += [prior for prior in trusting if prior not in priors]
        return Beside(model, tuple(fits([(model, prior, posterior.noise_std) for prior in priors])))

    @property
    def best(self) -> Fit:
        """The fit of the greatest evidence."""
        return max(self.fits, key=lambda fit: fit.evidence)

    def with_columns(self, columns: Columns) -> Beside:
        """Return the model with a hypothesis among its unknowns."""
        return self._over(self.model.beside(columns))

    def without(self, places: Sequence[tuple[int, int]]) -> Beside:
        """Return the model without columns, named by joint and place among all unknowns."""
        return self._over(self.model.without(places))

    def _over(self, model: LinearModel) -> Beside:
        return replace(self, model=model, fits=tuple(self._again(model)))

    def _again(self, model: LinearModel) -> list[Fit]:
        """Fits of another model at these priors, from the noise that each of them has here."""
        return fits([(model, fit.choice, fit.noise) for fit in self.fits])

    def screened(self, hypotheses: Sequence[Hypothesis]) -> list[Score]:
        """Scores to second order, at the prior that suits a hypothesis best, evidence of that prior included."""
        return self._best_of(_screened(self.model, self.fits, hypotheses))

    def hoped_for(self, hypotheses: Sequence[Hypothesis]) -> list[float]:
        """Scores to second order as if every row said something new, which it may beside what is not yet in the model.

        A large effect that is missing remembers itself, and by its memory the rows are worth too little to show it.
        """
        return [score.value for score in _screened(self.model, [self._hopeful], hypotheses)[0]]

    def screened_and_hoped_for(self, hypotheses: Sequence[Hypothesis]) -> tuple[list[Score], list[float]]:
        """Return `screened` and `hoped_for`: the rows are the same, and so are the products with them."""
        *per_fit, hopeful = _screened(self.model, [*self.fits, self._hopeful], hypotheses)
        return self._best_of(per_fit), [score.value for score in hopeful]

    def _best_of(self, per_fit: Sequence[Sequence[Score]]) -> list[Score]:
        """Of scores beside every fit, those at the prior that suits a hypothesis best."""
        best = self.best.evidence
        weighed = [
            [Score(s.value + fit.evidence - best, s.size) for s in scores]
            for fit, scores in zip(self.fits, per_fit, strict=True)
        ]
        return [max(scores, key=lambda score: score.value) for scores in zip(*weighed, strict=True)]

    @cached_property
    def _hopeful(self) -> Fit:
        """The fit with independent rows, at the most probable prior."""
        model = replace(self.model, n_effective=np.array([moves.sum() for moves in self.model.counted], dtype=float))
        return model.fit(self.best.choice, self.best.noise)

    def evidence_for(self, hypothesis: Hypothesis) -> tuple[float, Columns]:
        """Logarithm of the Bayes factor with the noise estimated anew, and the columns in their likeliest size.

        Both models count their samples by the memory of what the hypothesis leaves: noise is what the better model
        leaves, and a large effect that is not yet in one remembers itself.
        """
        h, sizes = hypothesis, hypothesis.sizes
        scores = [score for (score,) in self.model.screen_beside(self.fits, [h.columns], [h.bounds], sizes)]
        expected = [score.value + fit.evidence for score, fit in zip(scores, self.fits, strict=True)]
        size = scores[int(np.argmax(expected))].size
        columns = {j: size * part for j, part in hypothesis.columns.items()}
        model = self.model.beside(columns)
        near = [fit for fit, value in zip(self.fits, expected, strict=True) if value > max(expected) - FAR]
        best = max(fits([(model, fit.choice, fit.noise) for fit in near]), key=lambda fit: fit.evidence)
        without = self.best
        worth = model.n_effective.copy()
        for j in columns:
            counted, left = model.counted[j], best.left(j)
            own = counted.sum() / (residual_memory([left]) * returning(left[counted], model.phase[counted]))
            worth[j] = max(worth[j], own)
        if np.any(worth > FORGETS * model.n_effective):
            best = replace(model, n_effective=worth).fit(best.choice, best.noise)
            alone = replace(self.model, n_effective=worth)
            without = max(self._again(alone), key=lambda fit: fit.evidence)
        width = len(hypothesis.unit)
        x, std = best.x[-width:], np.sqrt(np.diag(best.covariance)[-width:])
        return best.evidence - without.evidence + float(sign_cost(x / std, hypothesis.bounds)), columns


def _screened(model: LinearModel, fits: Sequence[Fit], hypotheses: Sequence[Hypothesis]) -> list[list[Score]]:
    """Scores to second order beside each of several fits to the same rows."""
    columns, bounds = [h.columns for h in hypotheses], [h.bounds for h in hypotheses]
    return model.screen_beside(fits, columns, bounds, sorted({size for h in hypotheses for size in h.sizes}))


def places_of(hypotheses: Sequence[Hypothesis]) -> dict[Place, list[int]]:
    """Indices of the hypotheses at every place."""
    places: dict[Place, list[int]] = {}
    for k, h in enumerate(hypotheses):
        places.setdefault(h.place, []).append(k)
    return places


def other_roundings(fit: ThreeLoopIdentifier, j: int) -> FloatArray:
    """What joint j's Coulomb torque would be more with a tanh in the place of its own sign, (n_rows, k)."""
    friction, at = fit.observations_.plan.friction
    usual = tanh_widths(friction)
    coulomb = fit.links_.own_[j, at][0]
    n = fit.robot.n_joints
    own = _sign(fit.runs_, friction, j)
    columns = []
    for factor in WIDER:
        tanh = _core.Effect.of(
            "stribeck", stribeck_velocity=np.full(n, NEVER), exponent=np.ones(n), transition_width=factor * usual
        )
        columns.append(coulomb * (_sign(fit.runs_, tanh, j) - own))
    return np.stack(columns, axis=1)


def other_time(fit: ThreeLoopIdentifier) -> list[FloatArray]:
    """Change of every joint's friction if it turned round at another time, as large as that of another width.

    One column (n_rows, 1) per joint. A law that is not quite right turns round too soon or too late; no channel has
    another clock for that.
    """
    plan = fit.observations_.plan
    sooner, later = (
        [replace(s, dq_motor=s.dq_motor + samples / s.rate * s.ddq_motor) for s in fit.runs_] for samples in (0.5, -0.5)
    )
    columns = []
    for j in range(fit.robot.n_joints):
        turns = _sign(sooner, plan.friction[0], j) - _sign(later, plan.friction[0], j)
        width = shape_slopes(plan, fit.links_, fit.runs_, j)[:, 0]
        size = max(float(np.linalg.norm(turns)), 1e-300)
        columns.append(turns[:, None] * (float(np.linalg.norm(width)) / size))
    return columns


def between_encoders(fit: ThreeLoopIdentifier) -> FloatArray:
    """By how much two encoders show other accelerations, over those accelerations, (n_rows, n_joints or none).

    The steps of a coarse encoder are noise that links multiply with their inertia: whatever the finer one shows in the
    place of it explains that noise, and is no torque.
    """
    if not any(states.two_encoders for states in fit.runs_):
        return np.empty((0, 0))
    link, motor = (
        np.concatenate([states.in_band(getattr(states, name)) for states in fit.runs_]) for name in ("ddq", "ddq_motor")
    )
    size = np.sqrt(np.mean(link**2, axis=0))
    between: FloatArray = (motor - link)[:, size > 0] / size[size > 0]
    return between


def yielding(fit: ThreeLoopIdentifier, about: About) -> list[Columns]:
    """Change of all joints' torque if a gear yielded by `YIELDS` under its usual load, one column per joint.

    With one encoder, on the motor's side, a link is not where it is read to be but hangs behind by its load.
    """
    if any(states.two_encoders for states in fit.runs_):
        return []
    load = link_load(fit.observations_.plan, fit.links_)
    bent = [load(states) for states in fit.runs_]
    size = np.sqrt(np.mean(np.concatenate(bent) ** 2, axis=0))
    found = []
    for j in np.flatnonzero(size > 0).tolist():
        slopes = []
        for states, tau in zip(fit.runs_, bent, strict=True):
            behind = YIELDS * tau[:, j] / size[j]
            rate = slope(behind, states.rate)
            moved = behind, rate, slope(rate, states.rate)
            ends = []
            for sign in (-0.5, 0.5):
                motion = [x.copy() for x in (states.q, states.dq, states.ddq)]
                for x, change in zip(motion, moved, strict=True):
                    x[:, j] += sign * change
                q, dq, ddq = motion
                ends.append(fit.robot.inverse_dynamics(q, dq, ddq, about.phi))
            slopes.append((ends[0] - ends[1])[:, :, None])
        found.append(about.in_band(slopes))
    return found


def _sign(runs: Sequence[States], effect: _core.Effect, j: int) -> FloatArray:
    """Rounded sign of joint j's speed in the band, (n_rows,): a law's Coulomb columns taken together."""
    names = list(effect.coefficient_names)
    at = [k for k, name in enumerate(names) if name == "coulomb" or name.startswith(("coulomb_p", "coulomb_n", "stri"))]
    parts = []
    for states in runs:
        parts.append(effect_rows(effect, states, j)[:, at].sum(axis=1))
    return np.concatenate(parts)
