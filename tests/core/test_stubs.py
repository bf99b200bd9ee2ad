"""The stub says what the compiled module is: checked by importing it."""

import os
import subprocess
import sys

from helpers.data import ROOT

PACKAGE = ROOT / "python" / "dynid_rs"


def test_stub_matches_the_compiled_module(tmp_path):
    """The stub stands in a package that imports nothing: the rest of ours is read only where the stub names it."""
    package = tmp_path / "dynid_rs"
    package.mkdir()
    for path in PACKAGE.iterdir():
        (package / path.name).symlink_to(path)
    (package / "__init__.py").unlink()
    (package / "__init__.py").touch()
    result = subprocess.run(
        [sys.executable, "-m", "mypy.stubtest", "dynid_rs._core"],
        cwd=ROOT,
        env=os.environ | {"MYPYPATH": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stdout + result.stderr


def test_types_are_published():
    assert (PACKAGE / "py.typed").read_bytes() == b""
