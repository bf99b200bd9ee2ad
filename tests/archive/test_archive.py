"""Runs that are streamed: what is exact is exact, what is a sample is one sample, and memory stays flat."""

from __future__ import annotations

import functools
import json
import os
import subprocess
import sys
from dataclasses import dataclass, replace

import numpy as np
import pytest
from helpers.made_runs import MadeRun, arm
from helpers.run_files import write
from helpers.small_arm import as_current, dynid, refusal, run, snapshot, study, write_robot, write_runs
from helpers.tolerances import ALGEBRAIC
from numpy.testing import assert_allclose, assert_array_equal

from dynid_rs import DataError, LinkDynamicsIdentifier, RobotModel, ThreeLoopIdentifier, _core
from dynid_rs.archive import Archive, RunFile
from dynid_rs.archive.fingerprint import fingerprint
from dynid_rs.archive.overlaps import marks_of, suspects
from dynid_rs.archive.sample import Piece, choose_pieces, cut_out, pieces_of, work_space
from dynid_rs.archive.survey import Survey, gathered_findings, survey_run
from dynid_rs.archive.wide import FactorTree, cut_at_joints, wide_factor
from dynid_rs.base.findings import Finding
from dynid_rs.commands._inputs import size_in_bytes
from dynid_rs.identification.results import evaluate_runs, score
from dynid_rs.model.placed import PlacedEffect
from dynid_rs.regression.evaluation import band_rmse
from dynid_rs.runs.readers import Config
from dynid_rs.runs.recording import Recording

PLENTY = 10**9


@dataclass(frozen=True)
class Held:
    """A recording that is there already."""

    recording: Recording

    @property
    def name(self) -> str:
        return self.recording.name

    def read(self):
        return self.recording, []

    def signals(self):
        return self.recording

    def content(self) -> str:
        return fingerprint(self.recording)


NEARLY = {"rtol": 1e-3, "atol": 1e-3}
"""Torques [N m] of two fits under the weak prior whose noise's search began at different places: it ends within 1 %."""


@functools.cache
def small_runs(encoders):
    case = study(encoders)
    robot = RobotModel.from_urdf(case.robot)
    return robot, [RunFile(path, path.name, robot, Config()) for path in case.runs]


def both_ways(encoders, memory=PLENTY, **options):
    """The same runs through an archive whose sample holds all of them, and in memory."""
    robot, sources = small_runs(encoders)
    archive = Archive(robot, sources, memory=memory)
    archive.check()
    sample = archive.sample()
    learned = archive.fit(ThreeLoopIdentifier(robot, **options), sample, None)
    return learned, ThreeLoopIdentifier(robot, **options).fit([source.read()[0] for source in sources])


@pytest.mark.parametrize("prior", ["auto", None])
@pytest.mark.parametrize("weighting", ["joint_variance", "full_covariance"])
def test_with_everything_in_the_sample_nothing_is_lost(weighting, prior):
    """Factors, covariance between joints, models, domain, standard errors, training error: all as in memory."""
    links = LinkDynamicsIdentifier(weighting, prior=prior)
    learned, held = both_ways(1, links=links)
    streamed = learned.identifier
    assert len(learned.sample) == 3
    assert streamed.observations_.n_rows == held.observations_.n_rows
    covariance = held.parameter_covariance()
    std, size = np.sqrt(np.diag(covariance)), np.abs(held.links_.x_).max()
    if prior is None:
        assert_allclose(streamed.links_.x_, held.links_.x_, rtol=1e-9, atol=1e-11 * size)
        assert_allclose(streamed.links_.covariance_, held.links_.covariance_, rtol=1e-8)
        assert_allclose(streamed.parameter_covariance(), covariance, rtol=1e-6, atol=1e-14)
    else:
        # The noise's search ends at a change of 1 %, and goes on where the sample's ended.
        assert streamed.links_.posterior_.choice == held.links_.posterior_.choice
        assert_allclose(streamed.links_.worth_, held.links_.worth_, rtol=1e-12)
        assert np.all(np.abs(streamed.links_.x_ - held.links_.x_) <= 0.01 * std + 1e-9 * size)
        assert_allclose(streamed.links_.covariance_, held.links_.covariance_, rtol=1e-3, atol=1e-6)
        assert_allclose(np.sqrt(np.diag(streamed.parameter_covariance())), std, rtol=1e-2)
    motion = held.raw_runs_[0]
    for name in ("baseline_", "friction_model_", "two_loop_model_", "model_"):
        one, other = getattr(streamed, name), getattr(held, name)
        near = ALGEBRAIC if prior is None or name in ("baseline_", "friction_model_") else NEARLY
        assert_allclose(one.evaluate(*motion.signals())[0], other.evaluate(*motion.signals())[0], **near)
        assert one.domain == other.domain
    recordings = [source.read()[0] for source in small_runs(1)[1]]
    runs = evaluate_runs(held.model_, recordings, held.raw_runs_)
    rmse = band_rmse([run.comparison for run in runs])
    assert_allclose(learned.rmse, rmse, rtol=1e-7 if prior is None else 1e-4)


