"""Known terms: taken off the torque, kept in the model, and whether the data could tell them."""

from __future__ import annotations

import json
import re

import jsonschema
import numpy as np
import pytest
from helpers.data import ROOT
from helpers.diagnosed import recorded, rigid
from helpers.run_files import write
from helpers.small_arm import N_RUNS, URDF, as_current, dynid, refusal, run, write_robot
from sklearn.base import clone

from dynid_rs import DataError, Recording, RobotModel, TorqueModel, _core
from dynid_rs.commands._identifier import chosen_laws
from dynid_rs.identification.separability import examine, not_separable
from dynid_rs.identification.three_loops import ThreeLoopIdentifier
from dynid_rs.model.terms import read_terms

SHAPE = {"a": 0.5, "b": 0.12, "phase": 0.7, "gas_length": 0.4}
COEFFICIENT = 60.0
ELBOW = 1
TERM = ["[[term]]", 'kind = "counterbalance"', 'joint = "elbow"', "a = 0.5", "b = 0.12", "phase = 0.7"]
TERM += ["gas_length = 0.4", "counterbalance = 60"]
SAME_FIT = {"rtol": 1e-6, "atol": 2e-6}
"""Two fits of the same numbers, once with a term added to the torque and taken off again: roundings go from an
offset to gravity, which the runs hardly tell apart."""


def cylinder(q):
    """Torque of the elbow's cylinder, written out: tension c / (s - x) times the lever arm dL/dq."""
    a, b, phase, s = SHAPE.values()
    L = np.sqrt(a * a + b * b + 2 * a * b * np.cos(q + phase))
    return COEFFICIENT / (s - (L - (a - b))) * (-a * b * np.sin(q + phase) / L)


def known_term(coefficient=COEFFICIENT):
    shape = {name: [value] * 3 for name, value in SHAPE.items()}
    return _core.Effect.of("counterbalance", **shape), np.array([[0.0], [coefficient], [0.0]])


def columns_of(k, with_cylinder=True):
    columns = run(k)
    if with_cylinder:
        columns["tau_1"] = columns["tau_1"] + cylinder(columns["q_1"])
    return columns


def recording_of(k, with_cylinder=True):
    columns = columns_of(k, with_cylinder)
    q, tau = (np.stack([columns[f"{name}_{j}"] for j in range(3)], axis=1) for name in ("q", "tau"))
    return Recording(columns["t"], q, None, None, tau, name=f"run_{k}")


@pytest.fixture(scope="module")
def robot():
    return RobotModel.from_urdf_string(URDF)


@pytest.fixture(scope="module")
def fitted(robot):
    """With the cylinder in the torque and known, and without either."""
    known = ThreeLoopIdentifier(robot, known=[known_term()], friction_law="paper", residual=None)
    return (
        known.fit([recording_of(0), recording_of(1)]),
        ThreeLoopIdentifier(robot, friction_law="paper", residual=None).fit(
            [recording_of(0, False), recording_of(1, False)]
        ),
    )


@pytest.fixture(scope="module")
def command(tmp_path_factory):
    """`dynid identify` with a terms.toml: folder, result.json, printed text."""
    folder = tmp_path_factory.mktemp("known")
    (folder / "terms.toml").write_text("\n".join(TERM))
    runs = [write(folder / f"run_{k}.parquet", columns_of(k)) for k in range(N_RUNS)]
    printed = dynid(
        "identify", write_robot(folder), *runs[:2], "--test", runs[2], "--known", folder / "terms.toml",
        "-o", folder / "out",
    )  # fmt: skip
    assert printed.exit_code == 0, printed.output
    return folder, json.loads((folder / "out" / "result.json").read_text()), " ".join(printed.stdout.split())


def test_a_known_term_leaves_the_other_parameters_as_they_are(fitted):
    known, without = fitted
    np.testing.assert_allclose(known.links_.phi_base_, without.links_.phi_base_, **SAME_FIT)
    np.testing.assert_allclose(known.links_.own_, without.links_.own_, **SAME_FIT)
    np.testing.assert_allclose(known.links_.noise_std_, without.links_.noise_std_, **SAME_FIT)


