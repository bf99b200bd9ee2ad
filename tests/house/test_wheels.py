"""What builds the wheels, and what looks at them: both without building one."""

import importlib.util
import sys
import types
import zipfile

import pytest
from helpers.data import ROOT

HOOKS = (
    *("build_sdist", "get_requires_for_build_editable", "get_requires_for_build_sdist", "get_requires_for_build_wheel"),
    *("prepare_metadata_for_build_editable", "prepare_metadata_for_build_wheel"),
)


def module_at(path):
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def backend(monkeypatch):
    maturin = types.ModuleType("maturin")
    for hook in HOOKS:
        setattr(maturin, hook, None)
    monkeypatch.setitem(sys.modules, "maturin", maturin)
    for name in ("CARGO", "CARGO_BUILD_TARGET", "CARGO_TARGET_DIR"):
        monkeypatch.delenv(name, raising=False)
    return module_at(ROOT / "build_backend" / "dynid_build.py")


ARM = ["--zig", "--target", "aarch64-unknown-linux-gnu", "--compatibility", "manylinux_2_28"]
MAC = ["--target", "x86_64-apple-darwin", "--compatibility", "pypi"]


@pytest.mark.parametrize(
    ("arguments", "words", "target"),
    [
        ([], ["build"], None),
        (ARM, ["zigbuild", "--target", "aarch64-unknown-linux-gnu.2.28"], ARM[2]),
        (MAC, ["build", "--target", MAC[1]], MAC[1]),
    ],
)
def test_the_binary_is_built_as_the_module_is(backend, arguments, words, target):
    verb, *more = words
    expected = ["cargo", verb, "--profile", "wheel", "--workspace", "--bin", "dynid-estimator", *more]
    assert backend.build_command("wheel", arguments) == (expected, target)


def test_binary_and_module_have_one_linker(backend, tmp_path, monkeypatch):
    name = "CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_LINKER"
    monkeypatch.setenv(name, "what links without zig")
    monkeypatch.setattr(backend.shutil, "which", lambda name: f"/opt/a b/{name}")
    backend.share_linker(MAC, tmp_path)
    assert list(tmp_path.iterdir()) == []
    backend.share_linker(ARM, tmp_path / "target")
    linker = tmp_path / "target" / "link-aarch64-unknown-linux-gnu"
    assert backend.os.environ[name] == str(linker)
    assert backend.os.access(linker, backend.os.X_OK)
    said = "exec '/opt/a b/cargo-zigbuild' zig cc -- -target aarch64-linux-gnu.2.28 \"$@\""
    assert linker.read_text().splitlines() == ["#!/bin/sh", said]


def test_the_binary_of_another_system_does_not_stay(backend, tmp_path, monkeypatch):
    monkeypatch.setattr(backend, "SCRIPTS", tmp_path / "scripts")
    monkeypatch.setattr(backend, "ROOT", tmp_path)
    monkeypatch.setattr(backend.subprocess, "run", lambda *arguments, **options: None)
    (tmp_path / "scripts").mkdir()
    (tmp_path / "scripts" / "dynid-estimator").write_text("for Linux")
    built = tmp_path / "target" / "x86_64-pc-windows-msvc" / "wheel"
    built.mkdir(parents=True)
    (built / "dynid-estimator.exe").write_text("for Windows")
    backend.build_estimator("wheel", ["--target", "x86_64-pc-windows-msvc"])
    assert {path.name: path.read_text() for path in (tmp_path / "scripts").iterdir()} == {
        "dynid-estimator.exe": "for Windows"
    }


def test_arguments_of_the_user_stand_beside_the_profile(backend, monkeypatch):
    seen = []
    monkeypatch.setattr(backend, "build_estimator", lambda *given: seen.append(given))
    monkeypatch.setattr(backend.maturin, "build_wheel", lambda *given: seen.append(given), raising=False)
    backend.build_wheel("out", {"build-args": " ".join(ARM)})
    assert seen == [
        ("wheel", ARM),
        ("out", {"maturin.build-args": " ".join(["--profile", "wheel", *ARM])}, None),
    ]


def test_a_wheel_that_is_not_right_is_said_to_be_wrong(tmp_path):
    wheels = module_at(ROOT / "tests" / "wheels.py")
    path = tmp_path / "dynid_rs-0.1.0-cp311-abi3-manylinux_2_28_aarch64.whl"
    with zipfile.ZipFile(path, "w") as archive:
        for name in wheels.EXPECTED[1:]:
            archive.writestr(name, "")
        archive.write(sys.executable, "dynid_rs/_core.abi3.so")
        archive.writestr("tests/test_x.py", "")
    assert any("bytes, at most 10" in fault for fault in wheels.faults(path, 10))
    said = wheels.faults(path)
    assert "dynid_rs/robots/six_axis.urdf is missing" in said
    assert "tests does not belong in it" in said
    assert "has no bill of materials" in said
    assert any(fault.startswith("holds [] and ['dynid_rs/_core.abi3.so']") for fault in said)
