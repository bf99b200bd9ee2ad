"""The state at the end of a run in the fields of diagnostic_msgs/msg/DiagnosticArray, as its definition has them."""

import json

import pytest
from helpers.watched_runs import CLOCK, HOSTILE, both, change, run, watch

from dynid_rs import ros_diagnostics

DEFINITIONS = {
    "DiagnosticArray": {"header": "Header", "status": ["DiagnosticStatus"]},
    "Header": {"stamp": "Time", "frame_id": str},
    "Time": {"sec": "int32", "nanosec": "uint32"},
    "DiagnosticStatus": {
        "level": "byte",
        "name": str,
        "message": str,
        "hardware_id": str,
        "values": ["KeyValue"],
    },
    "KeyValue": {"key": str, "value": str},
}
"""diagnostic_msgs and what it is made of (std_msgs/Header, builtin_interfaces/Time), field by field."""
INTEGERS = {"int32": (-(2**31), 2**31), "uint32": (0, 2**32), "byte": (0, 256)}
OK, WARN, ERROR, STALE = 0, 1, 2, 3


def check(message, kind="DiagnosticArray"):
    """Every field is there, none beside, each of its kind."""
    if isinstance(kind, list):
        assert type(message) is list
        for one in message:
            check(one, kind[0])
    elif kind in INTEGERS:
        low, high = INTEGERS[kind]
        assert type(message) is int
        assert low <= message < high
    elif kind is str:
        assert type(message) is str
    else:
        assert message.keys() == DEFINITIONS[kind].keys()
        for field, of in DEFINITIONS[kind].items():
            check(message[field], of)


def told(*runs, of=None):
    message = ros_diagnostics(of or watch(), runs)
    again = json.loads(json.dumps(message, allow_nan=False))
    assert again == message
    check(again)
    assert len(again["status"]) == 7
    return again


def levels(*runs):
    return [status["level"] for status in told(*runs)["status"]]


def values(status):
    return {pair["key"]: pair["value"] for pair in status["values"]}


def test_levels_say_what_became_of_a_change():
    named, settled = both("friction")
    assert levels(run()) == [OK] * 7
    assert levels(run(named)) == [OK, WARN, OK, OK, OK, OK, OK]
    assert levels(run(named, settled)) == [OK, ERROR, OK, OK, OK, OK, OK]
    assert levels(run(*both("friction", outcome="withdrawn"))) == [OK] * 7
    assert levels(run(named, settled), run()) == [OK] * 7


def test_a_load_is_no_fault_of_a_joint():
    named, settled = both("load", "joint_6", 2.0)
    assert levels(run(named, settled)) == [OK] * 6 + [WARN]
    load = told(run(named, settled))["status"][-1]
    assert load["name"] == "dynid watch: load"
    assert (values(load)["load"], values(load)["load_unit"], values(load)["load_moment_x"]) == ("2", "kg", "0.1")


def test_what_was_not_watched_is_stale():
    settled = change("friction")
    assert levels(run(settled, unseen=(1, 3))) == [OK, STALE, OK, STALE, OK, OK, OK]
    assert levels(run(unseen=range(6))) == [STALE] * 7
    assert levels(run(rows=0)) == [STALE] * 7


def test_a_frozen_channel_is_no_stale_joint():
    named, settled = (
        change("frozen", "joint_2", 2.5, t=t, said=said, half=0.0) for t, said in ((9.0, "named"), (29.0, "settled"))
    )
    assert levels(run(named, unseen=(1,))) == [OK, WARN, OK, OK, OK, OK, OK]
    assert levels(run(named, settled, unseen=(1,))) == [OK, ERROR, OK, OK, OK, OK, OK]
    status = told(run(named, settled))["status"][1]
    assert status["message"].startswith("the torque channel does not change any more, 2.50")
    assert values(status)["frozen"] == "2.5"
    assert "one value all the time" in values(status)["frozen_advice"]


def test_words_and_numbers_say_the_same():
    status = told(run(*both("friction", size=-0.25, either="gain of joint_2")))["status"][1]
    assert (status["name"], status["hardware_id"]) == ("dynid watch: joint_2", "six_axis")
    assert status["message"] == "friction -25 % (-27 to -23 %), or gain of joint_2 (settled)"
    found = values(status)
    assert (found["friction"], found["friction_low"], found["friction_high"]) == ("-0.25", "-0.27", "-0.23")
    assert (found["friction_state"], found["friction_or"]) == ("settled", "gain of joint_2")
    assert "lubricated" in found["friction_advice"]
    assert float(found["residual_ratio"]) == pytest.approx(1.0, abs=0.15)
    assert found["watched_ratio"] == "1"


def test_two_changes_of_a_joint_are_both_said():
    status = told(run(*both("friction"), *both("offset", size=4.0, t=50.0)))["status"][1]
    assert status["message"].count("(settled)") == 2
    assert {"friction", "offset", "offset_unit"} <= values(status).keys()


@pytest.mark.parametrize(
    ("start", "stamp"),
    [
        (CLOCK + 0.25, {"sec": int(CLOCK) + 120, "nanosec": 250_000_000}),
        (0.0, {"sec": 0, "nanosec": 0}),
        (1e6, {"sec": 0, "nanosec": 0}),
        (CLOCK + 0.99999999999, {"sec": int(CLOCK) + 121, "nanosec": 0}),
    ],
)
def test_the_stamp_is_the_end_of_the_last_run_on_a_clock_on_the_wall(start, stamp):
    assert told(run(start=0.0), run(start=start))["header"] == {"stamp": stamp, "frame_id": ""}


def test_names_come_back_whatever_they_hold():
    status = told(run(*both("friction", HOSTILE)), of=watch(second=HOSTILE))["status"][1]
    assert (status["name"], status["level"]) == (f"dynid watch: {HOSTILE}", ERROR)


def test_without_a_run_there_is_no_state():
    with pytest.raises(ValueError, match="no run was watched"):
        ros_diagnostics(watch(), [])