def test_the_model_predicts_with_the_term(fitted, tmp_path):
    known, without = fitted
    assert known.model_.term_names[-1] == "counterbalance"
    states = known.states(recording_of(2))
    difference = known.model_.evaluate(*states.signals())[0] - without.model_.evaluate(*states.signals())[0]
    np.testing.assert_allclose(difference[:, ELBOW], cylinder(states.q[:, ELBOW]), rtol=1e-5, atol=1e-5)
    assert np.abs(difference[:, [0, 2]]).max() < 1e-5
    known.model_.save(tmp_path / "model.json")
    again = TorqueModel.load(tmp_path / "model.json")
    np.testing.assert_array_equal(again.evaluate(*states.signals())[0], known.model_.evaluate(*states.signals())[0])


def test_the_baseline_has_the_term_too(fitted):
    known, without = fitted
    states = known.states(recording_of(2))
    difference = known.baseline_.evaluate(*states.signals())[0] - without.baseline_.evaluate(*states.signals())[0]
    np.testing.assert_allclose(difference[:, ELBOW], cylinder(states.q[:, ELBOW]), rtol=1e-4, atol=1e-4)


def test_the_torque_of_a_term_on_a_slide_is_a_force():
    slide = RobotModel.from_urdf_string(URDF.replace('"revolute"', '"prismatic"', 1), tip="upper")
    spring = _core.Effect.of("joint_spring", rest_position=[0.0]), np.array([[20.0]])
    runs = recorded(rigid(slide))
    fit = ThreeLoopIdentifier(slide, known=[spring], residual=None).fit(runs[:2])
    (entry,) = examine(fit, [fit.states(runs[2])])
    assert (entry["joint"], entry["unit"]) == ("shoulder", "N")


def test_the_users_identifier_can_be_cloned(robot):
    again = clone(ThreeLoopIdentifier(robot, known=[known_term()]))
    assert again.known[0][0].kind == "counterbalance"
    np.testing.assert_array_equal(again.known[0][1], known_term()[1])


def test_the_command_keeps_the_term_and_says_whether_the_data_could_tell_it(command):
    folder, result, printed = command
    jsonschema.validate(result, json.loads((ROOT / "docs" / "reference" / "result.schema.json").read_text()))
    (entry,) = result["known"]
    assert (entry["kind"], entry["joint"]) == ("counterbalance", "elbow")
    assert entry["shape"] == SHAPE
    assert entry["coefficients"] == {"counterbalance": COEFFICIENT}
    states = run(0)["q_1"]
    assert entry["torque_rms"] == pytest.approx(np.sqrt(np.mean(cylinder(states) ** 2)), rel=0.2)
    assert "counterbalance of elbow, known" in printed
    model = TorqueModel.load(folder / "out" / "model.json")
    assert "counterbalance" in model.term_names
    assert "Known terms" in (folder / "out" / "report.html").read_text()


def test_a_term_that_rich_data_tells_is_called_separable(command):
    _, result, _ = command
    (entry,) = result["known"]
    assert entry["data_alone"]["separable"], entry
    assert not [f for f in result["data"]["findings"] if f["code"] == "not_separable"]
    # without it the base parameters do not make up for it
    assert entry["rmse_test_alone"]["without"] > 1.1 * entry["rmse_test_alone"]["with"]


def test_a_term_that_the_runs_cannot_tell_is_said_of_an_arm_whose_links_are_not_declared():
    """A cylinder on a short crank is gravity's torque; the arm's file has nothing that a prior could be centred on."""
    bare = RobotModel.from_urdf_string(re.sub("<inertial>.*?</inertial>", "", URDF, flags=re.DOTALL))
    shape = SHAPE | {"a": 4.0, "b": 0.01, "gas_length": 6.0}
    effect = _core.Effect.of("counterbalance", **{name: [value] * 3 for name, value in shape.items()})
    crank = effect, np.array([[0.0], [600.0], [0.0]])
    identifier = ThreeLoopIdentifier(bare, known=[crank], residual=None).fit([recording_of(0), recording_of(1)])
    entries = examine(identifier, [identifier.states(recording_of(2))])
    assert identifier.links_.posterior_ is not None
    assert "with_prior" not in entries[0]
    (finding,) = not_separable(entries, prior_used=True)
    assert finding.severity == "warning"
    assert "cannot separate the counterbalance of elbow" in finding.message


