"""Effects: literal formulas, the catalogue, one road from a fit to the control loop."""

import itertools

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from robots import random_chain
from tolerances import ALGEBRAIC, EXACT

from dynid_rs import _core

N, N_SAMPLES = 3, 600
CATALOGUE = {entry["kind"]: entry for entry in _core.effect_catalogue()}
SHAPES = {
    "rotor_inertia": {},
    "torque_offset": {},
    "friction": {"velocity_threshold": [0.0, 0.05, 0.1], "transition_width": [0.01, 0.02, 0.03]},
    "stribeck": {
        "stribeck_velocity": [0.1, 0.3, 1.0],
        "exponent": [1.0, 2.0, 0.7],
        "transition_width": [0.01, 0.02, 0.03],
    },
    "counterbalance": {
        "a": [0.8, 0.3, 1.0],
        "b": [0.2, 0.7, 0.5],
        "phase": [0.4, -2.0, 3.0],
        "gas_length": [0.6, 0.9, -0.3],
    },
}
"""One valid shape of every kind, another on every joint."""


def signals(seed=0, n_samples=N_SAMPLES, n=N):
    """Six signals of a smooth run with two encoders, (n_samples, n) each."""
    rng = np.random.default_rng(seed)
    t = np.arange(n_samples)[:, None] * 0.004
    amplitude, rate, phase = rng.uniform(0.3, 1.5, n), rng.uniform(1.0, 4.0, n), rng.uniform(0, 6, n)
    angle = rate * t + phase
    link = [amplitude * np.sin(angle), amplitude * rate * np.cos(angle), -amplitude * rate**2 * np.sin(angle)]
    return [*link, *(x + 1e-3 * np.sin(angle + k) for k, x in enumerate(link))]


def three_joints():
    chain = random_chain(1)
    assert chain.n_joints == N
    return _core.RobotModel.from_urdf_string(chain.urdf, gravity=chain.gravity)


def effect_of(kind):
    return _core.Effect.of(kind, **SHAPES[kind])


def per_joint(kind, function):
    """`function(shape of joint j by name, j)` side by side."""
    names = list(SHAPES[kind])
    return np.stack([function({x: SHAPES[kind][x][j] for x in names}, j) for j in range(N)], axis=1)


def stribeck(shape, dq):
    """Literal: one column per direction."""
    size = np.tanh(dq / shape["transition_width"]) * np.exp(
        -((np.abs(dq) / shape["stribeck_velocity"]) ** shape["exponent"])
    )
    return np.stack([np.where(dq >= 0, size, 0), np.where(dq < 0, size, 0)], axis=-1)


def test_stribeck_is_the_formula():
    q, dq, ddq, q_motor, dq_motor, ddq_motor = signals()
    dq_motor[:4] = [[0.0] * N, [1e-3] * N, [-1e-3] * N, [5.0] * N]
    columns = _core.effect_columns(effect_of("stribeck"), q, dq, ddq, q_motor, dq_motor, ddq_motor)
    assert_allclose(columns, per_joint("stribeck", lambda shape, j: stribeck(shape, dq_motor[:, j])), **ALGEBRAIC)


def kuka_quantec(q):
    """Hydraulic weight counterbalance of a KUKA Quantec as its authors print it (Weigand, 2021) [N m]."""
    D, k = 0.8, 0.2
    A = np.pi / 4 * (0.055**2 - 0.030**2)
    Z, R, T, m, V = 1.01, 296.8, 328.0, 2 * 0.0795, 2 * 0.48e-3
    delta = q + np.deg2rad(95)
    dl = np.sqrt(D**2 + k**2 - 2 * D * k * np.cos(delta)) - (D - k)
    h = D * k * np.sin(delta) / (dl + D - k)
    return h * A * Z * R * T * m / (V - dl * A)


def test_counterbalance_is_the_cylinder_of_a_real_robot():
    q = np.zeros((500, N))
    q[:, 1] = np.linspace(-np.pi, np.pi, 500)
    area = np.pi / 4 * (0.055**2 - 0.030**2)
    cylinder = {"a": 0.8, "b": 0.2, "phase": np.deg2rad(95) + np.pi, "gas_length": 2 * 0.48e-3 / area}
    effect = _core.Effect.of("counterbalance", **{name: [value] * N for name, value in cylinder.items()})
    coefficients = np.zeros((N, 1))
    coefficients[1] = 1.01 * 296.8 * 328.0 * 2 * 0.0795  # Z R T m
    tau = _core.effect_torque(effect, coefficients, q, q, q)
    expected = kuka_quantec(q[:, 1])
    assert np.ptp(expected) > 8e3
    assert_allclose(tau[:, 1], expected, rtol=1e-12, atol=1e-9)
    assert_array_equal(tau[:, [0, 2]], 0.0)


