"""Measured data of several robots, which is not part of the repository."""

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
"""Root of the repository."""
URDF_ROBOTS = (
    "dualarm7_hujinfei",
    "kuka_kr300_weigand",
    "kuka_lwr4p_flobaroid",
    "panda_gaz",
    "rokae_xmate3pro",
    "ur10e_innopolis",
)
"""Folders that hold a robot.urdf."""


def data_folder() -> Path:
    """Folder of the data: DYNID_DATA, else beside the repository. Skips the test where it is missing."""
    folder = Path(os.environ.get("DYNID_DATA", ROOT.parent / "shared" / "data"))
    if not folder.is_dir():
        missing = f"no measured data at {folder}; set DYNID_DATA to the folder that holds it"
        if os.environ.get("CI") == "true":
            pytest.fail(missing)
        pytest.skip(missing)
    return folder


def data_file(robot: str, name: str = "robot.urdf") -> Path:
    """One file of a robot's folder; a folder without it is a broken copy."""
    path = data_folder() / robot / name
    assert path.is_file(), f"{path} is missing; the data folder is not complete"
    return path
