"""The pages in a real browser: nobody is kept out, the first screen answers, and paper shows all of it."""

from __future__ import annotations

import functools
import json
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import chromium, made_diagnosis
from test_diagnosis_report import make_diagnosis, make_residuals
from test_report import make_result, make_table, write_inputs

from dynid_rs.report import write_report

SIZES = {"desk": (1280, 800), "phone": (390, 844)}
SCHEMES = ("light", "dark")
HOSTILE = "<img src=x onerror=alert(1)>@0/t</script>\"'&"


def clean(n_joints: int) -> dict[str, Any]:
    result = make_diagnosis(n_joints) | {"effects": [], "unexplained": [], "steps": [], "next_experiment": []}
    return result | {"nothing_to_add": True, "verdict": "Nothing to add: noise."}


def renamed(result: dict[str, Any], name: str) -> dict[str, Any]:
    """The same result with joints of another name."""
    return json.loads(re.sub(r"joint_(?=\d)", lambda _: json.dumps(name)[1:-1], json.dumps(result)))


def with_many_effects() -> dict[str, Any]:
    """Families, ties, an unknown one, effects without a curve and such that lower no error."""
    result = make_diagnosis(3)
    before, after = (result["rmse"]["test"][key] for key in ("before", "after"))
    for k, joint in enumerate(result["joints"]):
        bounds = [[-0.4, -0.2 if k % 2 else 0.1]] * 3
        more = {"rmse_test_change_interval": bounds}
        result["effects"].append(made_diagnosis.entry("torque_ripple", [joint], before, after, **more))
        result["effects"].append(made_diagnosis.entry("stribeck", [joint], before, after, above_band=True))
    return result


def without_test_runs() -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    result, columns = make_result(2), make_table(2, 200)
    result["data"]["test"] = []
    for key in ("wls", "before", "after", "floor", "after_interval"):
        result["rmse"]["test"][key] = [None] * 2
    return result, columns | {"set": np.full(columns["t"].size, "train")}


MADE: dict[str, Any] = {
    "diagnosis": lambda: (with_many_effects(), make_residuals(3)),
    "identified": lambda: (make_result(3), make_table(3, 300)),
    "clean": lambda: (clean(2), make_residuals(2)),
    "one joint": lambda: (make_diagnosis(1), make_residuals(1)),
    "no test runs": without_test_runs,
    "seven long names": lambda: (
        renamed(make_diagnosis(7), "AR5-5_07R-W4C4A2_with_a_name_that_goes_on_"),
        make_residuals(7),
    ),
    "hostile": lambda: (renamed(make_diagnosis(2), HOSTILE), make_residuals(2)),
}
SEEN = [("diagnosis", size, scheme) for size in SIZES for scheme in SCHEMES]
SEEN += [("identified", "desk", "light"), ("identified", "phone", "dark"), ("no test runs", "phone", "light")]
SEEN += [("hostile", "phone", "dark")]


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium.opened() as opened:
        yield opened


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    place = tmp_path_factory.mktemp("pages")
    return {
        name: write_report(write_inputs(place / name.replace(" ", "_"), *made())).resolve()
        for name, made in MADE.items()
    }


@dataclass(frozen=True)
class Seen:
    """One page in one window, first as it opens, then unfolded."""

    boxes: list[dict[str, float]]
    texts: list[str]
    chart: float
    too_wide: dict[str, list[str]]
    n_images: int
    faults: list[str]
    violations: list[tuple[str, str, str]] | None


@pytest.fixture(scope="module")
def looked_at(browser: Any, pages: dict[str, Path]) -> Callable[..., Seen]:
    """Open a page once for all tests that only look at it."""

    @functools.cache
    def look(name: str, size: str, scheme: str) -> Seen:
        width, height = SIZES[size]
        sight = chromium.Sight(browser, pages[name], width=width, height=height, scheme=scheme)
        boxes = [row.bounding_box() for row in sight.page.locator(".answer > div").all()]
        texts = sight.page.locator(".answer dd").all_inner_texts()
        chart = sight.page.locator(".bars h3").first.bounding_box()["y"]
        too_wide = {"folded": sight.too_wide()}
        sight.unfold()
        too_wide["unfolded"] = sight.too_wide()
        n_images = sight.page.evaluate("document.images.length")
        faults = list(sight.faults)
        seen_in_light = scheme == "dark" and (name, size, "light") in SEEN  # all but colours is the same page
        violations = sight.violations(of_colours=seen_in_light) if (name, size, scheme) in SEEN else None
        sight.close()
        return Seen(boxes, texts, chart, too_wide, n_images, faults, violations)

    return look


@pytest.mark.parametrize(("name", "size", "scheme"), SEEN)
def test_nobody_is_kept_out(looked_at: Callable[..., Seen], name: str, size: str, scheme: str) -> None:
    """Axe finds nothing at all, not even of small weight, with everything unfolded."""
    assert looked_at(name, size, scheme).violations == []


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("name", MADE)
def test_nothing_breaks(looked_at: Callable[..., Seen], name: str, size: str) -> None:
    """No message, no request, nothing beside the window, whether folded or not."""
    seen = looked_at(name, size, "light")
    assert seen.too_wide == {"folded": [], "unfolded": []}
    assert seen.faults == []
    assert seen.n_images == 0


