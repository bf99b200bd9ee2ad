"""Rooms: what may import what, formulas with one home, and dependencies that stay where they belong."""

import ast
import re
import shutil
import subprocess
import sys
import tomllib
from functools import cache

import pytest
from helpers.data import ROOT

PACKAGE = ROOT / "python" / "dynid_rs"
MODULES = sorted(PACKAGE.rglob("*.py"))

STANDARD_LIBRARY = sys.stdlib_module_names
FACE = "dynid_rs"
"""The package itself: hands names on, and nothing imports from it."""
ROOMS = {
    "base": set(),
    "report": {"base"},
    "runs": {"base"},
    "simulation": {"base", "runs"},
    "regression": {"base", "runs"},
    "model": {"base", "report", "runs", "regression"},
    "identification": {"base", "runs", "regression", "model"},
    "archive": {"base", "runs", "regression", "model", "identification"},
    "pooling": {"base", "regression", "model", "identification"},
    "excitation": {"base", "report", "runs", "simulation", "model"},
    "sensors": {"base", "runs", "regression", "model", "identification"},
    "reference": {"base", "runs", "regression", "model", "identification"},
    "diagnosis": {
        *("base", "runs", "regression", "model", "identification", "excitation"),
        *("sensors", "reference"),
    },
    "experiment": {"base", "report", "simulation", "excitation", "diagnosis"},
    "commands": {
        *("base", "report", "runs", "simulation", "regression", "model"),
        *("identification", "archive", "pooling", "excitation", "sensors", "reference", "diagnosis", "experiment"),
    },
}
"""Rooms from the ground up, and what each may import of the package besides itself and the compiled module."""
GROUND = {"base", "runs"}
"""Runs and files: quick to import, without any identification."""
HEAVY = {"sklearn", "typer", "rich"}
"""Libraries that nobody on the ground needs."""

DENIED = {
    r"tanh\(": {},
    r"multivariate_normal": {},
    r"np\.exp\(": {
        "identification/friction.py": "widths and thresholds are searched in their logarithm",
        "diagnosis/settling.py": "shapes that are scales are stepped in their logarithm",
        "identification/friction_laws.py": "Stribeck's velocity is searched in its logarithm",
        "diagnosis/ripple.py": "a wave in the angle, in complex numbers",
        "base/wording.py": "geometric mean of error ratios",
        "pooling/arm.py": "torque scales are pooled in their logarithm",
        "identification/smooth_friction.py": "widths and sharpness are improved in their logarithm",
        "regression/error_interval.py": "an interval of a ratio, in its logarithm",
        "diagnosis/estimates.py": "an interval of a scale, in its logarithm",
        "runs/low_pass.py": "poles and frequencies on the unit circle, in complex numbers",
        "sensors/lag.py": "a shift in time, in complex numbers",
    },
    r"(?m)^\s*(import|from) (pickle|joblib|dill|cloudpickle|shelve|marshal)\b": {
        "archive/work.py": "units of work go to other processes; nothing is kept that way",
        "commands/_cluster.py": "the cluster is joblib's",
    },
    r"pickle\.(dump|load)|allow_pickle=True": {},
}
"""Formulas have their home in Rust; models are files with a version. Exceptions: module and reason."""


def module_of(path):
    """Dotted name: `runs/readers/__init__.py` is `dynid_rs.runs.readers`."""
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@cache
def known_modules():
    """Dotted names of all modules of the package."""
    return frozenset(module_of(path) for path in MODULES)


def room_of(module):
    """Room of a dotted name; the command line's doors are part of the commands, the package itself is the face."""
    parts = module.split(".")
    if len(parts) == 1:
        return FACE
    return "commands" if parts[1] in ("cli", "__main__") else parts[1]


@cache
def imports_of(path, *, at_run_time=False):
    """Every module that a file imports, absolute, wherever the import stands: (line, dotted name).

    `at_run_time`: less what stands under TYPE_CHECKING.
    """
    return tuple(_imports(path, at_run_time))


def _imports(path, at_run_time):
    inside = path.relative_to(PACKAGE.parent).with_suffix("").parts
    package = inside[:-1]
    tree = ast.parse(path.read_text(encoding="utf-8"))
    skipped = set()
    if at_run_time:
        guards = (
            node for node in ast.walk(tree) if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test)
        )
        skipped = {id(node) for guard in guards for part in guard.body for node in ast.walk(part)}
    for node in ast.walk(tree):
        if id(node) in skipped:
            continue
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            parents = package[: len(package) - node.level + 1] if node.level else ()
            module = ".".join([*parents, *(node.module or "").split(".")]).strip(".")
            yield node.lineno, module
            yield from ((node.lineno, f"{module}.{alias.name}") for alias in node.names)


@cache
def siblings_of(path, *, at_run_time=False):
    """Modules of the package that a file imports, itself left out: (line, dotted name).

    ``from package import module`` names the module; what else a package hands on stands for the package.
    """
    known = known_modules()
    lines = {}
    for line, imported in imports_of(path, at_run_time=at_run_time):
        lines.setdefault(line, []).append(imported)
    found = {}
    for line, names in lines.items():
        for name in names:
            inside = [other for other in names if other.startswith(f"{name}.")]
            only_modules = bool(inside) and all(other in known or other == f"{FACE}._core" for other in inside)
            if name in known and not only_modules:
                found.setdefault(name, line)
    return [(line, module) for module, line in found.items() if module not in {FACE, module_of(path)}]


