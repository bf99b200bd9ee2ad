"""The robot file's inertials as a prior: the algebra, the weight that the evidence gives it, what it is good for."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import data
import numpy as np
import pytest
from small_arm import URDF, dynid, refusal, write_robot, write_runs
from threadpoolctl import threadpool_limits
from tolerances import ALGEBRAIC

from dynid_rs import RobotModel, _core, read_recording
from dynid_rs.columns import Block, Observations, observe
from dynid_rs.evidence import FRICTION_SPREAD, _Problem, fit_with_prior
from dynid_rs.friction import friction_effect
from dynid_rs.identification import ThreeLoopIdentifier
from dynid_rs.links import ASYMMETRY, LinkDynamicsIdentifier
from dynid_rs.loops import declared_plan
from dynid_rs.memory import column_memory, inflation
from dynid_rs.preprocessing import Band, prepare
from dynid_rs.priors import inertial_prior
from dynid_rs.simulation import bundled_robot, simulate, typical_arm
from dynid_rs.uncertainty import NORMAL_95, parameter_covariance

FLAT = 1e6
"""Relative uncertainty that stands for none at all."""


def spread_of(phi):
    """Plain relative uncertainty of the links' parameters, written out once more."""
    spread = []
    for link in np.reshape(phi, (-1, 10)):
        m, h, inertia = link[0], link[1:4], link[4:]
        size = max(np.sqrt((inertia[0] + inertia[2] + inertia[5]) / (2 * m)), np.linalg.norm(h) / m) if m > 0 else 0.0
        spread += [m] + 3 * [m * size] + 6 * [m * size**2]
    return np.array(spread)


def arm_and_plan(robot):
    arm = replace(typical_arm(robot, noise=1.0).rigid(), delay=0.0)
    shape = friction_effect(np.array(arm.velocity_threshold), np.array(arm.transition_width))
    return arm, declared_plan(robot, shape)


def regrouping(robot):
    base = robot.base_parameters()
    return np.array([base.project(unit) for unit in np.eye(len(robot.phi))]).T


@pytest.fixture(scope="module")
def six_axes():
    """Rigid six-axis arm, short runs without noise: robot, arm, plan, states of four runs of 6 s."""
    robot = RobotModel.from_urdf(bundled_robot())
    arm, plan = arm_and_plan(robot)
    quiet = replace(arm, noise_std=np.zeros(6), link_resolution=np.zeros(6), motor_resolution=np.zeros(6))
    recordings = simulate(quiet, n_runs=4, duration=6.0, rate=250.0, seed=5, derivatives=True).recordings
    return robot, arm, plan, [prepare(recording, Band(5.0), 250.0) for recording in recordings]


def observed(plan, runs, dphi, noise, rng):
    """Observations of an arm whose links differ by `dphi` from the file, with white noise; one block per run."""
    torque = [
        states.tau
        + plan.robot.inverse_dynamics(states.q, states.dq, states.ddq, dphi)
        + rng.normal(size=states.tau.shape) * noise
        for states in runs
    ]
    return observe(plan, runs, torque)


def true_unknowns(plan, arm, phi):
    base = plan.robot.base_parameters().project(phi)
    for (j, column), share in plan.absorbed.items():
        base = base + share * (arm.rotor_inertia[j] if column == 0 else arm.torque_offset[j])
    return np.concatenate([base, np.column_stack([arm.rotor_inertia, arm.torque_offset, arm.friction]).ravel()])


def torque_error(observations, x):
    """RMS per joint of what x leaves on runs without noise."""
    plan = observations.plan
    left = [
        np.concatenate([b.rows[j][:, -1] - b.rows[j][:, :-1] @ x[plan.unknowns(j)] for b in observations.blocks])
        for j in range(plan.robot.n_joints)
    ]
    return np.sqrt(np.mean(np.square(left), axis=1))


# --- algebra ---------------------------------------------------------------------------------------------------------


