"""A load that the robot file lacks: carried on all runs it is no difference between them, on one it is."""

from dataclasses import replace

import pytest
from helpers.chains import chain

from dynid_rs.identification.training import prepare_training_runs
from dynid_rs.runs.preprocessing import choose_band, common_rate
from dynid_rs.sensors.channels import channel_findings
from dynid_rs.simulation import simulate, typical_arm

OUT = 0.15
"""A load is this far off the last axis [m]."""


def scara(load=0.0):
    """Upright axes and a slide, with this load [kg] beside the tool's one."""
    mass = 1.0 + load
    out = load * OUT / mass
    about = 0.004 + 0.004 * load + load * OUT**2 - mass * out**2
    links = [("l1", 12, 0.2, 0.25), ("l2", 8, 0.15, 0.12), ("quill", 2, 0, 0.01), ("tool", mass, out, about)]
    joints = [
        ("j1", "revolute", "base", "l1", "0 0 1", 0.0, 2.4, 200, 5),
        ("j2", "revolute", "l1", "l2", "0 0 1", 0.4, 2.4, 90, 6),
        ("j3", "prismatic", "l2", "quill", "0 0 1", 0.3, 0.1, 300, 0.8),
        ("j4", "revolute", "quill", "tool", "0 0 1", 0.0, 5.0, 15, 10),
    ]
    return chain(links, joints)


def run(load, seed, duration):
    arm = replace(typical_arm(scara(load), noise=1.0, encoder_noise=1e-6).rigid(), delay=0.0)
    (recording,) = simulate(arm, n_runs=1, duration=duration, rate=250, seed=seed).recordings
    return replace(recording, q_motor=None, name=f"run_{seed}")


def found(recordings):
    states = prepare_training_runs(recordings, choose_band(recordings), common_rate(recordings))
    return channel_findings(scara(), states)


@pytest.mark.parametrize("seed", [0, 1])
def test_two_parts_of_one_run_carry_the_same_load(seed):
    """They were said to differ by 0.035 and 0.067 kg: 6 kg were more than the links' own numbers could become."""
    whole = run(6.0, seed, 20.0)
    middle = whole.n_samples // 2
    parts = [replace(whole.slice(0, middle), name="first"), replace(whole.slice(middle, whole.n_samples), name="last")]
    assert found(parts) == []


def test_what_one_run_carries_beside_the_load_of_all_is_weighed_alone():
    (finding,) = found([run(6.0, 0, 15.0), run(9.0, 1, 15.0)])
    assert (finding.code, finding.file) == ("payload_change", "run_1")
    assert finding.value == pytest.approx(3.0, rel=0.1)