def test_with_a_third_loop_all_stages_but_the_last_are_as_in_memory():
    """The last fit of the links stands beside the last mixtures; in memory it is half a round older."""
    learned, held = both_ways(2)
    streamed = learned.identifier
    assert held.residual_.kept.any()
    motion = held.raw_runs_[0]
    for name in ("baseline_", "friction_model_", "two_loop_model_"):
        one, other = getattr(streamed, name), getattr(held, name)
        near = NEARLY if name == "two_loop_model_" else ALGEBRAIC
        assert_allclose(one.evaluate(*motion.signals())[0], other.evaluate(*motion.signals())[0], **near)
    assert streamed.model_.residual is not None
    assert_allclose(score(streamed.model_, held.raw_runs_).rmse, score(held.model_, held.raw_runs_).rmse, rtol=1e-2)


def held_runs(change=lambda columns: columns):
    """The small arm's runs with changed columns."""
    names = ("q", "tau")
    for k in range(3):
        columns = change(run(k))
        unit = "A" if "current_0" in columns else "N*m"
        q, tau = (
            np.stack([columns[f"{'current' if unit == 'A' and name == 'tau' else name}_{j}"] for j in range(3)], axis=1)
            for name in names
        )
        yield Held(Recording(columns["t"], q, tau=tau, name=f"run_{k}", torque_unit=unit))


COUNTERBALANCE = _core.Effect.of("counterbalance", a=[0.5] * 3, b=[0.12] * 3, phase=[0.7] * 3, gas_length=[0.4] * 3)
OPTIONS = {
    "currents": ({}, as_current),
    "known term": ({"known": [(COUNTERBALANCE, np.array([[0.0], [60.0], [0.0]]))]}, lambda columns: columns),
    "free gain": ({"free_gains": (2,)}, lambda columns: columns),
    "stribeck": ({"friction_law": "stribeck"}, lambda columns: columns),
    "windows": ({"excluded": {"run_1": [(2.0, 3.5)]}}, lambda columns: columns),
    "standstill": ({"standstill": True}, lambda columns: columns),
    "load": (
        {"effects": (PlacedEffect.at("load_dependent_friction", 1, transition_width=0.01),)},
        lambda columns: columns,
    ),
    "motor's torque": ({"effects": (PlacedEffect.at("torque_saturation", 1),)}, lambda columns: columns),
}
OF_LOAD = ("load", "motor's torque")


@pytest.mark.parametrize("name", OPTIONS)
def test_what_stands_beside_the_declared_model_is_streamed_too(name):
    options, change = OPTIONS[name]
    robot, _ = small_runs(1)
    sources = list(held_runs(change))
    archive = Archive(robot, sources, memory=PLENTY)
    learned = archive.fit(ThreeLoopIdentifier(robot, residual=None, **options), archive.sample(), None)
    held = ThreeLoopIdentifier(robot, residual=None, **options).fit([source.recording for source in sources])
    size = np.abs(held.links_.x_).max()
    std = np.sqrt(np.diag(held.parameter_covariance()))
    # Load, noise and drive gains settle to a small part of the parameters' errors, from where the sample's ended.
    slow = 1e-3 * np.abs(held.links_.x_) + 1e-4 * size if name in OF_LOAD else 1e-9 * size
    difference = np.abs(learned.identifier.links_.x_ - held.links_.x_)
    assert np.all(difference <= 0.02 * std + slow)
    assert_allclose(learned.identifier.links_.torque_scale_, held.links_.torque_scale_, rtol=1e-3)
    assert_allclose(np.sqrt(np.diag(learned.identifier.parameter_covariance())), std, rtol=1e-2, atol=1e-9)