def test_the_prior_is_the_regrouped_covariance_of_the_links():
    robot = RobotModel.from_urdf(bundled_robot(), rotor_inertia=[2.0, 3.0, 2.0, 0.4, 0.3, 0.2])
    _, plan = arm_and_plan(robot)
    prior, K, n = inertial_prior(plan), regrouping(robot), plan.n_base
    spreads = (0.2, 0.5)
    rows, log_det = prior.rows(spreads)
    covariance = np.zeros((n + 6, n + 6))
    covariance[:n, :n] = K @ np.diag((spreads[0] * spread_of(robot.phi)) ** 2) @ K.T
    mean = np.concatenate([K @ robot.phi, np.zeros(6)])
    for j, inertia in enumerate(robot.rotor_inertia):
        direction = np.zeros(n + 6)
        direction[:n] = plan.absorbed.get((j, 0), np.zeros(n))
        direction[n + j] = plan.own[j, 0]
        covariance += np.outer(direction, direction) * (spreads[1] * inertia) ** 2
        mean += direction * inertia
    used = np.concatenate([np.arange(n), n + np.flatnonzero(plan.own[:, 0])])
    places = np.concatenate([np.arange(n), n + plan.n_own * np.flatnonzero(plan.own[:, 0])])
    covariance = covariance[np.ix_(used, used)]
    precision = rows[:, places].T @ rows[:, places]
    scale = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(
        precision * np.outer(scale, scale) @ (covariance / np.outer(scale, scale)), np.eye(len(used)), atol=1e-6
    )
    np.testing.assert_allclose(prior.mean[places], mean[used], **ALGEBRAIC)
    np.testing.assert_allclose(prior.std(spreads)[places], scale, rtol=1e-8)
    # span is a rotation here, so the determinant is that of the covariance itself
    assert log_det == pytest.approx(np.linalg.slogdet(covariance)[1], rel=1e-8)
    assert prior.rank == len(used)


def test_a_link_that_is_not_declared_has_no_prior():
    start = URDF.index('<link name="fore"><inertial>')
    end = URDF.index("</inertial>", start) + len("</inertial>")
    robot = RobotModel.from_urdf_string(URDF[:start] + '<link name="fore">' + URDF[end:])
    _, plan = arm_and_plan(robot)
    prior, K = inertial_prior(plan), regrouping(robot)
    spread = np.array(spread_of(robot.phi))
    assert np.all(spread[10:20] == 0)
    rows, _ = prior.rows((1.0,))
    # Whatever the second link and the rotors may be, the distance does not change.
    free = np.zeros((plan.n_columns, 10))
    free[: plan.n_base] = K[:, 10:20]
    assert np.abs(rows[:, :-1] @ free).max() <= 1e-9 * np.abs(rows[:, :-1]).max()
    # Elsewhere it is the limit of a huge spread.
    huge = np.where(spread > 0, spread, 1e4)
    covariance = K @ np.diag(huge**2) @ K.T
    for share in plan.absorbed.values():
        covariance += np.outer(share, share) * 1e8
    limit = np.linalg.inv(covariance)
    base = rows[:, : plan.n_base]
    np.testing.assert_allclose(base.T @ base, limit, atol=1e-4 * np.abs(limit).max())
    assert 0 < prior.rank < plan.n_base


