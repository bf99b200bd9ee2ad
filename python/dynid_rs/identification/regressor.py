"""What the field expects of an estimator of torque: `predict` and `score` on runs, and scikit-learn's tools."""

from __future__ import annotations

from abc import ABC, abstractmethod
from inspect import signature
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.base.estimator import Estimator
from dynid_rs.base.notebook import html_table
from dynid_rs.model.along import at_stamps, check_arm, check_some, check_unit
from dynid_rs.model.assembly import evaluate
from dynid_rs.regression.evaluation import compare, r2, r2_as_recorded
from dynid_rs.regression.is_fitted import check_is_fitted
from dynid_rs.runs.given import Runs, as_given, as_recordings, is_one
from dynid_rs.runs.preprocessing import States
from dynid_rs.runs.readers.config_file import Rules
from dynid_rs.runs.recording import Delay, Recording

FloatArray = NDArray[np.float64]


class RunRegressor(Estimator, ABC):
    """An estimator of torque that learns from runs: `cross_val_score(identifier, runs)` and `GridSearchCV` take it.

    Samples are whole runs, for neighbouring rows of one run are no independent data; the torque is in them, so `y` is
    left out everywhere.
    """

    robot: _core.RobotModel
    config: Rules
    model_: _core.TorqueModel

    @abstractmethod
    def states(self, recording: Recording) -> States:
        """States of a run in the band and at the rate of the training runs, channels as recorded."""

    def predict(self, X: Runs, *, torque_delay: Delay = 0.0) -> Any:
        """Torque at the runs' own stamps, in the unit of the training runs.

        As the torque channels show it, or that less a delay of `torque_delay` [s], of all or of each.

        Parameters
        ----------
        X : Recording, data frame, or list of them
            As for `fit`; data frames need no torque here.

        Returns
        -------
        ndarray (n_samples, n_joints), or a list of them
            A list for a list. NaN in rows of a data frame that are too short a part of it to be a run.
        """
        check_is_fitted(self, "model_")
        given = as_given(X, self.robot, self.config, require_torque=False)
        check_arm(self.robot, [run for one in given for run in one.recordings])
        found = [one.filled([self._torque(run, torque_delay) for run in one.recordings]) for one in given]
        return found[0] if is_one(X) else found

    def _torque(self, recording: Recording, torque_delay: Delay) -> FloatArray:
        states = self.states(recording).less_delay(torque_delay)
        return at_stamps(recording, states, evaluate(self.model_, states)[0])

    def score(
        self, X: Runs, y: None = None, *, per_joint: bool = False, as_recorded: bool = False
    ) -> float | FloatArray:
        """Coefficient of determination R2 of the torque, ``1 - (rmse / torque_std)^2``: 1 is perfect, 0 a constant.

        Parameters
        ----------
        X : Recording, data frame, or list of them
            Runs with torque, best such that nothing was fitted to. Several count row by row, as one.
        y : None
            For scikit-learn's tools; the torque is in the runs.
        per_joint : bool
            One number per joint instead of their mean.
        as_recorded : bool
            Of every sample as it was recorded, which is `sklearn.metrics.r2_score(recording.tau, predict(recording))`.
            By default of the torque in the band and in motion, where reports tell errors: noise beyond the band is no
            model's fault, and friction at rest no function of the state.

        Returns
        -------
        float, or ndarray (n_joints,)
            Joints alike, whatever their torque's size.
        """
        if y is not None:
            raise ValueError("y: the measured torque is in the runs themselves; leave y out")
        check_is_fitted(self, "model_")
        recordings = as_recordings(X, self.robot, self.config)
        check_some(recordings)
        check_arm(self.robot, recordings)
        check_unit(self.model_.torque_unit, recordings)
        if as_recorded:
            each = r2_as_recorded([run.tau for run in recordings], [self._torque(run, 0.0) for run in recordings])
        else:
            states = [self.states(run) for run in recordings]
            each = r2([compare(one, evaluate(self.model_, one)[0]) for one in states])
        return each if per_joint else float(each.mean())

    def __sklearn_tags__(self) -> Any:
        """Say what it is: a regressor of several outputs, on lists of runs instead of arrays."""
        from sklearn.utils import InputTags, RegressorTags, Tags, TargetTags

        return Tags(
            estimator_type="regressor",
            target_tags=TargetTags(required=False, multi_output=True, single_output=False),
            regressor_tags=RegressorTags(),
            input_tags=InputTags(two_d_array=False),
        )

    def __sklearn_is_fitted__(self) -> bool:
        """Whether `fit` has been called."""
        return any(name.endswith("_") and not name.startswith("_") for name in vars(self))

    def _repr_html_(self) -> str:
        name, defaults = type(self).__name__, signature(type(self).__init__).parameters
        params = self.get_params(deep=False)
        rows = [[key, repr(value)] for key, value in params.items() if repr(value) != repr(defaults[key].default)]
        if not self.__sklearn_is_fitted__():
            return html_table(("parameter", "value"), rows, title=f"{name}, not fitted yet")
        html: str = self.model_._repr_html_()
        return html_table(("parameter", "value"), rows, title=f"{name}, fitted") + html
