"""Inverse dynamics and regressor: batches and single calls against Pinocchio, in Python and in C++."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pinocchio as pin
from measure import ROOT, Row, compare, processor_seconds, unit

import dynid_rs as dyn
from dynid_rs import _core
from dynid_rs.simulation import bundled_robot

N_SAMPLES = 4096
DEFINES = (
    "NDEBUG",
    "BOOST_FUSION_INVOKE_MAX_ARITY=12",
    "BOOST_MPL_LIMIT_LIST_SIZE=30",
    "BOOST_MPL_LIMIT_VECTOR_SIZE=30",
    "BOOST_MPL_CFG_NO_PREPROCESSED_HEADERS",
)
"""What Pinocchio's headers ask for."""


def rows():
    """Goals G1 to G4."""
    path = bundled_robot()
    robot = dyn.RobotModel.from_urdf(path)
    model = pin.buildModelFromUrdf(str(path))
    data = model.createData()
    rng = np.random.default_rng(0)
    q, dq, ddq = rng.uniform(-2, 2, (3, N_SAMPLES, robot.n_joints))
    check(robot, model, data, q, dq, ddq)

    def pinocchio_torques():
        for k in range(N_SAMPLES):
            pin.rnea(model, data, q[k], dq[k], ddq[k])

    def pinocchio_regressors():
        stacked = np.empty((N_SAMPLES, robot.n_joints, 10 * robot.n_joints))
        for k in range(N_SAMPLES):
            stacked[k] = pin.computeJointTorqueRegressor(model, data, q[k], dq[k], ddq[k])

    yield compare(
        "G3",
        "inverse dynamics of a batch, per sample",
        lambda: robot.inverse_dynamics(q, dq, ddq),
        "Pinocchio, Python",
        pinocchio_torques,
        per=N_SAMPLES,
    )
    yield compare(
        "G1",
        "regressor of a batch into a new array, per sample",
        lambda: robot.joint_torque_regressor(q, dq, ddq),
        "Pinocchio, Python",
        pinocchio_regressors,
        per=N_SAMPLES,
        limit=70 if _core.processor_path() == "avx512" else 35,
    )
    kept = np.empty((N_SAMPLES, robot.n_joints, 10 * robot.n_joints))
    yield compare(
        "G1",
        "regressor of a batch into a given array, per sample",
        lambda: robot.joint_torque_regressor(q, dq, ddq, out=kept),
        "Pinocchio, Python",
        pinocchio_regressors,
        per=N_SAMPLES,
    )
    one_q, one_dq, one_ddq = q[:1], dq[:1], ddq[:1]
    room = np.empty((1, robot.n_joints, 10 * robot.n_joints))
    yield compare(
        "G4",
        "one regressor from Python into a given array",
        lambda: robot.joint_torque_regressor(one_q, one_dq, one_ddq, out=room),
        "Pinocchio, Python",
        lambda: pin.computeJointTorqueRegressor(model, data, q[0], dq[0], ddq[0]),
        limit=15,
    )
    yield compare(
        "G4",
        "one regressor from Python",
        lambda: robot.joint_torque_regressor(one_q, one_dq, one_ddq),
        "Pinocchio, Python",
        lambda: pin.computeJointTorqueRegressor(model, data, q[0], dq[0], ddq[0]),
        limit=10,
    )
    yield compare(
        "",
        "one inverse dynamics from Python",
        lambda: robot.inverse_dynamics(one_q, one_dq, one_ddq),
        "Pinocchio, Python",
        lambda: pin.rnea(model, data, q[0], dq[0], ddq[0]),
    )
    yield from against_cpp(robot, q, dq, ddq)


def check(robot, model, data, q, dq, ddq):
    """The two do the same: regressors need the same frames, torques are enough."""
    expected = np.array([pin.rnea(model, data, *state) for state in zip(q[:64], dq[:64], ddq[:64], strict=True)])
    np.testing.assert_allclose(robot.inverse_dynamics(q[:64], dq[:64], ddq[:64]), expected, rtol=0, atol=1e-12)


def against_cpp(robot, q, dq, ddq):
    """Ours through Python, arrays and all, against a C++ loop that calls nothing else."""
    peer = cpp_nanoseconds()
    if peer is None:
        yield Row("G1, G3", "Pinocchio in C++", "", "not built here", note="needs g++ and the package cmeel-eigen")
        return
    # The goals are against clang's build, which a long measurement found 1.6 times faster than g++'s.
    harder = 1.0 if shutil.which("clang++") else 1.6
    wide = _core.processor_path() == "avx512"
    few = q[:256], dq[:256], ddq[:256]
    room = np.empty((256, robot.n_joints, 10 * robot.n_joints))
    torques = processor_time(lambda: robot.inverse_dynamics(q, dq, ddq), len(q))
    stored = processor_time(lambda: robot.joint_torque_regressor(*few, out=room), 256)
    kernels = native_nanoseconds()
    figures = [
        ("G3", "inverse dynamics of a batch, per sample", torques, "rnea_ns", 35 if wide else 13),
        ("G1", "regressor of 256 samples into a given array, per sample", stored, "regressor_ns", 20 if wide else 12),
    ]
    if kernels is not None:
        own = 1e-9 * kernels["regressor_consumed_ns"]
        what = "regressor in lanes, used up in the cache (times phi), per sample, native"
        figures.append(("G2", what, own, "regressor_ns", 30 if wide else 13))
    for goal, what, own, key, limit in figures:
        ratio, least = 1e-9 * peer[key] / own, harder * limit
        yield Row(
            goal,
            what,
            unit(own),
            f"{unit(1e-9 * peer[key])} (Pinocchio, C++, {'g++' if harder > 1 else 'clang++'} -O3)",
            ratio,
            None,
            f">= {least:g}",
            ratio >= least,
            "" if harder == 1.0 else f"{limit} against clang's build, which is 1.6 times faster than g++'s",
        )


def processor_time(work, per):
    """Median seconds of the processor per sample."""
    return sorted(processor_seconds(work, 20) / per for _ in range(7))[3]


def native_nanoseconds():
    """The Rust bench's figures on the widest registers; None where it cannot be built."""
    if shutil.which("cargo") is None:
        return None
    command = ["cargo", "bench", "--quiet", "-p", "dynid-offline", "--bench", "batch"]
    lines = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout.splitlines()
    return [json.loads(line) for line in lines if line.startswith("{")][-1]


def cpp_nanoseconds():
    """Medians of `pinocchio.cpp`, built once against the wheel's headers; None where it cannot be built."""
    source, program = Path(__file__).with_name("pinocchio.cpp"), ROOT / "target" / "pinocchio-peer"
    prefix = next(folder for folder in Path(pin.__file__).parents if folder.name == "cmeel.prefix")
    include, library = prefix / "include", prefix / "lib"
    compiler = shutil.which("clang++") or shutil.which("g++")
    if not program.exists() or program.stat().st_mtime < source.stat().st_mtime:
        if compiler is None or not (include / "eigen3").is_dir():
            return None
        command = [compiler, "-std=c++17", "-O3", *(f"-D{name}" for name in DEFINES)]
        command += [f"-I{include}", f"-I{include / 'eigen3'}", source, "-o", program]
        command += [f"-L{library}", "-lpinocchio_default", f"-Wl,-rpath,{library}"]
        if subprocess.run(command, capture_output=True, check=False).returncode != 0:
            return None
    return json.loads(subprocess.run([program], capture_output=True, text=True, check=True).stdout)