def test_the_evidence_is_the_normal_density_of_the_data():
    robot = RobotModel.from_urdf_string(URDF)
    arm, plan = arm_and_plan(robot)
    recording = simulate(arm, n_runs=1, duration=4.0, rate=100.0, seed=2, derivatives=True).recordings[0]
    observations = observe(plan, [prepare(recording, Band(5.0), 100.0)])
    n_rows, factors, prior = observations.n_rows, observations.factors(), inertial_prior(plan)
    problem = _Problem(plan, factors, np.ones(3), prior, n_rows, np.full(3, float(n_rows)), np.full(3, 1e-9))
    size = np.array([np.linalg.norm(R[:, -1]) / np.sqrt(n_rows) for R in factors])
    used = plan.estimable()
    names = [name for effect in plan.effects for name in effect.coefficient_names]
    difference = []
    for spread in (0.05, 0.2, 1.0):
        point = problem.at(np.array([spread]), size)
        # every row as it is, unknowns with their covariance written out, flat ones with a huge one
        rows = [np.concatenate([b.rows[j] for b in observations.blocks]) for j in range(3)]
        C = np.zeros((3 * n_rows, plan.n_columns))
        for j in range(3):
            C[j * n_rows : (j + 1) * n_rows, plan.unknowns(j)] = rows[j][:, :-1]
        tau = np.concatenate([r[:, -1] for r in rows])
        K = regrouping(robot)
        covariance, mean = np.zeros((plan.n_columns, plan.n_columns)), np.zeros(plan.n_columns)
        covariance[: plan.n_base, : plan.n_base] = K @ np.diag((spread * spread_of(robot.phi)) ** 2) @ K.T
        for share in plan.absorbed.values():
            covariance[: plan.n_base, : plan.n_base] += np.outer(share, share) * 1e3**2
        mean[: plan.n_base] = K @ robot.phi
        for j in range(3):
            for k, name in enumerate(names):
                place = plan.n_base + j * plan.n_own + k
                norm = np.linalg.norm(rows[j][:, k])
                usual = FRICTION_SPREAD * np.linalg.norm(rows[j][:, -1]) / norm if norm > 0 else 0.0
                covariance[place, place] = (usual if name.startswith("viscous") else 1e3) ** 2 * used[place]
            pair = [plan.n_base + j * plan.n_own + names.index(name) for name in ("coulomb_pos", "coulomb_neg")]
            # Their difference has a prior, their mean has none.
            apart = (ASYMMETRY * size[j]) ** 2 / 4
            covariance[np.ix_(pair, pair)] = 1e3**2 + apart * np.array([[1.0, -1.0], [-1.0, 1.0]])
        total = C @ covariance @ C.T + np.diag(np.repeat(point.noise_std**2, n_rows))
        root = np.linalg.cholesky(total)
        distance = np.sum(np.linalg.solve(root, tau - C @ mean) ** 2)
        difference.append(point.evidence + distance / 2 + np.sum(np.log(np.diag(root))))
    # one constant for all: that of the unknowns without a prior, which stand here with a finite one
    assert np.ptp(difference) <= 0.05, difference


def test_rows_count_as_the_independent_samples_they_are_worth():
    rng = np.random.default_rng(0)
    n, pole = 20000, 0.8
    white = rng.normal(size=n)
    red = np.zeros(n)
    for k in range(1, n):
        red[k] = pole * red[k - 1] + white[k]
    columns = np.column_stack([np.ones(n), np.sin(np.arange(n) * 0.05), np.cos(np.arange(n) * 0.3)])
    memory = column_memory([columns])
    assert inflation([white], memory) == pytest.approx(1.0, abs=0.1)
    # the spectrum of first-order noise over its variance, at the columns' three frequencies
    spectrum = [(1 - pole**2) / (1 + pole**2 - 2 * pole * np.cos(w)) for w in (0.0, 0.05, 0.3)]
    assert inflation([red], memory) == pytest.approx(np.mean(spectrum), rel=0.15)


# --- what it is good for ---------------------------------------------------------------------------------------------


def test_a_short_run_gains_from_the_prior_and_its_intervals_hold(six_axes):
    """Arms that differ from their file by a fifth: left-out error against no prior, and coverage."""
    robot, arm, plan, runs = six_axes
    rng = np.random.default_rng(1)
    used, inside, ratios, spreads = plan.estimable(), [], [], []
    with threadpool_limits(1):
        for _ in range(25):
            dphi = 0.2 * spread_of(robot.phi) * rng.normal(size=len(robot.phi))
            noise = np.asarray(arm.noise_std)
            lone = observed(plan, runs[:1], dphi, noise, rng)
            left_out = observed(plan, runs[3:], dphi, 0 * noise, rng)
            fitted = LinkDynamicsIdentifier(prior="robot").fit(lone)
            without = LinkDynamicsIdentifier(prior=None).fit(lone)
            ratios.append(torque_error(left_out, fitted.x_) / torque_error(left_out, without.x_))
            spreads.append(fitted.posterior_.relative_uncertainty[0])
            std = np.sqrt(np.diag(parameter_covariance(lone, fitted, runs[:1], fitted_widths=False)))
            truth = true_unknowns(plan, arm, robot.phi + dphi)
            inside.append((np.abs(fitted.x_ - truth) <= NORMAL_95 * std)[used])
    ratios = np.array(ratios)
    hits = np.mean(inside, axis=0)
    mean, better = np.exp(np.mean(np.log(ratios))), np.mean(np.mean(np.log(ratios), axis=1) < 0)
    base, own = hits[: plan.n_base].mean(), hits[plan.n_base :].mean()
    print(f"left-out error with over without: {mean:.3f}, better {better:.2f}, coverage {base:.3f} {own:.3f}")
    print(f"relative uncertainty, truth 0.2: {np.percentile(spreads, [10, 50, 90]).round(3)}")
    assert mean <= 0.85
    assert better >= 0.9
    assert 0.92 <= base <= 0.99
    assert own >= 0.90
    assert 0.1 <= np.median(spreads) <= 0.4


