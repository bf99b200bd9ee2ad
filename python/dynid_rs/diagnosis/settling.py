"""Shapes of all effects and of friction settle together, once the names are there.

In turn they would stop in any narrow valley that no single one of them leads along.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dynid_rs.base.threads import side_by_side
from dynid_rs.diagnosis.belief import Belief
from dynid_rs.diagnosis.shaped import Shaped, is_valid, shaped_as
from dynid_rs.diagnosis.shapes import in_range, polished, searched
from dynid_rs.diagnosis.slopes import Slope, effect_slopes, friction_slopes, is_logarithmic
from dynid_rs.identification.smooth_friction import LARGEST_STEP, SPREAD_HERE, in_reach
from dynid_rs.model.placed import PlacedEffect

FloatArray = NDArray[np.float64]

MOST_STEPS = 6
"""Steps of all shapes together."""
SETTLED = 0.02
"""Step of a logarithm or of an angle at which shapes have settled."""


def settle(belief: Belief) -> None:
    """Every effect's shape beside all others, then steps of all shapes together towards likelier ones."""
    whole = belief.beside

    def likeliest(effect: PlacedEffect, places: list[tuple[int, int]]) -> PlacedEffect:
        now, beside = shaped_as(effect), whole.without(places)
        # Beside what was named later another shape of the grid may be the best.
        grid = [s for s in belief.catalogue.grid if (s.kind, s.joints) == (now.kind, now.joints)]
        shapes = belief.catalogue.of([now, *grid])
        best = int(np.argmax([score.value for score in beside.screened(shapes)]))
        h = polished(beside, belief.catalogue, shapes[best])
        return Shaped(h.kind, h.joints, h.shape).placed()

    each = list(zip(belief.setup.effects, belief.places(), strict=True))
    effects = side_by_side(lambda one: likeliest(*one), each)
    if tuple(effects) != belief.setup.effects:
        belief.reshape(effects)
    if not any(slope.effect for slope in effect_slopes(belief)):
        return
    alone = belief.kept
    belief.reshape(belief.setup.effects, (belief.fit.friction_.transition_width_, belief.fit.friction_.sharpness_))
    for _ in range(MOST_STEPS):
        slopes = [*effect_slopes(belief), *(s for s in friction_slopes(belief) if s.joint in belief.reached)]
        steps = _steps(belief, slopes)
        before = belief.kept
        while np.max(np.abs(steps)) > SETTLED:
            belief.reshape(*_moved(belief, slopes, steps))
            if belief.is_likelier_than(before):
                break
            belief.restore(before)
            steps /= 2
        else:
            break
    if not belief.is_likelier_than(alone):
        belief.restore(alone)


def _steps(belief: Belief, slopes: list[Slope]) -> FloatArray:
    """Gauss-Newton step of every shape, beside everything else that is fitted."""
    posterior, observations = belief.fit.links_.posterior_, belief.fit.observations_
    assert posterior is not None  # every fit that is diagnosed has the weak prior
    model = posterior.model(observations.plan, observations.joint_rows())
    model = model.beside(*({j: SPREAD_HERE * column for j, column in slope.columns.items()} for slope in slopes))
    x = model.fit(posterior.choice, posterior.noise_std).x[-len(slopes) :]
    return np.clip(SPREAD_HERE * x, -LARGEST_STEP, LARGEST_STEP)


def _moved(
    belief: Belief, slopes: list[Slope], steps: FloatArray
) -> tuple[list[PlacedEffect], tuple[FloatArray, FloatArray]]:
    """Effects and friction's shapes after the steps, those that lead out of what a shape may be left out."""
    effects = {effect: shaped_as(effect) for effect in belief.setup.effects}
    friction = belief.fit.friction_
    width, sharpness = friction.transition_width_.copy(), friction.sharpness_.copy()
    for slope, step in zip(slopes, steps.tolist(), strict=True):
        if slope.effect is None:
            (width if slope.name == "transition_width" else sharpness)[slope.joint] *= np.exp(step)
            continue
        old = effects[slope.effect]
        value = dict(old.shape)[slope.name]
        new = old.with_shape(
            slope.name, value * float(np.exp(step)) if is_logarithmic(old.kind, slope.name) else value + step
        )
        parameter = next(p for p in searched(new.kind) if p["name"] == slope.name)
        may_be = in_range(parameter, dict(new.shape)[slope.name]) and is_valid(new.kind, new.shape)
        if may_be and belief.catalogue.returns(new):
            effects[slope.effect] = new
    found = in_reach((width, sharpness), (friction.transition_width_, friction.sharpness_), belief.fit.runs_)
    return [shaped.placed() for shaped in effects.values()], found
