"""Physically consistent parameters: bodies that other engines accept, near the torque, near the robot file."""

import json
import sys
from dataclasses import replace

import numpy as np
import pytest
from helpers import data
from helpers.engines import accepted_by_mujoco, accepted_by_pinocchio
from helpers.result_files import validator
from helpers.robots import random_states
from helpers.small_arm import URDF, as_current, dynid, refusal, run, snapshot, write_robot, write_runs
from helpers.tolerances import ALGEBRAIC, EXACT
from numpy.testing import assert_allclose
from real_robots import CASES, identify

import dynid_rs as dyn
from dynid_rs import PhysicalIdentifier, RobotModel, ThreeLoopIdentifier, _core
from dynid_rs.identification.links import LinkDynamicsIdentifier, RowGroup
from dynid_rs.identification.results import score
from dynid_rs.model.bodies import declared_bodies
from dynid_rs.model.export import urdf
from dynid_rs.model.physical import coulomb_viscous
from dynid_rs.regression.fitted import weighted_system
from dynid_rs.simulation import bundled_robot, simulate, typical_arm

LARGEST_GROWTH = 0.02
"""What the torque error of a run not fitted may grow by for the sake of bodies that could be built."""
ROUND_TRIP = 1e-9
"""A URDF's inertia is about the centre: one subtraction and one addition of the parallel axis."""
QUIET = 1e-3
"""Noise [N*m] of the runs whose bodies are known; what it does to parameters, relative to the largest, is as small."""


def physical(identifier, **options):
    return PhysicalIdentifier(**options).fit(
        identifier.observations_, identifier.links_, torque_unit=identifier.torque_unit_
    )


def with_set(identifier):
    model = identifier.model_
    return model.with_physical(physical(identifier).physical_set(model))


def least_eigenvalues(phi):
    return np.linalg.eigvalsh(_core.pseudo_inertia(phi))[:, 0]


@pytest.fixture(scope="module")
def six_axis():
    """The bundled arm, rigid and with rotor inertia: its robot file, and a model identified from simulated runs."""
    path = bundled_robot()
    robot = RobotModel.from_urdf(path)
    runs = simulate(typical_arm(robot).rigid(), n_runs=3, duration=10.0, rate=200.0, seed=3).recordings
    identifier = ThreeLoopIdentifier(robot, residual=None).fit(runs[:2])
    return path, identifier, with_set(identifier), [identifier.states(runs[2])]


@pytest.fixture(scope="module")
def ur10e():
    case = CASES["UR10e, currents"]
    path = data.data_file(case.folder)
    identifier, _ = identify(case)
    tests = [dyn.read_recording(data.data_file(case.folder, f"{name}.parquet"), identifier.robot) for name in case.test]
    return path, identifier, with_set(identifier), [identifier.states(recording) for recording in tests]


@pytest.fixture(scope="module")
def panda():
    case = CASES["Franka Panda, joint torque"]
    path = data.data_file(case.folder)
    identifier, _ = identify(case)
    return path, identifier, with_set(identifier), None


ARMS = ("six_axis", "ur10e", "panda")


@pytest.mark.parametrize("arm", ARMS)
@pytest.mark.parametrize("with_original", [True, False])
def test_every_exported_inertia_passes_the_checks_of_other_engines(arm, with_original, request):
    path, _, model, _ = request.getfixturevalue(arm)
    text = urdf(model, path if with_original else None)
    n = model.robot.n_joints
    assert least_eigenvalues(model.physical_phi).min() > 0
    assert accepted_by_pinocchio(text, n) == n
    assert accepted_by_mujoco(text) == n


@pytest.mark.parametrize("arm", ARMS)
@pytest.mark.parametrize("with_original", [True, False])
def test_the_written_urdf_gives_the_same_torque(arm, with_original, request):
    path, _, model, _ = request.getfixturevalue(arm)
    text = urdf(model, path if with_original else None).decode()
    back = RobotModel.from_urdf_string(text)
    states = random_states(50, back.n_joints, seed=5)
    expected = model.robot.inverse_dynamics(*states, model.physical_phi)
    assert_allclose(back.inverse_dynamics(*states), expected, rtol=0, atol=ROUND_TRIP * np.abs(expected).max())
    if not with_original:
        assert_allclose(back.rotor_inertia, model.physical.rotor_inertia, rtol=1e-15)


