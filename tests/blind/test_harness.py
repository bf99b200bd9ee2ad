"""The blind suite itself: fair cases, answers kept away, and a scorer that tells right from wrong."""

import json
from dataclasses import replace

import numpy as np
import pyarrow.parquet as pq
import pytest
from arms import bare
from cases import GEARS, LATER, SCALED, all_cases
from maker import build, truth_of, write_seen, write_truth
from oracle import oracle_error
from page import page
from power import FAMILY_LEVEL, N_CANDIDATES, in_band, power
from scorer import score
from strangers import STRANGERS, build_stranger
from suite import run_case, run_cases
from tally import tally

from dynid_rs.simulation import kind_names
from dynid_rs.simulation.effects.base import Signals

JOINTS = ["waist", "elbow", "wrist"]
BAND_SHARE = 0.2
"""Of white noise at 250 Hz, by amplitude, inside 5 Hz."""
ESTIMATED = 0.1
"""Relative error of an RMS over some hundred independent values, three times over."""


def told(kind, joints, parameters=(), required=None, **more):
    return {
        "kind": kind, "joints": joints, "required": required or joints, "ratio": 2.0, "reached": 2.0,
        "parameters": [{"name": name, "value": value, "unit": ""} for name, value in parameters], **more,
    }  # fmt: skip


def truth(*effects, strangers=(), contacts=None):
    return {
        "joints": JOINTS, "rate": 100.0, "train": ["run_0.parquet"], "noise_std": [1.0, 1.0, 1.0],
        "effects": list(effects), "strangers": list(strangers), "contacts": contacts or {},
    }  # fmt: skip


def named(kind, joints, parameters=(), ties=(), rank=1, **more):
    return {
        "rank": rank, "kind": kind, "joints": joints, "ties": list(ties),
        "parameters": [{"name": n, "value": v, "interval": i} for n, v, i in parameters], **more,
    }  # fmt: skip


def result(*effects, findings=(), unexplained=(), before=(1.0, 1.0, 1.0), after=(0.5, 0.5, 0.5)):
    return {
        "effects": list(effects), "data": {"findings": list(findings)}, "unexplained": list(unexplained),
        "rmse": {"test": {"before": list(before), "after": list(after)}},
    }  # fmt: skip


def judge(truth, result):
    return score(truth, result, 1.0, [0.5, 0.5, 0.5])


def test_the_suite_has_every_kind_and_enough_of_each():
    cases = all_cases()
    assert len(cases) >= 300
    kinds = {put.kind for case in cases.values() for put in case.puts}
    assert set(kind_names()) - set(LATER) <= kinds
    gears = {kind for kinds in GEARS for kind, _ in kinds}
    assert {*SCALED, *LATER, "payload", "contact"} | gears == set(kind_names())
    assert len([case for case in cases.values() if case.group == "clean"]) >= 60
    for arm in ("four_axis", "six_axis", "seven_axis"):
        assert {case.encoders for case in cases.values() if case.arm == arm} == {1, 2}


def test_a_case_follows_from_its_number():
    first, again = build(all_cases()[30]), build(all_cases()[30])
    assert truth_of(first) == truth_of(again)
    np.testing.assert_array_equal(first.shown(4).tau, again.shown(4).tau)


def test_answers_stay_away(tmp_path):
    case = all_cases()[30]
    built = build(case)
    write_seen(built, tmp_path / "seen")
    write_truth(truth_of(built), tmp_path / "hidden")
    names = sorted(path.name for path in (tmp_path / "seen").rglob("*"))
    assert names == ["robot.urdf", *(f"run_{k}.parquet" for k in range(5))]
    table = pq.read_table(tmp_path / "seen" / "run_0.parquet")
    n = bare(case.arm).robot.n_joints
    assert set(table.column_names) == {"t", *(f"{s}_{j}" for s in ("q", "tau") for j in range(n))}
    everything = b"".join(path.read_bytes() for path in (tmp_path / "seen").iterdir())
    assert not any(kind.encode() in everything for kind in kind_names())
    hidden = json.loads((tmp_path / "hidden" / "truth.json").read_text())
    assert hidden["effects"][0]["kind"] == case.puts[0].kind


