"""The page of a fleet in a real browser: it says what is in the tables, sorts and filters, and keeps nobody out."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import chromium

from dynid_rs.report.fleet import build_fleet_page, write_fleet_page

HOSTILE = "<img src=x onerror=alert(1)>\"&'_a_long_name_that_does_not_end_" + "x" * 60
SIZES = {"desk": (1280, 800), "phone": (390, 844)}
CAUSE = {
    "kind": "friction",
    "place": "elbow",
    "name": "friction",
    "change": 0.5,
    "size": 2.5,
    "std_error": 0.4,
    "unit": "N*m",
    "deviations": 9.0,
    "mean": 5.0,
    "spread": 0.4,
    "at": 0.8,
}


def made(n: int, odd: int, name: str = "arm", failed: int = 0) -> tuple[dict[str, Any], dict[str, Any]]:
    """Content of fleet.json and quantities.parquet of `n` arms of two types, the first `odd` of each hundred odd."""
    rng = np.random.default_rng(0)
    types = [f"{name} type", "other"]
    kinds = [("friction", "elbow", "N*m", 0.8), ("base", "fore", "kg*m", None), ("gain", "wrist", "1", None)]
    kinds.append(("error", "elbow", "1", None))
    rows, columns = [], {key: [] for key in ("type", "arm", "deviations")}
    for k in range(n):
        is_odd = k % 100 < odd
        rows.append(
            {
                "name": f"{name}_{k:04d}",
                "status": "done",
                "message": "good",
                "n_runs": 3,
                "error_percent": 2.0 + 0.01 * k,
                "wls_percent": 9.0,
                "type": types[k % 2],
                "odd": "yes" if is_odd else "no",
                "deviations": 9.0 + k if is_odd else 1.0,
                "why": f"{name} elbow: friction +50 % (type 5.00 +- 0.40 N*m at 0.80 rad/s, {9.0 + k:.1f} deviations)"
                if is_odd
                else None,
                "causes": [CAUSE, CAUSE | {"kind": "base"}] if is_odd else [],
            }
        )
    nothing = dict.fromkeys(("n_runs", "error_percent", "wls_percent", "type", "odd", "deviations", "why"))
    why_not = {"status": "failed", "message": f"no {name}.csv", **nothing}
    rows += [{"name": f"{name}_f{k}", **why_not} for k in range(failed)]
    told = []
    for t, kind in enumerate(types):
        names = [row["name"] for row in rows if row["type"] == kind]
        quantities = []
        for what, place, unit, at in kinds:
            mean, deviation = (0.0, 0.0) if what == "gain" else (-3.5 if what == "error" else 5.0, 0.4)
            quantities.append(
                {
                    "kind": what,
                    "name": f"hx[{name}] + 0.4 m[hand]" if what == "base" else what,
                    "place": place,
                    "unit": unit,
                    "at": at,
                    "at_unit": "rad/s" if at else None,
                    "mean": mean,
                    "deviation": deviation,
                }
            )
            columns["type"] += len(names) * [kind]
            columns["arm"] += names
            columns["deviations"] += rng.standard_normal(len(names)).tolist()
        told.append({"name": kind, "n_arms": len(names), "judged": t == 0 or n > 20, "quantities": quantities})
    pooling = {"false_alarms": 0.05, "n_tests": 4 * n, "limit": 0.05 / (4 * n), "least_arms": 9, "types": told}
    answer = {"n_robots": len(rows), "failed": failed, "no": 0, "pooling": pooling, "robots": rows}
    table = {key: np.array(values, dtype=object if key != "deviations" else float) for key, values in columns.items()}
    return answer, table


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium.opened() as opened:
        yield opened


MADE = {"large": (1000, 10), "small": (12, 0), "hostile": (30, 3, HOSTILE, 2)}


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    place = tmp_path_factory.mktemp("fleet")
    return {name: write_fleet_page(place / f"{name}.html", *made(*given)) for name, given in MADE.items()}


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("name", MADE)
def test_nobody_is_kept_out_and_nothing_breaks(
    browser: Any, pages: dict[str, Path], name: str, size: str, scheme: str
) -> None:
    width, height = SIZES[size]
    sight = chromium.Sight(browser, pages[name], width=width, height=height, scheme=scheme)
    assert sight.too_wide() == []
    sight.unfold()
    assert sight.too_wide() == []
    if name != "large":  # axe takes a minute for a thousand rows, which are all alike
        assert sight.violations(of_colours=scheme == "dark") == []  # all else is the same page
    assert sight.faults == []
    sight.close()


def test_a_thousand_arms_are_less_than_two_megabytes(pages: dict[str, Path]) -> None:
    assert pages["large"].stat().st_size < 2_000_000


def test_the_first_screen_answers(browser: Any, pages: dict[str, Path]) -> None:
    sight = chromium.Sight(browser, pages["large"], width=1280, height=800)
    head = sight.page.locator("header").inner_text()
    number = "1\u202f000"
    for text in (
        f"{number}\u00a0arms of 2\u00a0types",
        f"100 of {number}",
        "arm_0909",
        "97\u00a0more arms",
        "friction",
    ):
        assert text in head, text
    box = sight.page.locator("dl.answer").bounding_box()
    assert box["y"] + box["height"] < 800
    sight.close()


def shown(page: Any) -> list[str]:
    return page.eval_on_selector_all("#arms tbody tr:not([hidden]) th", "all => all.map((one) => one.textContent)")


def test_the_table_of_all_arms_is_filtered_and_sorted(browser: Any, pages: dict[str, Path]) -> None:
    sight = chromium.Sight(browser, pages["large"], width=1280, height=800)
    page = sight.page
    assert len(shown(page)) == 1000
    page.fill("[data-sieve=arms]", "arm_00 FRICTION")
    assert shown(page) == [f"arm_{k:04d}" for k in range(10)]
    assert page.inner_text("[data-left=arms]") == "10 of 1000"
    page.fill("[data-sieve=arms]", "")
    page.check("[data-odd=arms]")
    assert len(shown(page)) == 100
    page.click("#arms thead button:text('Deviations')")
    page.click("#arms thead button:text('Deviations')")
    assert shown(page)[0] == "arm_0909"
    page.uncheck("[data-odd=arms]")
    assert len(shown(page)) == 1000
    assert sight.faults == []
    sight.close()


def test_distributions_show_every_quantity_and_mark_odd_arms() -> None:
    answer, table = made(200, 5)
    answer["robots"][0]["odd"] = "yes"
    table["deviations"][0] = 40.0  # the first arm's friction, beyond the edge
    page = build_fleet_page(answer, table)
    assert page.count('<svg class="spread"') == 8
    assert "<title>arm_0000: 40.0</title>" in page
    assert page.count("less than is seen") == 2  # gains of both types
    assert "<b>10 of 200</b>" in page


def test_what_is_missing_is_missing_at_the_link_that_is_named() -> None:
    answer, table = made(12, 1)
    answer["robots"][0]["causes"] = [CAUSE | {"kind": "load", "place": "fore", "size": -0.5}]
    page = build_fleet_page(answer, table)
    assert "Something is missing: mount it again" in page
    assert "last link" not in page


def test_fleets_about_which_little_can_be_said() -> None:
    answer, table = made(12, 0)
    for row in answer["robots"]:
        row["odd"] = "unknown"
    page = build_fleet_page(answer, table)
    assert "there are too few arms of one type" in page
    assert "a type needs 9 of them" in page
    assert "<p>No arm could be compared.</p>" in page
    none, table = made(12, 0)
    assert "<p>None.</p>" in build_fleet_page(none, table)
    assert "<b>None</b> of 12\u00a0arms that could be compared." in build_fleet_page(none, table)
