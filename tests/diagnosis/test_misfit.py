"""Names that do not hold: ripple that was not seen to return."""

from types import SimpleNamespace

import pytest

from dynid_rs.diagnosis import misfit
from dynid_rs.diagnosis.waves import of_signal
from dynid_rs.model.placed import PlacedEffect


@pytest.mark.parametrize(("times", "nameless"), [(1.9, True), (2.1, False)])
def test_ripple_has_to_go_round_twice(monkeypatch, times, nameless):
    """Before that any curve is one, and so is what else of the angle has a name on the joint; not what has memory."""
    monkeypatch.setattr(misfit, "waves", lambda *_, **__: None)
    monkeypatch.setattr(misfit, "_likeliest", lambda *_: None)
    ripple = PlacedEffect.at("torque_ripple", 1, cycles=7.0)
    spring = PlacedEffect.at("joint_spring", 1)
    elsewhere = PlacedEffect.at("joint_spring", 0)
    bristles = PlacedEffect.at("friction_hysteresis", 1, presliding_distance=0.01)
    effects = (ripple, spring, elsewhere, bristles)
    belief = SimpleNamespace(
        beside=None,
        setup=SimpleNamespace(effects=effects, robot=SimpleNamespace(n_joints=2)),
        catalogue=SimpleNamespace(times_round=lambda s: times if s.kind == "torque_ripple" else float("inf")),
    )
    contest = SimpleNamespace(beside=None, own=SimpleNamespace(value=100.0))
    found = misfit.nameless(belief, {(e.kind, e.joints): contest for e in effects})
    angle = of_signal(("q", 1))
    assert found == ({("torque_ripple", (1,)): angle, ("joint_spring", (1,)): angle} if nameless else {})