@pytest.fixture(scope="module")
def rich(six_axes):
    """Two minutes of the same arm, links off by a tenth: observations, true torque on another run."""
    robot, arm, plan, _ = six_axes
    quiet = replace(arm, noise_std=np.zeros(6), link_resolution=np.zeros(6), motor_resolution=np.zeros(6))
    recordings = simulate(quiet, n_runs=5, duration=30.0, rate=250.0, seed=9, derivatives=True).recordings
    runs = [prepare(recording, Band(5.0), 250.0) for recording in recordings]
    rng = np.random.default_rng(4)
    dphi = 0.1 * spread_of(robot.phi) * rng.normal(size=len(robot.phi))
    noise = np.asarray(arm.noise_std)
    return observed(plan, runs[:4], dphi, noise, rng), observed(plan, runs[4:], dphi, 0 * noise, rng)


def test_with_rich_data_the_weight_hardly_matters(rich):
    observations, left_out = rich
    with threadpool_limits(1):
        best = fit_with_prior(observations)
        errors = [
            torque_error(left_out, fit_with_prior(observations, spreads=factor * best.spreads).x)
            for factor in (0.3, 1.0, 3.0)
        ]
        without = torque_error(left_out, LinkDynamicsIdentifier(prior=None, ridge=0.0).fit(observations).x_)
    std = np.sqrt(np.mean([np.concatenate([b.rows[j][:, -1] for b in left_out.blocks]) ** 2 for j in range(6)], axis=1))
    for error in (*errors, without):
        assert np.all(error <= 0.01 * std), error / std
    assert np.all(errors[0] <= errors[1] + 0.002 * std)
    assert np.all(errors[2] <= errors[1] + 0.002 * std)


def test_a_wrong_prior_is_overruled_by_rich_data(rich):
    observations, left_out = rich
    robot = observations.plan.robot
    text = Path(bundled_robot()).read_text(encoding="utf-8")
    heavy = re.sub(r'<mass value="([^"]+)"', lambda m: f'<mass value="{2 * float(m[1])!r}"', text)
    wrong = RobotModel.from_urdf_string(heavy)
    assert np.allclose(np.asarray(wrong.phi)[::10], 2 * np.asarray(robot.phi)[::10])
    believed = Observations(replace(observations.plan, robot=wrong), observations.blocks)
    with threadpool_limits(1):
        fitted, right = fit_with_prior(believed), fit_with_prior(observations)
    std = np.sqrt(np.mean([np.concatenate([b.rows[j][:, -1] for b in left_out.blocks]) ** 2 for j in range(6)], axis=1))
    assert fitted.relative_uncertainty[0] > 2 * right.relative_uncertainty[0]
    assert np.all(torque_error(left_out, fitted.x) <= 0.01 * std)


def test_in_ampere_the_gain_of_the_prior_is_found(six_axes):
    robot, arm, plan, runs = six_axes
    rng = np.random.default_rng(6)
    dphi = 0.1 * spread_of(robot.phi) * rng.normal(size=len(robot.phi))
    in_torque = observed(plan, runs[:3], dphi, np.asarray(arm.noise_std), rng)
    gain = 0.08
    blocks = [
        Block(
            b.run,
            rows := [np.column_stack([r[:, :-1], gain * r[:, -1]]) for r in b.rows],
            [_core.triangular_factor(r) for r in rows],
        )
        for b in in_torque.blocks
    ]
    with threadpool_limits(1):
        known = fit_with_prior(in_torque)
        found = fit_with_prior(Observations(plan, blocks), unknown_gain=True)
    assert found.gain == pytest.approx(gain, rel=0.1)
    assert found.relative_uncertainty[0] == pytest.approx(known.relative_uncertainty[0], rel=0.3)
    np.testing.assert_allclose(found.x / gain, known.x, atol=0.05 * np.abs(known.x).max())