def circles(arrows):
    """Groups of names of which each leads to every other one along `arrows`, a name to the names it leads to."""
    reached = {}
    for start in arrows:
        seen, ways = set(), [start]
        while ways:
            for name in arrows.get(ways.pop(), ()):
                if name not in seen:
                    seen.add(name)
                    ways.append(name)
        reached[start] = seen
    return {frozenset(b for b in reached[a] if a in reached.get(b, ())) for a in arrows if a in reached[a]}


def test_circles_are_seen():
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"b"}, "d": {"a", "b"}}) == {frozenset("bc")}


def test_the_table_names_the_rooms_that_exist_and_its_arrows_point_down():
    assert set(ROOMS) == {room_of(module_of(path)) for path in MODULES} - {FACE}
    above = list(ROOMS)
    for place, allowed in enumerate(ROOMS.values()):
        assert allowed <= set(above[:place])


@pytest.mark.parametrize("room", ROOMS)
def test_a_room_imports_only_rooms_below_it(room):
    for path in (path for path in MODULES if room_of(module_of(path)) == room):
        for line, imported in siblings_of(path):
            assert room_of(imported) in ROOMS[room] | {room}, f"{path}:{line} imports {imported}"


@pytest.mark.parametrize("room", ROOMS)
def test_what_a_room_may_import_it_does(room):
    paths = [path for path in MODULES if room_of(module_of(path)) == room]
    assert ROOMS[room] == {room_of(imported) for path in paths for _, imported in siblings_of(path)} - {room}


def test_there_is_no_circle_between_modules():
    """At run time: a name that stands in an annotation alone may point either way, within its room."""
    arrows = {module_of(path): {name for _, name in siblings_of(path, at_run_time=True)} for path in MODULES}
    assert not circles(arrows)


@pytest.mark.parametrize("room", sorted(GROUND))
def test_the_ground_needs_no_heavy_library(room):
    for path in (path for path in MODULES if room_of(module_of(path)) == room):
        for line, imported in imports_of(path):
            assert imported.split(".")[0] not in HEAVY, f"{path}:{line} imports {imported}"


def test_nothing_imports_from_the_package_itself():
    """Its names are for users; inside, a name comes from the module it lives in."""
    known = known_modules()
    for path in MODULES:
        for line, imported in imports_of(path):
            parts = imported.split(".")
            if parts[0] == FACE and len(parts) == 2:
                assert parts[1] == "_core" or imported in known, f"{path}:{line} imports {imported}"


def test_the_package_never_imports_tests():
    tests = {path.stem for path in (ROOT / "tests").rglob("*.py")}
    tests |= {"tests", "helpers", "exam", "bad_data", "campaigns", "reference", "pytest", "hypothesis"}
    for path in MODULES:
        for line, imported in imports_of(path):
            assert imported.split(".")[0] not in tests, f"{path}:{line} imports {imported}"


def test_tests_have_the_rooms_of_the_package():
    """A folder per room, and inside it none but the room's own; five more for what is in no room."""
    beside = {"core", "online", "equations", "whole", "house"}
    folders = {path.parent.relative_to(ROOT / "tests") for path in (ROOT / "tests").rglob("test_*.py")}
    assert {folder.parts[0] for folder in folders} == set(ROOMS) | beside
    for folder in folders:
        assert str(folder) in beside or (PACKAGE / folder).is_dir(), folder


def test_the_package_imports_only_what_it_declares():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    declared = {re.split(r"[<>=~!;\[ ]", name)[0] for name in project["dependencies"]}
    modules = {"scikit-learn": "sklearn", "pin": "pinocchio", "python-calamine": "python_calamine"}
    brought = {
        "rich": "typer",  # typer depends on it
        "threadpoolctl": "scikit-learn",
        "joblib": "scikit-learn",
    }
    allowed = {modules.get(name, name) for name in declared} | {"dynid_rs"}
    allowed |= {name for name, by in brought.items() if by in declared}
    # Module: the extra that brings what it imports, late.
    optional = {
        "base/drawing.py": "plot",
        "commands/_cluster.py": "cluster",
        "excitation/collision.py": "collision",
        "model/bodies.py": "physical",
        "model/export.py": "collision",
        "model/mjcf.py": "mujoco",
        "model/robot_file.py": "xacro",
    }
    optional |= {f"runs/readers/{name}.py": "io" for name in ("hdf5", "excel", "bag_library", "bag_bounds")}
    callers = {"runs/frames.py": {"pandas", "polars"}}  # asked for by name, by somebody who has them
    for path in MODULES:
        extra = project["optional-dependencies"].get(optional.get(path.relative_to(PACKAGE).as_posix()), [])
        brings = {re.split(r"[<>=~!;\[ ]", name)[0] for name in extra}
        here = allowed | {modules.get(name, name) for name in brings} | ({"lz4"} if "rosbags" in brings else set())
        here |= callers.get(path.relative_to(PACKAGE).as_posix(), set())
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
