"""`dynid fleet` on a Dask cluster: the same tables to the byte, also where a worker is killed on the way."""

from __future__ import annotations

import os
import signal
import threading
import time
from pathlib import Path

import joblib
import pytest
from campaigns.fleet_arms import write_fleet
from helpers.small_arm import dynid, refusal

from dynid_rs import identify_fleet

N_ARMS = 8
TABLES = ("fleet.csv", "fleet.json", "fleet.parquet", "quantities.parquet")


@pytest.fixture(scope="module")
def arms(tmp_path_factory):
    """A fleet in a file, and its tables when one process makes them."""
    folder = tmp_path_factory.mktemp("fleet")
    toml, _ = write_fleet(folder, 11, range(N_ARMS), 0.0, kinds=("light_arm",))
    identify_fleet(toml, folder / "out", n_jobs=1)
    return toml, tables(folder / "out")


@pytest.fixture(scope="module")
def cluster():
    """Two worker processes of Dask, with a nanny each that replaces them."""
    import distributed  # an extra of the tests, slow to import

    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as here,
        distributed.Client(here) as client,
    ):
        yield client


def tables(output: Path) -> dict[str, bytes]:
    """The tables but for the folder's own name, which rows hold."""
    text = {name: (output / name).read_bytes() for name in TABLES if not name.endswith(".parquet")}
    text = {name: content.replace(str(output).encode(), b"OUT") for name, content in text.items()}
    return text | {"quantities.parquet": (output / "quantities.parquet").read_bytes()}


@pytest.mark.filterwarnings("ignore")
def test_a_cluster_makes_the_same_tables(cluster, arms, tmp_path):
    toml, alone = arms
    with joblib.parallel_config(backend="dask"):
        identify_fleet(toml, tmp_path / "out")
    assert tables(tmp_path / "out") == alone


@pytest.mark.filterwarnings("ignore")
def test_the_command_takes_the_scheduler_s_address(cluster, arms, tmp_path):
    toml, alone = arms
    printed = dynid("fleet", toml, "-o", tmp_path / "out", "--scheduler", cluster.scheduler.address)
    assert printed.exit_code == 0, printed.output
    assert tables(tmp_path / "out") == alone


@pytest.mark.filterwarnings("ignore")
def test_a_worker_that_is_killed_midway_loses_nothing(cluster, arms, tmp_path):
    """kill -9 as soon as two robots are done: others are under way then."""
    toml, alone = arms
    output = tmp_path / "out"
    before = set(cluster.run(os.getpid).values())
    victim = min(before)
    killed_at: list[int] = []

    def kill() -> None:
        while len(done := list(output.glob("arm_*/result.json"))) < 2:
            time.sleep(0.01)
        os.kill(victim, signal.SIGKILL)
        killed_at.append(len(done))

    killer = threading.Thread(target=kill)
    killer.start()
    with joblib.parallel_config(backend="dask"):
        identify_fleet(toml, output)
    killer.join()
    assert killed_at[0] < N_ARMS
    assert tables(output) == alone
    cluster.wait_for_workers(2, timeout=240)
    assert victim not in set(cluster.run(os.getpid).values())


def test_what_a_cluster_cannot_be(arms, tmp_path, monkeypatch):
    toml, _ = arms
    monkeypatch.setattr("dynid_rs.commands._cluster.SECONDS", 1.0)
    said = refusal(dynid("fleet", toml, "-o", tmp_path / "a", "--scheduler", "tcp://127.0.0.1:9"))
    assert "--scheduler tcp://127.0.0.1:9: no scheduler answers there" in said
    said = refusal(dynid("fleet", toml, "-o", tmp_path / "b", "--scheduler", "nonsense://x"))
    assert "--scheduler nonsense://x" in said
    said = refusal(dynid("fleet", toml, "-o", tmp_path / "c", "--scheduler", "tcp://x:1", "--jobs", "2"))
    assert "--scheduler and --jobs exclude each other" in said
