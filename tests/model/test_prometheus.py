"""The state at the end of a run as Prometheus reads it: by its own client's parser, and by the format's grammar."""

import re
from collections import Counter

import pytest
from helpers.watched_runs import CLOCK, HOSTILE, both, change, run, watch
from prometheus_client.parser import text_string_to_metric_families

from dynid_rs import prometheus_text
from dynid_rs.model.prometheus import _labels

VALUE = r'"(?:[^"\\\n]|\\[\\"n])*"'
SAMPLE = re.compile(rf"([a-zA-Z_:][a-zA-Z0-9_:]*)\{{([a-zA-Z_]\w*={VALUE}(?:,[a-zA-Z_]\w*={VALUE})*)\}} (\S+)")
UNITS = (
    "ratio",
    "newton_meters",
    "newtons",
    "amperes",
    "kilograms",
    "kilogram_meters",
    "seconds",
    "radians",
    "meters",
    "changed",
)


def samples(text):
    """Value by name and labels."""
    return {
        (one.name, frozenset(one.labels.items())): one.value
        for family in text_string_to_metric_families(text)
        for one in family.samples
    }


def value(text, name, **labels):
    (found,) = (
        number
        for (own, pairs), number in samples(text).items()
        if own == f"dynid_watch_{name}" and dict(pairs) == {"robot": "six_axis", **labels}
    )
    return found


def check_grammar(text):
    """Help and type of a metric before its samples, all of which stand together; no series twice, no time stamp."""
    assert text.endswith("\n")
    seen, now = Counter(), None
    lines = text.removesuffix("\n").split("\n")
    for k, line in enumerate(lines):
        if line.startswith("# HELP "):
            now = line.split()[2]
            assert re.fullmatch(rf"# TYPE {now} (gauge|counter)", lines[k + 1])
            counts = lines[k + 1].endswith("counter")
            assert now.endswith("_total") == counts
            assert counts or now.endswith(UNITS)
            seen[now] += 1
        elif not line.startswith("# TYPE "):
            name, labels, number = SAMPLE.fullmatch(line).groups()
            assert name == now
            float(number)
            seen[labels, name] += 1
    assert set(seen.values()) == {1}


CHANGED = (*both("friction", size=0.2), *both("offset", "joint_3", -4.0, t=50.0), *both("load", "joint_6", 2.0, t=90.0))


@pytest.mark.parametrize(
    "runs",
    [
        [run()],
        [run(*CHANGED, start=CLOCK), run(start=CLOCK + 200, unseen=(1, 4))],
        [run(rows=0)],
        [run(unseen=range(6))],
        [run(*CHANGED)],
    ],
)
def test_the_text_keeps_the_format(runs):
    text = prometheus_text(watch(), runs)
    check_grammar(text)
    assert len(samples(text)) == sum(not line.startswith("#") for line in text.splitlines())


def test_changes_come_back_as_they_were_said():
    text = prometheus_text(watch(), [run(*CHANGED)])
    assert value(text, "changed", joint="joint_2", kind="friction") == 1
    assert value(text, "change_ratio", joint="joint_2", kind="friction") == 0.2
    assert value(text, "offset_newton_meters", joint="joint_3") == -4.0
    assert value(text, "load_kilograms") == 2.0
    assert [value(text, "load_moment_kilogram_meters", axis=axis) for axis in "xyz"] == [0.1, 0.0, -0.05]
    assert value(text, "changed", kind="load") == 1
    assert sum(number for (name, _), number in samples(text).items() if name == "dynid_watch_changed") == 3
    assert value(text, "change_ratio", joint="joint_2", kind="gain") == 0
    assert value(text, "residual_ratio", joint="joint_1") == pytest.approx(1.0, abs=0.15)
    assert value(text, "rows_total") == 600


def test_delays_and_slips_have_their_units():
    said = [
        change(kind, joint, size, t=50.0, said="settled", half=0.1 * abs(size))
        for kind, joint, size in (("delay", "joint_1", 0.012), ("slip", "joint_4", -0.03))
    ]
    text = prometheus_text(watch(), [run(*said)])
    check_grammar(text)
    assert value(text, "delay_seconds", joint="joint_1") == 0.012
    assert value(text, "slip_radians", joint="joint_4") == -0.03
    assert value(text, "slip_radians", joint="joint_1") == 0
    assert value(text, "changed", joint="joint_4", kind="slip") == 1
    ratios = [labels for name, labels in samples(text) if name == "dynid_watch_change_ratio"]
    assert not [labels for labels in ratios if {("kind", "slip"), ("kind", "delay")} & labels]


def test_it_is_the_state_at_the_end_of_the_last_run():
    text = prometheus_text(watch(), [run(*CHANGED), run(*both("gain", outcome="withdrawn"), rows=100)])
    assert sum(number for (name, _), number in samples(text).items() if name == "dynid_watch_changed") == 0
    assert (value(text, "rows_total"), value(text, "runs_total")) == (700, 2)


def test_of_joints_that_were_not_watched_nothing_is_said_but_that():
    text = prometheus_text(watch(), [run(unseen=(1,))])
    names = {name for name, labels in samples(text) if ("joint", "joint_2") in labels}
    assert names == {"dynid_watch_watched_ratio"}
    assert value(text, "watched_ratio", joint="joint_2") == 0
    assert 'kind="load"' not in prometheus_text(watch(), [run(unseen=range(6))])


def test_a_frozen_channel_is_said_of_a_joint_that_so_is_not_watched():
    text = prometheus_text(watch(), [run(change("frozen", "joint_2", 2.5, half=0.0), unseen=(1,))])
    check_grammar(text)
    assert value(text, "changed", joint="joint_2", kind="frozen") == 1
    assert value(text, "changed", joint="joint_1", kind="frozen") == 0
    assert value(text, "watched_ratio", joint="joint_2") == 0
    ratios = [labels for name, labels in samples(text) if name == "dynid_watch_change_ratio"]
    assert not [labels for labels in ratios if ("kind", "frozen") in labels]


def test_masses_and_torques_stand_only_where_they_are_known():
    text = prometheus_text(watch("A"), [run(*CHANGED)])
    check_grammar(text)
    assert "kilogram" not in text
    assert "newton" not in text
    assert value(text, "offset_amperes", joint="joint_3") == -4.0
    assert value(text, "changed", kind="load") == 1


def test_a_clock_on_the_wall_is_told_from_a_controller_s():
    assert value(prometheus_text(watch(), [run(start=CLOCK)]), "last_row_timestamp_seconds") == CLOCK + 120.0
    assert "timestamp" not in prometheus_text(watch(), [run(start=1e6)])


def test_names_come_back_whatever_they_hold():
    text = prometheus_text(watch(second=HOSTILE), [run(*both("friction", HOSTILE))])
    check_grammar(text)
    assert value(text, "changed", joint=HOSTILE, kind="friction") == 1


def test_a_line_feed_breaks_no_line():
    """No joint's name holds one today."""
    assert _labels({"joint": 'a\nb\\n"'}) == r'{joint="a\nb\\n\""}'


def test_without_a_run_there_is_no_state():
    with pytest.raises(ValueError, match="no run was watched"):
        prometheus_text(watch(), [])
