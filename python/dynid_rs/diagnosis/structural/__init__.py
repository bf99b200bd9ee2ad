"""Effects that are no torque columns of the catalogue: changes of geometry, gravity, gains and encoders.

Their columns are derivatives of the predicted torque; what accepts them changes the robot or a channel, and the fit is
made again there. `refine` then moves what was accepted, one Gauss-Newton step per refit.
"""

from __future__ import annotations

from dynid_rs.diagnosis.candidate import Candidate
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.structural.beside import Beside
from dynid_rs.diagnosis.structural.encoder_eccentricity import eccentricity_candidates
from dynid_rs.diagnosis.structural.frames import displacement, levelled, put_back, tilt_of
from dynid_rs.diagnosis.structural.gravity_tilt import tilt_candidates
from dynid_rs.diagnosis.structural.kinematic_error import kinematic_candidates
from dynid_rs.diagnosis.structural.refine import Parameters, refine, structural_parameters, whole_model
from dynid_rs.diagnosis.structural.torque_gain import gain_candidates
from dynid_rs.identification import ThreeLoopIdentifier

__all__ = [
    "Beside",
    "Parameters",
    "displacement",
    "levelled",
    "put_back",
    "refine",
    "structural_candidates",
    "structural_parameters",
    "tilt_of",
]


def structural_candidates(fit: ThreeLoopIdentifier, setup: Setup) -> list[Candidate]:
    """Return every structural hypothesis beside the model that `fit` has of `setup`."""
    beside, plausible = whole_model(fit)
    return [
        *tilt_candidates(beside, setup, plausible),
        *kinematic_candidates(beside, setup, plausible),
        *gain_candidates(beside, setup),
        *eccentricity_candidates(beside, setup),
    ]