def test_linear_coefficients_come_from_all_runs():
    """A sample of a few runs, coefficients from all: standard errors shrink, and so does the error on unseen ones."""
    sources = [MadeRun(seed, 20.0) for seed in range(12)]
    limit = 7 * work_space(sources[0].recording())
    archive = Archive(arm(), sources, memory=limit)
    sample = archive.sample()
    assert 1 < len(sample) <= 3
    learned = archive.fit(ThreeLoopIdentifier(arm(), residual=None), sample, None)
    few = learned.identifier.in_memory_
    n = few.observations.n_rows
    assert learned.identifier.observations_.n_rows > 3 * n
    std = np.sqrt(np.diag(learned.identifier.parameter_covariance()))
    by_sample = ThreeLoopIdentifier(arm(), residual=None).fit(sample)
    alone = np.sqrt(np.diag(by_sample.parameter_covariance()))
    known = (std > 0) & (alone > 0)
    shrunk = np.median(std[known] / alone[known])
    assert 0.6 * np.sqrt(len(sample) / 12) < shrunk < 1.2 * np.sqrt(len(sample) / 12)
    unseen = [learned.identifier.states(MadeRun(seed, 20.0).recording()) for seed in (97, 98, 99)]
    ratio = score(learned.identifier.model_, unseen).rmse / score(by_sample.model_, unseen).rmse
    assert np.mean(np.log(ratio)) < 0


def test_a_tree_merges_as_the_whole_list_does():
    rng = np.random.default_rng(0)
    factors = [_core.triangular_factor(rng.normal(size=(9, 5))) for _ in range(13)]
    for n in range(1, 14):
        tree = FactorTree()
        for factor in factors[:n]:
            tree.add(factor)
        assert_array_equal(tree.total(), _core.merge_factors(factors[:n]))


def test_a_wide_factor_keeps_every_product():
    rng = np.random.default_rng(0)
    joints = [rng.normal(size=(50, width)) for width in (4, 3, 2)]
    again = cut_at_joints(wide_factor(joints), [4, 3, 2])
    for a, x in zip(joints, again, strict=True):
        for b, y in zip(joints, again, strict=True):
            assert_allclose(x.T @ y, a.T @ b, **ALGEBRAIC)


def test_surveys_come_back_from_what_is_kept():
    survey = Survey.from_entry(survey_run(MadeRun(0, 45.0)))
    plain, arrays = survey.to_entry()
    again = Survey.from_entry((json.loads(json.dumps(plain)), arrays))
    assert fingerprint(again) == fingerprint(survey)
    assert [(piece.start, piece.stop) for piece in again.pieces] == [(0, 22500), (22500, 45000)]


def pieces(n=40):
    rng = np.random.default_rng(1)
    return [Piece(0, 1, fingerprint(k), np.unique(rng.integers(0, 30, 6)).astype(np.uint16), 10) for k in range(n)]


def test_the_sample_knows_no_order():
    all_pieces = pieces()
    chosen = {all_pieces[k].key for k in choose_pieces(all_pieces, 120)}
    for seed in range(5):
        order = np.random.default_rng(seed).permutation(len(all_pieces))
        mixed = [all_pieces[k] for k in order]
        assert {mixed[k].key for k in choose_pieces(mixed, 120)} == chosen


def test_the_sample_is_bounded_and_reaches_rare_states():
    rare = Piece(0, 1, "f" * 64, np.array([99], dtype=np.uint16), 10)
    mixed = [*pieces(), rare]
    for n_bytes in (20, 50, 120, 10**6):
        chosen = choose_pieces(mixed, n_bytes)
        assert sum(mixed[k].n_bytes for k in chosen) <= n_bytes
        assert len(mixed) - 1 in chosen
    assert len(choose_pieces(mixed, 10**6)) == len(mixed)
    assert len(choose_pieces(mixed, 1)) == 1


def test_pieces_of_a_run_cover_it():
    recording = MadeRun(3, 70.0).recording()
    parts = pieces_of(recording)
    assert [part.start for part in parts[1:]] == [part.stop for part in parts[:-1]]
    assert (parts[0].start, parts[-1].stop) == (0, recording.n_samples)
    assert len({part.key for part in parts}) == 3
    alone = cut_out(recording, parts[1])
    assert_array_equal(alone.q, recording.q[parts[1].start : parts[1].stop])
    assert not any(np.shares_memory(alone.q, x) for x in (recording.q, recording.tau))
    assert len(pieces_of(recording.slice(0, 300))) == 1


