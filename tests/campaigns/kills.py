"""kill -9 at random instants of every command that writes: `python tests/campaigns/kills.py --count 500`.

Instants are drawn in time of the processor, so that a busy machine does not shift them; a third of them fall into the
end, where files are put in place.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import sys
import tempfile
import time
from pathlib import Path

if __package__ in (None, ""):
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from helpers.small_arm import study

from campaigns.commands import BY_NAME, Writing, faults_of, is_new, lay_old_results, prepare, start

KILLED = ("identify", "stream", "diagnose", "excite", "fleet", "simulate")
_TICK = os.sysconf("SC_CLK_TCK")


def used(pid: int) -> float:
    """Time of the processor that a process and its dead children have had [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return sum(map(int, fields[11:15])) / _TICK


def whole(writing: Writing, folder: Path) -> float:
    """Run to the end; the processor's time that it took [s]."""
    lay_old_results(writing, folder)
    process = start(writing, folder)
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode not in (0, 1) or not is_new(writing, folder) or faults_of(writing, folder):
        raise RuntimeError(f"{writing.name} fails by itself: {(folder / 'said').read_text()[-500:]}")
    return usage.ru_utime + usage.ru_stime


def killed_after(writing: Writing, folder: Path, seconds: float) -> bool:
    """Kill all of its processes then; False if it had ended by itself."""
    process = start(writing, folder)
    while process.poll() is None:
        try:
            if used(process.pid) >= seconds:
                break
        except (FileNotFoundError, ProcessLookupError):
            break
        time.sleep(0.001)
    ended = process.poll() is not None
    if not ended:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    return not ended


def campaign(names: tuple[str, ...], count: int, seed: int) -> dict[str, object]:
    """Figures, and whatever was found."""
    draw = random.Random(seed)
    found, n_killed, n_new = [], 0, 0
    with tempfile.TemporaryDirectory(prefix="kills-") as temporary:
        folder = Path(temporary)
        prepare(folder, study().output / "model.json")
        for place, name in enumerate(names):
            writing = BY_NAME[name]
            lasts = whole(writing, folder)
            for _ in range(count // len(names) + (place < count % len(names))):
                lay_old_results(writing, folder)
                at = lasts * (draw.uniform(0.85, 1.02) if draw.random() < 1 / 3 else draw.random())
                n_killed += killed_after(writing, folder, at)
                wrong = faults_of(writing, folder)
                n_new += is_new(writing, folder)
                if wrong:
                    found.append({"command": name, "seconds": at, "wrong": wrong})
                    print(f"{name} after {at:.2f} s: {wrong}", file=sys.stderr, flush=True)
    return {"trials": count, "killed": n_killed, "with_new_results": n_new, "found": found}


def main() -> int:
    """Print the figures as JSON; 1 if something was lost, mixed or left behind."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=500)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", choices=KILLED, action="append")
    options = parser.parse_args()
    figures = campaign(tuple(options.only or KILLED), options.count, options.seed)
    print(json.dumps(figures, indent=2))
    return int(bool(figures["found"]))


if __name__ == "__main__":
    sys.exit(main())
