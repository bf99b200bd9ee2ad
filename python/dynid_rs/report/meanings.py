"""What each kind of effect is, in one sentence for somebody who has not met it."""

from __future__ import annotations

MEANINGS = {
    "stribeck": "Friction is greatest just after the joint starts to move and falls as its lubricant film builds up.",
    "counterbalance": "A gas cylinder or spring carries part of the arm\u2019s weight.",
    "load_dependent_friction": "Friction grows with the torque that the gear carries.",
    "bearing_friction": "Friction grows with the torque of the joint beside it, as in a bearing that it tilts.",
    "position_dependent_friction": "Friction changes with the joint\u2019s angle, as of a gear that is not round.",
    "friction_hysteresis": "After a reversal friction builds up over a short way (presliding) instead of at once.",
    "load_hysteresis": "Friction grows with the gear\u2019s load, and builds up over a short way after each reversal.",
    "gear_hysteresis": "The gear gives back less torque than it took as its load falls again.",
    "coupled_friction": "A gear stage turns with two joints at once and rubs on both.",
    "torque_ripple": "Torque that goes up and down as gear teeth or motor poles pass by (cogging, toothing).",
    "inertial_coupling": "Accelerating one joint\u2019s rotor needs torque on another one.",
    "joint_spring": "A spring, a cable or a hose pulls the joint towards one position.",
    "another_function_of_the_position": "Something without a name depends on the joint\u2019s position.",
    "torque_saturation": "The drive gives less torque per ampere, or the sensor shows less, the greater the torque is.",
    "thermal_friction": "Friction falls as the joint warms up during the run.",
    "temperature_friction": "Friction changes with the joint\u2019s measured temperature.",
    "payload": "The arm carries a mass that the model did not know of.",
    "gravity_tilt": "The base does not stand as the robot file has it: gravity pulls in another direction.",
    "kinematic_error": "A joint\u2019s axis is not where the robot file has it.",
    "joint_elasticity": "The gear yields like a spring between motor and link.",
    "nonlinear_elasticity": "The gear\u2019s spring becomes stiffer, or softer, under load.",
    "backlash": "The gear has play: the motor turns a little before the link follows.",
    "encoder_delay": "Motor and link encoder are not read at the same instant.",
    "encoder_eccentricity": "An encoder disc is not centred: it shows an error that comes once a turn.",
    "torque_delay": "The torque channel is later than the positions, or earlier where its delay is negative.",
    "torque_gain": "The torque channel shows too much or too little, by a constant factor.",
    "unknown": "Something is there that depends on the signals below, and no name of the catalogue fits it.",
}


def meaning(kinds: list[str]) -> str:
    """Sentences on the kinds that an effect may be."""
    return " ".join(MEANINGS[kind] for kind in kinds or ["unknown"] if kind in MEANINGS)
