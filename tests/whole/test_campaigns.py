"""A few trials of each campaign of docs/measured/trust.md; thousands are run by hand."""

import json
import shutil

import pytest
from bad_data.clean import Clean
from bad_data.judge import Mark, Said
from bad_data.page import table
from bad_data.run import Result, Told
from campaigns import faults, kills, page

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
    figures = page.CAMPAIGNS["bad_data"].read(table(Result(7, told, [], clean, effects)))
    wanted = {"drawn": 3, "found": 2, "named": 1, "clean": 8, "alarmed": 1, "cases": 2, "stopped": 1}
    assert figures == wanted


def test_the_page_is_what_its_figures_say():
    """Nobody edits a figure by hand; what is written by hand stands below."""
    text = page.PAGE.read_text(encoding="utf-8")
    kept = json.loads(page.FIGURES.read_text())
    assert text == page.page(kept, text[text.index(page.BY_HAND) :])
