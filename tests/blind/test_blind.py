"""The quick selection of the blind suite: a few cases in every test run, all of them with DYNID_BLIND=quick."""

import os
from pathlib import Path

import pytest
from cases import RATIOS, all_cases
from suite import run_cases
from tally import tally

pytestmark = pytest.mark.timeout(1800)

QUICK = [case for case in all_cases().values() if case.quick]
EVERY = 5
"""Of the quick cases, so many apart are taken by a plain test run."""
STRONG = RATIOS[:2]

LEAST_RECALL = 0.9
"""Of single effects at 2 and 0.3 times the noise; the goal of the whole suite is 0.99."""
MOST_FALSE = 1
"""Cases with a name that is wrong."""
MOST_AFTER = 1.1
"""Median error over that of a model that was told the truth."""


@pytest.fixture(scope="module")
def figures(tmp_path_factory: pytest.TempPathFactory) -> dict:
    chosen = QUICK if os.environ.get("DYNID_BLIND") == "quick" else QUICK[::EVERY]
    kept = tmp_path_factory.mktemp("blind")
    return tally(run_cases(chosen, kept=Path(kept), jobs=min(2, os.cpu_count() or 1)))


def test_it_answers_every_case(figures):
    assert figures["errors"] == []
    assert figures["impossible"] == []


def test_it_finds_strong_effects(figures):
    rows = [row for row in figures["single"] if row["ratio"] in STRONG]
    recall = sum(row["recall"] * row["n"] for row in rows) / sum(row["n"] for row in rows)
    assert recall >= LEAST_RECALL, [miss for miss in figures["misses"] if miss["not_found"]]


def test_it_accuses_nobody_wrongly(figures):
    assert len([m for m in figures["misses"] if m["false"]]) <= MOST_FALSE, figures["misses"]
    clean = figures["groups"].get("clean")
    assert clean is None or clean["cases_with_false"] == 0


def test_it_ends_at_the_error_of_one_who_knows(figures):
    assert all(row["after_over_oracle"] <= MOST_AFTER for row in figures["single"] if row["ratio"] in STRONG)
