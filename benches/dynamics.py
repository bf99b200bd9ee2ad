"""Inverse dynamics and regressor: batches and single calls against Pinocchio, in Python and in C++."""

from __future__ import annotations

import json
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np
import pinocchio as pin
from measure import Row, compare, processor_seconds, unit

import dynid_rs as dyn
from dynid_rs import _core
from dynid_rs.simulation import bundled_robot

N_SAMPLES = 4096


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
    one = q[:1], dq[:1], ddq[:1]
    yield compare(
        "G4",
        "one regressor from Python",
        lambda: robot.joint_torque_regressor(*one),
        "Pinocchio, Python",
        lambda: pin.computeJointTorqueRegressor(model, data, q[0], dq[0], ddq[0]),
        limit=10,
    )
    yield compare(
        "",
        "one inverse dynamics from Python",
        lambda: robot.inverse_dynamics(*one),
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
    wide = _core.processor_path() == "avx512"
    few = q[:256], dq[:256], ddq[:256]
    for goal, what, work, key, limit in (
        ("G3", "inverse dynamics of a batch, per sample", robot.inverse_dynamics, "rnea_ns", 35 if wide else 13),
        (
            "G2",
            "regressor of 256 samples, per sample",
            robot.joint_torque_regressor,
            "regressor_ns",
            20 if wide else 12,
        ),
    ):
        states = few if goal == "G2" else (q, dq, ddq)
        own = sorted(processor_seconds(lambda w=work, s=states: w(*s), 20) / len(states[0]) for _ in range(7))[3]
        ratio = 1e-9 * peer[key] / own
        yield Row(
            goal,
            what,
            unit(own),
            f"{unit(1e-9 * peer[key])} (Pinocchio, C++, g++ -O3)",
            ratio,
            None,
            f">= {limit}",
            ratio >= limit,
            "the limit is against clang's build, which is about 1.6 times faster than g++'s",
        )


def cpp_nanoseconds():
    """Medians of `pinocchio.cpp`; None where it cannot be built."""
    prefix = Path(pin.__file__).parents[4] / "site-packages" / "cmeel.prefix"
    prefix = next((p for p in Path(pin.__file__).parents if p.name == "cmeel.prefix"), prefix)
    include = prefix / "include"
    eigen = include / "eigen3"
    compiler = shutil.which("clang++") or shutil.which("g++")
    if compiler is None or not eigen.is_dir():
        return None
    defines = [
        "-DNDEBUG",
        "-DBOOST_FUSION_INVOKE_MAX_ARITY=12",
        "-DBOOST_MPL_LIMIT_LIST_SIZE=30",
        "-DBOOST_MPL_LIMIT_VECTOR_SIZE=30",
        "-DBOOST_MPL_CFG_NO_PREPROCESSED_HEADERS",
    ]
    library = prefix / "lib"
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder) / "peer"
        source = Path(__file__).with_name("pinocchio.cpp")
        built = subprocess.run(
            [compiler, "-std=c++17", "-O3", *defines, f"-I{include}", f"-I{eigen}", source, "-o", program]
            + [f"-L{library}", "-lpinocchio_default", f"-Wl,-rpath,{library}"],
            capture_output=True,
            check=False,
        )
        if built.returncode != 0:
            return None
        return json.loads(subprocess.run([program], capture_output=True, text=True, check=True).stdout)