def test_a_lone_run_without_declared_inertials_keeps_the_ridge(six_axes):
    robot, _, _, runs = six_axes
    bare = RobotModel.from_urdf_string(
        re.sub(r"<inertial>.*?</inertial>", "", Path(bundled_robot()).read_text(encoding="utf-8"), flags=re.S)
    )
    assert not np.any(bare.phi)
    _, plan = arm_and_plan(robot)
    observations = observe(replace(plan, robot=bare), runs[:1])
    auto, none = (LinkDynamicsIdentifier(prior=prior).fit(observations) for prior in ("auto", None))
    np.testing.assert_array_equal(auto.x_, none.x_)
    assert auto.posterior_ is None
    with pytest.raises(ValueError, match="declares no link's inertia"):
        LinkDynamicsIdentifier(prior="robot").fit(observations)


def test_several_runs_stand_alone_by_default(six_axes):
    _, _, plan, runs = six_axes
    observations = observe(plan, runs[:2])
    auto, none = (LinkDynamicsIdentifier(prior=prior).fit(observations) for prior in ("auto", None))
    np.testing.assert_array_equal(auto.x_, none.x_)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"prior": "cad"}, "prior must be"),
        ({"prior": "robot", "weighting": None}, "weighed against the noise"),
        ({"prior": "robot", "ridge": 0.1}, "replaces the ridge"),
    ],
)
def test_priors_that_make_no_sense_are_refused(six_axes, arguments, words):
    _, _, plan, runs = six_axes
    with pytest.raises(ValueError, match=words):
        LinkDynamicsIdentifier(**arguments).fit(observe(plan, runs[:1]))


def test_full_covariance_goes_with_a_prior(six_axes):
    robot, arm, plan, runs = six_axes
    rng = np.random.default_rng(3)
    noise = np.asarray(arm.noise_std)
    lone = observed(plan, runs[:1], 0.1 * spread_of(robot.phi) * rng.normal(size=len(robot.phi)), noise, rng)
    full, simple = (LinkDynamicsIdentifier(w, prior="robot").fit(lone) for w in ("full_covariance", "joint_variance"))
    std = np.sqrt(np.diag(parameter_covariance(lone, full, runs[:1], fitted_widths=False)))
    shift = np.abs(full.x_ - simple.x_)[std > 0] / std[std > 0]
    assert shift.max() < 1


# --- the command -----------------------------------------------------------------------------------------------------


def test_the_command_says_which_prior_and_weight_it_used(tmp_path):
    import jsonschema

    robot, runs = write_robot(tmp_path), write_runs(tmp_path)
    printed = dynid("identify", robot, runs[0], "--test", runs[2], "--prior", "robot", "-o", tmp_path / "out")
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    jsonschema.validate(result, json.loads((data.ROOT / "docs" / "result.schema.json").read_text()))
    prior = result["prior"]
    assert prior["kind"] == "robot"
    assert 0 < prior["relative_uncertainty"]["links"] < 1  # the file is the truth here
    assert prior["relative_uncertainty"]["rotors"] is None
    assert 0 < prior["n_determined"] <= prior["n_directions"]
    assert all(n <= prior["n_rows"] for n in prior["n_effective"])
    for entry in prior["moved"]:
        assert entry["shift"] == pytest.approx((entry["value"] - entry["declared"]) / entry["std"])
    words = " ".join(printed.stdout.split())
    assert "inertials stand beside the data as if off by" in words
    assert "stand beside the data as a prior" in (tmp_path / "out" / "report.html").read_text()
    assert dynid("report", tmp_path / "out").exit_code == 0
    dynid("identify", robot, runs[0], "--test", runs[2], "--prior", "none", "-o", tmp_path / "none")
    assert json.loads((tmp_path / "none" / "result.json").read_text())["prior"] is None


