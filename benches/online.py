"""Time of one torque estimate: the Rust bench's percentiles, and one call from Python against Pinocchio and numpy."""

from __future__ import annotations

import json
import shutil
import subprocess

import numpy as np
import pinocchio as pin
from measure import ROOT, Row, compare

import dynid_rs as dyn
from dynid_rs import _core
from dynid_rs.simulation import bundled_robot

CYCLES = 10_000_000
LIMITS = {"p50_ns": 300, "p99.9_ns": 500}
"""Free-running, on the widest registers [ns]."""
WATCHED = 200
"""What a watch of six joints may cost a cycle beyond the stream's, half of all cycles [ns]."""

N_COMPONENTS = 10
EPS, LAMBDA = 0.02, 0.01
"""Width and threshold of the friction [rad/s]."""


def rows(cycles: int = CYCLES):
    """Goal G12 as far as one estimate is concerned."""
    yield from native(cycles)
    yield from from_python()


def from_python():
    """Rigid body, friction and mixtures of six joints in one call, against Pinocchio and numpy by hand."""
    path = bundled_robot()
    robot = dyn.RobotModel.from_urdf(path)
    n, rng = robot.n_joints, np.random.default_rng(0)
    friction = rng.uniform(0, 2, (n, 8))
    weights = np.full(N_COMPONENTS, 1 / N_COMPONENTS)
    means = rng.uniform(-1, 1, (n, N_COMPONENTS, 3))
    root = rng.uniform(-0.5, 0.5, (n, N_COMPONENTS, 3, 3)) + np.eye(3)
    covariances = root @ root.transpose(0, 1, 3, 2)
    mixtures = [
        _core.GaussianMixtureRegression(weights, mean, covariance)
        for mean, covariance in zip(means, covariances, strict=True)
    ]
    effect = _core.Effect.of("friction", velocity_threshold=[LAMBDA] * n, transition_width=[EPS] * n)
    model = _core.TorqueModel(
        robot,
        robot.phi,
        [(effect, friction)],
        residual=("joint_state", mixtures),
        encoder_delay=[0.0] * n,
        noise_std=[0.1] * n,
        domain=([[-9.0, 9.0]] * n, [9.0] * n, [99.0] * n),
    )
    q, dq, ddq = rng.uniform(-1, 1, (3, 1, n))
    peer = by_hand(pin.buildModelFromUrdf(str(path)), friction, means, covariances)
    np.testing.assert_allclose(model.torque(q, dq, ddq)[0], peer(q[0], dq[0], ddq[0]), rtol=1e-9, atol=1e-9)
    out = np.empty((1, n))
    yield compare(
        "G12",
        "one estimate from Python into a given array",
        lambda: model.torque(q, dq, ddq, out=out),
        "Pinocchio and numpy",
        lambda: peer(q[0], dq[0], ddq[0]),
        limit=60,
    )


def by_hand(model, friction, means, covariances):
    """The same estimate as somebody writes it with Pinocchio and numpy, what does not move prepared; equal weights."""
    data = model.createData()
    centre, inputs = means[..., :2], covariances[..., :2, :2]
    inverse = np.linalg.inv(inputs)
    gain = np.einsum("jki,jkil->jkl", covariances[..., 2, :2], inverse)
    log_size = -0.5 * np.log(np.linalg.det(inputs))
    positive, negative = friction[:, ::2], friction[:, 1::2]

    def estimate(q, dq, ddq):
        rigid_body = pin.rnea(model, data, q, dq, ddq)
        s = np.tanh(dq / EPS)
        gate = 0.5 * (1 + np.abs(s))
        fast = np.abs(dq) >= LAMBDA
        columns = np.stack([s * gate, fast * gate * dq, fast * dq**2, fast * dq**3], axis=1)
        rubbing = (columns * np.where((dq >= 0)[:, None], positive, negative)).sum(axis=1)
        away = np.stack([q, dq], axis=1)[:, None] - centre
        log_density = log_size - 0.5 * np.einsum("jki,jkil,jkl->jk", away, inverse, away)
        h = np.exp(log_density - log_density.max(axis=1, keepdims=True))
        conditional = means[..., 2] + (gain * away).sum(axis=2)
        return rigid_body + rubbing + (h * conditional).sum(axis=1) / h.sum(axis=1)

    return estimate


def native(cycles: int):
    """Percentiles of the Rust bench."""
    if shutil.which("cargo") is None:
        yield Row("G12", "one torque estimate", "cargo is missing", "")
        return
    command = ["cargo", "bench", "--quiet", "-p", "dynid-core", "--bench", "estimate", "--", str(cycles)]
    lines = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout.splitlines()
    found = [json.loads(line) for line in lines if line.startswith("{")]
    clock = next(entry for entry in found if entry["what"] == "clock alone")
    yield Row(
        "", f"the clock alone, {cycles:,} readings", f"p50 {clock['p50_ns']} ns, p99.9 {clock['p99.9_ns']} ns", ""
    )
    widest = found[-1]["path"]
    for entry in found[1:]:
        figures = ", ".join(f"{key[:-3]} {entry[key]}" for key in ("p50_ns", "p99_ns", "p99.9_ns", "p99.99_ns")) + " ns"
        what = f"{entry['what']}, {entry['cycles']:,} cycles, {entry['path']}"
        if entry["what"] == "estimate" and entry["path"] == widest:
            met = all(entry[key] <= most for key, most in LIMITS.items())
            yield Row(
                "G12",
                what,
                figures,
                "",
                None,
                None,
                "p50 <= 300, p99.9 <= 500 ns",
                met,
                "holds one reading of the clock",
            )
        else:
            yield Row("", what, figures, "")
        if entry["what"] == "stream, watched" and entry["path"] == widest:
            yield watch_row(found, entry)


def watch_row(found, watched):
    """What a watch costs a cycle: the stream that is watched beside the same one that is not."""
    alone = next(one for one in found if (one["what"], one["path"]) == ("stream", watched["path"]))
    more = {key: watched[key] - alone[key] for key in ("mean_ns", "p50_ns", "p99_ns", "p99.9_ns")}
    return Row(
        "",
        f"what a watch that nothing disturbs costs a cycle more, {watched['path']}",
        ", ".join(f"{key[:-3]} {value}" for key, value in more.items()) + " ns",
        "",
        None,
        None,
        f"p50 <= {WATCHED} ns",
        more["p50_ns"] <= WATCHED,
        "differences of percentiles; one cycle in twenty evaluates what a load would add",
    )