def test_axe_would_find_something(browser: Any, pages: dict[str, Path], tmp_path: Path) -> None:
    spoiled = tmp_path / "spoiled.html"
    text = pages["clean"].read_text(encoding="utf-8")
    spoiled.write_text(text.replace("--muted: #4f5967", "--muted: #c4c9cf").replace(' lang="en"', ""), encoding="utf-8")
    sight = chromium.Sight(browser, spoiled, width=1280, height=800)
    assert {"color-contrast", "html-has-lang"} <= {rule for rule, _, _ in sight.violations()}
    sight.close()


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("name", MADE)
def test_first_screen_answers_three_questions(looked_at: Callable[..., Seen], name: str, size: str) -> None:
    seen, (_, height) = looked_at(name, size, "light"), SIZES[size]
    assert len(seen.boxes) == 3
    assert all(seen.texts)
    assert seen.boxes[-1]["y"] + seen.boxes[-1]["height"] <= height
    if size == "desk":  # the chart begins on the first screen
        assert seen.chart < height


@pytest.mark.parametrize("name", ["diagnosis", "identified"])
def test_keyboard_reaches_and_works_everything(browser: Any, pages: dict[str, Path], name: str) -> None:
    sight = chromium.Sight(browser, pages[name], width=1280, height=800)
    sight.unfold()
    page = sight.page
    page.evaluate(
        """() => {
          const all = "a[href], button, input, select, summary, [tabindex='0']";
          window.wanted = new Set([...document.querySelectorAll(all)].filter((e) => e.offsetParent !== null));
          document.addEventListener("focusin", (event) => window.wanted.delete(event.target));
        }"""
    )
    n = page.evaluate("window.wanted.size")
    for _ in range(n + 5):
        page.keyboard.press("Tab")
    # A group of tabs that the browser holds to be one stop does not exist here: every one has to be reached.
    assert page.evaluate("[...window.wanted].map((e) => e.outerHTML.slice(0, 80))") == []
    plot = page.locator(".plot[data-figure=time-0]")
    plot.focus()
    page.keyboard.press("ArrowRight")
    assert "measured" in page.evaluate("document.activeElement.nextElementSibling.textContent")
    span = "(() => { const { min, max } = Charts.drawn.get(document.activeElement)[0].scales.x; return max - min; })()"
    whole = page.evaluate(span)
    page.keyboard.press("+")
    assert page.evaluate(span) < 0.6 * whole
    page.keyboard.press("0")
    assert page.evaluate(span) == pytest.approx(whole)
    sight.close()


def test_curves_can_be_switched_and_runs_chosen(browser: Any, pages: dict[str, Path]) -> None:
    sight = chromium.Sight(browser, pages["identified"], width=1280, height=800)
    sight.unfold()
    page = sight.page
    shown = "Charts.drawn.get(document.querySelector('[data-figure=time-0]'))[0].series.map((s) => s.show)"
    before = page.evaluate(shown)
    page.locator("input[data-term=friction]").check()
    assert page.evaluate(shown) != before
    first = page.locator("details[data-of=time-0] tbody").inner_text()
    page.locator("select[data-run]").select_option("1")
    assert page.locator("details[data-of=time-0] tbody").inner_text() != first
    button = page.locator("table.sortable thead button").nth(2)
    button.click()
    values = page.evaluate(
        "[...document.querySelector('table.sortable').tBodies[0].rows].map((r) => Number(r.cells[2].dataset.value))"
    )
    assert values == sorted(values)
    assert sight.faults == []
    sight.close()


def test_pictures_are_drawn(browser: Any, pages: dict[str, Path]) -> None:
    """Every chart has ink on it in both schemes, in colours of its own scheme."""
    inks = {}
    for scheme in SCHEMES:
        sight = chromium.Sight(browser, pages["diagnosis"], width=1280, height=800, scheme=scheme)
        sight.unfold()
        inks[scheme] = sight.page.evaluate(
            """() => [...document.querySelectorAll(".plot canvas")].map((canvas) => {
              const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
              const seen = new Set();
              for (let i = 0; i < data.length; i += 4) if (data[i + 3] === 255) seen.add(data.slice(i, i + 3).join());
              return [...seen];
            })"""
        )
        sight.close()
    assert all(len(colours) >= 2 for canvases in inks.values() for colours in canvases)
    assert any("0,103,165" in colours for colours in inks["light"])
    assert any("90,180,236" in colours for colours in inks["dark"])


@pytest.mark.parametrize("name", ["diagnosis", "identified"])
def test_paper_shows_all_of_it(browser: Any, pages: dict[str, Path], tmp_path: Path, name: str) -> None:
    """Printing unfolds what is folded and folds it again; nothing is wider than the page."""
    sight = chromium.Sight(browser, pages[name], width=1280, height=800, scheme="dark")
    folded = sight.page.locator("details:not([open])").count()
    printed = sight.page.pdf(path=str(tmp_path / "report.pdf"), format="A4", print_background=True)
    assert printed.startswith(b"%PDF")
    assert sight.page.locator("details:not([open])").count() == folded
    sight.page.emulate_media(media="print")
    sight.page.set_viewport_size({"width": 690, "height": 1000})  # A4 less its margins
    sight.page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    assert sight.page.locator("details:not([open], .numbers, .name)").count() == 0
    assert sight.too_wide() == []
    assert sight.page.evaluate("[...document.querySelectorAll('.plot')].every((p) => p.querySelector('canvas'))")
    assert sight.page.evaluate("getComputedStyle(document.body).color") == "rgb(23, 28, 34)"
    assert sight.faults == []
    sight.close()