def test_counterbalance_is_the_work_of_its_gas():
    """Torque is the slope of the isothermal gas's energy, -c ln(gas column), by complex step; both ways of working."""
    q = np.tile(np.linspace(-3, 3, 200)[:, None], (1, N))
    columns = _core.effect_columns(effect_of("counterbalance"), q, q, q)[:, :, 0]

    def energy(shape, q):
        a, b = shape["a"], shape["b"]
        stroke = np.sqrt(a**2 + b**2 + 2 * a * b * np.cos(q + shape["phase"])) - abs(a - b)
        gas = shape["gas_length"] - stroke if shape["gas_length"] > 0 else -shape["gas_length"] + stroke
        return -np.log(gas)

    step = 1e-30
    expected = per_joint("counterbalance", lambda shape, j: energy(shape, q[:, j] + 1j * step).imag / step)
    assert_allclose(columns, expected, **ALGEBRAIC)
    doubled = {name: [2 * x if name != "phase" else x for x in v] for name, v in SHAPES["counterbalance"].items()}
    again = _core.effect_columns(_core.Effect.of("counterbalance", **doubled), q, q, q)
    assert_allclose(again[:, :, 0], columns, **ALGEBRAIC)


def test_every_kind_is_in_the_catalogue_and_tested():
    assert set(CATALOGUE) == set(SHAPES)
    for kind, entry in CATALOGUE.items():
        effect = effect_of(kind)
        assert effect.kind == kind
        assert effect.coefficient_names == [c["name"] for c in entry["coefficients"]]
        assert effect.n_columns == len(entry["coefficients"])
        assert effect.shape == [(s["name"], SHAPES[kind][s["name"]]) for s in entry["shape"]]
        assert all(c["lower"] < c["upper"] for c in entry["coefficients"])
        units = [x["unit"].format(torque="N*m", angle="rad") for x in (*entry["coefficients"], *entry["shape"])]
        assert not any("{" in unit for unit in units)
        assert entry["declared"] == (kind in {"rotor_inertia", "torque_offset", "friction"})


@pytest.mark.parametrize("kind", [kind for kind in CATALOGUE if not CATALOGUE[kind]["declared"]])
def test_a_search_can_begin(kind):
    """Most combinations of the grid make an effect; every parameter has values."""
    entry = CATALOGUE[kind]
    names = [s["name"] for s in entry["shape"]]
    grids = [s["grid"] for s in entry["shape"]]
    assert all(len(grid) > 0 for grid in grids)
    made, refused = 0, []
    for values in itertools.product(*grids):
        try:
            _core.Effect.of(kind, **{name: [value] * N for name, value in zip(names, values, strict=True)})
            made += 1
        except ValueError as error:
            refused.append(str(error))
    assert made > 0.7 * (made + len(refused))
    assert all(" needs " in sentence for sentence in refused)


@pytest.mark.parametrize(
    ("kind", "shape", "words"),
    [
        ("stribek", {}, ["no effect", "stribek", "stribeck", "counterbalance"]),
        ("stribeck", {}, ["stribeck_velocity, exponent, transition_width", "none"]),
        ("torque_offset", {"width": [1.0]}, ["torque_offset", "none", "width"]),
        ("friction", {"velocity_threshold": [0.1], "width": [0.1]}, ["transition_width", "width"]),
        ("friction", {"velocity_threshold": [0.1, 0.1], "transition_width": [0.1]}, ["1 values", "one per joint"]),
        ("friction", {"velocity_threshold": [], "transition_width": []}, ["no values", "one per joint"]),
        ("friction", {"velocity_threshold": [-0.1], "transition_width": [0.1]}, ["joint 0", "at least 0"]),
        (
            "stribeck",
            {"stribeck_velocity": [0.1, 0.0], "exponent": [1, 1], "transition_width": [1, 1]},
            ["stribeck_velocity of joint 1", "positive"],
        ),
        (
            "stribeck",
            {"stribeck_velocity": [np.nan], "exponent": [1], "transition_width": [1]},
            ["stribeck_velocity", "finite"],
        ),
        ("counterbalance", {"a": [1], "b": [1], "phase": [0], "gas_length": [3]}, ["joint 0", "different a and b"]),
        ("counterbalance", {"a": [1], "b": [2], "phase": [0], "gas_length": [2]}, ["gas_length above the stroke"]),
    ],
)
def test_a_wrong_shape_is_refused(kind, shape, words):
    with pytest.raises(ValueError) as refused:
        _core.Effect.of(kind, **shape)
    for word in words:
        assert word in str(refused.value)


