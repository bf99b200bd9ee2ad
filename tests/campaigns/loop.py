"""A drawn arm of which nothing is known: excite, record, diagnose, excite what is open, until only noise is left.

python tests/campaigns/loop.py --seed N [--arms 20] [--minutes M] [--jobs 2]
                               [--page docs/measured/loop.md] [--keep FILE.json]

Every step is a command as a user gives it, on files: `dynid excite`, `dynid diagnose`, `dynid excite --after`,
`dynid estimate`. The loop ends where `dynid excite --after` says that nothing more needs to be recorded (`is_wanted`),
or with MOST motions. Beside it the same arm moves as the parameters are excited best, and at random. With --keep what
was found stays in FILE, and the same command goes on where it broke off.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

if __package__ in (None, ""):
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from exam.draw import REPORTED, stream

from campaigns import loop_page
from campaigns.kept import commit, keep, read_kept
from campaigns.loop_arm import draw_unknown
from campaigns.loop_ways import CommandFailedError, Ways

Figures = dict[str, Any]

LARGEST = 2**31


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what the arguments ask for."""
    options = _parser().parse_args(arguments)
    invocation = {"seed": options.seed, "arms": options.arms}
    found = read_kept(options.keep, invocation, ("seed", "arms"), "arms")
    ends = time.monotonic() + 60 * options.minutes
    drawn = REPORTED + stream(options.seed, 71).choice(LARGEST - REPORTED, options.arms, replace=False)
    with ThreadPoolExecutor(options.jobs) as pool:  # the work is done by processes
        for arm in pool.map(lambda seed: examine(seed, ends), drawn[len(found["arms"]) :].tolist()):
            if arm is None:
                continue
            found["arms"].append({**arm, "commit": commit()})
            print(loop_page.told(arm), flush=True)
            keep(options.keep, found)
    print(loop_page.tables(found["arms"]))
    if options.page is not None:
        options.page.write_text(loop_page.page(found["invocation"], found["arms"]), encoding="utf-8")
        print(f"page: {options.page}")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description="From an unknown arm to a model of which only noise is left")
    parser.add_argument("--seed", type=int, required=True, help="from which arms and effects are drawn")
    parser.add_argument("--arms", type=int, default=20)
    parser.add_argument("--minutes", type=float, default=1e9, help="no arm begins after them")
    parser.add_argument("--jobs", type=int, default=1, help="arms at once")
    parser.add_argument("--page", type=Path, help="write the tables to this Markdown file")
    parser.add_argument("--keep", type=Path, help="file in which figures stay; goes on where it broke off")
    return parser


def examine(seed: int, ends: float) -> Figures | None:
    """Draw an arm and go all three ways with it; the loop first, for the others go on as far as it does.

    None where the time is over.
    """
    if time.monotonic() > ends:
        return None
    with tempfile.TemporaryDirectory() as folder:
        arm = draw_unknown(seed, Path(folder))
        kinds = [told["kind"] for told in arm.truth["effects"]]
        case: Figures = {"seed": seed, "kinds": kinds, "ways": {}, "failure": None}
        try:
            ways = Ways(arm)
            oracle = ways.oracle()
            case["oracle_over_noise"] = (oracle.error / oracle.noise).tolist()
            case["ways"]["loop"] = list(ways.loop(oracle))
            for way in ("exciting", "random"):
                case["ways"][way] = list(ways.repeated(way, oracle, len(case["ways"]["loop"])))
        except CommandFailedError as error:
            case["failure"] = str(error)
    return case


if __name__ == "__main__":
    sys.exit(main())
