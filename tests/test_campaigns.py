"""A few trials of each campaign of docs/trust.md; thousands are run by hand."""

import json
import shutil

import pytest
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


def test_the_page_is_what_its_figures_say():
    """Nobody edits a figure by hand; what is written by hand stands below."""
    text = page.PAGE.read_text(encoding="utf-8")
    kept = json.loads(page.FIGURES.read_text())
    assert text == page.page(kept, text[text.index(page.BY_HAND) :])
