"""What is wrong with runs, asked from Python: the findings of `dynid inspect`."""

from __future__ import annotations

from dynid_rs import _core
from dynid_rs.base.findings import Finding
from dynid_rs.runs.checks import check_recording, contradicting_signals, is_damage, severity_order
from dynid_rs.runs.checks.beside import beside_each_other
from dynid_rs.runs.given import Runs, as_recordings
from dynid_rs.runs.readers.config_file import Rules
from dynid_rs.sensors import set_findings


def inspect(runs: Runs, robot: _core.RobotModel | None = None, config: Rules = None) -> list[Finding]:
    """Look for everything that would spoil a model learned from these runs, as `dynid inspect` does.

    Parameters
    ----------
    runs : Recording, data frame, or list of them
        Of one arm.
    robot : RobotModel, optional
        With it, what the runs say together: swapped joints, signs, amperes called N m, gravity, contacts.
    config : Config, path or mapping, optional
        What a data frame's columns are, as for `read_recording`.

    Returns
    -------
    list of Finding
        Errors first; `message` is a sentence, `code` a stable name, `file` the run's name.

    Raises
    ------
    DataError
        A data frame that cannot be read.
    ValueError
        Robot and runs have different numbers of joints.
    """
    recordings = as_recordings(runs, robot, config, as_recorded=True)
    alone = [check_recording(run, robot) for run in recordings]
    found = [finding for own in beside_each_other(recordings, alone) for finding in own]
    if robot is not None and not any(is_damage(finding) for finding in found):
        found += set_findings(robot, [run.without(*contradicting_signals(run)) for run in recordings])
    return sorted(found, key=severity_order)
