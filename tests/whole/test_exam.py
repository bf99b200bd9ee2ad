"""The exam examines itself: it shares nothing with the product, its physics holds, its marks are just."""

import ast
import json
import stat
import sys
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from exam import run
from exam.arm import GRAVITY, Joint, build_model, draw_arm
from exam.case import write_case
from exam.declared import rows_of
from exam.draw import GROUPS, NAMED, REPORTED, draw
from exam.frictions import bristles
from exam.hidden import hide, shown_torque
from exam.oracle import p_value
from exam.page import page
from exam.score import score
from exam.tally import complaints, goals
from exam.world import inverse_dynamics, make_world
from helpers.data import ROOT
from scipy.integrate import solve_ivp

FOLDER = ROOT / "tests" / "exam"
ALLOWED = {"exam", "numpy", "scipy", "pinocchio", "pyarrow"}
"""What the examiner may lean on, besides the standard library."""
CLEAN, QUICK = 2, 810
"""A clean case, and one with little data."""


def test_the_examiner_imports_nothing_of_the_product_or_of_other_tests():
    for path in FOLDER.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                assert node.level == 0, f"{path.name}:{node.lineno}"
                names = [node.module]
            else:
                names = []
            for name in names:
                root = name.split(".")[0]
                assert root in ALLOWED or root in sys.stdlib_module_names, f"{path.name}:{node.lineno}: {name}"
        text = path.read_text(encoding="utf-8")
        assert "__import__" not in text, path.name
        assert "importlib" not in text, path.name


def files_of(folder):
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def test_a_seed_gives_the_same_bytes_and_another_one_others(tmp_path):
    for name, seed in (("a", QUICK), ("b", QUICK), ("c", QUICK + 1)):
        write_case(seed, tmp_path / name)
    first, second, other = (files_of(tmp_path / name) for name in "abc")
    assert first == second
    assert not set(first.values()) & set(other.values())


def test_half_of_the_cases_are_drawn_clean():
    cases = [draw(seed) for seed in range(1000)]
    for group, part in GROUPS.items():
        share = np.mean([case.group == group for case in cases])
        assert abs(share - part) < 4 * np.sqrt(part * (1 - part) / len(cases))
    assert {wish.kind for case in cases for wish in case.wishes} >= set(NAMED)


