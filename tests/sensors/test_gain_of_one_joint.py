"""A gantry's slides have inertia as of a rotor: what its one turning joint says is not known of the others."""

from dataclasses import replace

import pytest
from helpers.chains import chain

from dynid_rs.identification.training import prepare_training_runs
from dynid_rs.runs.preprocessing import choose_band, common_rate
from dynid_rs.sensors.channels import channel_findings
from dynid_rs.simulation import simulate, typical_arm

TOOL, OUT = 2.0, 0.05
"""What the file has behind the turning joint [kg], and how far off its axis [m]."""
LOAD_OUT = 0.12
"""A load is this far off that axis [m]."""


def gantry(load):
    """Three slides and one joint that turns, with this load [kg]."""
    mass = TOOL + load
    out = (TOOL * OUT + load * LOAD_OUT) / mass
    about = TOOL * OUT**2 + load * LOAD_OUT**2 + 0.005 + 0.002 * load - mass * out**2
    links = [("x", 20, 0, 0.5), ("y", 10, 0, 0.2), ("z", 6, 0, 0.1), ("tool", mass, out, about)]
    joints = [
        ("jx", "prismatic", "base", "x", "1 0 0", 0.0, 1.0, 800, 1),
        ("jy", "prismatic", "x", "y", "0 1 0", 0.0, 0.6, 500, 1),
        ("jz", "prismatic", "y", "z", "0 0 1", 0.0, 0.4, 400, 1),
        ("jc", "revolute", "z", "tool", "0 1 0", 0.0, 3.0, 30, 4),
    ]
    return chain(links, joints)


@pytest.mark.parametrize(("load", "factor", "codes"), [(6.0, 1.0, []), (0.0, 1e3, ["torque_unit"])])
def test_a_load_on_the_only_joint_that_tells_a_gain_is_no_unit_of_all(load, factor, codes):
    """The slides got the turning joint's 0.12 N m per N m, and inspect and diagnose stopped with an error."""
    arm = replace(typical_arm(gantry(load), noise=1.0, encoder_noise=1e-6).rigid(), delay=0.0)
    recordings = [
        replace(run, q_motor=None, tau=factor * run.tau)
        for run in simulate(arm, n_runs=3, duration=20.0, rate=250, seed=0).recordings
    ]
    states = prepare_training_runs(recordings, choose_band(recordings), common_rate(recordings))
    assert [finding.code for finding in channel_findings(gantry(0.0), states)] == codes