def test_rotors_of_the_config_are_declared(tmp_path):
    robot, runs = write_robot(tmp_path), write_runs(tmp_path)
    config = tmp_path / "dynid.toml"
    config.write_text("[motor]\nrotor_inertia = [0.4, 0.3, 0.1]\n")
    dynid("identify", robot, runs[0], "--test", runs[2], "--prior", "robot", "--config", config, "-o", tmp_path / "out")
    prior = json.loads((tmp_path / "out" / "result.json").read_text())["prior"]
    assert prior["relative_uncertainty"]["rotors"] > 0
    model = json.loads((tmp_path / "out" / "model.json").read_text())
    assert "0.4" in json.dumps(model)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("rotor_inertia = [1.0, 2.0]", "must be one number or 3"),
        ("rotor_inertia = -1.0", "at least 0"),
        ("inertia = 1.0", "not known"),
        ("rotor_inertia = 'big'", "must be a number"),
    ],
)
def test_rotors_that_make_no_sense_are_refused(tmp_path, line, words):
    robot, runs = write_robot(tmp_path), write_runs(tmp_path, n_runs=1)
    config = tmp_path / "dynid.toml"
    config.write_text(f"[motor]\n{line}\n")
    sentence = refusal(dynid("identify", robot, *runs, "--config", config, "-o", tmp_path / "out"))
    assert words in sentence
    assert "[motor]" in sentence
    assert not (tmp_path / "out").exists()


def test_an_unknown_prior_is_refused(tmp_path):
    robot, runs = write_robot(tmp_path), write_runs(tmp_path, n_runs=1)
    assert "--prior must be auto, robot or none" in refusal(
        dynid("identify", robot, *runs, "--prior", "cad", "-o", tmp_path / "out")
    )


# --- the KUKA with its hydraulic counterbalance ----------------------------------------------------------------------

KUKA_GEAR = np.array([1798 / 7, 1872 / 7, 757 / 3, 221, 5032 / 21, 206793 / 1340])
KUKA_ROTOR = np.array([0.00923, 0.0118, 0.0118, 0.00173, 0.00173, 0.00173])
"""Rotors [kg m^2] of the authors' model, before the gears."""
AXIS_2 = 1


def authors_counterbalance(q):
    """Torque [N m] of the authors' hydraulic counterbalance, as their README writes it."""
    D, k, Z, R, T = 0.8, 0.2, 1.01, 296.8, 328.0
    area = np.pi / 4 * (0.055**2 - 0.030**2)
    m, V = 2 * 0.0795, 2 * 0.48e-3
    delta = q + np.deg2rad(95)
    dl = np.sqrt(D**2 + k**2 - 2 * D * k * np.cos(delta)) - (D - k)
    h = D * k * np.sin(delta) / (dl + D - k)
    return h * area * Z * R * T * m / (V - dl * area)


def kuka_terms():
    """The same as a term of the catalogue: cos(q + phase) = -cos(q + 95 deg), gas length V / A, coefficient Z R T m."""
    area = np.pi / 4 * (0.055**2 - 0.030**2)
    shape = {"a": 0.8, "b": 0.2, "phase": np.deg2rad(95) - np.pi, "gas_length": 2 * 0.48e-3 / area}
    return shape, 1.01 * 296.8 * 328.0 * 2 * 0.0795


@pytest.fixture(scope="module")
def kuka(tmp_path_factory):
    """result.json of `dynid identify` with a prior or none, the counterbalance known, and what was printed."""
    folder = tmp_path_factory.mktemp("kuka")
    shape, coefficient = kuka_terms()
    lines = [f"{name} = {float(value)!r}" for name, value in {**shape, "counterbalance": coefficient}.items()]
    (folder / "terms.toml").write_text(
        "\n".join(["[[term]]", 'kind = "counterbalance"', f"joint = {AXIS_2}", *lines, ""])
    )
    (folder / "dynid.toml").write_text(f"[motor]\nrotor_inertia = {(KUKA_ROTOR * KUKA_GEAR**2).tolist()}\n")
    files = [data.data_file("kuka_kr300_weigand", name) for name in ("robot.urdf", "traj_A.parquet", "traj_B.parquet")]
    results = {}
    for prior in ("robot", "none"):
        printed = dynid(
            "identify", files[0], files[1], "--test", files[2], "--prior", prior, "--known", folder / "terms.toml",
            "--config", folder / "dynid.toml", "-o", folder / prior,
        )  # fmt: skip
        results[prior] = json.loads((folder / prior / "result.json").read_text()), printed.stdout, folder / prior
    return results