@pytest.mark.parametrize("number", [0, 180, 300, 583])
def test_the_oracle_is_left_with_noise(number):
    built = build(all_cases()[number])
    noise = BAND_SHARE * bare(built.case.arm).noise_std * (1 + max(gain_of(built), default=0.0))
    np.testing.assert_allclose(oracle_error(built) / noise, 1.0, atol=2 * ESTIMATED)


def test_the_oracle_of_warmth_has_to_fit_the_friction_that_warmth_lessens():
    """It knows how warm it was, not the torque: where friction is nearly gone, friction is known less well."""
    built = build(all_cases()[132])
    noise = BAND_SHARE * bare(built.case.arm).noise_std
    error = oracle_error(built) / noise
    untold = replace(built, placed=())
    assert np.all(error < 1.2)
    assert np.all(error > 1)
    assert np.all(oracle_error(untold) > 3 * noise)


def gain_of(built):
    return [float(np.max(p.effect.gain)) for p in built.placed if hasattr(p.effect, "gain")]


def test_most_of_an_effect_is_in_the_band_but_not_of_one_outside():
    spring = in_band(build(all_cases()[84]))[0]
    assert max(spring["rms_over_noise"]) == pytest.approx(2.0, rel=ESTIMATED)
    nothing = in_band(replace(build(all_cases()[420]), placed=()))
    assert nothing == []


def test_power_of_the_test_that_knows():
    level = FAMILY_LEVEL / N_CANDIDATES
    assert power(0.0, 3) == pytest.approx(level, rel=1e-3)
    # By another road: the share of noisy draws above the threshold.
    rng = np.random.default_rng(0)
    draws = (rng.standard_normal((100_000, 2)) + np.array([np.sqrt(20.0), 0.0])) ** 2
    threshold = -2 * np.log(level)  # chi-square of two degrees
    assert power(20.0, 2) == pytest.approx(np.mean(draws.sum(axis=1) > threshold), abs=0.01)


@pytest.mark.parametrize("kind", STRANGERS)
def test_strangers_depend_on_what_they_say(kind):
    rng = np.random.default_rng(0)
    names = ["j", "k", "l"]
    arm = bare("four_axis")
    signals = {name: rng.uniform(-1.0, 1.0, (50, 3)) for name in ("q", "dq", "ddq", "tau_link")}
    effect = build_stranger(kind, 0, 1, np.ones(3), 1.0)

    def torque(changed):
        s = signals | changed
        return effect.motor_torque(
            arm, Signals(np.arange(50.0), s["q"], s["dq"], s["ddq"], s["q"], s["dq"], s["ddq"], s["tau_link"], s["q"])
        )

    allowed = {name for group in effect.depends_on(names) for name in group}
    changes = set()
    for signal, values in signals.items():
        for joint, name in enumerate(names):
            other = values.copy()
            other[:, joint] = rng.uniform(-1.0, 1.0, 50)
            if np.any(torque({signal: other}) != torque({})):
                changes.add(f"{signal}_{name}")
    assert changes <= allowed
    assert all(set(group) & changes for group in effect.depends_on(names))
    assert np.flatnonzero(np.any(torque({}) != 0, axis=0)).tolist() == list(effect.joints_pushed)


def test_right_answers_are_right():
    judged = judge(truth(told("stribeck", ["elbow"])), result(named("stribeck", ["elbow"])))
    assert judged["effects"][0]["found"]
    assert judged["top1"]
    assert judged["false"] == []
    assert judged["after_over_oracle"] == [1.0, 1.0, 1.0]


def test_a_wrong_joint_is_a_miss_and_a_false_name():
    judged = judge(truth(told("stribeck", ["elbow"])), result(named("stribeck", ["wrist"])))
    assert not judged["effects"][0]["found"]
    assert judged["effects"][0]["right_kind"]
    assert judged["false"] == [("stribeck", "wrist")]
    assert not judged["top1"]