def test_torque_error_grows_by_two_percent_at_most_on_the_ur10e(ur10e):
    _, identifier, _, tests = ur10e
    fitted = physical(identifier)
    free = score(identifier.model_, tests).rmse
    assert np.all(score(fitted.torque_model(identifier.model_), tests).rmse <= (1 + LARGEST_GROWTH) * free)


def test_currents_get_their_common_gain_from_the_declared_inertials(ur10e):
    _, identifier, model, _ = ur10e
    gain = model.physical.drive_gain
    # Published: 14.87 13.26 11.13 10.62 11.03 11.47 and, by others, 10.00 10.70 8.46 9.00 9.48 10.12 [N*m/A].
    assert np.all((gain[:5] > 8) & (gain[:5] < 15))
    assert_allclose(gain[0] / gain, identifier.links_.torque_scale_, **ALGEBRAIC)
    masses, declared = model.physical_phi[::10], identifier.robot.phi[::10]
    assert np.all((masses[:-1] > 0.49 * declared[:-1]) & (masses[:-1] < 2.01 * declared[:-1]))


def test_bodies_of_a_simulated_arm_explain_its_torque(six_axis):
    """Simulated with bodies and noise: the free fit may follow the noise where no body could, and nothing else."""
    _, identifier, _, tests = six_axis
    free = score(identifier.model_, tests).rmse
    error = score(physical(identifier).torque_model(identifier.model_), tests).rmse
    assert np.all(error <= (1 + LARGEST_GROWTH) * free)


def test_what_the_torque_does_not_tell_stays_as_declared():
    """Runs of the declared bodies, hardly any noise: base parameters are met, the null space is the robot file's."""
    robot = RobotModel.from_urdf_string(URDF)
    _, links, observations = fit_to(robot, robot.phi)
    fitted = PhysicalIdentifier().fit(observations, links)
    assert_allclose(fitted.phi_, robot.phi, rtol=0, atol=QUIET * np.abs(robot.phi).max())


def test_a_wrong_robot_file_is_corrected_where_the_torque_tells():
    """Truth with other bodies than declared: base parameters follow the truth, the standard ones are bodies."""
    robot = RobotModel.from_urdf_string(URDF)
    true = robot.phi.reshape(-1, 10) * np.array([1.3, 0.7, 1.5])[:, None]
    _, links, observations = fit_to(robot, true.ravel())
    fitted = PhysicalIdentifier().fit(observations, links)
    base = robot.base_parameters()
    expected = base.project(true.ravel())
    assert_allclose(base.project(fitted.phi_), expected, rtol=0, atol=2e-3 * np.abs(expected).max())
    assert least_eigenvalues(fitted.phi_).min() > 0


def test_base_parameters_of_no_body_are_answered_with_a_body():
    """A torque that no body gives (a negative inertia of the last link): the answer is a body, and the error grows."""
    robot = RobotModel.from_urdf_string(URDF)
    impossible = robot.phi.copy()
    impossible[26] = -0.02  # Iyy of the hand, about the wrist's axis
    identified, links, observations = fit_to(robot, impossible)
    fitted = PhysicalIdentifier().fit(observations, links)
    assert least_eigenvalues(fitted.phi_).min() > 0
    free, forced = (score(model, identified[1]).rmse for model in (identified[0], fitted.torque_model(identified[0])))
    assert forced[2] > 2 * free[2]


