"""A few trials of each campaign of docs/measured/trust.md; thousands are run by hand."""

import importlib.util
import json
import shutil
from dataclasses import replace

import pytest
from bad_data.clean import Clean
from bad_data.judge import Mark, Said
from bad_data.page import recordings, table
from bad_data.run import Result, Told
from campaigns import drawn, faults, kills, mutants, page, reach, rust_mutants
from helpers.data import ROOT

needs_strace = pytest.mark.skipif(shutil.which("strace") is None, reason="strace is not here (apt install strace)")


def test_a_few_kills_lose_nothing():
    figures = kills.campaign(("identify", "simulate"), 4, seed=1)
    assert figures["found"] == []
    assert figures["killed"] > 0


@needs_strace
def test_a_few_faults_of_the_system_lose_nothing():
    figures = faults.campaign(("estimate",), 6, seed=1)
    assert figures["found"] == []
    assert figures["injected"] == 6


def test_the_figures_of_bad_data_are_those_of_its_table():
    marks = (Mark(True, True), Mark(True, False, ["said of another place"]), Mark(False, False, ["not found"]))
    told = [Told("wrap", 0, variant, "inspect", "at 1 rad", mark) for variant, mark in enumerate(marks)]
    alarms = [Said("error", code, file, "tau_0", None, None, "", "") for code, file in (("stuck", "a"), ("gap", "a"))]
    clean = [Clean(1, "clean", 3, alarms), Clean(2, "clean", 5, [])]
    effects = [Clean(3, "single", 2, alarms), Clean(4, "mixture", 1, [])]
    alike = [Told("wrap", 0, variant, "diagnose", "at 1 rad", mark) for variant, mark in enumerate(marks[1:])]
    figures = page.CAMPAIGNS["bad_data"].read(table(Result(7, told, alike, clean, effects)))
    wanted = {"drawn": 3, "found": 2, "named": 1, "clean": 8, "alarmed": 1, "cases": 2, "stopped": 1}
    wanted["others"] = {"diagnose": {"drawn": 2, "found": 1, "named": 0}}
    assert figures == wanted


def test_an_alarm_without_a_file_is_of_all_recordings_and_a_breakdown_too():
    everywhere = Said("error", "mounting", "", "", None, None, "", "")
    parts = [Said("warning", "contact", f"run_0.parquet (part {k})", "tau_0", None, None, "", "") for k in (1, 2)]
    broken = Clean(3, "single", 2, [], "KeyError: 'rows'")
    assert recordings([Clean(1, "clean", 4, [everywhere])]) == (4, 4)
    assert recordings([Clean(1, "clean", 2, parts)]) == (2, 1)
    assert recordings([Clean(1, "clean", 4, []), broken]) == (6, 2)
    assert "stopped by an error: 1." in table(Result(7, [], [], [], [broken, Clean(4, "single", 1, [])]))


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("hostile", "1 failed, 47 passed in 3.21s"),
        ("determinism", "1 failed, 8 passed in 3.21s"),
        ("fuzz", "urdf             1,000 executions in 3.0 s, 900 edges, 40 MB"),
        ("readers", "table            1,000 executions in 3.0 s, 900 edges, 40 MB"),
        ("online", "1000 streams: 3.21s"),
    ],
)
def test_a_campaign_that_failed_is_not_told_as_one_that_found_nothing(name, said):
    """Its figures alone would say `all 47`, `no crash`, `none failed`."""
    ends = {code: replace(page.CAMPAIGNS[name], command=f"echo '{said}'; exit {code}") for code in (0, 1)}
    assert page.run(ends[0], quick=False)["figures"] == page.CAMPAIGNS[name].read(said)
    with pytest.raises(SystemExit, match="ended with 1:"):
        page.run(ends[1], quick=False)


def test_a_campaign_whose_figures_hold_what_was_found_has_them_after_a_failure():
    said = json.dumps({"functions": 3, "calls": 10, "found": {"f": ["x: the process died"]}})
    failing = replace(page.CAMPAIGNS["boundary"], command=f"echo '{said}'; exit 1")
    assert "**1 found" in failing.say(page.run(failing, quick=False)["figures"])


def test_the_page_is_what_its_figures_say():
    """Nobody edits a figure by hand; what is written by hand stands below."""
    text = page.PAGE.read_text(encoding="utf-8")
    kept = json.loads(page.FIGURES.read_text())
    assert text == page.page(kept, text[text.index(page.BY_HAND) :])