def test_laws_of_friction_are_compared_beside_known_terms(robot):
    """Friction that falls with speed and is known: what is left of the elbow's needs no such law."""
    size = np.array([[0.0, 0.0], [8.0, 8.0], [0.0, 0.0]])
    falling = {"stribeck_velocity": [0.15] * 3, "exponent": [1.0] * 3, "transition_width": [0.01] * 3}
    effect = _core.Effect.of("stribeck", **falling)

    def with_stribeck(k):
        columns = run(k, velocity=True)
        q, dq, tau = (np.stack([columns[f"{name}_{j}"] for j in range(3)], axis=1) for name in ("q", "dq", "tau"))
        rest = np.zeros_like(q)
        tau = tau + _core.effect_torque(effect, size, q, dq, rest, q, dq, rest, step=1 / 200)
        return Recording(columns["t"], q, None, None, tau, name=f"run_{k}")

    runs = [with_stribeck(k) for k in range(N_RUNS)]
    unknown = ThreeLoopIdentifier(robot, residual=None)
    known = ThreeLoopIdentifier(robot, residual=None, known=[(effect, size)])
    assert chosen_laws(unknown, runs)[ELBOW] == "stribeck"
    assert chosen_laws(known, runs) == ("coulomb_viscous",) * 3


def test_the_standard_error_of_the_size_is_that_of_a_fit(robot):
    """A factor in front of the term, fitted by plain least squares over many draws of the noise."""
    from dynid_rs.identification.links import LinkDynamicsIdentifier
    from dynid_rs.identification.separability import separation
    from dynid_rs.regression.columns import Block, Observations, observe

    identifier = ThreeLoopIdentifier(robot, residual=None).fit([recording_of(0, False), recording_of(1, False)])
    plan, runs = identifier.observations_.plan, identifier.runs_
    torque = [states.in_band(np.eye(3)[ELBOW] * cylinder(states.q[:, [ELBOW]])) for states in runs]
    observations = observe(plan, runs)

    def with_torque(tau):
        rows = observations.rows_with(tau)
        return Observations(plan, [Block(k, j, [_core.triangular_factor(x) for x in j]) for k, j in enumerate(rows)])

    rng, noise_std, factors, told = np.random.default_rng(0), np.array([0.4, 0.3, 0.1]), [], []
    clean = [states.in_band(identifier.model_.evaluate(*states.signals())[0]) for states in runs]
    weights = 1 / noise_std
    for _ in range(60):
        noise = [states.in_band(rng.normal(size=states.tau.shape) * noise_std) for states in runs]
        measured = [a + b + t for a, b, t in zip(clean, noise, torque, strict=True)]
        wide, right = [], []
        for j in range(3):
            rows = np.concatenate([block.rows[j] for block in with_torque(measured).blocks])
            extended = np.zeros((len(rows), plan.n_columns + 1))
            extended[:, plan.unknowns(j)] = rows[:, :-1]
            moves = np.concatenate([states.counted[:, j] for states in runs])
            extended[:, -1] = np.concatenate(torque)[:, j] * moves
            wide.append(weights[j] * extended)
            right.append(weights[j] * rows[:, -1])
        A = np.concatenate(wide)
        norms = np.linalg.norm(A, axis=0)
        norms[norms == 0] = 1
        factors.append(np.linalg.lstsq(A / norms, np.concatenate(right), rcond=1e-12)[0][-1] / norms[-1])
        fitted = with_torque([a + b for a, b in zip(clean, noise, strict=True)])
        links = LinkDynamicsIdentifier(prior=None).fit(fitted)
        told.append(separation(with_torque(torque), fitted, links, ELBOW).std_error)
    assert np.mean(factors) == pytest.approx(1, abs=5 * np.std(factors) / np.sqrt(60))
    # 60 draws know their spread to about a tenth
    assert np.median(told) == pytest.approx(np.std(factors), rel=0.3)


def test_known_terms_in_ampere_are_refused(robot, tmp_path):
    path = write(tmp_path / "run.parquet", as_current(run(0)))
    (tmp_path / "terms.toml").write_text("\n".join(TERM))
    sentence = refusal(
        dynid("identify", write_robot(tmp_path), path, "--known", tmp_path / "terms.toml", "-o", tmp_path / "out")
    )
    assert "known terms are in N*m" in sentence
    assert "drive gains" in sentence
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("known", "words"),
    [
        (lambda: [(known_term()[0], np.zeros((2, 1)))], "of shape (3, 1)"),
        (lambda: [(known_term()[0], np.full((3, 1), np.nan))], "must be finite"),
        (lambda: [known_term(), known_term()], "is there twice"),
        (lambda: [(_core.Effect.torque_offset(), np.zeros((3, 1)))], "is fitted in every model"),
    ],
)
def test_known_terms_that_make_no_sense_are_refused(robot, known, words):
    with pytest.raises(ValueError) as error:
        ThreeLoopIdentifier(robot, known=known()).fit(recording_of(0))
    assert words in str(error.value)


