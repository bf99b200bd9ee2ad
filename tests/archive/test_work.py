"""Units of work in other processes: the same bits as here, also when a process dies on the way."""

from __future__ import annotations

import functools
import os

import joblib
import pytest
from helpers.deadly_runs import Broken, Deadly, threads
from helpers.made_runs import MadeRun, arm
from helpers.small_arm import dynid, refusal, snapshot, write_robot, write_runs

from dynid_rs import DataError, ThreeLoopIdentifier
from dynid_rs.archive import Archive
from dynid_rs.archive import work as work_module
from dynid_rs.archive.cache import Cache
from dynid_rs.archive.work import RUST_THREADS, Work

N_RUNS = 6


def sources(deadly=None):
    runs = [MadeRun(seed, 5.0) for seed in range(N_RUNS)]
    if deadly is not None:
        runs[3] = deadly
    return runs


def fitted(work, runs=None):
    """Model and covariance, as bytes."""
    archive = Archive(arm(), sources() if runs is None else runs, memory=30_000_000, work=work)
    archive.check()
    learned = archive.fit(ThreeLoopIdentifier(arm(), residual=None), archive.sample(), None)
    identifier = learned.identifier
    return identifier.model_.__reduce__()[1], identifier.parameter_covariance().tobytes(), learned.rmse.tobytes()


@functools.cache
def serial():
    return fitted(Work())


def test_two_processes_give_the_same_bits():
    assert fitted(Work(n_jobs=2)) == serial()


def test_small_batches_give_the_same_bits(monkeypatch, tmp_path):
    monkeypatch.setattr(work_module, "UNITS_AHEAD", 1)
    assert fitted(Work(Cache(tmp_path), n_jobs=2)) == serial()
    assert fitted(Work(Cache(tmp_path))) == serial()
    assert len(Cache(tmp_path).entries()) == 2 * N_RUNS


def test_a_process_that_dies_costs_nothing_but_time(tmp_path):
    deadly = Deadly(3, 5.0, folder=tmp_path, home=os.getpid())
    assert fitted(Work(n_jobs=2), sources(deadly)) == serial()
    assert len(list(tmp_path.iterdir())) == 1


def test_processes_that_keep_dying_are_one_sentence(tmp_path, monkeypatch):
    monkeypatch.setattr(work_module, "MOST_DEATHS", 1)
    deadly = Deadly(3, 5.0, folder=tmp_path, deaths=100, home=os.getpid())
    with pytest.raises(ChildProcessError, match=r"a process that worked on made_0 or one of the 5 runs after it died"):
        fitted(Work(n_jobs=2), sources(deadly))
    assert len(list(tmp_path.iterdir())) >= 1 + work_module.MOST_DEATHS


def test_a_run_that_cannot_be_read_elsewhere_is_the_same_sentence():
    with pytest.raises(DataError, match="made_3: is no run") as caught:
        fitted(Work(n_jobs=2), sources(Broken(3, 5.0)))
    assert caught.value.file == "made_3"


def test_every_process_has_one_thread_of_rust(monkeypatch):
    monkeypatch.delenv(RUST_THREADS, raising=False)
    elsewhere = [plain for plain, _ in Work(n_jobs=2).map(threads, sources())]
    assert {plain["threads"] for plain in elsewhere} == {"1"}
    assert os.getpid() not in {plain["process"] for plain in elsewhere}
    here = [plain for plain, _ in Work().map(threads, sources())]
    assert {(plain["threads"], plain["process"]) for plain in here} == {(None, os.getpid())}


def test_jobs_of_the_command(tmp_path):
    robot, paths = write_robot(tmp_path), write_runs(tmp_path)
    arguments = ("identify", robot, *paths, "--residual", "none", "--memory", "10MB")
    for jobs in ("1", "2"):
        assert dynid(*arguments, "-o", tmp_path / jobs, "--jobs", jobs).exit_code in (0, 1)
    assert snapshot(tmp_path / "1") == snapshot(tmp_path / "2")
    for jobs in ("0", "-2"):
        sentence = refusal(dynid(*arguments, "-o", tmp_path / "out", f"--jobs={jobs}"))
        assert f"--jobs must be at least 1, or -1 for one per core, found {jobs}" in sentence
    with pytest.raises(ValueError, match="n_jobs must be at least 1"):
        Work(n_jobs=0)


@pytest.fixture(scope="module")
def cluster():
    """Two worker processes of Dask, with a nanny each that replaces them."""
    import distributed  # an extra of the tests, slow to import

    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as here,
        distributed.Client(here) as client,
    ):
        yield client


@pytest.mark.filterwarnings("ignore")
def test_a_dask_cluster_gives_the_same_bits(cluster):
    with joblib.parallel_config(backend="dask"):
        assert fitted(Work(n_jobs=None)) == serial()
        processes = {plain["process"] for plain, _ in Work(n_jobs=None).map(threads, sources())}
    assert processes <= set(cluster.run(os.getpid).values())


@pytest.mark.filterwarnings("ignore")
def test_a_dask_worker_that_is_killed_midway_costs_nothing_but_time(cluster, tmp_path):
    before = set(cluster.run(os.getpid).values())
    deadly = Deadly(3, 5.0, folder=tmp_path, home=os.getpid())
    with joblib.parallel_config(backend="dask"):
        assert fitted(Work(n_jobs=None), sources(deadly)) == serial()
    assert len(list(tmp_path.iterdir())) == 1
    cluster.wait_for_workers(2, timeout=240)
    assert len(before - set(cluster.run(os.getpid).values())) == 1


@pytest.mark.filterwarnings("ignore")
def test_dask_workers_that_keep_dying_are_one_sentence(cluster, tmp_path, monkeypatch):
    """Dask says nothing of a run that killed four workers; how many it kills before the wait ends, the machine says."""
    monkeypatch.setattr(work_module, "LONGEST_UNIT", 20.0)
    deadly = Deadly(3, 5.0, folder=tmp_path, deaths=100, home=os.getpid())
    with (
        joblib.parallel_config(backend="dask"),
        pytest.raises(ChildProcessError, match=r"died again and again or gave"),
    ):
        fitted(Work(n_jobs=None), sources(deadly))
    assert cluster.status == "running"
