"""Does the model still hold? A sequential test per change that has a name, by the code that runs online.

The tests, their threshold and how a name is chosen: `rust/dynid-core/src/watch`.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, fields
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.base.changes import FROZEN, Change, kind_words
from dynid_rs.base.files import write_json
from dynid_rs.base.json_file import is_object
from dynid_rs.base.quoting import shown
from dynid_rs.base.units import angle_units
from dynid_rs.model.healthy import LEAST_ROWS, Healthy, learn
from dynid_rs.model.units import load_unit, torque_units
from dynid_rs.regression.uncertainty import NORMAL_95
from dynid_rs.runs.given import Runs, as_recordings
from dynid_rs.runs.recording import FloatArray, Recording

MOST_REMEMBERED = 4 << 20
"""Bytes, as the compiled reader has it."""
ANEW = "name another file, or remove this one to begin anew"
"""What to do about a file that holds nothing remembered."""
NOTHING = 1e12
"""Tolerates everything: for rows alone."""


@dataclass(frozen=True)
class Tolerated:
    """Changes that are none yet.

    Parameters
    ----------
    friction : float
        Of a joint's friction, relative: it warms up.
    gain : float
        Of the torque that a joint's channel shows, relative.
    offset : float
        Constant torque on a joint, in deviations of what the model leaves.
    load : float
        Mass at the last link [kg; in ampere: kg times what the channel shows per N m].
    delay : float
        Time by which a joint's torque channel is later than it was, or earlier [s].
    slip : float
        Jump of the position that a joint's encoder shows [rad, m].
    unknown : float
        Of the deviation of what the model leaves, relative.
    """

    friction: float = 0.1
    gain: float = 0.05
    offset: float = 2.0
    load: float = 0.1
    delay: float = 0.004
    slip: float = 0.005
    unknown: float = 1.0


N_TESTS = 7
"""Of a joint: friction, gain, offset, delay, slip, error, frozen channel; one more is of the load."""


@dataclass(frozen=True, eq=False)
class Watched:
    """What a watch says of a run.

    Attributes
    ----------
    name : str
        Of the run.
    changes : tuple of Change
        In the order in which they were said.
    t : ndarray (n_rows,)
        Time at the end of every row [s].
    left : ndarray (n_rows, n_joints)
        Mean of what the model and what was named leave of the torque over the row [torque unit].
    deviation : ndarray (n_rows, n_joints)
        What is expected of it [torque unit].
    watched : ndarray of bool (n_rows, n_joints)
        Rows in which a joint moves as the model was trained to; others say nothing.
    before : tuple of Change
        What stood before the run already, as what was remembered says; at the time of its first sample.
    remembered : str
        What the watch knows at the end, for the next run, or the next start of a program.
    """

    name: str
    changes: tuple[Change, ...]
    t: FloatArray
    left: FloatArray
    deviation: FloatArray
    watched: NDArray[np.bool_]
    before: tuple[Change, ...] = ()
    remembered: str = field(default="", repr=False)


class Watch:
    """Says what of a model no longer holds: friction, gain, offset, delay, slip of a joint, a load, or the unknown.

    Parameters
    ----------
    model : TorqueModel
        What was identified.
    false_alarms_per_day : float
        Alarms that nothing has caused, of all tests together, that are put up with.
    tolerated : Tolerated
        Changes that are none yet.
    row : float
        Time over which what the model leaves is averaged [s].
    window : int, optional
        Samples to differentiate over, where positions come alone; about 20 ms by default, 15 ms at 1 kHz.

    Attributes
    ----------
    inflation_ : ndarray (n_joints,)
        Variance of rows over what the model expects, at most; ones before `fit`.
    memory_ : ndarray (n_joints,)
        Rows that are worth an independent one, at most; ten before `fit`.
    least_speed_ : ndarray (n_joints,)
        Mean speed of a row [rad/s, m/s] below which healthy runs are too few to say what the model leaves, so that it
        says nothing; infinite of a joint that they do not move for thirty rows, 0 before `fit`.
    frozen_after_, frozen_way_ : ndarray (n_joints,)
        Time [s] after which a value that a torque channel repeats is no torque, where the model's torque has gone so
        far meanwhile [torque unit]; never before `fit`.
    healthy_ : tuple of str
        Names of the runs that `fit` was given; not there before, nor in a watch that was loaded.
    """

    def __init__(
        self,
        model: _core.TorqueModel,
        *,
        false_alarms_per_day: float = 1.0,
        tolerated: Tolerated | None = None,
        row: float = 0.2,
        window: int | None = None,
    ) -> None:
        self.model = model
        self.false_alarms_per_day = false_alarms_per_day
        self.tolerated = tolerated
        self.row = row
        self.window = window

    def fit(self, X: Runs) -> Watch:
        """Learn what the model leaves while nothing has changed: a recording, a data frame, or a list of them.

        Raises
        ------
        ValueError
            No joint moves long enough in these runs, or a run is not one of this robot; begins with their names.
        """
        n = self.model.robot.n_joints
        everything, untold = Tolerated(*[NOTHING] * len(fields(Tolerated))), Healthy.untold(n, memory=1.0)
        found = [self._run(run, everything, untold) for run in as_recordings(X, self.model.robot)]
        told = [run for run, *_ in found]
        relative = [
            np.divide(run.left, run.deviation, out=np.full_like(run.left, np.nan), where=run.watched) for run in told
        ]
        per_test = self.false_alarms_per_day / (N_TESTS * n + 1)
        healthy = learn(relative, [speed for _, speed, _ in found], [repeats for *_, repeats in found], per_test)
        if healthy is None:
            names = ", ".join(shown(run.name) for run in told)
            raise ValueError(
                f"{names}: no joint moves for {LEAST_ROWS * self.row:.0f} s within "
                "what the model was trained on, too little to tell what it leaves; give longer runs without a change"
            )
        self._take(healthy)
        self.healthy_ = tuple(run.name for run in told)
        return self

    def watch(self, recording: Recording, *, remembered: str | None = None) -> Watched:
        """Go through a run, and say what has changed.

        Parameters
        ----------
        recording : Recording
            From its beginning.
        remembered : str, optional
            What the watch of the run before knew (`Watched.remembered`): what was named is taken for granted, and a
            test that was under way goes on. Without it the watch begins anew.

        Raises
        ------
        ValueError
            The run is not one of this robot, in another unit, or lacks a temperature that friction follows.
        FormatError
            What is remembered is of another model, or of a watch with other settings.
        """
        return self._run(recording, self.tolerated or Tolerated(), self._learned(), remembered)[0]

    def save(self, path: str | PathLike[str]) -> None:
        """Write what healthy runs have said, and what is tolerated, for `load` and for ``dynid-estimator --changes``.

        Raises
        ------
        OSError
            The system refuses.
        """
        write_json(
            path,
            {
                "format": "dynid-watch-settings",
                "version": 3,
                "joints": list(self.model.robot.joint_names),
                "row": float(self.row),
                "false_alarms_per_day": float(self.false_alarms_per_day),
                "tolerated": asdict(self.tolerated or Tolerated()),
                **self._learned().to_json(),
            },
        )

    @staticmethod
    def load(path: str | PathLike[str], model: _core.TorqueModel, *, window: int | None = None) -> Watch:
        """Return a watch of `model` as `save` has written it.

        Raises
        ------
        FormatError
            The file is none, of a newer program, or of another arm.
        OSError
            The system refuses.
        """
        mend = "write it anew with `dynid watch MODEL.json --save`"
        if not is_object(path):
            raise _core.FormatError(f"{Path(path)}: not a watch's settings: it is no JSON object; {mend}")
        said = _core.read_watch(Path(path))
        joints = tuple(said["joints"])
        if joints != tuple(model.robot.joint_names):
            raise _core.FormatError(
                f"{Path(path)}: of an arm with other joints ({shown(', '.join(joints[:3]))}, ...) than the model's; "
                f"{mend}"
            )
        tolerated = Tolerated(*(said[kind.name] for kind in fields(Tolerated)))
        found = Watch(
            model, false_alarms_per_day=said["false_per_day"], tolerated=tolerated, row=said["row"], window=window
        )
        found._take(Healthy(*(np.array(said[one.name]) for one in fields(Healthy))))
        return found

    def _run(
        self,
        run: Recording,
        tolerated: Tolerated,
        healthy: Healthy,
        remembered: str | None = None,
    ) -> tuple[Watched, FloatArray, FloatArray]:
        """What is said of a run, mean speeds of its rows (n_rows, n), and how its torques repeat (n, 4)."""
        from dynid_rs.model.observer import check_run

        check_run(self.model, run)
        names = ("q", "dq", "ddq", "q_motor", "dq_motor", "ddq_motor")
        said, ends, left, variance, moves, (stood, knows), (speed, repeats) = _core.watch_run(
            self.model,
            run.t,
            tuple(getattr(run, name) for name in names),
            run.tau,
            temperature=run.temperature,
            step=1.0 / run.rate,
            window=self.window,
            **healthy.lists(),
            row=self.row,
            false_per_day=self.false_alarms_per_day,
            **asdict(tolerated),
            remembered=remembered,
        )
        changes, before = (tuple(_change(one, run.t, self.model) for one in told) for told in (said, stood))
        deviation = np.sqrt(healthy.inflation * variance)
        return Watched(run.name, changes, run.t[ends], left, deviation, moves > 0, before, knows), speed, repeats

    def _learned(self) -> Healthy:
        untold = Healthy.untold(self.model.robot.n_joints)
        return Healthy(*(getattr(self, f"{one.name}_", getattr(untold, one.name)) for one in fields(Healthy)))

    def _take(self, healthy: Healthy) -> None:
        for one in fields(Healthy):
            setattr(self, f"{one.name}_", getattr(healthy, one.name))


def read_remembered(path: str | PathLike[str]) -> str:
    """What `Watch.watch` or ``dynid-estimator --remember`` has kept in a file.

    Raises
    ------
    FormatError
        It is no JSON object.
    OSError
        The system refuses.
    """
    if not is_object(path):
        raise _core.FormatError(f"{Path(path)}: not what a watch remembers: it is no JSON object; {ANEW}")
    with Path(path).open("rb") as file:
        # One byte more than may be read, which the reader refuses.
        return file.read(MOST_REMEMBERED + 1).decode(errors="replace")


def _change(said: dict[str, Any], t: FloatArray, model: _core.TorqueModel) -> Change:
    kind, size, std = said["kind"], said["size"], said["std"]
    joints, torque_unit = model.robot.joint_names, model.torque_unit
    own, turn = torque_units(model)[said["joint"]], angle_units(model.robot.joint_kinds)[said["joint"]]
    either = said["or"]
    return Change(
        float(t[said["sample"]]),
        kind,
        joints[said["joint"]],
        size,
        (size - NORMAL_95 * std, size + NORMAL_95 * std),
        tuple(said["moments"]) if kind == "load" else None,
        said["said"],
        None
        if either is None
        else ("a load" if either[0] == "load" else f"{kind_words(either[0])} of {joints[either[1]]}"),
        {"load": load_unit(torque_unit), "offset": own, FROZEN: own, "delay": "s", "slip": turn}.get(kind, ""),
    )
