"""Units of work for other processes, which import no more than this to read them: runs that kill, and who was there."""

from __future__ import annotations

import os
import signal
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dynid_rs import DataError, Recording
from dynid_rs.archive.work import RUST_THREADS
from dynid_rs.base.findings import Finding
from helpers.made_runs import MadeRun


@dataclass(frozen=True)
class Deadly(MadeRun):
    """Kills the process that reads it for the `deaths`-th time or before, unless it is this one."""

    folder: Path = Path()
    deaths: int = 1
    home: int = 0

    def read(self) -> tuple[Recording, list[Finding]]:
        died = len(list(self.folder.iterdir()))
        if died < self.deaths and os.getpid() != self.home:
            (self.folder / f"{died}").touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return super().read()


@dataclass(frozen=True)
class Broken(MadeRun):
    """Cannot be read."""

    def read(self) -> tuple[Recording, list[Finding]]:
        raise DataError(f"{self.name}: is no run", file=self.name)


def threads(source: MadeRun) -> tuple[dict[str, Any], dict[str, Any]]:
    """In which process this ran, and with how many threads of Rust."""
    del source
    return {"threads": os.environ.get(RUST_THREADS), "process": os.getpid()}, {}
