"""Effects: literal formulas, the catalogue, one road from a fit to the control loop."""

import itertools
import pickle
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.robots import random_chain
from helpers.tolerances import ALGEBRAIC, EXACT
from helpers.whole_model import OF_ANGLE
from numpy.testing import assert_allclose, assert_array_equal

from dynid_rs import _core
from dynid_rs.diagnosis.shaped import Shaped
from dynid_rs.identification.links import LinkDynamicsIdentifier
from dynid_rs.model.assembly import assemble, evaluate, with_changes
from dynid_rs.model.placed import PlacedEffect, effects_of
from dynid_rs.model.units import own_unit
from dynid_rs.regression.columns import make_plan, observe
from dynid_rs.runs.preprocessing import Band, States

N, N_SAMPLES = 3, 600
CATALOGUE = {entry["kind"]: entry for entry in _core.effect_catalogue()}
FRICTION_NAMES = [coefficient["name"] for coefficient in CATALOGUE["friction"]["coefficients"]]
SHAPES = {
    "rotor_inertia": {},
    "torque_offset": {},
    "friction": {"velocity_threshold": [0.0, 0.05, 0.1], "transition_width": [0.01, 0.02, 0.03]},
    "smooth_friction": {"transition_width": [0.01, 0.002, 0.12], "sharpness": [1.0, 2.5, 6.0]},
    "stribeck": {
        "stribeck_velocity": [0.1, 0.3, 1.0],
        "exponent": [1.0, 2.0, 0.7],
        "transition_width": [0.01, 0.02, 0.03],
        "sharpness": [2.5, 1.2, 0.0],
    },
    "counterbalance": {
        "a": [0.8, 0.3, 1.0],
        "b": [0.2, 0.7, 0.5],
        "phase": [0.4, -2.0, 3.0],
        "gas_length": [0.6, 0.9, -0.3],
    },
    "load_dependent_friction": {"transition_width": [0.01, 0.02, 0.03], "sharpness": [0.0, 1.0, 2.5]},
    "bearing_friction": {
        "side": [1.0, -1.0, 1.0],
        "transition_width": [0.01, 0.02, 0.03],
        "sharpness": [0.0, 1.0, 2.5],
    },
    "position_dependent_friction": {
        "cycles": [1.0, 2.0, 3.0],
        "transition_width": [0.01, 0.02, 0.03],
        "sharpness": [0.0, 1.0, 2.5],
    },
    "friction_hysteresis": {"presliding_distance": [0.001, 0.01, 0.1]},
    "load_hysteresis": {"presliding_distance": [0.002, 0.02, 0.2]},
    "gear_hysteresis": {"hysteresis_load": [1.0, 4.0, 0.5], "carried_load": [0.0, 2.0, 3.0]},
    "coupled_friction": {
        "partner": [1.0, 0.0, -1.0],
        "ratio": [0.5, 2.0, 1.0],
        "transition_width": [0.01, 0.02, 0.03],
        "sharpness": [2.5, 1.2, 0.0],
    },
    "torque_ripple": {"cycles": [1.0, 57.3, 100.0]},
    "inertial_coupling": {"partner": [2.0, -1.0, 0.0]},
    "joint_spring": {"rest_position": [0.0, 0.3, -1.0]},
    "torque_saturation": {},
    "thermal_friction": {
        "time_constant": [0.5, 1.0, 2.0],
        "reference_speed": [0.0, 0.5, 2.0],
        "transition_width": [0.01, 0.02, 0.03],
        "sharpness": [2.5, 1.2, 0.0],
    },
    "temperature_friction": {
        "reference_temperature": [20.0, 30.0, -5.0],
        "transition_width": [0.01, 0.02, 0.03],
        "sharpness": [2.5, 1.2, 0.0],
        **{name: [3.0 - k, 0.5 * k, 1.0] for k, name in enumerate(FRICTION_NAMES)},
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


REMEMBER = {"friction_hysteresis", "load_hysteresis", "gear_hysteresis", "thermal_friction"}
"""Kinds that depend on the samples before."""


def temperature_of(q):
    """A temperature of every joint that moves with it, which none does."""
    return 30 + 10 * np.sin(q)


def three_joints():
    chain = random_chain(1)
    assert chain.n_joints == N
    return _core.RobotModel.from_urdf_string(chain.urdf, gravity=chain.gravity)


def effect_of(kind):
    return _core.Effect.of(kind, **SHAPES[kind])


def sign(speed, p):
    """Friction's sign, joint by joint: of some sharpness, or a tanh where that is 0."""
    sharp = np.where(p.sharpness > 0, p.sharpness, 1.0)
    rounded = speed / (np.abs(speed) ** sharp + p.transition_width**sharp) ** (1 / sharp)
    return np.where(p.sharpness > 0, rounded, np.tanh(speed / p.transition_width))


def smooth_friction(p, x):
    v, size, s = x.dq_motor, np.abs(x.dq_motor), sign(x.dq_motor, p)
    return [s, np.abs(s), v, size, v * size, v**2]


def stribeck(p, x):
    size = sign(x.dq_motor, p) * np.exp(-((np.abs(x.dq_motor) / p.stribeck_velocity) ** p.exponent))
    return [np.where(x.dq_motor >= 0, size, 0), np.where(x.dq_motor < 0, size, 0)]


def load_dependent_friction(p, x):
    at_rest = np.abs(x.tau_link) * sign(x.dq_motor, p)
    return [at_rest, at_rest * np.abs(x.dq_motor)]


def bearing_friction(p, x):
    beside = [1, 0, None]  # of joint 2 there is none behind
    load = np.stack([np.zeros(len(x.q)) if k is None else np.abs(x.tau_link[:, k]) for k in beside], axis=1)
    return [load * sign(x.dq_motor, p)]


def position_dependent_friction(p, x):
    return [sign(x.dq_motor, p) * wave(p.cycles * x.q) for wave in (np.cos, np.sin)]


def coupled_friction(p, x):
    v = x.dq_motor
    both, there = np.stack([v[:, 0] + 0.5 * v[:, 1], v[:, 1] + 2.0 * v[:, 0], v[:, 2]], axis=1), [1, 1, 0]
    return [sign(both, p) * there, both * there]


def torque_ripple(p, x):
    return [wave(m * p.cycles * x.q_motor) for m in (1, 2) for wave in (np.cos, np.sin)]


def inertial_coupling(p, x):
    return [x.ddq_motor[:, [2, 1, 0]] * [1, 0, 1]]


def temperature_friction(p, x):
    v, s = x.dq_motor, sign(x.dq_motor, p)
    gate = (1 + np.abs(s)) / 2
    terms = [s * gate, v * gate, v**2, v**3]  # Eqs. 10-11, each direction with its own coefficients
    levels = [[getattr(p, FRICTION_NAMES[2 * k + side]) for side in (0, 1)] for k in range(4)]
    friction = sum(np.where(v >= 0, *both) * term for both, term in zip(levels, terms, strict=True))
    return [(x.temperature - p.reference_temperature) * friction]


FORMULAS = {
    "rotor_inertia": lambda p, x: [x.ddq_motor],
    "torque_offset": lambda p, x: [np.ones_like(x.q)],
    "smooth_friction": smooth_friction,
    "stribeck": stribeck,
    "load_dependent_friction": load_dependent_friction,
    "bearing_friction": bearing_friction,
    "position_dependent_friction": position_dependent_friction,
    "coupled_friction": coupled_friction,
    "torque_ripple": torque_ripple,
    "inertial_coupling": inertial_coupling,
    "joint_spring": lambda p, x: [x.q - p.rest_position],
    "torque_saturation": lambda p, x: [x.tau_motor**3],
    "temperature_friction": temperature_friction,
}
"""Columns as the documentation prints them; `p` has the shape parameters, `x` the signals."""


@pytest.mark.parametrize("kind", FORMULAS)
def test_columns_are_the_formula(kind):
    names = ("q", "dq", "ddq", "q_motor", "dq_motor", "ddq_motor")
    x = SimpleNamespace(**dict(zip(names, signals(), strict=True)))
    x.dq_motor[:4] = [[0.0] * N, [1e-3] * N, [-1e-3] * N, [5.0] * N]
    x.tau_link = 3 * np.sin(x.q) - x.ddq
    x.tau_motor = x.tau_link + np.sign(x.dq_motor)
    x.temperature = temperature_of(x.q)
    p = SimpleNamespace(**{name: np.array(values) for name, values in SHAPES[kind].items()})
    expected = np.stack(FORMULAS[kind](p, x), axis=-1)
    motion = (getattr(x, name) for name in names)
    more = {"tau_motor": x.tau_motor, "temperature": x.temperature}
    columns = _core.effect_columns(effect_of(kind), *motion, x.tau_link, **more)
    assert_allclose(columns, expected, **ALGEBRAIC)


ENDS = {"held_from": [-0.4, -1.0, 0.1], "held_to": [0.3, -0.2, 0.1]}


@pytest.mark.parametrize("kind", OF_ANGLE)
def test_a_function_of_the_angle_with_ends_keeps_its_value_beyond_them(kind):
    free, ended = effect_of(kind), _core.Effect.of(kind, **SHAPES[kind], **ENDS)
    run = signals()
    within = [np.clip(x, *ENDS.values()) if k in (0, 3) else x for k, x in enumerate(run)]
    columns = _core.effect_columns(ended, *run)
    assert_array_equal(columns, _core.effect_columns(free, *within))
    assert np.any(columns != _core.effect_columns(free, *run))
    assert dict(ended.shape) == SHAPES[kind] | ENDS
    copy = pickle.loads(pickle.dumps(ended))
    assert_array_equal(_core.effect_columns(copy, *run), columns)


@pytest.mark.parametrize(
    ("kind", "ends", "words"),
    [
        *((kind, ENDS, ["held_from", "functions of a joint's own angle"]) for kind in ("torque_offset", "stribeck")),
        ("friction_hysteresis", ENDS, ["functions of a joint's own angle"]),
        ("torque_ripple", {"held_from": [0.0] * N}, ["the shape parameters are cycles, found cycles, held_from"]),
        ("torque_ripple", {"held_from": [0.0] * N, "held_to": [1.0]}, ["held_to has 1 values, cycles has 3"]),
        ("torque_ripple", {"held_from": [0.0], "held_to": [1.0]}, ["held_from has 1 values, cycles has 3"]),
        ("torque_ripple", {"held_from": [], "held_to": []}, ["held_to has no values"]),
        ("torque_ripple", {"held_from": [0, 0.2, 0], "held_to": [1, 0.1, 1]}, ["held_from of joint 1", "not above"]),
    ],
)
def test_ends_that_make_no_sense_are_refused(kind, ends, words):
    with pytest.raises(ValueError) as refused:
        _core.Effect.of(kind, **SHAPES[kind], **ends)
    for word in words:
        assert word in str(refused.value)


def test_places_of_one_kind_share_an_effect_whether_they_end_or_not(tmp_path):
    placed = [PlacedEffect.at("torque_ripple", 0, cycles=2.0), PlacedEffect.at("torque_ripple", 2, cycles=5.0)]
    placed[0] = placed[0].held((-9.0, 9.0)).held((-0.4, 0.3))  # the last ends count
    ((effect, joints),) = effects_of(placed, N)
    assert joints == (0, 2)
    run = signals()
    within = [np.clip(x, [-0.4, -9, -9], [0.3, 9, 9]) if k in (0, 3) else x for k, x in enumerate(run)]
    free = _core.Effect.of("torque_ripple", cycles=[2.0, 2.0, 5.0])
    assert_array_equal(_core.effect_columns(effect, *run), _core.effect_columns(free, *within))
    model = model_of([])
    ended = with_changes(model, effects=[(effect, np.ones((N, 4)))])
    ended.save(tmp_path / "model.json")
    assert '"version": 4,' in (tmp_path / "model.json").read_text()
    assert_array_equal(_core.TorqueModel.load(tmp_path / "model.json").evaluate(*run)[0], ended.evaluate(*run)[0])


def test_every_kind_has_a_formula_here():
    elsewhere = REMEMBER | {"friction", "counterbalance"}
    assert set(FORMULAS) | elsewhere == set(CATALOGUE)


def smooth_sign(v, width, sharpness):
    """Of speeds (n,), as the first column of smooth friction."""
    effect = _core.Effect.of("smooth_friction", transition_width=[width], sharpness=[sharpness])
    dq = np.asarray(v)[:, None]
    return _core.effect_columns(effect, 0 * dq, dq, 0 * dq)[:, 0, 0]


@pytest.mark.parametrize("sharpness", [0.5, 1.0, 2.5, 6.0, 50.0])
def test_the_smooth_sign_is_a_number_at_any_speed(sharpness):
    speeds = np.concatenate([[0.0], np.logspace(-150, 150, 301)])
    s = smooth_sign(speeds, 0.004, sharpness)
    assert s[0] == 0.0
    assert (np.diff(s) >= 0).all()
    assert s[-1] <= 1.0
    assert_array_equal(smooth_sign(-speeds, 0.004, sharpness), -s)
    slow = speeds < 1e-60
    assert_allclose(s[slow], speeds[slow] / 0.004, rtol=1e-12)


def test_the_smooth_sign_has_the_shape_that_its_sharpness_says():
    """2.5 is nearest to a hyperbolic tangent; at 6 it is a straight line and then one, and at 1 it rises for long."""
    v = np.linspace(0, 5, 501)
    off = [np.abs(smooth_sign(v, 1.0, p) - np.tanh(v)).max() for p in (1.0, 1.5, 2.5, 6.0)]
    assert np.argmin(off) == 2
    assert off[2] < 0.04
    assert np.abs(smooth_sign(v, 1.0, 6.0) - np.minimum(v, 1.0)).max() < 0.11
    assert_allclose(smooth_sign([1.0, 4.0], 1.0, 1.0), [0.5, 0.8], rtol=1e-15)


def test_friction_hysteresis_is_dahls_equation():
    """Against an integrator of dz/dt = v/d (1 - z sign(v)) along the path between the samples."""
    from scipy.integrate import solve_ivp

    q = signals()[0]
    columns = _core.effect_columns(effect_of("friction_hysteresis"), q, q, q)[:, :, 0]
    for j, d in enumerate(SHAPES["friction_hysteresis"]["presliding_distance"]):
        z = [0.0]
        for dx in np.diff(q[:80, j]):
            bent = solve_ivp(
                lambda _, z, v=dx, d=d: v / d * (1 - z * np.sign(v)), (0, 1), z[-1:], rtol=1e-10, atol=1e-12
            )
            z.append(bent.y[0, -1])
        assert_allclose(columns[:80, j], z, rtol=0, atol=1e-7)
    assert np.abs(columns).max() <= 1.0
    assert columns.max() > 0.99
    assert columns.min() < -0.99


def test_load_hysteresis_is_the_load_times_the_same_bristles():
    q = signals()[0]
    load = 5 * np.cos(3 * q)
    shape = SHAPES["load_hysteresis"]
    columns = _core.effect_columns(effect_of("load_hysteresis"), q, q, q, tau_link=load)
    bristles = _core.effect_columns(_core.Effect.of("friction_hysteresis", **shape), q, q, q)
    assert_allclose(columns, np.abs(load)[:, :, None] * bristles, **ALGEBRAIC)
    assert np.ptp(columns, axis=0).min() > 1.0


def wound(n_samples, n_cycles):
    """Load (n_samples, N) [N m] of gears that are wound to and fro."""
    turn = np.linspace(0, 2 * np.pi * n_cycles, n_samples)[:, None]
    return np.array([3.0, 7.0, 5.0]) * (np.sin(turn) + 0.3 * np.sin(3 * turn))


def gear_hysteresis(load):
    q = np.sin(np.linspace(0, 9, len(load)))[:, None] + np.zeros(N)
    return _core.effect_columns(effect_of("gear_hysteresis"), q, q, q, tau_link=load)[:, :, 0]


def test_gear_hysteresis_is_dahls_equation_along_what_the_load_leaves_the_spring():
    """Against an integrator of dz/ds = x'/d (1 - z sign(x')), x = load - c z, the load straight between samples."""
    from scipy.integrate import solve_ivp

    load = wound(400, 2)
    columns = gear_hysteresis(load)
    shape = SHAPES["gear_hysteresis"]
    for j, (d, c) in enumerate(zip(shape["hysteresis_load"], shape["carried_load"], strict=True)):
        z = [0.0]
        for change in np.diff(load[:120, j]):

            def rate(_, z, v=change, d=d, c=c):
                turning = (1 - z * np.sign(v)) / d
                return v * turning / (1 + c * turning)

            z.append(solve_ivp(rate, (0, 1), z[-1:], rtol=1e-10, atol=1e-12).y[0, -1])
        assert_allclose(columns[:120, j], z, rtol=0, atol=1e-7)
    assert np.abs(columns).max() <= 1.0
    assert (np.ptp(columns, axis=0) > 1.3).all()


def test_gear_hysteresis_takes_energy_in_every_cycle():
    """Work along a closed loop of the wind-up, the last of three alike, is never given back."""
    load = wound(30_001, 3)
    wind_up, z = load[20_000:] / 1e4, gear_hysteresis(load)[20_000:]
    assert_allclose(wind_up[-1], wind_up[0], rtol=0, atol=1e-12)
    assert_allclose(z[-1], z[0], rtol=0, atol=1e-4)
    work = np.trapezoid(z, wind_up, axis=0)
    # Between none and that of dry friction along the same way.
    way = np.sum(np.abs(np.diff(wind_up, axis=0)), axis=0)
    assert (work > 0.1 * way).all()
    assert (work < way).all()


def test_hysteresis_depends_on_the_way_only():
    """Twice as many samples on the same way, and samples that stand still, end in the same place."""
    way = np.concatenate([np.linspace(0, 0.02, 20), np.linspace(0.02, 0.013, 20)])[:, None] * np.ones(N)
    fine = np.interp(np.linspace(0, 39, 79), np.arange(40), way[:, 0])[:, None] * np.ones(N)
    held = np.repeat(way, 3, axis=0)
    ends = [_core.effect_columns(effect_of("friction_hysteresis"), q, q, q)[-1] for q in (way, fine, held)]
    assert_allclose(ends[1], ends[0], rtol=1e-12)
    assert_allclose(ends[2], ends[0], rtol=1e-12)
    assert np.all(ends[0] < 0.99)


def test_thermal_friction_is_a_first_order_warm_up():
    """At constant speed the warmth is u (1 - exp(-t/T)), u = 1 or |v|/v_r, whatever the step."""
    shape = SHAPES["thermal_friction"]
    speed = np.array([0.7, -0.4, 1.5])
    for dt in (0.001, 0.02):
        n_samples = round(4 / dt)
        dq = np.tile(speed, (n_samples, 1))
        columns = _core.effect_columns(effect_of("thermal_friction"), 0 * dq, dq, 0 * dq, step=dt)
        t = dt * np.arange(n_samples)[:, None]
        source = np.array([1.0, 0.4 / 0.5, 1.5 / 2.0])
        warmth = source * (1 - np.exp(-t / np.array(shape["time_constant"])))
        p = SimpleNamespace(**{name: np.array(shape[name]) for name in ("transition_width", "sharpness")})
        assert_allclose(columns[:, :, 0], warmth * sign(speed, p), **ALGEBRAIC)
        assert_allclose(columns[:, :, 1], warmth * speed, **ALGEBRAIC)


def test_what_an_effect_needs_must_be_there():
    q = np.zeros((10, N))
    with pytest.raises(ValueError, match="torque_saturation needs tau_motor"):
        _core.effect_columns(effect_of("torque_saturation"), q, q, q, tau_link=q)
    with pytest.raises(ValueError, match="thermal_friction needs step"):
        _core.effect_torque(effect_of("thermal_friction"), np.zeros((N, 2)), q, q, q)
    with pytest.raises(ValueError, match="tau_motor has 9 samples"):
        _core.effect_columns(effect_of("torque_saturation"), q, q, q, tau_motor=q[1:])
    with pytest.raises(ValueError, match="tau_motor holds NaN at row 0"):
        _core.effect_columns(effect_of("torque_saturation"), q, q, q, tau_motor=q + np.nan)
    with pytest.raises(ValueError, match="tau_link has 9 samples"):
        _core.effect_columns(effect_of("load_dependent_friction"), q, q, q, tau_link=q[1:])
    with pytest.raises(ValueError, match="step"):
        _core.effect_columns(effect_of("thermal_friction"), q, q, q, step=0.0)
    with pytest.raises(ValueError, match="load_dependent_friction needs tau_link"):
        _core.observe(three_joints(), [effect_of("load_dependent_friction")], [], q, q, q, q, q, q, q, kept=[0])
    with pytest.raises(ValueError, match="temperature_friction needs temperature, which was not given"):
        _core.effect_columns(effect_of("temperature_friction"), q, q, q)
    with pytest.raises(ValueError, match="temperature has 9 samples"):
        _core.effect_columns(effect_of("temperature_friction"), q, q, q, temperature=q[1:])
    with pytest.raises(ValueError, match="temperature holds NaN at row 0"):
        _core.effect_columns(effect_of("temperature_friction"), q, q, q, temperature=q + np.nan)
    with pytest.raises(ValueError, match="follows a measured temperature, which was not given"):
        model_of(["temperature_friction"]).evaluate(q, q, q)
    with pytest.raises(ValueError, match="thermal_friction changes with time"):
        model_of(["thermal_friction"])


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
    values = SHAPES["counterbalance"]
    shapes = [{name: values[name][j] for name in values} for j in range(N)]
    expected = np.stack([energy(shape, q[:, j] + 1j * step).imag / step for j, shape in enumerate(shapes)], axis=1)
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
        assert effect.signals == entry["signals"]
        assert effect.has_memory == entry["memory"] == (kind in REMEMBER)
        assert entry["declared"] == (kind in {"rotor_inertia", "torque_offset", "friction", "smooth_friction"})


def kinds_that(holds):
    return {kind for kind, entry in CATALOGUE.items() if holds(entry)}


def test_the_catalogue_says_where_a_kind_acts_and_what_it_takes():
    assert kinds_that(lambda entry: entry["places"] == "pair") == {"inertial_coupling"}
    assert kinds_that(lambda entry: entry["places"] == "neighbours") == {"coupled_friction"}
    for entry in CATALOGUE.values():
        assert (entry["places"] == "joint") == all(p["name"] != "partner" for p in entry["shape"])
    assert kinds_that(lambda entry: entry["sought"]) == kinds_that(lambda entry: not entry["declared"])
    loaded = {"load_dependent_friction", "load_hysteresis", "gear_hysteresis", "bearing_friction"}
    assert kinds_that(lambda entry: "load" in entry["requires"]) == loaded
    assert kinds_that(lambda entry: "temperature" in entry["requires"]) == {"temperature_friction"}
    assert CATALOGUE["gear_hysteresis"]["requires"] == ["two_encoders", "load"]
    turning = {"counterbalance", "position_dependent_friction", "torque_ripple", "bearing_friction"}
    assert kinds_that(lambda entry: "revolute" in entry["requires"]) == turning


def test_the_catalogue_says_how_a_report_draws_a_kind_and_how_large_it_may_be():
    drawn = {kind: entry["drawn_against"] for kind, entry in CATALOGUE.items() if entry["drawn_against"]}
    assert drawn == {
        "stribeck": ["dq", "rad/s"],
        "load_dependent_friction": ["tau_link", "{torque}"],
        "bearing_friction": ["tau_link", "{torque}"],
        "position_dependent_friction": ["q", "rad"],
        "torque_ripple": ["q", "rad"],
        "joint_spring": ["q", "rad"],
        "counterbalance": ["q", "rad"],
        "torque_saturation": ["tau_motor", "{torque}"],
        "inertial_coupling": ["ddq", "rad/s^2"],
        "thermal_friction": ["t", "s"],
        "temperature_friction": ["temperature", "degC"],
        "load_hysteresis": ["tau_link", "{torque}"],
    }
    largest = {kind: entry["most_relative"] for kind, entry in CATALOGUE.items() if entry["most_relative"] is not None}
    assert largest == {"torque_saturation": 0.5}


def test_the_catalogue_says_how_a_shape_is_searched():
    relative, ranges = {}, {}
    for kind, entry in CATALOGUE.items():
        for p in entry["shape"]:
            if p["relative_to"] is not None:
                relative.setdefault((p["name"], p["relative_to"]), set()).add(kind)
            assert (p["lowest"] is None) == (p["highest"] is None) == (p["scale"] is None)
            if p["lowest"] is not None:
                ranges[kind, p["name"]] = (p["scale"], p["lowest"], p["highest"])
    widths = kinds_that(lambda entry: any(p["name"] == "transition_width" for p in entry["shape"]))
    assert relative == {
        ("transition_width", "friction_width"): widths - {"friction", "smooth_friction"},
        ("sharpness", "friction_sharpness"): widths - {"friction", "smooth_friction"},
        ("hysteresis_load", "load"): {"gear_hysteresis"},
        ("carried_load", "load"): {"gear_hysteresis"},
        ("stribeck_velocity", "speed"): {"stribeck"},
        ("side", "chain"): {"bearing_friction"},
    }
    assert ranges == {
        ("stribeck", "stribeck_velocity"): ("log", 1e-3, 10.0),
        ("stribeck", "exponent"): ("log", 0.5, 2.1),
        ("friction_hysteresis", "presliding_distance"): ("log", 2.9e-4, 0.3),
        ("load_hysteresis", "presliding_distance"): ("log", 5e-4, 0.3),
        ("gear_hysteresis", "hysteresis_load"): ("log", 1e-4, 1e5),
        ("gear_hysteresis", "carried_load"): ("log", 1e-4, 1e5),
        ("coupled_friction", "ratio"): ("linear", -5.0, 5.0),
        ("torque_ripple", "cycles"): ("log", 3.5, 1e4),
        ("counterbalance", "b"): ("log", 0.02, 2 / 3),
        ("counterbalance", "phase"): ("linear", -4.0, 4.0),
        ("counterbalance", "gas_length"): ("log", 0.05, 100.0),
        ("thermal_friction", "time_constant"): ("log", 5.0, 300.0),
    }


@pytest.mark.parametrize("kind", [kind for kind in CATALOGUE if not CATALOGUE[kind]["declared"]])
def test_a_search_can_begin(kind):
    """Most combinations of the grid make an effect; every parameter has values."""
    entry = CATALOGUE[kind]
    names = [s["name"] for s in entry["shape"]]
    # What names another joint or repeats friction comes from the fit.
    by_the_fit = {"partner": -1.0, **dict.fromkeys(FRICTION_NAMES, 1.0)}
    grids = [[by_the_fit[s["name"]]] if s["name"] in by_the_fit else s["grid"] for s in entry["shape"]]
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
        ("bearing_friction", {"side": [1, 0.5, 1], "transition_width": [0.1] * 3}, ["side of joint 1", "-1"]),
        ("inertial_coupling", {"partner": [1, 1]}, ["partner of joint 1", "another joint"]),
        ("inertial_coupling", {"partner": [0.5, 0]}, ["partner of joint 0", "-1 for none"]),
        ("inertial_coupling", {"partner": [2, 0]}, ["partner of joint 0"]),
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
    more = {"step": step, "temperature": temperature_of(q)}
    _, terms, status = model.evaluate(q, dq, ddq, *motor, temperature=more["temperature"])
    assert_array_equal(status, 0)
    q, dq = _core.align_link_side(q, dq, ddq, model.encoder_delay)
    tau_link = model.robot.inverse_dynamics(q, dq, ddq, model.phi)
    ((effect, coefficients),) = model.effects
    more["tau_motor"] = _core.motor_torque(model.effects, model.torque_scale, q, dq, ddq, *motor, tau_link=tau_link)
    tau = _core.effect_torque(effect, coefficients, q, dq, ddq, *motor, tau_link, **more)
    assert_allclose(terms[:, 1], tau, **EXACT)
    assert np.ptp(tau) > 0 or kind == "torque_offset"
    columns = _core.effect_columns(effect, q, dq, ddq, *motor, tau_link, **more)
    assert columns.shape == (N_SAMPLES, N, effect.n_columns)
    assert_allclose(np.einsum("njk,jk->nj", columns, coefficients), tau, **ALGEBRAIC)


def test_all_effects_sum_and_survive_the_file(tmp_path):
    model = model_of(CATALOGUE, step=0.004)
    run = signals(2)
    warm = {"temperature": temperature_of(run[0])}
    total, terms, _ = model.evaluate(*run, **warm)
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
    assert_array_equal(loaded.evaluate(*run, **warm)[0], total)


@pytest.mark.parametrize("kind", CATALOGUE)
def test_rows_of_the_fit_are_the_filtered_columns(kind):
    from scipy.signal import sosfiltfilt

    robot = three_joints()
    run = signals(4)
    tau_link = robot.inverse_dynamics(*run[:3], robot.phi)
    effect, step = effect_of(kind), 0.004
    band = Band(10.0).design(1 / step)
    kept = list(range(3, N_SAMPLES, 7))
    more = {"tau_link": tau_link, "tau_motor": 2 * tau_link, "step": step, "temperature": temperature_of(run[0])}
    rows = _core.observe(robot, [effect], [], *run, tau_link, filter=band, kept=kept, **more)
    columns = _core.effect_columns(effect, *run, **more)
    filtered = sosfiltfilt(band[0], columns, axis=0, padlen=band[2])[kept]
    for j in range(N):
        assert_allclose(rows[j][:, :-1], filtered[:, j], rtol=1e-9, atol=1e-9 * np.abs(columns).max())


def test_a_plan_knows_what_can_be_told_apart():
    """The same spring twice, a spring that the offset shifts, and effects that are new."""
    robot = three_joints()
    spring = effect_of("joint_spring")
    shifted = _core.Effect.of("joint_spring", rest_position=[1.0] * N)
    friction = effect_of("friction")
    declared = [_core.Effect.rotor_inertia(), _core.Effect.torque_offset(), friction]
    new = [effect_of(kind) for kind in CATALOGUE if not CATALOGUE[kind]["declared"] and kind != "joint_spring"]
    plain = make_plan(robot, declared)
    plan = make_plan(robot, [*declared, spring, spring, shifted, *new])
    assert_array_equal(plan.own[:, : plain.n_own], plain.own)
    assert plan.absorbed.keys() >= plain.absorbed.keys()
    edges = plain.n_own + np.arange(4)
    assert plan.own[:, edges[0]].all()
    assert not plan.own[:, edges[1]].any()
    assert not plan.own[plan.own[:, 1], edges[2]].any()
    names = [name for effect in plan.effects for name in effect.coefficient_names]
    for at in range(edges[3], plan.n_own):
        told = {
            "coupled_friction": [1, 1, 0],  # no partner
            "coupled_viscous": [1, 1, 0],
            "bearing_friction": [1, 1, 0],  # no neighbour
            "inertial_coupling": [1, 0, 0],  # no partner; as joint 0's, with its link and both rotors
            "ripple_cos1": [0, 1, 1],  # once per turn of the first joint is its gravity
            "ripple_sin1": [0, 1, 1],
        }.get(names[at], [1, 1, 1])
        assert_array_equal(plan.own[:, at], np.array(told, dtype=bool), err_msg=names[at])
    assert plan.friction == (plan.effects[2], slice(2, 10))


def test_a_plan_may_hold_an_effect_to_some_joints():
    effects = [_core.Effect.torque_offset(), effect_of("counterbalance"), effect_of("friction_hysteresis")]
    plan = make_plan(three_joints(), effects, acts_on={1: [1], 2: []})
    assert_array_equal(plan.own[:, 1:], [[False, False], [True, False], [False, False]])


def test_units_of_every_coefficient():
    expected = {"warm_viscous": "A*s/rad", "saturation": "1/(A)^2", "load_friction": "1", "hysteresis": "A"}
    assert {name: own_unit(name, "A", "revolute") for name in expected} == expected
    assert own_unit("rotor_inertia", "N*m", "revolute") == "kg*m^2"
    assert own_unit("viscous3_neg", "N*m", "prismatic") == "N*(s/m)^3"
    assert own_unit("spring_stiffness", "N*m", "revolute") == "N*m/rad"
    for entry in CATALOGUE.values():
        assert all(own_unit(c["name"], "N*m", "prismatic") for c in entry["coefficients"])


def rich_run(model, seed, n_samples=6000, rate=250.0):
    """States of a run of many harmonics with the torque of `model`, without noise."""
    rng = np.random.default_rng(seed)
    t = np.arange(n_samples) / rate
    rates = 2 * np.pi * 0.05 * np.arange(1, 9)[:, None, None]
    phase, size = (
        rng.uniform(0, 6, (8, 1, N)),
        rng.uniform(0.1, 0.5, (8, 1, N)) / np.sqrt(np.arange(1, 9))[:, None, None],
    )
    angle = rates * t[:, None] + phase
    q, dq = (size * np.sin(angle)).sum(axis=0), (size * rates * np.cos(angle)).sum(axis=0)
    ddq = -(size * rates**2 * np.sin(angle)).sum(axis=0)
    tau = model.evaluate(q, dq, ddq)[0]
    every = np.ones(n_samples, dtype=bool)
    return States(f"run_{seed}", t, q, dq, ddq, q, dq, ddq, tau, rate, Band(10.0), every, two_encoders=False)


def test_a_fit_recovers_what_the_estimator_adds():
    """Torque by the online code, columns by the rows of the fit, memory and load included: exact without noise."""
    rng = np.random.default_rng(11)
    robot = three_joints()
    cylinder = {"a": [0.8] * N, "b": [0.2] * N, "phase": [0.4] * N, "gas_length": [0.6] * N}
    effects = [
        _core.Effect.rotor_inertia(),
        _core.Effect.torque_offset(),
        effect_of("friction"),
        effect_of("stribeck"),
        effect_of("load_dependent_friction"),
        effect_of("friction_hysteresis"),
        effect_of("coupled_friction"),
        _core.Effect.of("counterbalance", **cylinder),
        effect_of("thermal_friction"),
    ]
    acts_on = {7: [1]}
    plan = make_plan(robot, effects, acts_on=acts_on)
    own = np.where(plan.own, rng.uniform(0.5, 3.0, plan.own.shape), 0.0)
    edges = np.cumsum([0, *(effect.n_columns for effect in effects)])
    terms = [(effect, own[:, first:last]) for effect, first, last in zip(effects, edges, edges[1:], strict=False)]
    boxes = {"encoder_delay": [0.0] * N, "noise_std": [0.1] * N, "domain": ([[-9, 9]] * N, [99] * N, [999] * N)}
    truth = _core.TorqueModel(robot, robot.phi, terms, **boxes, step=1 / 250.0)
    runs = [rich_run(truth, seed) for seed in (1, 2)]
    tau_link = [robot.inverse_dynamics(states.q, states.dq, states.ddq, robot.phi) for states in runs]
    with pytest.raises(ValueError, match="load_dependent_friction needs tau_link"):
        observe(plan, runs)
    runs = [replace(states, tau_link=load) for states, load in zip(runs, tau_link, strict=True)]
    observations = observe(plan, runs)
    links = LinkDynamicsIdentifier(prior=None).fit(observations)
    assert_allclose(links.own_, own, rtol=0, atol=1e-5)
    model = assemble(plan, links, links.own_, runs, encoder_delay=np.zeros(N), torque_unit="N*m")
    assert model.step == 1 / 250.0
    assert model.term_names[1:] == [effect.kind for effect in effects]
    test_run = rich_run(truth, 3)
    assert_allclose(evaluate(model, test_run)[0], test_run.tau, rtol=0, atol=1e-5)


@pytest.mark.parametrize("ratio", [-0.5, 0.3, 2.0])
def test_a_stage_that_two_joints_turn_is_one_stage_seen_from_both(ratio):
    """Its speed is one: both joints' columns are the same motion, in the partner's own unit of speed."""
    shape = (("partner", 2.0), ("ratio", ratio), ("transition_width", 0.1))
    placed = Shaped("coupled_friction", (0, 2), shape).placed()
    ((effect, _),) = effects_of([placed], N)
    columns = _core.effect_columns(effect, *signals())
    side, speed = np.sign(ratio) * columns[:, 0, 0], columns[:, 0, 1] / ratio
    assert np.ptp(side) > 1
    assert_allclose(columns[:, 2], np.stack([side, speed], axis=1), **ALGEBRAIC)


def test_a_sign_without_a_sharpness_is_a_tanh():
    """As files before version 6 mean it."""
    shape = {name: values for name, values in SHAPES["load_dependent_friction"].items() if name != "sharpness"}
    old = _core.Effect.of("load_dependent_friction", **shape)
    assert old.shape == _core.Effect.of("load_dependent_friction", **shape, sharpness=[0.0] * N).shape
    assert PlacedEffect.at("load_dependent_friction", 1, transition_width=0.02).shape_at(1)["sharpness"] == 0.0
    assert dict(old.shape)["sharpness"] == [0.0] * N
    with pytest.raises(ValueError, match="transition_width, sharpness"):
        _core.Effect.of("load_dependent_friction", sharpness=[1.0] * N)
