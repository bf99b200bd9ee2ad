"""Where runs come from: something small that can be sent to another process and reads its run there."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

from dynid_rs import _core
from dynid_rs.archive.fingerprint import fingerprint
from dynid_rs.base.errors import DataError
from dynid_rs.base.files import check_readable, with_sentence
from dynid_rs.base.findings import Finding
from dynid_rs.runs.checks import check_recording, contradicting_signals, refused_sources
from dynid_rs.runs.parts import whole_name
from dynid_rs.runs.readers import Config, Run, read_run
from dynid_rs.runs.readers.formats import files_of
from dynid_rs.runs.recording import Recording


class RunSource(Protocol):
    """One run that is read when it is needed, the same every time; it has to be picklable."""

    @property
    def name(self) -> str:
        """Short name for every message."""

    def read(self) -> tuple[Recording, list[Finding]]:
        """Read the run without the signals that contradict its positions; and what its checks found."""

    def signals(self) -> Recording:
        """Read the run once more, whose findings are known."""

    def content(self) -> str:
        """Return a hash of all that `read` depends on: what is kept of the run is kept under it."""


def signals_of(source: RunSource) -> Recording:
    """Read a run once more; a source that knows no shorter way goes through its checks again."""
    again = getattr(source, "signals", None)
    return source.read()[0] if again is None else again()


_LAST: dict[str, tuple[object, _core.RobotModel, Config, Run]] = {}
"""The file in parts that was read last, until its last part is taken: a data set may hold hundreds."""


def refuse_gain(run: Run, config: Config, name: str) -> None:
    """Raise `DataError` where a gain is given for the currents of a run of which torque is read."""
    if config.drive_gain is not None and "tau" in run.columns.signals:
        raise DataError(
            f"{name}: holds torque, and drive gains (--drive-gain, or [drive] gain in {config.source}) are for "
            "currents; leave them out, or write `tau = false` under [columns] where currents stand beside it",
            code="no_current",
            file=name,
        )


@dataclass(frozen=True)
class RunFile:
    """A run in a file.

    Parameters
    ----------
    path : Path
        Any file or folder that `read_recording` takes.
    name : str
        Short name for every message.
    robot : RobotModel
        The arm.
    config : Config
        Names, units and signs of the file.
    part, n_parts : int
        Which part of how many, where gaps or jumps of time split the file.
    """

    path: Path
    name: str
    robot: _core.RobotModel
    config: Config
    part: int = 0
    n_parts: int = 1

    def read(self) -> tuple[Recording, list[Finding]]:
        """Read and check the file.

        Raises
        ------
        DataError, OSError
            It cannot be read, or is no run of this robot; the text is a sentence.
        """
        run = self._run()
        recording = self._part(run)
        said = run.findings(self.name) if self.part == 0 else []
        findings = check_recording(recording, self.robot)
        return recording.without(*refused_sources(findings)), [*said, *findings]

    def signals(self) -> Recording:
        """Read the file; of the checks, only what decides which signals are left out.

        Raises
        ------
        DataError, OSError
            As `read`.
        """
        recording = self._part(self._run())
        return recording.without(*contradicting_signals(recording))

    def _run(self) -> Run:
        run = self._read_file()
        refuse_gain(run, self.config, self.name)
        return run

    def _read_file(self) -> Run:
        """Read the file; for the parts of one that follow each other only once."""
        if self.n_parts == 1:
            return read_run(self.path, self.robot, self.config, name=self.name)
        info = self.path.stat()
        key = (self.path, info.st_mtime_ns, info.st_size)
        held = _LAST.get("run")
        if held is None or held[0] != key or held[1] is not self.robot or held[2] is not self.config:
            whole = read_run(self.path, self.robot, self.config, name=whole_name(self.name))
            held = (key, self.robot, self.config, whole)
        _LAST.clear()
        if self.part < self.n_parts - 1:
            _LAST["run"] = held
        return held[3]

    def _part(self, run: Run) -> Recording:
        return replace(run.parts[self.part], name=self.name)

    def content(self) -> str:
        """Hash of the file's bytes, its name, its rules and the robot."""
        hashes = []
        for path in files_of(self.path):
            place = check_readable(path)
            try:
                with place.open("rb") as file:
                    hashes.append(hashlib.file_digest(file, "sha256").hexdigest())
            except OSError as error:
                raise with_sentence(error, path, "read") from None
        content = hashes[0] if len(hashes) == 1 else fingerprint(*hashes)
        suffix = self.path.suffix.lower()
        return fingerprint(content, self.name, suffix, self.robot, self.config, self.part)
