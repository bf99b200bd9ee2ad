"""Where the online binary is."""

import os
import shutil
import sys
from pathlib import Path

from helpers.data import ROOT


def find_estimator() -> Path:
    """The binary: named in DYNID_ESTIMATOR, installed beside this Python, or built by cargo."""
    name = "dynid-estimator"
    if named := os.environ.get("DYNID_ESTIMATOR"):
        assert Path(named).is_file(), f"DYNID_ESTIMATOR names {named}, which is not there; name the built binary"
        return Path(named)
    if installed := shutil.which(name, path=str(Path(sys.executable).parent)):
        return Path(installed)
    release = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")) / "release"
    built = shutil.which(name, path=str(release))
    assert built, f"no {name} in {release}; build it: cargo build --release -p dynid-estimator"
    return Path(built)