def test_torque_of_a_pendulum_is_the_closed_form():
    mass, length, spin = 3.0, 0.7, 0.05
    joint = Joint("joint_1", np.zeros(3), np.zeros(3), np.array([0.0, 1.0, 0.0]))
    model = build_model([joint], [pin.Inertia(mass, np.array([length, 0.0, 0.0]), spin * np.eye(3))])
    q, dq, ddq = np.random.default_rng(0).uniform(-2, 2, (3, 50, 1))
    # Turning about y by q lowers a point on x: its height is -length sin q.
    closed = (mass * length**2 + spin) * ddq - mass * GRAVITY * length * np.cos(q)
    np.testing.assert_allclose(inverse_dynamics(model, q, dq, ddq), closed, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("seed", [3, 8, 18])
def test_the_work_of_the_rigid_torque_is_energy(seed):
    world = make_world(draw(seed))
    s = world.runs[0]
    data = world.model.createData()
    energy = np.array(
        [
            pin.computeKineticEnergy(world.model, data, q, dq) + pin.computePotentialEnergy(world.model, data, q)
            for q, dq in zip(s.q, s.dq, strict=True)
        ]
    )
    power = np.sum(s.tau_rigid * s.dq, axis=1)
    work = np.concatenate([[0.0], np.cumsum((power[1:] + power[:-1]) / 2 * np.diff(s.t))])
    np.testing.assert_allclose(work, energy - energy[0], atol=1e-3 * np.ptp(energy))


@pytest.mark.parametrize("seed", [3, 8, 18])
def test_speeds_and_accelerations_are_those_of_the_positions(seed):
    s = make_world(draw(seed)).runs[0]
    for x, rate in ((s.q, s.dq), (s.dq, s.ddq)):
        way = np.cumsum((rate[1:] + rate[:-1]) / 2 * np.diff(s.t)[:, None], axis=0)
        np.testing.assert_allclose(way, x[1:] - x[0], atol=2e-3 * np.ptp(x))


def test_the_file_tells_the_makers_arm():
    arm = draw_arm(draw(CLEAN))
    told, read = build_model(arm.joints, arm.told), pin.buildModelFromXML(arm.urdf())
    q, dq, ddq = np.random.default_rng(0).uniform(-1, 1, (3, 20, arm.n_joints))
    np.testing.assert_allclose(inverse_dynamics(read, q, dq, ddq), inverse_dynamics(told, q, dq, ddq), rtol=1e-9)
    off = [abs(a.mass / b.mass - 1) for a, b in zip(arm.told, arm.true, strict=True)]
    assert 0.05 < np.mean(off) < 0.35


def test_bristles_follow_their_differential_equation():
    way = 0.02
    t = np.linspace(0.0, 6.0, 3001)
    q, dq = 0.1 * np.sin(2 * t), lambda t: 0.2 * np.cos(2 * t)
    exact = solve_ivp(
        lambda t, z: dq(t) / way * (1 - z * np.sign(dq(t))), (0, 6), [0.0], t_eval=t, max_step=1e-3, rtol=1e-8
    )
    np.testing.assert_allclose(bristles(q, way), exact.y[0], atol=2e-3)


def test_nothing_is_left_of_a_clean_world():
    exam = hide(draw(CLEAN))
    torque = [shown_torque(exam, s)[:: s.every] for s in exam.world.train]
    assert exam.declared.ratio(rows_of(exam.world, torque)).max() < 0.05
    assert exam.left.max() < 0.05


def test_hidden_effects_have_the_size_that_was_wished():
    exam = hide(draw(16))
    (wish,), (hidden,) = exam.world.case.wishes, exam.hidden
    assert hidden.effect.kind == wish.kind
    assert hidden.strength == pytest.approx(wish.ratio, rel=0.02)
    assert p_value(exam, 0) < 1e-5


def test_the_oracle_does_not_see_what_is_not_there():
    exam = hide(draw(16))
    (hidden,) = exam.hidden
    nothing = replace(exam, hidden=(replace(hidden, rows=1e-3 * hidden.rows),))
    assert p_value(nothing, 0) > 1e-4


TRUTH = {
    "seed": 7,
    "group": "mixture",
    "case": {"motion": "fourier"},
    "joints": ["a", "b", "c"],
    "elastic": None,
    "facts": {"joint_elasticity": ["c"], "torque_gain": []},
    "effects": [
        {
            "kind": "stribeck", "joints": ["a"], "named": True, "ratio": 2.0, "seen": True, "shape": {},
            "parameters": {"stribeck_pos": 1.0},
        },
        {
            "kind": "torque_ripple", "joints": ["b"], "named": True, "ratio": 0.5, "seen": True,
            "shape": {"cycles": 50.0}, "parameters": {"cycles": 50.0},
        },
    ],
}  # fmt: skip


def effect(kind, *joints, ties=(), **parameters):
    told = [{"name": name, "value": v, "unit": "1", "interval": [v - 0.1, v + 0.1]} for name, v in parameters.items()]
    ties = [{"kind": other, "joints": list(places)} for other, *places in ties]
    return {"kind": kind, "joints": list(joints), "parameters": told, "ties": ties}


def marks(*effects, after=(1.0, 1.0, 1.0), truth=TRUTH):
    test = {"before": [1.0, 1.0, 1.0], "after": list(after)}
    result = {"effects": list(effects), "unexplained": [], "rmse": {"test": test}}
    return score(truth, result, 5.0, None)


def found(outcome):
    return [told["found"] for told in outcome["effects"]]


def test_a_name_is_right_with_its_kind_its_place_and_its_order():
    outcome = marks(effect("stribeck", "a", stribeck_pos=1.05), effect("torque_ripple", "b", cycles=50.1))
    assert outcome["false"] == []
    assert found(outcome) == [True, True]
    assert outcome["right"] == 2
    assert [told["covered"] for told in outcome["intervals"]] == [True, True]
    assert complaints(outcome) == []


def test_a_wrong_place_a_wrong_kind_and_a_wrong_order_are_false():
    wrong = [effect("stribeck", "b"), effect("joint_spring", "a"), effect("torque_ripple", "b", cycles=31.0)]
    outcome = marks(*wrong)
    assert len(outcome["false"]) == 3
    assert found(outcome) == [False, False]
    assert len(complaints(outcome)) == 5


def test_unknown_accuses_nobody_and_a_fact_is_no_effect():
    outcome = marks(effect("unknown", "b"), effect("joint_elasticity", "c"))
    assert (outcome["false"], outcome["right"]) == ([], 0)
    assert marks(effect("joint_elasticity", "a"))["false"] == ["joint_elasticity at a"]


def test_what_is_named_as_a_tie_only_is_found_and_the_first_name_is_false():
    outcome = marks(effect("friction_hysteresis", "a", ties=[("stribeck", "a")]))
    assert found(outcome) == [True, False]
    assert outcome["effects"][0]["tie"]
    assert outcome["false"] == ["friction_hysteresis at a"]


def test_a_false_name_that_is_the_tie_of_a_right_one_is_excused():
    right = effect("stribeck", "a", ties=[("friction_hysteresis", "a")])
    assert marks(right, effect("friction_hysteresis", "a"))["false"] == []


def test_names_of_one_thing_are_one():
    told = TRUTH["effects"][0] | {"kind": "thermal_friction", "parameters": {}}
    warm = TRUTH | {"effects": [told]}
    assert found(marks(effect("temperature_friction", "a"), truth=warm)) == [True]
    tilted = TRUTH | {"effects": [told | {"kind": "gravity_tilt", "joints": ["a", "b", "c"]}]}
    assert found(marks(effect("kinematic_error", "a"), truth=tilted)) == [True]
    assert found(marks(effect("kinematic_error", "b"), truth=tilted)) == [False]


def test_a_joint_that_got_worse_is_harm():
    outcome = marks(after=(0.5, 1.2, 1.0))
    assert outcome["harm"] == [0.5, 1.2, 1.0]
    assert "a joint 1.20 times worse" in complaints(outcome)
    missed = {goal.name for goal in goals([outcome]) if not goal.met}
    assert "cases with a joint more than 1.05 times worse than declared" in missed
    assert "worst joint, error after over before" not in missed


def test_a_case_without_a_result_has_failed():
    outcome = score(TRUTH, None, 70.0, "traceback")
    assert outcome["harm"] is None
    assert complaints(outcome)[0] == "traceback"
    reached = {goal.name: goal.reached for goal in goals([outcome])}
    assert reached["cases that ended in a traceback or without a result"] == 1
    assert reached["cases above 60 s"] == 1


def test_fresh_seeds_are_for_reporting():
    seeds = run.fresh_seeds(50)
    assert len(set(seeds)) == 50
    assert min(seeds) >= REPORTED
    assert run.seeds_of("3-5,9") == [3, 4, 5, 9]


def program(folder, text):
    path = folder / "dynid"
    path.write_text(f"#!{sys.executable}\n{text}", encoding="utf-8")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return str(path)


def test_a_program_that_breaks_is_seen_and_a_broken_exam_goes_on(tmp_path, capsys):
    arguments = ["--seeds", "2-3", "--jobs", "1", "--keep", str(tmp_path / "kept")]
    program_path = program(tmp_path, "raise ZeroDivisionError('nothing left')")
    assert run.main([*arguments, "--program", program_path]) == 1
    assert "traceback: ZeroDivisionError: nothing left" in capsys.readouterr().out
    outcome = tmp_path / "kept" / "3" / "outcome.json"
    outcome.unlink()
    before = (tmp_path / "kept" / "2" / "outcome.json").stat().st_mtime_ns
    assert run.main([*arguments, "--program", program_path]) == 1
    assert outcome.exists()
    assert (tmp_path / "kept" / "2" / "outcome.json").stat().st_mtime_ns == before
    assert run.main(["--seeds", "4", "--keep", str(tmp_path / "kept"), "--program", program_path]) == 2


def test_a_case_goes_from_its_seed_to_the_page(tmp_path, capsys):
    written = tmp_path / "exam.md"
    code = run.main(["--seeds", str(QUICK), "--jobs", "1", "--keep", str(tmp_path / "kept"), "--page", str(written)])
    outcome = json.loads((tmp_path / "kept" / str(QUICK) / "outcome.json").read_text(encoding="utf-8"))
    assert outcome["failure"] is None, outcome.get("message")
    assert code == 0
    text = written.read_text(encoding="utf-8")
    assert "| clean cases with a false name | at most 0.02 |" in text
    assert "below 1000" in text
    assert text.endswith(f"## Seeds\n\n{QUICK}\n")
    assert page([outcome], "", "").count("\n## ") == text.count("\n## ")
    assert "[1/1]" in capsys.readouterr().out


def test_either_of_two_kinds_is_found_by_what_it_may_be_and_accuses_nobody():
    either = effect("unknown", "a", ties=[("stribeck", "a")]) | {"told_as": "friction_hysteresis"}
    outcome = marks(either)
    assert (found(outcome), outcome["false"], outcome["effects"][0]["tie"]) == ([True, False], [], True)
    itself = effect("unknown", "a", ties=[("friction_hysteresis", "a")]) | {"told_as": "stribeck"}
    assert found(marks(itself)) == [True, False]
    assert found(marks(effect("unknown", "a") | {"told_as": "stribeck"})) == [False, False]