def test_rotor_inertias_are_found_and_never_negative():
    robot = RobotModel.from_urdf_string(URDF)
    rotor = np.array([0.0, 0.5, 0.1])
    _, links, observations = fit_to(robot, robot.phi, rotor)
    fitted = PhysicalIdentifier().fit(observations, links)
    # Of shoulder and elbow nothing tells rotor and link apart: one sum, which the declared bodies divide.
    assert observations.plan.own[:, 0].tolist() == [False, False, True]
    assert_allclose(fitted.rotor_inertia_[2], rotor[2], atol=QUIET)
    whole = [fitted.rotor_inertia_[1] + fitted.phi_[16], rotor[1] + robot.phi[16]]
    assert_allclose(whole[0], whole[1], atol=5 * QUIET)
    _, links, observations = fit_to(robot, robot.phi, -rotor)
    assert PhysicalIdentifier().fit(observations, links).rotor_inertia_.min() >= 0


def test_coulomb_and_viscous_friction_come_back_from_a_model_that_has_no_other():
    """Of a law that is Coulomb plus viscous, with other coefficients backwards: the averages of both directions."""
    robot = RobotModel.from_urdf_string(URDF)
    coefficients = np.zeros((3, 8))
    coefficients[:, 0], coefficients[:, 1] = (1.0, 2.0, 3.0), (1.4, 2.0, 2.0)
    coefficients[:, 2], coefficients[:, 3] = (0.5, 0.6, 0.0), (0.7, 0.6, 0.0)
    effects = [(_core.Effect.friction([0.0] * 3, [1e-6] * 3), coefficients)]
    domain = ([[-1.0, 1.0]] * 3, [2.0] * 3, [1.0] * 3)
    model = _core.TorqueModel(robot, robot.phi, effects, encoder_delay=[0.0] * 3, noise_std=[0.0] * 3, domain=domain)
    damping, friction = coulomb_viscous(model)
    assert_allclose(damping, [0.6, 0.6, 0.0], atol=1e-9)
    assert_allclose(friction, [1.2, 2.0, 2.5], atol=1e-9)


def test_friction_of_an_export_is_all_of_it_whenever_the_channel_shows_it_and_however_warm_it_is():
    """Coulomb 3, viscous 2 by the law; a peak at low speed adds what least squares makes of it."""
    robot, n = RobotModel.from_urdf_string(URDF), 3
    law = {"coulomb_pos": 3.0, "coulomb_neg": 3.0, "viscous1_pos": 2.0, "viscous1_neg": 2.0}
    names = [f"{part}_{side}" for part in ("coulomb", "viscous1", "viscous2", "viscous3") for side in ("pos", "neg")]
    width = {"transition_width": np.full(n, 1e-6)}
    own = (_core.Effect.friction([0.0] * n, [1e-6] * n), np.tile([law.get(name, 0.0) for name in names], (n, 1)))
    at_rest = {name: np.full(n, law.get(name, 0.0)) for name in names}
    warm = _core.Effect.of("temperature_friction", reference_temperature=np.full(n, 30.0), **width, **at_rest)
    peak = _core.Effect.of("stribeck", stribeck_velocity=np.full(n, 0.5), exponent=np.ones(n), **width)

    def found(*more, delay=0.0):
        domain = ([[-1.0, 1.0]] * n, [2.0] * n, [1.0] * n)
        parts = {"encoder_delay": [0.0] * n, "noise_std": [0.0] * n, "domain": domain, "step": 0.004}
        model = _core.TorqueModel(robot, robot.phi, [own, *more], torque_delay=delay, **parts)
        return np.stack(coulomb_viscous(model))

    expected = np.outer([2.0, 3.0], np.ones(n))
    for delay in (0.02, -0.02, [0.0, 0.01, 0.03]):
        assert_allclose(found(delay=delay), expected, atol=1e-9)
    assert_allclose(found((warm, np.full((n, 1), -0.01))), expected, atol=1e-9)
    speed = 2.0 * (np.arange(50) + 0.5) / 50
    columns = np.column_stack([speed, np.ones(50)])
    added = np.linalg.lstsq(columns, 2.0 * np.exp(-speed / 0.5), rcond=None)[0]
    assert_allclose(found((peak, np.full((n, 2), 2.0))), expected + added[:, None], atol=1e-9)


