"""The health page in a real browser: nobody is kept out, nothing breaks, and changes are drawn."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from helpers import chromium
from helpers.watched_runs import CLOCK, DEVIATION, HOSTILE, both, run, watch

from dynid_rs import health_page
from dynid_rs.base.findings import Finding

SIZES = {"desk": (1280, 800), "phone": (400, 844)}
SCHEMES = ("light", "dark")


def changed() -> list[Any]:
    """Two runs with changes of every fate, a spike that dwarfs all else, and a joint that stands."""
    first = run(*both("friction"), *both("gain", outcome="withdrawn", t=50.0), *both("load", "joint_6", 2.0, t=80.0))
    second = run(*both("offset", "joint_4", 3.0, either="gain of joint_4")[:1], rows=20_000, seed=2, unseen=(4,))
    second.left[5000, 2] = 400.0 * DEVIATION
    return [first, second]


MADE: dict[str, Any] = {
    "changed": (watch(), changed(), [Finding("gap", "warning", "Half is missing.", file="run.csv")]),
    "clock": (watch(), [run(start=CLOCK + 9000.0 * k, rows=9000, seed=k) for k in range(3)], []),
    "unseen": (watch(), [run(unseen=range(6)), run(rows=0)], []),
    "hostile": (watch(second=HOSTILE), [run(*both("friction", HOSTILE), name=HOSTILE)], []),
}


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium.opened() as opened:
        yield opened


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    place = tmp_path_factory.mktemp("health")
    return {
        name: health_page(watch, runs, place / f"{name}.html", findings=findings)
        for name, (watch, runs, findings) in MADE.items()
    }


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("name", MADE)
def test_nobody_is_kept_out_and_nothing_breaks(
    browser: Any, pages: dict[str, Path], name: str, size: str, scheme: str
) -> None:
    width, height = SIZES[size]
    sight = chromium.Sight(browser, pages[name], width=width, height=height, scheme=scheme)
    assert sight.too_wide() == []
    sight.unfold()
    assert sight.too_wide() == []
    assert sight.violations(of_colours=scheme == "dark") == []  # all else is the same page
    assert sight.faults == []
    sight.close()


@pytest.mark.parametrize("size", SIZES)
def test_what_to_do_is_seen_without_scrolling_aside(browser: Any, pages: dict[str, Path], size: str) -> None:
    width, height = SIZES[size]
    sight = chromium.Sight(browser, pages["changed"], width=width, height=height)
    cells = sight.page.locator("#changes td.text").all()
    assert len(cells) == 4
    for box in (cell.bounding_box() for cell in cells):
        assert box["x"] + box["width"] <= width
    sight.close()


def test_changes_are_drawn_in_their_colours(browser: Any, pages: dict[str, Path]) -> None:
    """On the canvas of the second joint: named, settled and withdrawn; on that of the first no withdrawn one."""
    sight = chromium.Sight(browser, pages["changed"], width=1280, height=800)
    colours = """(j) => {
      const canvas = document.querySelector(`.plot[data-figure=trend-${j}] canvas`);
      const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
      const seen = {};
      for (let i = 0; i < data.length; i += 4) if (data[i + 3] === 255) {
        const key = data.slice(i, i + 3).join();
        seen[key] = (seen[key] ?? 0) + 1;
      }
      return seen;
    }"""
    named, settled, withdrawn = "192,74,22", "0,127,92", "139,149,161"
    first, second = (sight.page.evaluate(colours, j) for j in (0, 1))
    assert min(second.get(colour, 0) for colour in (named, settled, withdrawn)) > 100
    assert second[named] > 2 * first[named] > 200
    assert first.get(withdrawn, 0) < 100
    sight.close()


def test_charts_zoom_together_and_are_read_by_the_keyboard(browser: Any, pages: dict[str, Path]) -> None:
    sight = chromium.Sight(browser, pages["changed"], width=1280, height=800)
    page = sight.page
    span = "(j) => { const { min, max } = Charts.drawn.get(document.querySelector(`[data-figure=trend-${j}]`))[0]" + (
        ".scales.x; return max - min; }"
    )
    whole = page.evaluate(span, 0)
    page.locator(".plot[data-figure=trend-1]").focus()
    page.keyboard.press("ArrowRight")
    assert "mean" in page.evaluate("document.activeElement.nextElementSibling.textContent")
    page.keyboard.press("+")
    assert page.evaluate(span, 0) == pytest.approx(page.evaluate(span, 1))
    assert page.evaluate(span, 0) < 0.6 * whole
    sight.close()


def test_paper_shows_all_of_it(browser: Any, pages: dict[str, Path], tmp_path: Path) -> None:
    sight = chromium.Sight(browser, pages["changed"], width=1280, height=800, scheme="dark")
    assert sight.page.pdf(path=str(tmp_path / "health.pdf"), format="A4", print_background=True).startswith(b"%PDF")
    sight.page.emulate_media(media="print")
    sight.page.set_viewport_size({"width": 690, "height": 1000})  # A4 less its margins
    sight.page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    assert sight.page.locator("details:not([open], .numbers, .name)").count() == 0
    assert sight.too_wide() == []
    assert sight.page.evaluate("getComputedStyle(document.querySelector('#changes thead')).position") == "static"
    assert sight.faults == []
    sight.close()
