"""Files that `dynid watch` writes: settings, what it remembers, a page for people, text for Prometheus and for ROS."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dynid_rs.base.findings import Finding
    from dynid_rs.model.watch import Watch, Watched

_OWN = {
    "save": rb'\s*\{\s*"format"\s*:\s*"dynid-watch-settings"',
    "report": rb"<!DOCTYPE html>.*?<title>[^<]* health of the torque model</title>",
    "prometheus": rb"# HELP dynid_watch_",
    "ros": rb'\s*\{\s*"header"\s*:.*?"name"\s*:\s*"dynid watch: ',
}
"""How a file begins that an earlier watch has written by the option of that name. One that is remembered is read first,
and refused by its reader where it is none."""
_BEGINNING = 1 << 16
"""Bytes in which that shows."""


@dataclass(frozen=True)
class WatchFiles:
    """Where each is to go, as the options of that name say; None: it is not asked for."""

    save: Path | None = None
    remember: Path | None = None
    report: Path | None = None
    prometheus: Path | None = None
    ros: Path | None = None

    def check(self, runs: Sequence[Path] | None, read: Sequence[Path], *, force: bool = False) -> None:
        """Refuse before any work is done what cannot be written, is read, or has no run.

        What an earlier watch wrote by the same option is replaced; anything else with `force` only.

        Raises
        ------
        ValueError, OSError
            The text is a sentence.
        """
        from dynid_rs.commands._output import check_file, check_not_read

        given = self._given()
        if not runs and set(given) != {"save"}:
            asked = next((f" for --{option}" for option in given if option != "save"), "")
            raise ValueError(f"no run to watch{asked}; name one, or write settings with --save WATCH.json")
        for option, path in given.items():
            check_file(path)
            twice = [other for other, same in given.items() if other != option and same.resolve() == path.resolve()]
            if twice:
                raise ValueError(f"{path}: --{option} and --{twice[0]} are to be two files; name another one")
        check_not_read(list(given.values()), read)
        if not force:
            _check_own(given)

    def remembered(self) -> str | None:
        """What an earlier call has left; None where there is nothing, or nothing is to be remembered.

        Raises
        ------
        OSError
            The file cannot be read.
        """
        from dynid_rs.model.watch import read_remembered

        return read_remembered(self.remember) if self.remember is not None and self.remember.exists() else None

    def write(self, watch: Watch, watched: Sequence[Watched], findings: Sequence[Finding]) -> None:
        """Write what is asked for.

        Raises
        ------
        OSError
            A place cannot be written; the text is a sentence.
        """
        from dynid_rs.base.files import write_json, write_text

        if self.save is not None:
            watch.save(self.save)
        if self.report is not None:
            from dynid_rs.model.health import health_page

            health_page(watch, watched, self.report, findings=findings, goes_on=self.remember is not None)
        if self.prometheus is not None:
            from dynid_rs.model.prometheus import prometheus_text

            write_text(self.prometheus, prometheus_text(watch, watched))
        if self.ros is not None:
            from dynid_rs.model.ros_diagnostics import ros_diagnostics

            write_json(self.ros, ros_diagnostics(watch, watched))

    def keep(self, watched: Sequence[Watched]) -> None:
        """Write what the watch knows, last of all: what was not said is said again by the same command.

        Raises
        ------
        OSError
            The place cannot be written; the text is a sentence.
        """
        from dynid_rs.base.files import write_text

        if self.remember is not None:
            write_text(self.remember, watched[-1].remembered)

    def lines(self) -> list[str]:
        """Where they are; what is remembered is no news for people."""
        words = {"save": "settings"}
        return [
            f"{words.get(option, option)}: {path}" for option, path in self._given().items() if option != "remember"
        ]

    def _given(self) -> dict[str, Path]:
        return {option: path for option, path in asdict(self).items() if path is not None}


def _check_own(given: dict[str, Path]) -> None:
    """Refuse to replace what is not the watch's own."""
    from dynid_rs.base.files import with_sentence

    for option, path in given.items():
        if option not in _OWN or not path.is_file():
            continue
        try:
            with path.open("rb") as file:
                beginning = file.read(_BEGINNING)
        except OSError as error:
            raise with_sentence(error, path, "read") from None
        if not re.match(_OWN[option], beginning, re.DOTALL):
            raise FileExistsError(
                f"{path}: there is a file already, which no --{option} of `dynid watch` has written; "
                "name another file, or replace it with --force"
            )