def test_fingerprints_tell_contents_apart():
    values = [1, 1.0, True, "1", b"1", None, [1], [[1]], (1, 1), {"a": 1}, {"b": 1}, np.ones(1), np.ones((1, 1)), arm()]
    prints = [fingerprint(value) for value in values]
    assert len(set(prints)) == len(values)
    assert prints == [fingerprint(value) for value in values]
    with pytest.raises(TypeError, match="object has no fingerprint"):
        fingerprint(object())


def test_findings_are_counted_where_there_are_many():
    many = [Finding("gap", "warning", f"gap {k}") for k in range(8)] + [Finding("gap", "error", "bad")]
    gathered = gathered_findings(many)
    assert [finding.message for finding in gathered] == [
        *(f"gap {k}" for k in range(5)),
        "3 more findings of this kind, the last: gap 7",
        "bad",
    ]


# The command.


def streamed(folder, *arguments, memory="10MB", encoders=2, n_runs=3):
    """Identify with hardly any memory: the printed answer and result.json."""
    robot = write_robot(folder)
    paths = write_runs(folder, encoders=encoders, n_runs=n_runs)
    out = folder / "out"
    printed = dynid("identify", robot, *paths, "-o", out, "--memory", memory, "--residual", "none", *arguments)
    path = out / "result.json"
    return printed, json.loads(path.read_text()) if path.is_file() else None


def test_the_command_streams_what_does_not_fit(tmp_path):
    printed, result = streamed(tmp_path)
    assert printed.exit_code in (0, 1), printed.output
    (finding,) = [f for f in result["data"]["findings"] if f["code"] == "streamed"]
    assert "2 runs" in finding["message"]
    assert "linear coefficients" in finding["message"]
    assert result["data"]["train"] == ["run_0.parquet", "run_1.parquet"]
    assert result["data"]["n_samples"] == {"train": 3202, "test": 1601}
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [
        "model.json",
        "report.html",
        "residuals.parquet",
        "result.json",
    ]


def test_what_fits_is_not_streamed_whatever_the_limit(tmp_path):
    done = study(2)
    arguments = ("identify", done.robot, *done.runs[:2], "--test", done.runs[2], "--memory", "40GB")
    assert dynid(*arguments, "-o", tmp_path / "out").exit_code == 0
    assert snapshot(tmp_path / "out") == snapshot(done.output)
    assert not [f for f in done.result["data"]["findings"] if f["code"] == "streamed"]


def test_runs_of_different_rates_are_learned_from_together(tmp_path):
    robot = write_robot(tmp_path)
    paths = [
        write(tmp_path / f"run_{k}.parquet", run(k, rate=rate)) for k, rate in ((0, 200.0), (1, 250.0), (2, 200.0))
    ]
    printed = dynid("identify", robot, *paths, "-o", tmp_path / "out", "--memory", "10MB", "--residual", "none")
    assert printed.exit_code in (0, 1), printed.output
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert result["data"]["n_samples"]["train"] == 1601 + 2001
    assert "streamed" in {f["code"] for f in result["data"]["findings"]}


def test_a_torque_of_the_other_sign_is_named_by_the_sample(tmp_path):
    robot = write_robot(tmp_path)
    runs = [run(k) for k in range(3)]
    paths = [write(tmp_path / f"run_{k}.parquet", one | {"tau_1": -one["tau_1"]}) for k, one in enumerate(runs)]
    printed = dynid("identify", robot, *paths, "-o", tmp_path / "out", "--memory", "10MB", "--residual", "none")
    assert printed.exit_code == 1, printed.output
    found = json.loads((tmp_path / "out" / "result.json").read_text())["data"]["findings"]
    assert {"streamed", "torque_flipped"} <= {f["code"] for f in found}
    (flipped,) = [f for f in found if f["code"] == "torque_flipped"]
    assert "tau = [1, -1, 1]" in flipped["message"]
    assert flipped.get("rows") is None


def test_samples_that_are_there_twice_are_refused_as_in_memory(tmp_path):
    robot, paths = write_robot(tmp_path), write_runs(tmp_path, n_runs=3)
    piece = write(tmp_path / "piece.parquet", {name: x[300:1300] for name, x in run(1).items()})
    copy = write(tmp_path / "copy.parquet", run(2))
    for twice in (["--test", piece], ["--test", paths[2], "--test", copy], [piece, "--test", paths[2]]):
        arguments = ("identify", robot, paths[0], paths[1], *twice, "-o", tmp_path / "out")
        in_memory, streamed = (refusal(dynid(*arguments, "--memory", memory)) for memory in ("4GB", "10MB"))
        assert streamed == in_memory
        assert "given twice" in streamed or "both learned from and tested on" in streamed
        assert not (tmp_path / "out").exists()


