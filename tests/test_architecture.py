"""Floors: what may import what, formulas with one home, and dependencies that stay where they belong."""

import ast
import re
import shutil
import subprocess
import sys
import tomllib

import pytest
from data import ROOT

PACKAGE = ROOT / "python" / "dynid_rs"
MODULES = sorted(PACKAGE.rglob("*.py"))

STANDARD_LIBRARY = sys.stdlib_module_names
GROUND = {"errors", "files", "findings", "recording", "readers", "checks"}
"""Runs and files: usable, and quick to import, without any identification."""
FLOORS = {
    "errors": set(),
    "findings": set(),
    "files": {"errors"},
    "recording": {"errors"},
    "readers": {"errors", "files", "findings", "recording"},
    "checks": {"_core", "errors", "findings", "recording"},  # the package itself has brought the compiled module
}
"""What each ground module may import of the package, besides itself."""
HEAVY = {"sklearn", "plotly", "typer", "rich"}
"""Libraries that nobody on the ground needs."""

DENIED = {
    r"tanh\(": {},
    r"multivariate_normal": {},
    r"np\.exp\(": {
        "friction.py": "widths and thresholds are searched in their logarithm",
        "friction_laws.py": "Stribeck's velocity is searched in its logarithm",
        "evidence.py": "the relative uncertainty is searched in its logarithm",
        "wording.py": "geometric mean of error ratios",
    },
    r"(?m)^\s*(import|from) (pickle|joblib|dill|cloudpickle|shelve|marshal)\b": {
        "archive/work.py": "units of work go to other processes; nothing is kept that way",
    },
    r"pickle\.(dump|load)|allow_pickle=True": {},
}
"""Formulas have their home in Rust; models are files with a version. Exceptions: module and reason."""


def name_of(path):
    """Top module inside the package: `readers/csv.py` is `readers`."""
    return path.relative_to(PACKAGE).with_suffix("").parts[0]


def imports_of(path):
    """Every module that a file imports, absolute, wherever the import stands: (line, dotted name)."""
    inside = path.relative_to(PACKAGE.parent).with_suffix("").parts
    package = inside[:-1]
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            parents = package[: len(package) - node.level + 1] if node.level else ()
            module = ".".join([*parents, *(node.module or "").split(".")]).strip(".")
            yield node.lineno, module
            yield from ((node.lineno, f"{module}.{alias.name}") for alias in node.names)


def siblings_of(path):
    """Modules of the package that a file imports: (line, top module)."""
    known = {name_of(module) for module in MODULES} | {"_core"}
    for line, imported in imports_of(path):
        parts = imported.split(".")
        if parts[0] == "dynid_rs" and len(parts) > 1 and parts[1] in known:
            yield line, parts[1]


def test_the_table_names_modules_that_exist():
    assert set(FLOORS) == GROUND
    assert {name_of(path) for path in MODULES} >= GROUND


@pytest.mark.parametrize("module", sorted(GROUND))
def test_the_ground_imports_nothing_from_above(module):
    for path in (path for path in MODULES if name_of(path) == module):
        for line, imported in siblings_of(path):
            assert imported in FLOORS[module] | {module}, f"{path}:{line} imports {imported}"
        for line, imported in imports_of(path):
            assert imported.split(".")[0] not in HEAVY, f"{path}:{line} imports {imported}"


def test_only_the_command_line_imports_the_command_line():
    for path in MODULES:
        if name_of(path) not in {"cli", "commands"}:
            for line, imported in siblings_of(path):
                assert imported not in {"cli", "commands"}, f"{path}:{line} imports {imported}"


def test_the_package_never_imports_tests():
    tests = {path.stem for path in (ROOT / "tests").rglob("*.py")}
    tests |= {"tests", "reference", "pytest", "hypothesis"}
    for path in MODULES:
        for line, imported in imports_of(path):
            assert imported.split(".")[0] not in tests, f"{path}:{line} imports {imported}"


def test_the_package_imports_only_what_it_declares():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    declared = {re.split(r"[<>=~!;\[ ]", name)[0] for name in project["dependencies"]}
    modules = {"scikit-learn": "sklearn", "pin": "pinocchio"}
    brought = {
        "rich": "typer",  # typer depends on it
        "threadpoolctl": "scikit-learn",
        "joblib": "scikit-learn",
    }
    allowed = {modules.get(name, name) for name in declared} | {"dynid_rs"}
    allowed |= {name for name, by in brought.items() if by in declared}
    # Module: the extra that brings what it imports, late.
    optional = {"bodies.py": "physical", "excitation/collision.py": "collision"}
    for path in MODULES:
        extra = project["optional-dependencies"].get(optional.get(path.relative_to(PACKAGE).as_posix()), [])
        brings = {re.split(r"[<>=~!;\[ ]", name)[0] for name in extra}
        here = allowed | {modules.get(name, name) for name in brings}
        for line, imported in imports_of(path):
            top = imported.split(".")[0]
            assert top in here or top in STANDARD_LIBRARY, f"{path}:{line} imports {imported}"


@pytest.mark.parametrize("pattern", DENIED)
def test_what_is_denied_is_nowhere(pattern):
    for path in MODULES:
        text = path.read_text(encoding="utf-8")
        for found in re.finditer(pattern, text):
            line = text.count("\n", 0, found.start()) + 1
            where = path.relative_to(PACKAGE).as_posix()
            assert where in DENIED[pattern], f"{path}:{line} holds {found.group()!r}"


@pytest.mark.parametrize("pattern", DENIED)
def test_exceptions_are_still_needed(pattern):
    for module in DENIED[pattern]:
        text = (PACKAGE / module).read_text(encoding="utf-8")
        assert re.search(pattern, text), f"{module} needs no exception"


def test_the_binary_is_small():
    cargo = shutil.which("cargo")
    assert cargo, "cargo is not on the path; install Rust from https://rustup.rs"
    command = [cargo, "tree", "--locked", "-p", "dynid-estimator", "-e", "normal,build", "--prefix", "none"]
    tree = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    crates = {line.split()[0] for line in tree.splitlines() if line}
    assert {"dynid-estimator", "dynid-core", "dynid-io", "nalgebra"} <= crates
    assert not crates & {"pyo3", "numpy", "faer", "rayon", "dynid-offline", "dynid-py"}


def test_the_core_depends_on_nalgebra_only():
    manifest = tomllib.loads((ROOT / "rust" / "dynid-core" / "Cargo.toml").read_text(encoding="utf-8"))
    assert set(manifest["dependencies"]) == {"nalgebra"}


def test_crates_come_from_crates_io_only():
    lock = tomllib.loads((ROOT / "Cargo.lock").read_text(encoding="utf-8"))
    sources = {crate["source"] for crate in lock["package"] if "source" in crate}
    assert sources == {"registry+https://github.com/rust-lang/crates.io-index"}
    ours = {crate["name"] for crate in lock["package"] if "source" not in crate}
    assert ours == {path.parent.name for path in (ROOT / "rust").glob("*/Cargo.toml")}
