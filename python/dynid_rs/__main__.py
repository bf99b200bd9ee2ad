"""The door of `dynid` and of `python -m dynid_rs`: it stands before every import that takes time."""

from __future__ import annotations

import signal
import sys
from contextlib import suppress

from dynid_rs.base import interrupt, room, streams, threads


def main() -> None:
    """Entry point."""
    streams.open_missing()
    room.one_heap()
    interrupt.listen()
    told = threads.limit()
    if told is not None:
        with suppress(OSError):  # nobody hears it
            print(f"note: {told}", file=sys.stderr, flush=True)
    try:
        from dynid_rs.cli import main as run

        interrupt.check()
        run()
    except KeyboardInterrupt:  # while it starts; what commands do with it, `run_command` says
        print("interrupted", file=sys.stderr)
        sys.exit(interrupt.INTERRUPTED)
    except (ImportError, MemoryError) as error:  # libraries that find no room
        if not room.ran_out(error):
            raise
        print(f"error: {room.RAN_OUT}", file=sys.stderr)
        sys.exit(2)
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # the rest takes an instant, and its answer stands


if __name__ == "__main__":
    main()