def test_runs_that_share_a_few_rows_are_suspects_and_no_others():
    one, two, three = (held.recording for held in held_runs())
    assert suspects([marks_of(each) for each in (one, two, three)]) == []
    piece = one.slice(200, 1200)
    assert suspects([marks_of(each) for each in (two, piece, three, one)]) == [(1, 3)]
    still = replace(one, q=np.zeros_like(one.q))
    assert len(marks_of(still)) == 0
    assert suspects([marks_of(still), marks_of(still)]) == []


def test_rows_of_one_coarse_joint_are_alike_and_pieces_of_it_are_found():
    """Encoder of 4096 steps, torque in steps of 0.05 N m: most pairs of runs were read again, and copies missed."""

    def run(seed):
        random, t = np.random.default_rng(seed), np.arange(20_000) * 0.001
        phase = random.uniform(0, 2 * np.pi, 3)
        q = np.sin(2 * np.pi * np.outer(t, [0.2, 0.5, 1.1]) + phase) @ [0.5, 0.3, 0.1]
        tau = 10 * np.sin(q) + random.normal(0, 0.1, len(t))
        step = 2 * np.pi / 4096
        coarse = [np.round(x[:, None] / unit) * unit for x, unit in ((q, step), (tau, 0.05))]
        return Recording(t=t, q=coarse[0], tau=coarse[1], name=str(seed))

    runs = [run(seed) for seed in range(12)]
    marks = [marks_of(each) for each in runs]
    assert suspects(marks) == []
    for k, start in ((0, 0), (3, 5000), (7, 12_000), (11, 19_000)):
        assert suspects([*marks, marks_of(runs[k].slice(start, start + 1000))]) == [(k, 12)]


def with_a_part_at_rest(columns):
    """The same run, and after a gap a second in which it hardly begins to move."""
    more = {name: values[-200:].copy() for name, values in columns.items()}
    noise = np.random.default_rng(0)
    for name, values in more.items():
        if name != "t":
            values[30:] = values[30] + noise.normal(0.0, 1e-6 if name.startswith("q") else 1e-2, 170)
    more["t"] += 10.0
    return {name: np.concatenate([values, more[name]]) for name, values in columns.items()}


@pytest.mark.parametrize("place", [1, 2], ids=["learned from", "tested on"])
def test_a_part_with_too_little_motion_is_left_out_as_in_memory(tmp_path, place):
    robot, paths = write_robot(tmp_path), write_runs(tmp_path, n_runs=3)
    write(paths[place], with_a_part_at_rest(run(place)))
    arguments = ("identify", robot, *paths[:2], "--test", paths[2], "--residual", "none")
    said = {}
    for memory in ("4GB", "10MB"):
        out = tmp_path / memory
        printed = dynid(*arguments, "-o", out, "--memory", memory)
        assert printed.exit_code in (0, 1), printed.output
        result = json.loads((out / "result.json").read_text())
        found = result["data"]["findings"]
        assert ("streamed" in {f["code"] for f in found}) == (memory == "10MB")
        left_out = [f["message"] for f in found if "this part is left out" in f["message"]]
        said[memory] = left_out, result["data"]["train"], result["data"]["test"], result["data"]["n_samples"]
    assert len(said["4GB"][0]) == 1
    assert f"run_{place}.parquet (part 2 of 2)" in said["4GB"][0][0]
    assert said["10MB"] == said["4GB"]


def test_an_unreadable_run_in_the_middle(tmp_path):
    paths = write_runs(tmp_path, n_runs=3)
    middle = tmp_path / "run_0b.parquet"
    middle.write_bytes(paths[0].read_bytes()[:5000])
    robot = write_robot(tmp_path)
    arguments = ("identify", robot, paths[0], paths[1], middle, paths[2], "-o", tmp_path / "out", "--memory", "10MB")
    sentence = refusal(dynid(*arguments))
    assert "run_0b.parquet" in sentence
    assert not (tmp_path / "out").exists()


def test_a_run_of_another_robot(tmp_path):
    paths = write_runs(tmp_path, n_runs=3)
    columns = {name: x for name, x in run(1).items() if not name.endswith("_2")}
    other = write(tmp_path / "other.parquet", columns)
    arguments = ("identify", write_robot(tmp_path), *paths[:2], other, paths[2], "-o", tmp_path / "out")
    sentence = refusal(dynid(*arguments, "--memory", "10MB"))
    assert "other.parquet" in sentence
    assert not (tmp_path / "out").exists()


