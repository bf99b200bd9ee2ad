"""Which law of friction a fit has where none is asked for, and what contradicts it."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from helpers.diagnosed import ROBOT, measured

from dynid_rs import LinkDynamicsIdentifier, ThreeLoopIdentifier
from dynid_rs.identification.friction import FrictionIdentifier
from dynid_rs.identification.smooth_friction import SmoothFrictionIdentifier
from dynid_rs.model.physical import coulomb_viscous
from dynid_rs.sensors import contacts_beside


def law_of(**options):
    fit = ThreeLoopIdentifier(ROBOT, residual=None, **options).fit(measured(n_runs=1, duration=8.0))
    effect, _ = fit.observations_.plan.friction
    return effect.kind, fit


@pytest.mark.parametrize(
    ("options", "kind"),
    [
        ({}, "smooth_friction"),
        ({"links": LinkDynamicsIdentifier(prior="robot")}, "smooth_friction"),
        ({"links": LinkDynamicsIdentifier(prior=None)}, "friction"),
        ({"links": LinkDynamicsIdentifier(None)}, "friction"),
        ({"links": LinkDynamicsIdentifier(ridge=1e-6)}, "friction"),
        ({"friction": FrictionIdentifier()}, "friction"),
        ({"friction": SmoothFrictionIdentifier()}, "smooth_friction"),
        ({"friction_law": "paper"}, "friction"),
    ],
)
def test_the_law_where_none_is_asked_for(options, kind):
    assert law_of(**options)[0] == kind


def test_with_a_friction_experiment_it_is_the_paper_s():
    laws = ThreeLoopIdentifier(ROBOT)._laws(with_pairs=True)
    assert set(laws) == {"paper"}
    given = ThreeLoopIdentifier(ROBOT, friction=SmoothFrictionIdentifier())._laws(with_pairs=True)
    assert set(given) == {"smooth"}


@pytest.mark.parametrize(
    ("friction", "law"),
    [(FrictionIdentifier(), "smooth"), (SmoothFrictionIdentifier(), "paper"), (SmoothFrictionIdentifier(), "stribeck")],
)
def test_a_search_of_another_law_s_shapes_is_refused(friction, law):
    with pytest.raises(ValueError, match="does not search shapes of friction_law"):
        law_of(friction=friction, friction_law=law)


def test_exported_friction_holds_what_remembers_a_short_way():
    """Backwards and forwards at speed, its sign has turned round, as friction's has."""
    _, fit = law_of()
    names = [name for effect in fit.observations_.plan.effects for name in effect.coefficient_names]
    own = fit.links_.own_
    level = own[:, names.index("hysteresis")] + own[:, names.index("coulomb")]
    viscous, coulomb = coulomb_viscous(fit.model_)
    assert np.all(np.abs(own[:, names.index("hysteresis")]) > 1e-6)
    at_speed = own[:, names.index("viscous")] * np.asarray(fit.model_.domain[1]) / 2
    told = coulomb + viscous * np.asarray(fit.model_.domain[1]) / 2
    np.testing.assert_allclose(told, level + at_speed, rtol=0.05)


def pushed(run, torque):
    """A run in which something pushes the elbow for half a second."""
    tau = run.tau.copy()
    tau[(run.t > 4.0) & (run.t < 4.5), 1] += torque
    return SimpleNamespace(run=type(run)(run.t, run.q, tau=tau, name="pushed", joints=run.joints)).run


def test_a_push_is_told_where_it_was_and_leaves_the_training_s_as_they_are():
    *train, test = measured(n_runs=3, duration=12.0)
    fit = ThreeLoopIdentifier(ROBOT, residual=None).fit(train)
    assert contacts_beside(fit, train, [test]) == []
    torque = 0.5 * float(np.std(test.tau[:, 1]))
    (found,) = contacts_beside(fit, train, [pushed(test, torque)])
    assert (found.code, found.file) == ("contact", "pushed")
