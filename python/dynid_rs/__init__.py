"""Torque models of robot arms from measured runs: identified in Python, evaluated in Rust.

A torque model is a sum of terms; Rust knows what each term is, Python finds out how big it is.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from dynid_rs._core import (
    BaseParameters,
    Effect,
    FormatError,
    MdhError,
    PhysicalSet,
    RobotModel,
    TorqueModel,
    UrdfError,
    __version__,
)
from dynid_rs.base.errors import DamageWarning, DataError, MissingLibraryError, RankDeficientError

if TYPE_CHECKING:
    from dynid_rs.commands._fleet_run import identify_fleet
    from dynid_rs.diagnosis.found import FoundEffect
    from dynid_rs.diagnosis.loop import diagnose
    from dynid_rs.diagnosis.outcome import Diagnosis
    from dynid_rs.diagnosis.setup import Setup
    from dynid_rs.excitation import FourierExcitation
    from dynid_rs.experiment.designing import NextExperiment
    from dynid_rs.experiment.next import next_experiment
    from dynid_rs.identification.base_fit import BaseFit, fit_base_parameters
    from dynid_rs.identification.directions import ParameterDirections, parameter_directions
    from dynid_rs.identification.doubt import Doubt
    from dynid_rs.identification.friction import FrictionIdentifier
    from dynid_rs.identification.links import LinkDynamicsIdentifier
    from dynid_rs.identification.mixture import GaussianMixtureRegressor
    from dynid_rs.identification.rbf import RbfRegressor
    from dynid_rs.identification.residual import ResidualCompensator
    from dynid_rs.identification.three_loops import ThreeLoopIdentifier
    from dynid_rs.model.adapt import Adaptation
    from dynid_rs.model.detection import DetectionCurve, detection_curve
    from dynid_rs.model.export import to_pinocchio
    from dynid_rs.model.health import health_page
    from dynid_rs.model.observer import MomentumObserver
    from dynid_rs.model.physical import PhysicalIdentifier
    from dynid_rs.model.prometheus import prometheus_text
    from dynid_rs.model.robot_file import read_robot
    from dynid_rs.model.ros_diagnostics import ros_diagnostics
    from dynid_rs.model.watch import Tolerated, Watch
    from dynid_rs.pooling.arm import ArmEstimate
    from dynid_rs.pooling.fleet import Fleet
    from dynid_rs.regression.instruments import InstrumentalVariables
    from dynid_rs.runs.readers import Config, PartsWarning, read_config, read_recording, read_recordings
    from dynid_rs.runs.recording import Recording
    from dynid_rs.runs.recordings import Recordings
    from dynid_rs.sensors.inspection import inspect

# scikit-learn takes a second to import; nobody who only evaluates a model should wait for it.
_LATE = {
    "Adaptation": "model.adapt",
    "ArmEstimate": "pooling.arm",
    "BaseFit": "identification.base_fit",
    "Config": "runs.readers",
    "DetectionCurve": "model.detection",
    "Diagnosis": "diagnosis.outcome",
    "Doubt": "identification.doubt",
    "Fleet": "pooling.fleet",
    "FoundEffect": "diagnosis.found",
    "FourierExcitation": "excitation",
    "FrictionIdentifier": "identification.friction",
    "GaussianMixtureRegressor": "identification.mixture",
    "InstrumentalVariables": "regression.instruments",
    "LinkDynamicsIdentifier": "identification.links",
    "MomentumObserver": "model.observer",
    "NextExperiment": "experiment.designing",
    "ParameterDirections": "identification.directions",
    "PartsWarning": "runs.readers",
    "PhysicalIdentifier": "model.physical",
    "RbfRegressor": "identification.rbf",
    "Recording": "runs.recording",
    "Recordings": "runs.recordings",
    "ResidualCompensator": "identification.residual",
    "Setup": "diagnosis.setup",
    "ThreeLoopIdentifier": "identification.three_loops",
    "Tolerated": "model.watch",
    "Watch": "model.watch",
    "detection_curve": "model.detection",
    "diagnose": "diagnosis.loop",
    "fit_base_parameters": "identification.base_fit",
    "health_page": "model.health",
    "identify_fleet": "commands._fleet_run",
    "inspect": "sensors.inspection",
    "next_experiment": "experiment.next",
    "parameter_directions": "identification.directions",
    "prometheus_text": "model.prometheus",
    "read_config": "runs.readers",
    "read_recording": "runs.readers",
    "read_recordings": "runs.readers",
    "read_robot": "model.robot_file",
    "ros_diagnostics": "model.ros_diagnostics",
    "to_pinocchio": "model.export",
}

__all__ = [
    "Adaptation",
    "ArmEstimate",
    "BaseFit",
    "BaseParameters",
    "Config",
    "DamageWarning",
    "DataError",
    "DetectionCurve",
    "Diagnosis",
    "Doubt",
    "Effect",
    "Fleet",
    "FormatError",
    "FoundEffect",
    "FourierExcitation",
    "FrictionIdentifier",
    "GaussianMixtureRegressor",
    "InstrumentalVariables",
    "LinkDynamicsIdentifier",
    "MdhError",
    "MissingLibraryError",
    "MomentumObserver",
    "NextExperiment",
    "ParameterDirections",
    "PartsWarning",
    "PhysicalIdentifier",
    "PhysicalSet",
    "RankDeficientError",
    "RbfRegressor",
    "Recording",
    "Recordings",
    "ResidualCompensator",
    "RobotModel",
    "Setup",
    "ThreeLoopIdentifier",
    "Tolerated",
    "TorqueModel",
    "UrdfError",
    "Watch",
    "__version__",
    "detection_curve",
    "diagnose",
    "fit_base_parameters",
    "health_page",
    "identify_fleet",
    "inspect",
    "next_experiment",
    "parameter_directions",
    "prometheus_text",
    "read_config",
    "read_recording",
    "read_recordings",
    "read_robot",
    "rmse",
    "ros_diagnostics",
    "to_pinocchio",
]


def __getattr__(name: str) -> Any:
    if name in _LATE:
        from importlib import import_module

        found = globals()[name] = getattr(import_module(f".{_LATE[name]}", __name__), name)
        return found
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)


def rmse(measured: Any, predicted: Any) -> Any:
    """Root mean square of measured minus predicted, (n_samples, n_joints) each: (n_joints,)."""
    import numpy as np

    from dynid_rs.base.masked import unmasked

    return np.sqrt(np.mean((np.asarray(unmasked(measured)) - np.asarray(unmasked(predicted))) ** 2, axis=0))
