"""Inverse dynamics and regressor against compiled peers: Pinocchio's C++ and CasADi's C, each by the best compiler."""

from __future__ import annotations

import functools
import importlib.util
import json
import shutil
import statistics
import subprocess
import tempfile
from pathlib import Path

import numpy as np
import pinocchio as pin
from limits import figures_by_path
from measure import ROOT, Row, processor_seconds, unit

from dynid_rs import _core

HERE = Path(__file__).parent
ROUNDS = 7
COMPILERS = ("clang++", "g++")
DEFINES = (
    "NDEBUG",
    "BOOST_FUSION_INVOKE_MAX_ARITY=12",
    "BOOST_MPL_LIMIT_LIST_SIZE=30",
    "BOOST_MPL_LIMIT_VECTOR_SIZE=30",
    "BOOST_MPL_CFG_NO_PREPROCESSED_HEADERS",
)
"""What Pinocchio's headers ask for."""
CALIBRATION = 1e-3
"""How far a calibrated arm's joints stand from where they were drawn [m, rad]."""


def rows(robot, model, q, dq, ddq):
    """Goals G1 to G3 in turn with programs that call nothing else."""
    pinocchio = pinocchio_programs()
    if not pinocchio:
        yield Row("G1, G3", "Pinocchio in C++", "", "not built here", note="needs g++ or clang++ and cmeel-eigen")
    arms = {}
    if importlib.util.find_spec("casadi") is None:
        yield Row("G2, G3", "CasADi's C", "", "not built here", note="needs the package casadi")
    else:
        arms = {"as drawn": casadi_programs(model, robot, q[:64], dq[:64], ddq[:64])}
        arms["calibrated"] = casadi_programs(calibrated(model))
    ours = own(robot, q, dq, ddq)
    times = [
        (ours(), best(pinocchio), {name: best(programs) for name, programs in arms.items()}) for _ in range(ROUNDS)
    ]
    if pinocchio:
        yield from against_pinocchio(times, "clang++" in pinocchio)
    if arms.get("as drawn"):
        yield from against_casadi(times)


def against_pinocchio(times, clang):
    """Arrays and all from Python, but for what is used up in the cache; that is our Rust bench's."""
    # The goals are against clang's build, which a long measurement found 1.6 times faster than g++'s.
    harder = 1.0 if clang else 1.6
    wide = _core.processor_path() == "avx512"
    for goal, what, own, key, limit in (
        ("G3", "inverse dynamics of a batch, per sample", "torques", "rnea_ns", 35 if wide else 13),
        ("G1", "regressor of 256 samples into a given array, per sample", "stored", "regressor_ns", 20 if wide else 12),
        ("G2", USED_UP, "regressor_consumed_ns", "regressor_ns", 30 if wide else 13),
    ):
        note = "" if clang else f"{limit} against clang's build, which is 1.6 times faster than g++'s"
        pairs = [(ours[own], theirs[key]) for ours, theirs, _ in times if own in ours]
        if pairs:
            yield row(goal, what, pairs, f"Pinocchio, C++, {times[-1][1][f'{key} by']} -O3", harder * limit, note)


def against_casadi(times):
    """The same arm; and as a remark one whose placements were calibrated, where no product with zero is left out."""
    wide = 1.0 if _core.processor_path() == "avx512" else 0.5
    for goal, what, own, key, limit in (
        ("G3", "inverse dynamics of a batch, per sample", "torques", "rnea_ns", 10),
        ("G2", USED_UP, "regressor_consumed_ns", "regressor_ns", 9),
        ("G3", "one inverse dynamics, native", "one_rnea_ns", "rnea_ns", 2),
        ("G2", "one regressor, native", "one_regressor_ns", "regressor_ns", 2),
    ):
        drawn, real = (
            [(ours[own], casadi[arm][key]) for ours, _, casadi in times if own in ours]
            for arm in ("as drawn", "calibrated")
        )
        if drawn:
            ratio = statistics.median(theirs for _, theirs in real) / statistics.median(ours for ours, _ in real)
            note = f"of an arm whose placements were calibrated, so that none of its numbers is zero: {ratio:.3g}"
            yield row(
                goal,
                what,
                drawn,
                f"CasADi, C, {times[-1][2]['as drawn'][f'{key} by']} {CASADI_FLAGS}",
                wide * limit,
                note,
            )


USED_UP = "regressor in lanes, used up in the cache (times phi), per sample, native"


def row(goal, what, pairs, peer, limit, note):
    """A row of nanoseconds that came in turn."""
    own, other = (statistics.median(column) for column in zip(*pairs, strict=True))
    ratios = [theirs / ours for ours, theirs in pairs]
    ratio, peer = other / own, f"{unit(1e-9 * other)} ({peer})"
    spread = min(ratios), max(ratios)
    return Row(goal, what, unit(1e-9 * own), peer, ratio, spread, f">= {limit:g}", ratio >= limit, note)


