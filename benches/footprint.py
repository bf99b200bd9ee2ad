"""What it costs to have the package: bytes of the wheel, and milliseconds of its import after numpy's."""

from __future__ import annotations

import statistics
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

from measure import ROOT, Row

ROUNDS = 11
LARGEST = 2e6
LONGEST = 0.050

IMPORT = """
import time
import numpy
start = time.process_time()
import dynid_rs
print(time.process_time() - start)
"""


def rows(wheel: bool):
    """Goal G13; the wheel is built for it (stripped, as it is published)."""
    if wheel:
        with tempfile.TemporaryDirectory() as folder:
            command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", folder, ROOT]
            subprocess.run(list(map(str, command)), check=True)
            (built,) = Path(folder).glob("*.whl")
            size = built.stat().st_size
            parts = of_wheel(built)
        yield Row("G13", "wheel", megabytes(size), "", limit="<= 2 MB", met=size <= LARGEST, note=parts)
    times = [float(subprocess.check_output([sys.executable, "-c", IMPORT])) for _ in range(ROUNDS)]
    middle = statistics.median(times)
    figure = f"{1e3 * middle:.1f} ms ({1e3 * min(times):.1f} to {1e3 * max(times):.1f})"
    yield Row("G13", "import after numpy", figure, "", limit="<= 50 ms", met=middle <= LONGEST)


def of_wheel(wheel: Path) -> str:
    """How many of the bytes, compressed, are what."""
    sizes = {"compiled module": 0, "`dynid-estimator`": 0, "Python and data": 0}
    with zipfile.ZipFile(wheel) as archive:
        for entry in archive.infolist():
            if entry.filename.endswith((".so", ".pyd", ".dylib")):
                part = "compiled module"
            elif "/scripts/" in entry.filename:
                part = "`dynid-estimator`"
            else:
                part = "Python and data"
            sizes[part] += entry.compress_size
    return ", ".join(f"{part} {megabytes(size)}" for part, size in sizes.items())


def megabytes(size: float) -> str:
    """Decimal megabytes."""
    return f"{size / 1e6:.2f} MB"


if __name__ == "__main__":
    for line in rows(wheel=True):
        print(line, flush=True)