def test_a_declared_body_without_extent_is_made_one():
    """Points and massless links in the robot file are no frame of reference; they are thickened, not refused."""
    robot = RobotModel.from_urdf_string(
        URDF.replace(
            'ixx="0.005" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"',
            'ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"',
        )
    )
    bodies = declared_bodies(robot)
    pseudo = bodies.roots @ bodies.roots.transpose(0, 2, 1)
    assert np.linalg.eigvalsh(pseudo)[:, 0].min() > 0
    assert_allclose(pseudo[:, 3, 3], robot.phi[::10], **ALGEBRAIC)
    assert_allclose(_core.phi_from_pseudo_inertia(pseudo)[:20], robot.phi[:20], **ALGEBRAIC)


def test_the_model_file_keeps_the_set_and_files_without_one_still_load(six_axis, tmp_path):
    _, identifier, model, _ = six_axis
    model.save(tmp_path / "with.json")
    back = dyn.TorqueModel.load(tmp_path / "with.json")
    for name in ("phi", "rotor_inertia", "damping", "friction", "drive_gain"):
        assert np.array_equal(getattr(back.physical, name), getattr(model.physical, name)), name
    identifier.model_.save(tmp_path / "without.json")
    assert "physical" not in json.loads((tmp_path / "without.json").read_text())
    assert dyn.TorqueModel.load(tmp_path / "without.json").physical is None
    assert identifier.model_.physical_phi is None


def test_a_set_that_is_no_body_is_refused():
    robot = RobotModel.from_urdf_string(URDF)
    good = {"damping": np.zeros(3), "friction": np.zeros(3), "drive_gain": np.ones(3)}
    dyn.PhysicalSet(robot.phi, np.zeros(3), **good)
    for spoiled in (
        {"phi": -robot.phi},
        {"phi": robot.phi[:-1]},
        {"rotor_inertia": [-1.0, 0.0, 0.0]},
        {"damping": [-1.0, 0.0, 0.0]},
        {"drive_gain": [0.0, 1.0, 1.0]},
    ):
        with pytest.raises(ValueError, match=next(iter(spoiled))):
            dyn.PhysicalSet(**{"phi": robot.phi, "rotor_inertia": np.zeros(3)} | good | spoiled)


def test_the_command_writes_set_section_and_sentence(tmp_path):
    robot, runs = write_robot(tmp_path), write_runs(tmp_path)
    printed = dynid("identify", robot, *runs[:2], "--test", runs[2], "-o", tmp_path / "out", "--physical")
    assert printed.exit_code in (0, 1), printed.output
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    validator().validate(result)
    section = result["physical"]
    assert section["reason"] in " ".join(printed.stdout.split())
    assert section["rmse_test_free"] == result["rmse"]["test"]["after"]
    assert [link["link"] for link in section["links"]] == ["upper", "fore", "hand"]
    model = dyn.TorqueModel.load(tmp_path / "out" / "model.json")
    assert_allclose(model.physical_phi[::10], [link["mass"] for link in section["links"]])
    assert section["drive_gain"] is None


def test_currents_without_declared_masses_are_refused_with_the_mend(tmp_path):
    import re

    from helpers.run_files import write

    robot = tmp_path / "robot.urdf"
    robot.write_text(re.sub(r"<inertial>.*?</inertial>", "", URDF, flags=re.S))
    runs = [write(tmp_path / f"run_{k}.parquet", as_current(run(k))) for k in range(2)]
    before = snapshot(tmp_path)
    sentence = refusal(dynid("identify", robot, *runs, "-o", tmp_path / "out", "--physical"))
    assert "declares no masses" in sentence
    assert "--drive-gain" in sentence
    assert snapshot(tmp_path) == before


def test_a_missing_library_is_named_with_the_mend(tmp_path, monkeypatch):
    robot, runs = write_robot(tmp_path), write_runs(tmp_path, n_runs=2)
    monkeypatch.setitem(sys.modules, "cvxpy", None)
    before = snapshot(tmp_path)
    sentence = refusal(dynid("identify", robot, *runs, "-o", tmp_path / "out", "--physical"))
    assert "cvxpy" in sentence
    assert "pip install 'dynid-rs[physical]'" in sentence
    assert snapshot(tmp_path) == before


