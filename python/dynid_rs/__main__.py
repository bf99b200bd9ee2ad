"""The door of `dynid` and of `python -m dynid_rs`: it stands before every import that takes time."""

from __future__ import annotations

import signal
import sys

from dynid_rs.base import interrupt


def main() -> None:
    """Entry point."""
    interrupt.listen()
    try:
        from dynid_rs.cli import main as run

        interrupt.check()
        run()
    except KeyboardInterrupt:  # while it starts; what commands do with it, `run_command` says
        print("interrupted", file=sys.stderr)
        sys.exit(interrupt.INTERRUPTED)
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # the rest takes an instant, and its answer stands


if __name__ == "__main__":
    main()
