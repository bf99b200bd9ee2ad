"""The stub says what the compiled module is: checked by importing it."""

import os
import subprocess
import sys

from helpers.data import ROOT


def test_stub_matches_the_compiled_module():
    result = subprocess.run(
        [sys.executable, "-m", "mypy.stubtest", "dynid_rs._core"],
        cwd=ROOT,
        env=os.environ | {"MYPYPATH": str(ROOT / "python")},
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stdout + result.stderr


def test_types_are_published():
    assert (ROOT / "python" / "dynid_rs" / "py.typed").read_bytes() == b""