def own(robot, q, dq, ddq):
    """Nanoseconds per sample of ours, once more with every call; those of the Rust bench where it can be built."""
    few = q[:256], dq[:256], ddq[:256]
    room = np.empty((256, robot.n_joints, 10 * robot.n_joints))

    def once():
        figures = {
            "torques": 1e9 * processor_seconds(lambda: robot.inverse_dynamics(q, dq, ddq), 20) / len(q),
            "stored": 1e9 * processor_seconds(lambda: robot.joint_torque_regressor(*few, out=room), 20) / 256,
        }
        return figures | rust_figures()

    return once


def rust_figures():
    """The Rust bench's figures on the widest registers."""
    by_path = figures_by_path()
    return by_path[-1] if by_path else {}


def best(programs):
    """Figures of one run of each program: the least of each, and which compiler it is of."""
    figures = {
        compiler: json.loads(subprocess.run([program], capture_output=True, text=True, check=True).stdout)
        for compiler, program in programs.items()
    }
    least = {}
    for key in ("rnea_ns", "regressor_ns") if figures else ():
        compiler = min(figures, key=lambda name: figures[name][key])
        least |= {key: figures[compiler][key], f"{key} by": compiler}
    return least


def pinocchio_programs():
    """`pinocchio.cpp` by every compiler that can build it against the wheel's headers; kept until it changes."""
    prefix = next(folder for folder in Path(pin.__file__).parents if folder.name == "cmeel.prefix")
    include, library = prefix / "include", prefix / "lib"
    programs = {}
    for compiler in filter(shutil.which, COMPILERS):
        program = ROOT / "target" / f"pinocchio-peer-{compiler}"
        sources = [HERE / "pinocchio.cpp", HERE / "clock.hpp"]
        if not program.exists() or program.stat().st_mtime < max(source.stat().st_mtime for source in sources):
            flags = ["-std=c++17", "-O3", *(f"-D{name}" for name in DEFINES), f"-I{include}", f"-I{include / 'eigen3'}"]
            link = [f"-L{library}", "-lpinocchio_default", f"-Wl,-rpath,{library}"]
            if not built([compiler, *flags, sources[0], "-o", program, *link]):
                continue
        programs[compiler] = program
    return programs


CASADI_FLAGS = "-O3 -march=native"


def casadi_programs(model, robot=None, *states):
    """`casadi.cpp` with the C that CasADi writes for this arm, by every compiler; checked against `robot` before."""
    import casadi
    from arm_graph import functions

    torques, regressor = functions(model)
    if robot is not None:
        check(robot, torques, regressor, states)
    writer = casadi.CodeGenerator("casadi_peer.c")
    writer.add(torques)
    writer.add(regressor)
    programs = {}
    for compiler in filter(shutil.which, COMPILERS):
        folder = scratch()
        writer.generate(f"{folder}/")
        flags = CASADI_FLAGS.split()
        c = {"clang++": "clang", "g++": "gcc"}[compiler]
        if built([c, *flags, "-c", folder / "casadi_peer.c", "-o", folder / "graph.o"]) and built(
            [compiler, "-std=c++17", *flags, HERE / "casadi.cpp", folder / "graph.o", "-o", folder / "program"]
        ):
            programs[compiler] = folder / "program"
    return programs


def check(robot, torques, regressor, states):
    """CasADi's graph and ours give the same numbers, entry by entry."""
    for state in zip(*states, strict=True):
        one = [signal[None] for signal in state]
        np.testing.assert_allclose(torques(*state).full().ravel(), robot.inverse_dynamics(*one)[0], rtol=0, atol=1e-10)
        np.testing.assert_allclose(regressor(*state).full(), robot.joint_torque_regressor(*one)[0], rtol=0, atol=1e-10)


def calibrated(model):
    """The arm with every joint a little beside where it was drawn."""
    rng = np.random.default_rng(0)
    real = model.copy()
    for j in range(1, real.njoints):
        real.jointPlacements[j] = real.jointPlacements[j] * pin.exp6(CALIBRATION * rng.standard_normal(6))
    return real


def built(command):
    """Whether the compiler was content."""
    return subprocess.run(list(map(str, command)), capture_output=True, check=False).returncode == 0


def scratch():
    """A new folder that goes with this process."""
    return Path(tempfile.mkdtemp(dir=folder_of_scratch().name))


@functools.cache
def folder_of_scratch():
    return tempfile.TemporaryDirectory()