def model_of(kinds, seed=3, step=None):
    """Chain with every one of `kinds`, random coefficients, a delay between the encoders, gains."""
    rng = np.random.default_rng(seed)
    robot = three_joints()
    terms = [(effect_of(kind), rng.uniform(-2, 2, (N, effect_of(kind).n_columns))) for kind in kinds]
    return _core.TorqueModel(
        robot,
        robot.phi,
        terms,
        torque_scale=[1.0, 0.7, 1.3],
        encoder_delay=[0.003, 0.0, 0.001],
        noise_std=[0.1] * N,
        domain=([[-9, 9]] * N, [99] * N, [999] * N),
        step=step,
    )


@pytest.mark.parametrize("kind", CATALOGUE)
def test_one_effect_is_its_term_of_the_model(kind):
    """`TorqueModel.evaluate` runs the online estimator; `effect_torque` and `effect_columns` give the same bits."""
    step = 0.004 if "step" in CATALOGUE[kind]["signals"] else None
    model = model_of([kind], step=step)
    q, dq, ddq, *motor = signals(1)
    _, terms, status = model.evaluate(q, dq, ddq, *motor)
    assert_array_equal(status, 0)
    q, dq = _core.align_link_side(q, dq, ddq, model.encoder_delay)
    tau_link = model.robot.inverse_dynamics(q, dq, ddq, model.phi)
    ((effect, coefficients),) = model.effects
    tau = _core.effect_torque(effect, coefficients, q, dq, ddq, *motor, tau_link, step=step)
    assert_allclose(terms[:, 1], tau, **EXACT)
    assert np.ptp(tau) > 0 or kind == "torque_offset"
    columns = _core.effect_columns(effect, q, dq, ddq, *motor, tau_link, step=step)
    assert columns.shape == (N_SAMPLES, N, effect.n_columns)
    assert_allclose(np.einsum("njk,jk->nj", columns, coefficients), tau, **ALGEBRAIC)


def test_all_effects_sum_and_survive_the_file(tmp_path):
    model = model_of(CATALOGUE, step=0.004)
    run = signals(2)
    total, terms, _ = model.evaluate(*run)
    summed = np.zeros_like(total)
    for k in range(terms.shape[1]):
        summed += terms[:, k]
    assert_allclose(total, summed, **EXACT)
    model.save(tmp_path / "model.json")
    loaded = _core.TorqueModel.load(tmp_path / "model.json")
    assert loaded.step == 0.004
    assert loaded.term_names == ["rigid_body", *CATALOGUE]
    for (effect, coefficients), (other, others) in zip(model.effects, loaded.effects, strict=True):
        assert (effect.kind, effect.shape) == (other.kind, other.shape)
        assert_array_equal(coefficients, others)
    assert_array_equal(loaded.evaluate(*run)[0], total)


@pytest.mark.parametrize("kind", CATALOGUE)
def test_rows_of_the_fit_are_the_filtered_columns(kind):
    from scipy.signal import sosfiltfilt

    from dynid_rs.preprocessing import Band

    robot = three_joints()
    run = signals(4)
    tau_link = robot.inverse_dynamics(*run[:3], robot.phi)
    effect, step = effect_of(kind), 0.004
    band = Band(10.0).design(1 / step)
    kept = list(range(3, N_SAMPLES, 7))
    rows = _core.observe(robot, [effect], [], *run, tau_link, filter=band, kept=kept, tau_link=tau_link, step=step)
    columns = _core.effect_columns(effect, *run, tau_link, step=step)
    filtered = sosfiltfilt(band[0], columns, axis=0, padlen=band[2])[kept]
    for j in range(N):
        assert_allclose(rows[j][:, :-1], filtered[:, j], rtol=1e-9, atol=1e-9 * np.abs(columns).max())