def test_runs_of_another_kind():
    robot, sources = small_runs(2)
    one = small_runs(1)[1][1]
    archive = Archive(robot, [sources[0], one], memory=PLENTY)
    with pytest.raises(DataError, match="hold different signals"):
        archive.check()


def test_a_run_that_is_there_twice():
    robot, sources = small_runs(1)
    again = replace(sources[0], name="again")
    with pytest.raises(DataError, match=r"again \(run_0.parquet\) is given twice to learn from"):
        Archive(robot, [*sources, again], memory=PLENTY).check()
    archive = Archive(robot, sources, memory=PLENTY)
    with pytest.raises(DataError, match="is both learned from and tested on"):
        archive.check({archive.surveys[0].key: "run_0.parquet"})


def test_a_joint_that_never_moves_in_any_of_many_runs():
    robot, sources = small_runs(1)
    still = []
    for k in range(12):
        recording = sources[k % 3].read()[0]
        q = recording.q + 1e-9 * k
        q[:, 1] = 0.1
        still.append(Held(replace(recording, q=q, dq=None, name=f"still_{k}")))
    with pytest.raises(DataError, match=r"still_0, still_1, still_2 and 9 more runs: joint elbow never moves"):
        Archive(robot, still, memory=PLENTY).check()


def test_refusals_before_any_work(tmp_path):
    robot, (path, *_) = write_robot(tmp_path), write_runs(tmp_path)
    lone = dynid("identify", robot, path, "-o", tmp_path / "out", "--memory", "200kB")
    assert "this run alone needs more work space than --memory allows" in refusal(lone)
    for text in ("many", "0", "-4GB", "1e400", "4XB", "."):
        sentence = refusal(dynid("identify", robot, path, "-o", tmp_path / "out", f"--memory={text}"))
        assert "--memory must be a size such as 500MB or 4GB" in sentence
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("text", "size"), [("4GB", 4 * 10**9), ("500 mb", 5 * 10**8), ("2e9", 2 * 10**9), ("1.5k", 1500), ("7b", 7)]
)
def test_sizes(text, size):
    assert size_in_bytes("--memory", text) == size


def test_refusals_of_what_cannot_be_streamed(tmp_path):
    printed, _ = streamed(tmp_path, "--prior", "robot")
    assert "a prior is weighed against rows in time" in refusal(printed)
    printed, _ = streamed(tmp_path, memory="3MB")
    assert "the test runs need more work space" in refusal(printed)
    # The friction experiment: before any of the runs is read, which would take hours.
    slow = tmp_path / "run_2.parquet"
    printed, _ = streamed(tmp_path, "--friction", slow, memory="3MB")
    sentence = refusal(printed)
    assert "--friction: up to run_2.parquet these runs need more work space" in sentence
    assert "not streamed" in sentence
    printed, _ = streamed(tmp_path, "--test-from", "3")
    assert "--test-from cuts a lone run" in refusal(printed)
    assert not (tmp_path / "out").exists()
    robot, sources = small_runs(1)
    with pytest.raises(DataError, match="this run alone needs"):
        Archive(robot, sources, memory=100_000)


PEAK = """
import sys
from helpers.made_runs import MadeRun, arm
from helpers.processes import peak_bytes
from dynid_rs import ThreeLoopIdentifier
from dynid_rs.archive import Archive
archive = Archive(arm(), [MadeRun(seed, 30.0) for seed in range(int(sys.argv[1]))], memory=100_000_000)
archive.check()
learned = archive.fit(ThreeLoopIdentifier(arm(), residual=None), archive.sample(), None)
print(archive.n_samples, peak_bytes())
"""


def test_memory_is_flat_in_the_number_of_runs():
    peaks = {}
    for n_runs in (4, 16):
        paths = os.pathsep.join(path for path in sys.path if path)
        done = subprocess.run(
            [sys.executable, "-c", PEAK, str(n_runs)],
            env=os.environ | {"PYTHONPATH": paths},
            capture_output=True,
            text=True,
            timeout=240,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        n_samples, peaks[n_runs] = map(int, done.stdout.split())
        assert n_samples == n_runs * 30_000
    # Twelve more runs of 4.5 MB of signals each; in memory they would take some 250 MB.
    assert peaks[16] - peaks[4] < 12.5e6, peaks
