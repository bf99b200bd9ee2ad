"""What both passes over an archive are made of, against the plain way of doing it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.made_runs import MadeRun, arm
from helpers.run_files import write
from numpy.testing import assert_allclose, assert_array_equal

from dynid_rs import _core
from dynid_rs.archive import RunFile
from dynid_rs.archive.runs import signals_of
from dynid_rs.archive.sample import PIECE, content_key, pieces_of, run_key
from dynid_rs.runs.checks import check_recording, contradicting_signals, refused_sources
from dynid_rs.runs.checks.motion import equal_runs, extent
from dynid_rs.runs.preprocessing import Band
from dynid_rs.runs.readers import Config


@pytest.mark.parametrize("shape", [(500,), (500, 1), (500, 6), (500, 3, 5)])
@pytest.mark.parametrize("cutoff", [5.0, 40.0])
def test_the_band_is_scipys(shape, cutoff):
    from scipy.signal import sosfiltfilt

    x = np.random.default_rng(0).standard_normal(shape).cumsum(axis=0)
    sections, _, padding = Band(cutoff).design(200.0)
    wanted = sosfiltfilt(sections, x, axis=0, padlen=min(padding, len(x) - 1))
    # It starts from the same settled state, found in another order of the sums.
    assert_allclose(Band(cutoff).apply(x, 200.0), wanted, rtol=0, atol=1e-12 * np.abs(x).max())


def test_a_run_shorter_than_the_padding_is_filtered_and_what_is_not_finite_stays_so():
    x = np.random.default_rng(1).standard_normal((30, 2))
    x[7, 1] = np.nan
    filtered = Band(5.0).apply(x, 200.0)
    assert np.isfinite(filtered[:, 0]).all()
    assert np.isnan(filtered[:, 1]).any()


def test_extents_are_those_of_numpy():
    recording = MadeRun(3, 2.0).recording()
    q = np.round(recording.q, 3)
    q[400:450, 2] = q[400, 2]
    recording = replace(recording, q=q)
    found = extent(recording, "q")
    assert_array_equal(found.lowest, q.min(axis=0))
    assert_array_equal(found.highest, q.max(axis=0))
    assert_array_equal(found.largest_step, np.abs(np.diff(q, axis=0)).max(axis=0))
    for j, longest in enumerate(found.longest_equal):
        assert longest == max((stop - start for start, stop in equal_runs(q[:, j], 2)), default=1)
    assert found.longest_equal[2] >= 50


@pytest.mark.parametrize("flipped", [False, True])
def test_a_second_reading_is_the_first_without_its_findings(tmp_path, flipped):
    recording = MadeRun(4, 10.0).recording()
    dq = np.gradient(recording.q, recording.t, axis=0)
    run = replace(recording, dq=-dq if flipped else dq)
    assert contradicting_signals(run) == refused_sources(check_recording(run)) == (("dq",) if flipped else ())
    signals = {name: getattr(run, name) for name in ("q", "dq", "tau", "q_motor")}
    columns = {f"{name}_{j}": x[:, j] for name, x in signals.items() for j in range(run.n_joints)}
    source = RunFile(write(tmp_path / "run.npz", {"t": run.t} | columns), "run.npz", arm(), Config())
    first, again = source.read()[0], source.signals()
    assert (first.dq is None) == (again.dq is None) == flipped
    for signal in ("t", "q", "tau", "q_motor"):
        assert_array_equal(getattr(again, signal), getattr(first, signal))


def test_a_run_and_its_pieces_are_hashed_alike():
    recording = MadeRun(5, 2.5 * PIECE).recording()
    pieces = pieces_of(recording)
    assert len(pieces) == 2
    assert content_key(recording) == run_key([piece.key for piece in pieces])
    other = replace(recording, tau=recording.tau + np.eye(*recording.tau.shape))
    assert content_key(other) != content_key(recording)
    alone = recording.slice(pieces[1].start, pieces[1].stop)
    assert content_key(alone) == pieces[1].key


def test_a_factor_is_that_of_the_same_columns_one_by_one():
    rows = np.random.default_rng(6).standard_normal((700, 23))
    rows[:, 9] = 0.0
    factor = _core.triangular_factor(rows)
    for width in range(1, 24):
        assert_array_equal(_core.triangular_factor(np.ascontiguousarray(rows[:, :width])), factor[:width, :width])


def test_a_source_that_only_reads_is_read_again():
    class Plain:
        def __init__(self, run):
            self.name, self.read, self.content = run.name, run.read, run.content

    run = MadeRun(6, 4.0)
    with pytest.raises(AttributeError):
        Plain(run).signals()
    assert_array_equal(signals_of(Plain(run)).tau, signals_of(run).tau)