@pytest.mark.parametrize("options", [{"growth": 0.0}, {"margin": 1.0}, {"mass_range": (2.0, 3.0)}])
def test_parameters_out_of_range_are_refused(options):
    robot = RobotModel.from_urdf_string(URDF)
    _, links, observations = fit_to(robot, robot.phi)
    with pytest.raises(ValueError, match=next(iter(options))):
        PhysicalIdentifier(**options).fit(observations, links)


@pytest.mark.parametrize("with_more", [False, True])
@pytest.mark.parametrize("weighting", [None, "joint_variance", "full_covariance"])
def test_the_system_is_the_one_that_the_fit_solved(weighting, with_more):
    """Normal equations of `weighted_system` vanish at the fit, whatever the weighting and what stands beside the runs.

    As the rows of a friction experiment do, of which the bodies' friction knew nothing.
    """
    robot = RobotModel.from_urdf_string(URDF)
    _, _, observations = fit_to(robot, robot.phi, noise=0.3)
    other = fit_to(robot, 1.1 * np.asarray(robot.phi), noise=0.1)[2]
    more = [RowGroup(other.factors(), other.n_counted)] if with_more else []
    links = LinkDynamicsIdentifier(weighting, prior=None).fit(observations, beside=more)
    system = weighted_system(observations, links)
    gradient = system[:, :-1].T @ (system[:, -1] - system[:, :-1] @ links.x_)
    size = np.linalg.norm(system[:, :-1], axis=0) * np.linalg.norm(system[:, -1])
    # Weights and covariance are those after the last solution, one step on: equal to the tolerance of the iteration.
    assert np.all(np.abs(gradient) <= 2e-3 * np.maximum(size, 1e-300))


def fit_to(robot, phi, rotor=0.0, noise=QUIET):
    """(model, states of the runs), fitted links and observations of runs with these bodies and rotors, no friction."""
    runs = simulate(typical_arm(robot).rigid(), n_runs=2, duration=6.0, rate=200.0, derivatives=True).recordings
    rng = np.random.default_rng(1)
    exact = []
    for recording in runs:
        tau = robot.inverse_dynamics(recording.q, recording.dq, recording.ddq, phi) + rotor * recording.ddq
        tau += noise * rng.standard_normal(tau.shape)
        exact.append(replace(recording, tau=tau, q_motor=None, dq_motor=None, ddq_motor=None))
    identifier = ThreeLoopIdentifier(robot, residual=None).fit(exact)
    return (identifier.model_, identifier.raw_runs_), identifier.links_, identifier.observations_


def test_what_is_not_identified_stays_as_it_was():
    """Compliance of the third loop, step and known terms come over: only phi and the fitted effects are the set's."""
    robot = RobotModel.from_urdf_string(URDF)
    rng = np.random.default_rng(0)
    mixture = _core.GaussianMixtureRegression([1.0], [[0.0, 0.0, 0.3]], [np.diag([1.0, 1.0, 0.1])])
    known = (_core.Effect.of("friction_hysteresis", presliding_distance=[1e-3] * 3), np.array([[1.0], [0.0], [2.0]]))
    model = _core.TorqueModel(
        robot,
        robot.phi,
        [(_core.Effect.torque_offset(), np.array([[0.1], [0.2], [0.3]])), known],
        residual=("load_free_deflection", [mixture] * 3),
        compliance=[1e-2] * 3,
        encoder_delay=[1e-3] * 3,
        noise_std=[0.1] * 3,
        domain=([[-1.0, 1.0]] * 3, [2.0] * 3, [1.0] * 3),
        step=0.004,
    )
    fitted = PhysicalIdentifier()
    fitted.phi_, fitted._channel_phi, fitted.own_ = robot.phi, robot.phi, np.array([[0.1], [0.2], [0.3]])
    states = [rng.uniform(-1, 1, (20, 3)) for _ in range(6)]
    for ours, theirs in zip(fitted.torque_model(model).evaluate(*states), model.evaluate(*states), strict=True):
        assert_allclose(ours, theirs, **EXACT)
