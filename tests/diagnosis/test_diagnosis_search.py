"""The search on arms whose truth is known: nothing where nothing is, names and numbers where something is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.binaries import find_estimator
from helpers.diagnosed import (
    ROBOT,
    SIX_AXES,
    entry_of,
    errors,
    found_in,
    holds,
    measured,
    names,
    recorded,
    rigid,
    truth_of,
    with_effects,
)
from helpers.nameless import Nameless
from helpers.online_answers import assert_same_answers
from helpers.run_files import write
from helpers.small_arm import JOINTS, dynid

from dynid_rs import _core
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.identification.results import score
from dynid_rs.simulation import equip
from dynid_rs.simulation.folder import run_columns

TRUTH = ("friction_hysteresis:elbow:2", "load_dependent_friction:wrist:2")
WARM_RUN = {"duration": 90.0, "rate": 40.0, "n_runs": 2}
"""As long as a warm-up."""
EXPLAINED = 0.85
"""Part of the error's power above a clean arm's that a name has to take off a run that nothing has touched."""
NEAR = 1.5
"""Error over that of a clean arm that counts as near it: a run of 12 s scatters by a tenth."""
ARCTAN_WIDTH = 0.03
"""Speed [rad/s] at which friction has half of its size; a tanh or a root of any sharpness turns round otherwise."""


@pytest.fixture(scope="module")
def noise():
    """What the declared model leaves of a run of the clean arm, (n_joints,)."""
    runs = measured()
    fit = Setup(ROBOT).identifier(residual=None).fit(runs[:2])
    return score(fit.model_, [fit.states(runs[2])]).rmse


@pytest.fixture(scope="module")
def mixed():
    return measured(*TRUTH, n_runs=4)


@pytest.fixture(scope="module")
def found(mixed):
    return found_in(mixed)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_clean_arm_gives_nothing(seed):
    runs = measured(seed=seed)
    found = found_in(runs)
    assert found.entries == []
    assert found.left == []
    assert found.steps == []
    before, after = errors(found, runs[2:])
    np.testing.assert_array_equal(before, after)


def test_friction_that_turns_round_like_an_arctan_is_no_effect():
    arm = replace(rigid(), friction=np.zeros_like(rigid().friction))
    size, viscous = 0.04 * np.array([80.0, 60.0, 25.0]), np.array([2.0, 1.5, 0.5])

    def torque(joint):
        def arctan(signals):
            dq = signals.dq[:, joint]
            return size[joint] * 2 / np.pi * np.arctan(dq / ARCTAN_WIDTH) + viscous[joint] * dq

        return arctan

    effects = [Nameless("nameless", (j,), 1.0, torque=torque(j)) for j in range(3)]
    found = found_in(recorded(equip(arm, effects)))
    assert found.entries == []


@pytest.mark.parametrize(
    ("wish", "joints", "unlike"),
    [
        ("stribeck:elbow", ("elbow",), ("transition_width",)),
        ("load_dependent_friction:wrist", ("wrist",), ("transition_width",)),
        ("bearing_friction:shoulder:2", ("shoulder",), ("transition_width",)),
        ("friction_hysteresis:elbow", ("elbow",), ()),
        ("load_hysteresis:elbow:2", ("elbow",), ()),
        ("joint_spring:elbow:2", ("elbow",), ("rest_position",)),
        ("counterbalance:elbow:2", ("elbow",), ("a",)),
        ("torque_gain:elbow:3", ("elbow",), ()),
        ("torque_delay::2", JOINTS, ()),
        ("gravity_tilt::2", JOINTS, ()),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_one_effect_is_found_by_name_and_place_and_its_numbers_hold_the_truth(wish, joints, unlike, noise):
    kind = wish.split(":")[0]
    arm = with_effects(rigid(), wish)
    runs = recorded(arm)
    found = found_in(runs)
    assert names(found) == {(kind, joints)}
    assert holds(entry_of(found, kind), truth_of(arm, kind, unlike)) == []
    before, after = errors(found, runs[2:])
    assert np.sum(before**2 - after**2) > EXPLAINED * np.sum(before**2 - noise**2)
    assert np.any(before > 1.5 * after)


@pytest.mark.parametrize("wish", ["encoder_eccentricity:1:4", "kinematic_error:2:2"])
def test_what_needs_six_axes_to_be_seen(wish):
    kind, joint, _ = wish.split(":")
    arm = with_effects(rigid(SIX_AXES), wish)
    runs = recorded(arm, duration=25.0, rate=100.0)
    found = found_in(runs, SIX_AXES)
    assert names(found) == {(kind, (SIX_AXES.joint_names[int(joint)],))}
    (effect,) = arm.effects
    if kind == "kinematic_error":
        truth = dict(zip(("x", "y", "z", "rx", "ry", "rz"), (*effect.offset, *effect.turn), strict=True))
    else:
        size, phase = effect.amplitude[int(joint)], effect.phase[int(joint)]
        truth = {"cosine": size * np.sin(phase), "sine": size * np.cos(phase)}
    assert holds(entry_of(found, kind), truth) == []


def test_friction_that_falls_while_a_run_goes_on():
    arm = with_effects(rigid(), "thermal_friction:elbow:2")
    found = found_in(recorded(arm, **WARM_RUN))
    assert names(found) == {("thermal_friction", ("elbow",))}
    truth = truth_of(arm, "thermal_friction", ("reference_speed", "transition_width"))
    assert holds(entry_of(found, "thermal_friction"), truth) == []


def test_friction_that_follows_the_thermometer():
    found = found_in(measured("thermal_drift", duration=40.0, rate=50.0))
    assert {kind for kind, _ in names(found)} == {"temperature_friction"}


def test_two_effects_are_found_and_the_error_is_near_the_noise(mixed, found, noise):
    assert names(found) == {("friction_hysteresis", ("elbow",)), ("load_dependent_friction", ("wrist",))}
    before, after = errors(found, mixed[3:])
    assert np.all(after < NEAR * noise)
    for entry in found.entries:
        at = JOINTS.index(entry["joints"][0])
        assert entry["rmse_test_after"][at] < NEAR * noise[at] < entry["rmse_test_before"][at]
        assert entry["p_value"] < 0.05
        for parameter in entry["parameters"]:
            low, high = parameter["interval"]
            assert low < parameter["value"] < high
        plot, change = entry["plot"], entry["rmse_test_change_interval"][at]
        assert len(plot["x"]) == len(plot["partial"])
        assert plot["quantity"] == "friction_torque"
        assert np.corrcoef(plot["mean"], plot["curve"])[0, 1] > 0.95
        assert np.all(np.array(plot["curve_low"]) <= plot["curve_high"])
        assert change is None or change[1] < 0
    assert np.any(before > 5 * noise)


def training_side(entry):
    return {key: value for key, value in entry.items() if not key.startswith("rmse_test")}


def file_of(model, folder):
    model.save(folder / "model.json")
    return (folder / "model.json").read_bytes()


def test_what_has_no_name_weighs_and_turns_round_as_it_was_declared(found):
    before, after = found.before, found.after
    nameless = [j for j, joint in enumerate(JOINTS) if all(joint not in places for _, places in names(found))]
    assert nameless == [0]
    for shape in ("transition_width_", "sharpness_"):
        was, now = (getattr(fit.friction_, shape) for fit in (before, after))
        np.testing.assert_array_equal(now[nameless], was[nameless])
        assert np.all(now[1:] != was[1:])


def test_a_test_run_touches_nothing(tmp_path, mixed, found):
    """A test run that goes another way: the same model to the bit, the same names, the same errors in training."""
    foreign = replace(mixed[3], q=mixed[3].q[::-1].copy(), tau=1.1 * mixed[3].tau[::-1] + 1.0)
    again = found_in([*mixed[:3], foreign])
    assert file_of(again.after.model_, tmp_path) == file_of(found.after.model_, tmp_path)
    assert file_of(again.before.model_, tmp_path) == file_of(found.before.model_, tmp_path)
    assert again.steps == found.steps
    assert again.left == found.left
    assert [training_side(entry) for entry in again.entries] == [training_side(entry) for entry in found.entries]
    assert again.entries[0]["rmse_test_after"] != found.entries[0]["rmse_test_after"]


def test_names_do_not_depend_on_the_order_of_the_runs(mixed, found):
    other = found_in([*mixed[2::-1], mixed[3]])
    assert names(other) == names(found)
    for entry in found.entries:
        values, others = (
            {p["name"]: p["value"] for p in e["parameters"]} for e in (entry, entry_of(other, entry["kind"]))
        )
        for parameter in entry["parameters"]:
            low, high = parameter["interval"]
            assert abs(others[parameter["name"]] - values[parameter["name"]]) < 0.5 * (high - low)


def test_what_was_found_runs_online(tmp_path, mixed, found):
    model, out, states = tmp_path / "model.json", tmp_path / "out.parquet", tmp_path / "states.csv"
    found.after.model_.save(model)
    assert {"friction_hysteresis", "load_dependent_friction"} <= set(_core.TorqueModel.load(model).term_names)
    run = write(tmp_path / "run.parquet", run_columns(mixed[3]))
    assert dynid("estimate", model, run, "-o", out, "--states", states).exit_code == 0
    assert_same_answers(find_estimator(), model, states.read_text(), out)


def test_friction_that_would_drive_its_joint_is_not_named():
    """Friction that falls as the load grows has the columns of one that grows with it, and the other sign."""
    joint, width = 2, 0.02

    def helping(signals):
        return -0.12 * np.tanh(signals.dq[:, joint] / width) * np.abs(signals.tau_link[:, joint])

    found = found_in(recorded(equip(rigid(), [Nameless("nameless", (joint,), 1.0, torque=helping)])))
    assert ("load_dependent_friction", ("wrist",)) not in names(found)
