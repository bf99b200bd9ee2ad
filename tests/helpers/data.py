"""Measured data of several robots, which is not part of the repository.

`python tests/helpers/data.py` prints where it is looked for.
"""

import os
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
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


def place() -> Path:
    """Where the data is looked for: DYNID_DATA, else beside the repository."""
    return Path(os.environ.get("DYNID_DATA", ROOT.parent / "shared" / "data"))


def data_folder() -> Path:
    """Folder of the data. Skips the test where it is missing."""
    import pytest  # late, for those who only ask for the place

    folder = place()
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


if __name__ == "__main__":
    print(place())