def test_one_entry_or_one_per_joint_is_the_same():
    pair = truth(told("coupled_friction", ["elbow", "wrist"]))
    together = judge(pair, result(named("coupled_friction", ["wrist", "elbow"])))
    apart = judge(pair, result(*(named("coupled_friction", [j], rank=k) for k, j in enumerate(["elbow", "wrist"]))))
    half = judge(pair, result(named("coupled_friction", ["wrist"])))
    assert together["effects"] == apart["effects"]
    assert together["effects"][0]["found"]
    assert half["effects"][0]["partly"]
    assert not half["effects"][0]["found"]


def test_joints_that_hardly_feel_it_need_not_be_named_but_may():
    pair = truth(told("inertial_coupling", ["elbow", "wrist"], required=["wrist"]))
    for joints in (["wrist"], ["elbow", "wrist"]):
        judged = judge(pair, result(named("inertial_coupling", joints)))
        assert judged["effects"][0]["found"]
        assert judged["false"] == []


def test_a_tie_counts_apart():
    answer = result(named("torque_gain", ["waist"], ties=[{"kind": "stribeck", "joints": ["elbow"]}]))
    judged = judge(truth(told("stribeck", ["elbow"])), answer)
    assert not judged["effects"][0]["found"]
    assert judged["effects"][0]["or_tied"]
    assert (judged["top1"], judged["top1_or_tie"]) == (False, True)
    assert (judged["false"], judged["false_or_untied"]) == ([("torque_gain", "waist")], [])


def test_the_whole_robot_has_no_joint():
    judged = judge(truth(told("gravity_tilt", JOINTS)), result(named("gravity_tilt", ["waist"])))
    assert judged["effects"][0]["found"]
    assert judged["false"] == []


def test_a_session_that_warms_up_has_two_names():
    for kind in ("thermal_friction", "temperature_friction"):
        assert judge(truth(told("thermal_drift", JOINTS)), result(named(kind, JOINTS)))["effects"][0]["found"]
    assert not judge(truth(told("thermal_drift", JOINTS)), result(named("stribeck", JOINTS)))["effects"][0]["found"]


def test_sensors_may_be_named_as_findings():
    finding = {"code": "torque_delay", "severity": "warning", "column": "tau_2"}
    late = truth(told("torque_delay", ["wrist"]))
    assert judge(late, result(findings=[finding]))["effects"][0]["found"]
    assert judge(truth(), result(findings=[finding]))["false"] == [("torque_delay", "wrist")]
    assert judge(truth(), result(findings=[finding | {"severity": "info"}]))["false"] == []


def test_intervals_that_cover():
    there = truth(told("stribeck", ["elbow"], [("stribeck_pos", [2.0])]))
    answer = result(named("stribeck", ["elbow"], [("stribeck_pos", 2.5, [1.5, 3.5]), ("no_such", 1.0, [0.0, 2.0])]))
    (parameter,) = judge(there, answer)["parameters"]
    assert parameter["covered"]
    assert parameter["error_over_half_width"] == pytest.approx(0.5)


def test_parameters_that_come_once_per_joint():
    there = truth(told("joint_elasticity", ["waist", "elbow"], [("stiffness", [1.0, 2.0]), ("damping", [0.1, 0.2])]))
    numbers = [("stiffness", 2.0, [1.9, 2.1]), ("stiffness", 1.0, [0.9, 1.1]), ("damping", 0.2, [0.15, 0.25])]
    together = judge(there, result(named("joint_elasticity", ["elbow", "waist"], numbers)))["parameters"]
    assert [(p["true"], p["covered"]) for p in together] == [(2.0, True), (1.0, True), (0.2, True)]


def test_an_eccentric_disc_in_two_parts():
    there = truth(told("encoder_eccentricity", ["elbow"], [("amplitude", [2.0]), ("phase", [0.5])]))
    answer = result(named("encoder_eccentricity", ["elbow"], [("cosine", 0.9, [0.5, 1.5]), ("sine", 1.8, [1.0, 2.0])]))
    parts = {p["name"]: p["true"] for p in judge(there, answer)["parameters"]}
    q = 0.3  # 2 sin(q + 0.5)
    assert parts["cosine"] * np.cos(q) + parts["sine"] * np.sin(q) == pytest.approx(2 * np.sin(q + 0.5))


