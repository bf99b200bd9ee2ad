"""What measured robots lack, by name and number: ripple, memory, friction against a measured difference."""

from __future__ import annotations

import numpy as np
import pytest
from real_diagnosis import CASES, close_the_loop, load

from dynid_rs.assembly import evaluate
from dynid_rs.diagnosis.ripple import ripple_orders
from dynid_rs.diagnosis.state import fitted

MOTOR = "bare motor, held"
ARM = "seven axes, currents"


def lines_of(name, *, all_runs=False):
    runs = load(CASES[name])
    train = [*runs.train, *runs.test] if all_runs else runs.train
    return ripple_orders(fitted(runs.setup(), train), [*train, *runs.further])


def found(lines, joint, order, width):
    """The line of a joint nearest to an order, if within `width`."""
    near = [line for line in lines if line.joint == joint and abs(line.order - order) < width]
    return min(near, key=lambda line: abs(line.order - order), default=None)


def test_the_motors_cogging_is_found_strongest_first():
    lines = lines_of(MOTOR)
    assert abs(lines[0].order - 72) < 0.2
    for order, size in ((72, 0.180), (18, 0.043), (12, 0.031), (24, 0.018), (36, 0.014), (48, None), (144, None)):
        line = found(lines, 0, order, 0.2)
        assert line is not None, order
        assert line.p_value < 1e-3
        if size is not None:  # the set's own Fourier series, over the whole turn
            assert abs(line.amplitude - size) < 0.15 * size, (order, line.amplitude)


@pytest.mark.parametrize("name", [MOTOR, "bare motor, turning"])
def test_cogging_comes_off_angles_that_were_never_seen(name):
    outcome = close_the_loop(load(CASES[name]))
    assert outcome.raw_after < {MOTOR: 0.2, "bare motor, turning": 0.75}[name] * outcome.raw_before


def test_ripple_is_found_once_and_twice_per_motor_turn():
    """Gears near 100 on joint 1 and near 81 on joints 3 and 5; joints rest in each other's friction runs."""
    lines = lines_of(ARM, all_runs=True)
    for joint, order in ((1, 100), (1, 200), (1, 400), (3, 162), (5, 80), (5, 161)):
        line = found(lines, joint, order, 1.5)
        assert line is not None, (joint, order)
        assert line.p_value < 1e-6
    strongest = {joint: next(line for line in lines if line.joint == joint).order for joint in (1, 3, 5)}
    assert abs(strongest[3] - 162) < 1.5
    assert abs(strongest[5] - 161) < 1.5


@pytest.mark.parametrize(("name", "bound"), [("Franka joint 1, friction", 0.326), ("Franka joint 6, friction", 0.240)])
def test_memory_is_chosen_and_the_fast_run_is_predicted_as_well_as_by_a_law_fitted_to_it(name, bound):
    outcome = close_the_loop(load(CASES[name]))
    assert "friction_hysteresis" in [effect.kind for effect in outcome.setup.effects]
    assert outcome.after[0] <= bound
    assert outcome.after[0] < 0.6 * outcome.before[0]


def test_friction_identified_from_motors_is_the_measured_difference():
    """Motor torque times the ratio, less what the sensor behind the gear shows, less the sensor side's own friction."""
    runs = {side: load(CASES[f"xMate3 Pro, {side} torque"]) for side in ("motor", "joint")}
    fits = {side: fitted(run.setup(), run.train) for side, run in runs.items()}
    states = {side: [fits[side].states(r) for r in (*runs[side].train, *runs[side].test)] for side in runs}

    def in_band(side, values):
        return np.concatenate([s.in_band(values(s)) for s in states[side]])

    def term(side, name):
        model = fits[side].model_
        return in_band(side, lambda s: evaluate(model, s)[1][:, model.term_names.index(name)])

    motor, sensor = in_band("motor", lambda s: s.tau), in_band("joint", lambda s: s.tau)
    acceleration = in_band("motor", lambda s: s.ddq)
    velocity = in_band("motor", lambda s: s.dq)
    sign = in_band("motor", lambda s: np.sign(s.dq))
    rotor, identified, behind = term("motor", "rotor_inertia"), term("motor", "friction"), term("joint", "friction")
    for j in range(motor.shape[1]):
        v = velocity[:, j]
        columns = [sensor[:, j], acceleration[:, j], v, v * np.abs(v), v**3, sign[:, j], np.ones(len(v))]
        ratio = 1 / np.linalg.lstsq(np.column_stack(columns), motor[:, j], rcond=None)[0][0]
        measured = ratio * (motor[:, j] - rotor[:, j]) - sensor[:, j] + behind[:, j]
        measured, friction = measured - measured.mean(), ratio * (identified[:, j] - identified[:, j].mean())
        assert abs(ratio / (108, 138, 113, 112, 77, 87, 47)[j] - 1) < 0.2
        assert 0.9 < friction @ measured / (friction @ friction) < 1.1
        assert (measured - friction).std() < 0.25 * measured.std()
