"""Maturin, with the Rust binary `dynid-estimator` built first and put where maturin packs scripts from.

Arguments for maturin go to the binary too: ``-C build-args="--zig --target aarch64-unknown-linux-gnu --compatibility
manylinux_2_28"`` makes both for another processor and an old C library.
"""

import itertools
import os
import shlex
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
BINARY = "dynid-estimator"


def value_of(arguments, option):
    """What stands after an option, or None."""
    following = dict(itertools.pairwise(arguments))
    return following.get(option, os.environ.get("CARGO_BUILD_TARGET") if option == "--target" else None)


def build_command(profile, arguments):
    """Words that build the binary as `arguments` ask maturin to build the module; and the target, if one is named."""
    target, libc = value_of(arguments, "--target"), value_of(arguments, "--compatibility") or ""
    cargo = [os.environ.get("CARGO", "cargo")]
    verb = "zigbuild" if "--zig" in arguments else "build"
    # Of the whole workspace, so that libraries have the features that the module builds them with, and are built once.
    command = [*cargo, verb, "--profile", profile, "--workspace", "--bin", BINARY]
    if target is None:
        return command, None
    version = libc.removeprefix("manylinux_").replace("_", ".") if "--zig" in arguments and libc else ""
    return [*command, "--target", f"{target}.{version}" if version else target], target


def share_linker(arguments, folder):
    """One linker, written into `folder`, for binary and module where zig links; nothing without zig.

    `cargo zigbuild` and maturin each bring one of their own, and for another linker cargo builds all libraries again.
    """
    target, libc = value_of(arguments, "--target"), value_of(arguments, "--compatibility") or ""
    zigbuild = shutil.which("cargo-zigbuild")
    if "--zig" not in arguments or target is None or zigbuild is None:
        return
    version = libc.removeprefix("manylinux_").replace("_", ".")
    machine = ".".join(filter(None, [target.replace("-unknown-", "-"), version]))
    linker = folder / f"link-{target}"
    folder.mkdir(parents=True, exist_ok=True)
    linker.write_text(f'#!/bin/sh\nexec {shlex.quote(zigbuild)} zig cc -- -target {machine} "$@"\n')
    linker.chmod(0o755)
    os.environ[f"CARGO_TARGET_{target.upper().replace('-', '_')}_LINKER"] = str(linker)


def build_estimator(profile, arguments=()):
    """Build the binary and copy it into the wheel's script folder, which then holds nothing else."""
    command, target = build_command(profile, arguments)
    folder = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")).resolve()
    share_linker(arguments, folder)
    subprocess.run(command, cwd=ROOT, check=True)
    built = folder / (target or "") / profile
    for old in SCRIPTS.iterdir():
        old.unlink()  # of another system, under another name
    name = f"{BINARY}.exe" if "windows" in (target or "") or (target is None and os.name == "nt") else BINARY
    shutil.copy2(built / name, SCRIPTS / name)


def build_wheel(wheel_directory, config_settings=None, metadata_directory=None):
    """Small: the profile takes longer to build."""
    settings = dict(config_settings or {})
    given = settings.pop("maturin.build-args", settings.pop("build-args", ""))
    arguments = shlex.split(given) if isinstance(given, str) else list(given)
    build_estimator("wheel", arguments)
    settings["maturin.build-args"] = shlex.join(["--profile", "wheel", *arguments])
    return maturin.build_wheel(wheel_directory, settings, metadata_directory)


def build_editable(wheel_directory, config_settings=None, metadata_directory=None):
    """Soon there again after a change, and from what `cargo test --release` has built."""
    build_estimator("release")
    return maturin.build_editable(wheel_directory, config_settings, metadata_directory)