def test_the_tests_nearest_to_a_module_are_those_of_its_own_folder_that_import_it():
    first, *others = reach.nearest("regression/error_interval.py")
    assert first == ROOT / "tests" / "regression" / "test_error_interval.py"
    # By way of the command line, and of what the package's face hands on.
    assert {
        ROOT / "tests" / "commands" / "test_identify.py",
        ROOT / "tests" / "identification" / "test_identification.py",
    } <= set(others)
    assert not {path.parent.name for path in others} & {"house", "campaigns"}


def test_a_change_is_tried_by_the_tests_of_its_statement():
    """Of a statement with a body its head alone; of one over several lines all of them."""
    lines = [
        "def f(x):",
        "    if (",
        "        x > 1",
        "    ):",
        "        return g(",
        "            x,",
        "        )",
        "    return 0",
    ]
    source = "\n".join(lines)
    assert [drawn._statement(source, line) for line in (1, 3, 6, 8)] == [[1, 1], [2, 4], [5, 7], [8, 8]]


def test_annotations_and_sentences_are_not_changed():
    source = "def f(x: int | None = 1) -> int | None:\n    y: int | None = x + 1\n    raise ValueError(f'{x + 1}')\n"
    spans = drawn._undecided(source)
    assert [text for first, last in spans if (text := _between(source, first, last)) == "int | None"] == [
        "int | None"
    ] * 3
    assert any("ValueError" not in _between(source, *span) and "x + 1" in _between(source, *span) for span in spans)


def _between(source, first, last):
    assert first[0] == last[0]
    return source.splitlines()[first[0] - 1][first[1] : last[1]]


def test_what_lived_is_named_and_what_does_not_end_is_killed():
    changes = [
        {"name": "a", "part": "runs", "result": "killed"},
        {"name": "b", "part": "runs", "result": "survived"},
        {"name": "c", "part": "diagnosis", "result": "timeout"},
    ]
    figures = mutants.summed(changes, 1000)
    assert (figures["drawn"], figures["killed"], figures["timeouts"], figures["survived"]) == (3, 2, 1, ["b"])
    assert mutants.said({"seed": 1, "python": figures}) == (
        "Python 2 of 3 killed (67 %), drawn from 1,000: diagnosis 1 of 1, runs 1 of 2"
    )


def test_a_change_to_rust_is_found_again_where_its_line_has_moved():
    names = [f"a.rs:{line}:{column}: replace {a} with {b} in f" for line, column, a, b in SLIPS]
    assert [rust_mutants.located(name, names) for name in names] == [0, 1, 2, 3]
    moved = [f"a.rs:{line + 2}:{column}: replace {a} with {b} in f" for line, column, a, b in SLIPS]
    assert [rust_mutants.located(name, moved) for name in names] == [0, 1, 2, 3]
    assert rust_mutants.located("a.rs:3:9: replace / with * in f", names) is None


SLIPS = ((3, 9, "+", "-"), (3, 20, "+", "-"), (8, 9, "+", "-"), (3, 9, "+", "*"))


def test_the_fuzzer_goes_on_where_the_last_call_ended(tmp_path, monkeypatch):
    spec = importlib.util.spec_from_file_location("fuzz_run", ROOT / "fuzz" / "run.py")
    fuzzer = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(fuzzer)
    asked, short, failing = [], [], []

    def fuzz(program, target, limits, work):
        asked.append(int(limits[0].removeprefix("-runs=")))
        short.append("-max_len=512" in limits)
        return {"target": target, "executions": asked[-1], "seconds": 1.0, "peak_rss_mb": 30, "failed": bool(failing)}

    monkeypatch.setattr(fuzzer, "fuzz", fuzz)
    monkeypatch.setattr(fuzzer, "SLICE", 10)
    program, other = (tmp_path / "program",), (tmp_path / "other",)
    program[0].write_bytes(b"one")
    other[0].write_bytes(b"other")
    assert fuzzer.fuzz_often(program, "lines", 25, tmp_path)["executions"] == 25
    assert asked == [10, 10, 5]
    assert fuzzer.fuzz_often(program, "lines", 25, tmp_path)["executions"] == 25
    assert fuzzer.fuzz_often(program, "model", 5, tmp_path)["executions"] == 5
    assert asked == [10, 10, 5, 5]
    failing.append("lines")  # what failed is not noted: the next call tries again
    assert fuzzer.fuzz_often(program, "lines", 30, tmp_path)["failed"]
    failing.clear()
    assert fuzzer.fuzz_often(program, "lines", 30, tmp_path)["seconds"] == 4.0
    assert fuzzer.fuzz_often(other, "lines", 10, tmp_path)["seconds"] == 1.0
    short.clear()
    fuzzer.fuzz_often(other, "lines", 60, tmp_path)
    assert short == [True, True, False, True, True]  # every fourth time inputs may be long
