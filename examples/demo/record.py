"""`python examples/demo/record.py [FOLDER]`: the runs of `dynid demo`, made by `dynid simulate`.

Three runs of the bundled arm, whose third joint has friction with memory, as a controller's log would hold them: one
encoder, an angle to 1e-5 rad, a torque to 0.01 N*m, text, packed. Without FOLDER those in the package are replaced.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

PACKAGED = Path(__file__).parents[2] / "python" / "dynid_rs" / "demo"
ASKED = ("--runs", "3", "--duration", "10", "--rate", "100", "--effect", "friction_hysteresis:joint_3", "--seed", "0")
DECIMALS = {"t": 2, "q": 5, "tau": 2}
"""Of the columns that are kept; the second encoder is left out, as most logs do."""


def record(folder: Path) -> None:
    """Simulate, round and write the runs and `truth.json` to `folder`, which exists."""
    with tempfile.TemporaryDirectory() as made:
        dynid = [sys.executable, "-m", "dynid_rs", "simulate", "-o", made, *ASKED]
        subprocess.run(dynid, check=True, stdout=subprocess.DEVNULL)
        for path in sorted(Path(made).glob("run_*.parquet")):
            # A quarter smaller than by gzip, which counts: the runs are a part of every wheel.
            packed = pa.Codec("zstd", compression_level=22).compress(as_text(path).encode(), asbytes=True)
            (folder / f"{path.stem}.csv.zst").write_bytes(packed)
        (folder / "truth.json").write_bytes((Path(made) / "truth.json").read_bytes())


def as_text(path: Path) -> str:
    """A run as comma separated text."""
    columns = pq.read_table(path).to_pydict()
    kept = {name: DECIMALS[name.rpartition("_")[0] or name] for name in columns if _is_kept(name)}
    rows = zip(*([f"{value:.{places}f}" for value in columns[name]] for name, places in kept.items()), strict=True)
    return "\n".join(",".join(row) for row in [tuple(kept), *rows]) + "\n"


def _is_kept(name: str) -> bool:
    return (name.rpartition("_")[0] or name) in DECIMALS


if __name__ == "__main__":
    record(Path(sys.argv[1]) if len(sys.argv) > 1 else PACKAGED)