def test_the_term_is_the_authors_formula():
    shape, coefficient = kuka_terms()
    q = np.linspace(-2.3, 0.3, 200)[:, None]
    effect = _core.Effect.of("counterbalance", **{name: [value] for name, value in shape.items()})
    tau = _core.effect_torque(effect, [[coefficient]], q, 0 * q, 0 * q)
    np.testing.assert_allclose(tau[:, 0], authors_counterbalance(q[:, 0]), rtol=1e-10, atol=1e-8)
    assert np.ptp(tau) > 4000


def test_with_the_prior_the_counterbalance_takes_axis_2_from_above_80_to_below_35_percent(kuka):
    result = kuka["robot"][0]
    (entry,) = result["known"]
    std = result["rmse"]["test"]["torque_std"][AXIS_2]
    errors = {key: value / std for key, value in entry["rmse_test_with_prior"].items()}
    print(errors, result["prior"]["relative_uncertainty"])
    assert errors["without_same_weight"] > 0.8
    assert errors["with"] < 0.35
    assert result["rmse"]["test"]["after"][AXIS_2] / std < 0.35
    # The evidence alone, without the term, loosens the prior until base parameters imitate it.
    assert errors["with"] < errors["without"] < errors["without_same_weight"]
    off = entry["relative_uncertainty"]
    assert off["with"] == off["without_same_weight"] < 0.3
    assert off["without"] > 2 * off["with"]
    assert entry["with_prior"]["separable"]
    # the other axes do not pay for it
    assert np.all(np.array(result["rmse"]["test"]["after"]) <= 0.5 * np.array(result["rmse"]["test"]["torque_std"]))


def test_without_the_prior_the_tool_says_that_the_data_cannot_separate_it(kuka):
    result, printed, _ = kuka["none"]
    (entry,) = result["known"]
    assert not entry["data_alone"]["separable"]
    assert entry["data_alone"]["share"] < 1e-5
    assert entry["data_alone"]["std_error"] > 1
    (finding,) = [f for f in result["data"]["findings"] if f["code"] == "not_separable"]
    assert finding["severity"] == "warning"
    words = "his data cannot separate the counterbalance of joint_2 from the base parameters"
    assert words in finding["message"]
    assert words in result["verdict"]
    assert words in " ".join(printed.split())
    # and so it is: without a prior the term changes nothing
    bare = entry["rmse_test_alone"]
    assert abs(bare["with"] / bare["without"] - 1) < 0.1


def test_with_the_prior_it_says_what_the_prior_is_for(kuka):
    result, printed, folder = kuka["robot"]
    words = "ithout the prior, this data cannot separate the counterbalance of joint_2"
    assert words in result["verdict"]
    assert "without it under the same weight of the prior" in " ".join(printed.split())
    assert "Known terms" in (folder / "report.html").read_text()


def test_the_saved_model_has_the_counterbalance(kuka, tmp_path):
    folder = kuka["robot"][2]
    model = _core.TorqueModel.load(folder / "model.json")
    assert "counterbalance" in model.term_names
    run_b = data.data_file("kuka_kr300_weigand", "traj_B.parquet")
    printed = dynid("estimate", folder / "model.json", run_b, "-o", tmp_path / "torques.parquet")
    assert printed.exit_code == 0, printed.output


def test_the_default_prefers_the_prior_on_the_kuka_by_its_training_run_alone():
    robot = RobotModel.from_urdf(data.data_file("kuka_kr300_weigand"))
    train, test = (read_recording(data.data_file("kuka_kr300_weigand", f"traj_{name}.parquet"), robot) for name in "AB")
    errors = []
    for prior in ("auto", None):
        identifier = ThreeLoopIdentifier(robot, links=LinkDynamicsIdentifier(prior=prior), residual=None).fit(train)
        assert (identifier.links_.posterior_ is not None) == (prior == "auto")
        states = identifier.states(test)
        left = states.in_band(states.tau - identifier.model_.evaluate(*states.signals())[0])
        errors.append(np.sqrt(np.mean(left**2, axis=0)))
    print("error with over without the prior", (errors[0] / errors[1]).round(2))
    assert np.exp(np.mean(np.log(errors[0] / errors[1]))) < 0.75