def test_windows_of_contact():
    pushes = {"run_0.parquet": [[1.0, 2.0], [5.0, 6.0]], "run_1.parquet": [[3.0, 4.0]]}

    def window(file, first, last):
        return {"code": "contact", "severity": "info", "file": file, "rows": [first, last]}

    findings = [
        window("run_0.parquet", 110, 190),
        window("run_0.parquet", 800, 850),
        window("x/run_1.parquet", 350, 420),
    ]
    contact = judge(truth(contacts=pushes), result(findings=findings))["contact"]
    assert contact["found"] == {"train": [True, False], "test": [True]}
    assert contact["false_windows"] == 1
    assert contact["seconds_beyond"] == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("signals", "right"),
    [
        ([("q_wrist", 0.5), ("dq_motor_elbow", 0.4)], True),
        ([("q_waist", 0.6), ("q_wrist", 0.5), ("dq_elbow", 0.4)], True),
        ([("q_waist", 0.6), ("tau_link_waist", 0.55), ("q_wrist", 0.5), ("dq_elbow", 0.4)], False),
        ([("q_wrist", 0.5)], False),
    ],
)
def test_unknown_with_the_right_signals(signals, right):
    stranger = told("squeezed_friction", ["elbow", "wrist"], pushed=["elbow"], depends_on=[["q_wrist"], ["dq_elbow"]])
    depends_on = [{"signal": name, "strength": strength} for name, strength in signals]
    answer = result(unexplained=[{"joint": "elbow", "depends_on": depends_on}], after=(1.0, 0.6, 1.0))
    unknown = judge(truth(strangers=[stranger]), answer)["unknown"]
    assert unknown["right_signals"] is right
    assert unknown["share_removed"] == pytest.approx(0.8)


def answering(effects):
    """An examiner that says the same of everything."""

    def examine(seen, output):
        n = sum(name.startswith("tau_") for name in pq.read_schema(seen / "run_0.parquet").names)
        return result(*effects, before=[1.0] * n, after=[1.0] * n), 2.0

    return examine


def test_from_number_to_figures(tmp_path):
    (spring,) = truth_of(build(all_cases()[84]))["effects"]
    answers = {84: [named("joint_spring", spring["joints"])], 420: [], 423: [named("stribeck", ["waist"])]}
    outcomes = [run_case(all_cases()[n], tmp_path / str(n), answering(effects)) for n, effects in answers.items()]

    def gives_up(seen, output):
        raise ValueError("no idea")

    outcomes.append(run_case(all_cases()[108], tmp_path / "108", gives_up))
    figures = tally(json.loads(json.dumps(outcomes)))
    goals = {goal["goal"]: goal["value"] for goal in figures["goals"]}
    assert goals["clean: cases with a false attribution"] == 0.5
    assert goals["recall at 2"] == 0.5
    assert [label[:3] for label, _ in figures["errors"]] == ["108"]
    text = page(figures)
    assert "no idea" in text
    assert "wrongly named: stribeck at waist" in text
    rows = [line for line in text.splitlines() if line.startswith("| joint_spring | 2 |")]
    assert [row.split("|")[3:5] for row in rows] == [[" 1 ", " 1.00 "]]


def test_results_are_kept(tmp_path, monkeypatch):
    monkeypatch.setattr("suite.run_case", lambda case, folder: {"case": case.__dict__ | {"puts": []}, "label": "made"})
    case = all_cases()[420]
    (first,) = run_cases([case], kept=tmp_path)
    monkeypatch.setattr("suite.run_case", lambda case, folder: pytest.fail("it was there"))
    (again,) = run_cases([case], kept=tmp_path)
    assert again["label"] == first["label"] == "made"
    monkeypatch.setattr("suite.code_digest", lambda: "other code")
    with pytest.raises(pytest.fail.Exception):
        list(run_cases([case], kept=tmp_path))
