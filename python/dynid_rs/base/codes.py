"""Names of what can be wrong with a run: what is found, by what evidence, and what mends it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple


class Code(NamedTuple):
    """What a name stands for, in words: what is `found`, the `evidence` that tells it, and the `mend`."""

    found: str
    evidence: str
    mend: str


CODES: Mapping[str, Code] = {
    # Files and time
    "not_finite": Code("NaN or infinity", "the cell", "cut these rows out or split the run there"),
    "bad_cell": Code("a cell that is empty or no number", "the cell", "correct the cell, or cut the row out"),
    "time_backwards": Code("time that goes backwards", "two stamps", "none needed, the run is read in parts"),
    "time_stands_still": Code("stamps that repeat", "two stamps", "remove the repeated rows"),
    "gap": Code("missing samples, bridged", "steps over the usual step", "none needed; record without losses"),
    "long_gap": Code(
        "missing samples, too many to bridge", "step over the usual step", "none needed, the run is read in parts"
    ),
    "sampling_rate": Code(
        "time in another unit; or a slow rate",
        "rate, duration and speed against logs of robots and the other runs",
        "give [units] time, or write the file again in seconds",
    ),
    "jitter": Code(
        "stamps that are not those of the samples",
        "95th percentile of the steps' deviation, or a long step that short ones make up for",
        "stamp samples where they are taken, or number them evenly",
    ),
    "run_twice": Code("samples that another run has too", "equal rows, to the last bit", "name the run once"),
    # One channel
    "units_degrees": Code("positions in degrees", "limits, or the torque", 'give [units] angle = "deg"'),
    "units_mixed": Code("one position in degrees, others in radians", "limits", "write that column in radians"),
    "units_length": Code("lengths in millimetres", "limits", 'give [units] length = "mm"'),
    "units_radians": Code(
        "radians that are read as degrees", "no position beyond 2 pi of them", "take [units] angle out of dynid.toml"
    ),
    "absurd_value": Code("a number beyond all arms", "the cell", "cut these rows out, or give the unit"),
    "position_jump": Code("a position that jumps", "the step against the usual ones", "cut these rows out"),
    "torque_spike": Code("a torque that stands alone", "the rows around it and the range", "cut the row out"),
    "velocity_spike": Code("a velocity that stands alone", "the rows around it and the range", "cut the row out"),
    "stuck": Code("a channel that stays while the joint moves", "equal rows, and a jump after", "cut these rows out"),
    "lost_bits": Code(
        "a channel in too coarse steps, or a bit that hangs",
        "the lattice of values, or jumps of one size",
        "record all digits; mend the encoder or its cable",
    ),
    "wrapped": Code("an angle that starts again after a turn", "a step of 2 pi", "unwrap the angle"),
    "saturated": Code("a torque that stays at the end of its range", "the plateau's length", "move less, or slower"),
    "torque_beyond_effort": Code("torque beyond the drives", "effort limits of the file", "check the torque's unit"),
    "position_limits": Code("positions beyond the limits", "the robot file", "check robot, zero and sign"),
    "dq_disagrees": Code(
        "a velocity that is not the position's: late, held, another unit, sign or joint",
        "its integral against the position",
        "none needed, it is not used; give [units] velocity, or leave the column out",
    ),
    "dq_motor_disagrees": Code("the same of a motor's velocity", "its integral", "none needed, it is not used"),
    "ddq_disagrees": Code("the same of an acceleration", "its integral", "none needed, it is not used"),
    "motor_flipped": Code("a motor encoder with the other sign", "the link's encoder", "give [signs] q_motor"),
    "motor_scale": Code("a motor encoder before the gear", "the link's encoder", "give [gear] ratio"),
    "motor_swapped": Code("motor encoders exchanged", "the link's encoders", "map them under [columns]"),
    "motor_disagrees": Code("encoders that contradict each other", "their correlation", "check both channels"),
    "encoder_offset": Code("encoders with different zeros", "their mean difference", "subtract the offset"),
    "encoder_delay": Code("encoders on two clocks", "difference over speed", "none needed, it is fitted and removed"),
    # The arm
    "torque_swapped": Code("torques of two joints exchanged", "the arm's model", "map them under [columns]"),
    "position_swapped": Code("positions of two joints exchanged", "the arm's model", "map them under [columns]"),
    "joints_swapped": Code("two joints exchanged", "the arm's model", "map them under [columns]"),
    "torque_flipped": Code("a torque with the other sign", "the arm's model", "give [signs] tau"),
    "position_flipped": Code("a position with the other sign", "the arm's model", "give [signs] q"),
    "joint_flipped": Code("a joint that turns the other way", "the arm's model", "give [signs] q and tau"),
    "zero_shifted": Code(
        "a position whose zero is a quarter turn or a half from the robot file's",
        "the arm's model",
        "add it to the column, or turn the joint's origin",
    ),
    "torque_unit": Code("torque in another unit", "the arm's model", "give [units] torque or [gear] apply_to"),
    "joint_order": Code(
        "joints in an order that the file cannot say",
        "names of joints in a format that gives no text",
        "list the columns in dynid.toml, or write the run as CSV, JSON lines or Parquet",
    ),
    "current_as_torque": Code("currents called torque", "the arm's model", "call the columns current_0, ..."),
    "torque_late": Code("torque on a late clock", "the arm's model", "shift it, or let dynid diagnose fit it"),
    "torque_filtered": Code("torque behind a slow filter", "delay, and noise that falls off", "record it unfiltered"),
    "mounting": Code("gravity from another side, or of another size", "the arm's model", "give --gravity"),
    "payload_change": Code("a run with another load", "the arm's model", "learn from runs of one load"),
    "contact": Code("a push from outside", "bursts of the residual", "leave these samples out"),
    # Motion
    "joint_never_moves": Code("a joint that stands", "its range", "record a run that moves it"),
    "small_motion": Code("a joint that hardly moves", "its range", "move it further: dynid excite"),
    "slow_motion": Code("a joint that only creeps", "its speed", "move it faster: dynid excite"),
    "few_reversals": Code("a joint that moves one way", "reversals", "move it to and fro: dynid excite"),
    "mostly_still": Code("a joint that mostly rests", "its share of motion", "move it more: dynid excite"),
    "joints_together": Code(
        "joints that move as one", "correlation of velocities", "let them move apart: dynid excite"
    ),
    "short_run": Code("a short run", "its duration", "record longer"),
}
"""Codes of findings and of refusals about runs, in the order of a page."""

OF_LEARNING = frozenset(list(CODES)[list(CODES).index("joint_never_moves") :])
"""What a run lacks to learn parameters from; it can be watched, and looked at for contacts, all the same."""


def mend_of(code: str) -> str | None:
    """What mends a fault, in general; None for codes that are not about runs."""
    known = CODES.get(code)
    return None if known is None else known.mend
