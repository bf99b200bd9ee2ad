"""Maturin, with the Rust binary `dynid-estimator` built first and put where maturin packs scripts from."""

import os
import shutil
import subprocess
from pathlib import Path

import maturin
from maturin import (  # noqa: F401  (hooks that need nothing more)
    build_sdist,
    get_requires_for_build_editable,
    get_requires_for_build_sdist,
    get_requires_for_build_wheel,
    prepare_metadata_for_build_editable,
    prepare_metadata_for_build_wheel,
)

ROOT = Path(__file__).resolve().parent.parent
SCRIPTS = ROOT / "rust/dynid-py/dynid_rs.data/scripts"
SCRIPTS.mkdir(parents=True, exist_ok=True)  # maturin wants the folder even where it only writes metadata


def build_estimator(profile: str) -> None:
    """Build the binary and copy it into the wheel's script folder."""
    cargo = os.environ.get("CARGO", "cargo")
    subprocess.run([cargo, "build", "--profile", profile, "--package", "dynid-estimator"], cwd=ROOT, check=True)
    target = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
    name = "dynid-estimator.exe" if os.name == "nt" else "dynid-estimator"
    shutil.copy2(target / profile / name, SCRIPTS / name)


def build_wheel(wheel_directory, config_settings=None, metadata_directory=None):
    """Small: the profile takes longer to build."""
    build_estimator("wheel")
    settings = {"build-args": "--profile wheel", **(config_settings or {})}
    return maturin.build_wheel(wheel_directory, settings, metadata_directory)


def build_editable(wheel_directory, config_settings=None, metadata_directory=None):
    """Soon there again after a change, and from what `cargo test --release` has built."""
    build_estimator("release")
    return maturin.build_editable(wheel_directory, config_settings, metadata_directory)
