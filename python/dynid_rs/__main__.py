"""The door of `dynid` and of `python -m dynid_rs`: it stands before every import that takes time."""

from __future__ import annotations

import os
import signal
import sys
from types import FrameType

INTERRUPTED = 130


def main() -> None:
    """Entry point."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # else it is ignored, as in the background
        signal.signal(signal.SIGINT, _first)
    try:
        from dynid_rs.cli import main as run

        run()
    except KeyboardInterrupt:  # while it starts; what commands do with it, `run_command` says
        print("interrupted", file=sys.stderr)
        sys.exit(INTERRUPTED)
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # the rest takes an instant, and its answer stands


def _first(number: int, frame: FrameType | None) -> None:
    """Let the work end in order; who presses again does not want to wait for that."""
    signal.signal(signal.SIGINT, _second)
    raise KeyboardInterrupt


def _second(number: int, frame: FrameType | None) -> None:
    """Results are whole or not there even so: the next command clears what is left of this one."""
    os._exit(INTERRUPTED)


if __name__ == "__main__":
    main()
