"""The clients of examples/online talk to the binary, and get the numbers of `TorqueModel.evaluate`."""

import importlib
import re
import subprocess
import sys
import time

import numpy as np
import pytest
from helpers.binaries import find_estimator
from helpers.data import ROOT
from helpers.robots import random_chain
from helpers.tolerances import EXACT

from dynid_rs import RobotModel, TorqueModel

EXAMPLES = ROOT / "examples" / "online"

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="shared memory and its paths are Linux's")


@pytest.fixture
def clients(monkeypatch):
    monkeypatch.syspath_prepend(str(EXAMPLES))
    return importlib.import_module("udp_client"), importlib.import_module("shm_client")


@pytest.fixture
def model(tmp_path):
    n = 3
    robot = RobotModel.from_urdf_string(random_chain(1).urdf)
    model = TorqueModel(
        robot,
        robot.phi,
        [],
        encoder_delay=[0.0] * n,
        noise_std=[0.1] * n,
        domain=([[-3.0, 3.0]] * n, [3.0] * n, [9.0] * n),
    )
    model.save(tmp_path / "model.json")
    return model


@pytest.fixture
def start(model, tmp_path):
    running = []

    def start(*options):
        command = [find_estimator(), tmp_path / "model.json", *options]
        process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
        running.append(process)
        return re.split(r"listening on |sharing ", process.stderr.readline())[1].strip()

    yield start
    for process in running:
        process.terminate()
        process.stderr.close()
        assert process.wait(20) == 0


def test_datagrams(clients, model, start, capsys):
    host, port = start("--udp", "127.0.0.1:0").split(":")
    clients[0].main(host, port, 3, 101)
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 2
    t, phase = 0.1, 0.3 * np.arange(3)
    total, _, _ = model.evaluate(
        *(x[None] for x in (0.5 * np.sin(t + phase), 0.5 * np.cos(t + phase), -0.5 * np.sin(t + phase)))
    )
    assert str(np.round(total[0], 3)) in lines[1]


def test_shared_memory(clients, model, start, tmp_path):
    udp, shm = clients
    slots = shm.Slots(start("--shm", str(tmp_path / "slot"), "--rate", "200"))
    rng = np.random.default_rng(0)
    for k in range(20):
        q, dq, ddq = rng.uniform(-1, 1, (3, 3))
        slots.send(udp.state(k, 0.001 * k, q, dq, ddq))
        end = time.monotonic() + 20
        while (found := slots.receive()) is None or found[1] != k:
            assert time.monotonic() < end
        np.testing.assert_allclose(found[2][0], model.evaluate(q[None], dq[None], ddq[None])[0][0], **EXACT)