def terms_file(tmp_path, lines):
    path = tmp_path / "terms.toml"
    path.write_text("\n".join(lines))
    return path


def test_a_terms_file_is_read(robot, tmp_path):
    ((effect, coefficients),) = read_terms(terms_file(tmp_path, TERM), robot)
    assert effect.kind == "counterbalance"
    assert {name: values[ELBOW] for name, values in effect.shape} == SHAPE
    np.testing.assert_array_equal(coefficients, known_term()[1])


def test_a_sharpness_that_is_left_out_is_none(robot, tmp_path):
    shape = {"stribeck_velocity": 0.1, "exponent": 1.0, "transition_width": 0.01}
    numbers = [f"{name} = {value}" for name, value in (shape | {"stribeck_pos": 3.0, "stribeck_neg": 2.0}).items()]
    lines = ["[[term]]", 'kind = "stribeck"', "joint = 1", *numbers]
    for more, expected in (([], 0.0), (["sharpness = 2.5"], 2.5)):
        ((effect, coefficients),) = read_terms(terms_file(tmp_path, lines + more), robot)
        assert {name: values[1] for name, values in effect.shape} == shape | {"sharpness": expected}
        assert coefficients[1].tolist() == [3.0, 2.0]


def test_terms_of_one_kind_on_two_joints_are_one_effect(robot, tmp_path):
    second = ["", *(line.replace('"elbow"', "2").replace("a = 0.5", "a = 0.9").replace("60", "7") for line in TERM)]
    ((effect, coefficients),) = read_terms(terms_file(tmp_path, TERM + second), robot)
    assert dict(effect.shape)["a"][1:] == [0.5, 0.9]
    np.testing.assert_array_equal(coefficients[:, 0], [0, 60, 7])


def _without(key):
    return [line for line in TERM if not line.startswith(key)]


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        (["[[term]"], "not valid TOML"),
        (["term = 3"], "must be a table [[term]]"),
        (["[terms]"], "must be a table [[term]]"),
        (_without("kind"), "kind: is missing"),
        ([line.replace("counterbalance", "counterballance", 1) for line in TERM], "did you mean counterbalance?"),
        ([*_without("kind"), 'kind = "friction"'], "is not known"),
        (_without("joint"), "joint: is missing"),
        ([line.replace("elbow", "knee") for line in TERM], "is no joint of small_arm"),
        ([*_without("joint"), "joint = 3"], "index from 0 to 2"),
        (_without("phase"), "phase: is missing"),
        (_without("counterbalance"), "counterbalance: is missing"),
        ([*TERM, "lenght = 1"], "lenght: this key is not known"),
        ([*_without("a ="), 'a = "long"'], "must be a finite number"),
        ([*_without("a ="), "a = inf"], "must be a finite number"),
        ([*_without("a ="), "a = -1.0"], "must be positive"),
        ([*_without("gas_length"), "gas_length = 0.1"], "gas_length above the stroke"),
        ([*_without("counterbalance"), "counterbalance = -5"], "must be at least 0"),
        ([*TERM, "", *TERM], "is there twice"),
    ],
)
def test_terms_files_with_a_fault_are_refused(robot, tmp_path, lines, words):
    with pytest.raises(DataError) as error:
        read_terms(terms_file(tmp_path, lines), robot)
    assert "terms.toml" in str(error.value)
    assert words in str(error.value)


def test_the_command_refuses_a_faulty_terms_file_before_any_work(tmp_path):
    path = write(tmp_path / "run.parquet", run(0))
    terms = terms_file(tmp_path, _without("phase"))
    sentence = refusal(dynid("identify", write_robot(tmp_path), path, "--known", terms, "-o", tmp_path / "out"))
    assert "term 1 (counterbalance), phase" in sentence
    missing = refusal(
        dynid("identify", write_robot(tmp_path), path, "--known", tmp_path / "no.toml", "-o", tmp_path / "out")
    )
    assert "no.toml" in missing
