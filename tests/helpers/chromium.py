"""A real Chromium for tests that look at pages; where there is none they are skipped with a reason, but not in CI."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome")
COLOURS = ("color-contrast", "link-in-text-block")
"""Axe's rules on colours, that on contrast first."""
HIDE_ALIKE = """() => {
  const names = ["color", "backgroundColor", "backgroundImage", "boxShadow", "textShadow", "opacity", "filter",
    "mixBlendMode", "clipPath", "maskImage", "fontSize", "fontWeight", "display", "visibility", "position", "zIndex",
    "textIndent", "webkitTextFillColor"];
  const look = (e) => {
    const own = getComputedStyle(e), text = [...e.childNodes].some((n) => n.nodeType === 3 && n.data.trim() !== "");
    return [e.tagName, text, ...names.map((name) => own[name])].join("|");
  };
  const seen = new Map();
  window.alike = [...document.querySelectorAll("tbody tr")].filter((row) => {
    if (!seen.has(row.parentElement)) seen.set(row.parentElement, new Set());
    const before = seen.get(row.parentElement), own = [row, ...row.querySelectorAll("*")].map(look).join();
    return before.has(own) || !before.add(own);
  });
  for (const row of window.alike) row.style.display = "none";
}"""
"""Hides rows of a table that look like one above them: what contrast depends on is the same of every element in it."""


def find() -> str:
    """Return the browser's path; skips the test, or fails it in CI, where it or playwright is missing."""
    reasons = []
    path = next(filter(None, map(shutil.which, NAMES)), None)
    if path is None:
        reasons.append("no Chromium: apt-get install chromium")
    try:
        import axe_playwright_python  # noqa: F401
        import playwright  # noqa: F401
    except ImportError as error:
        reasons.append(f"{error.name} is missing: pip install '.[test]'")
    if reasons and os.environ.get("CI") == "true":
        pytest.fail("CI has to look at the report: " + "; ".join(reasons))
    if reasons or path is None:
        pytest.skip("; ".join(reasons))
    return path


@contextmanager
def opened() -> Iterator[Any]:
    """Yield the browser, closed again afterwards."""
    path = find()
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=["--no-sandbox", "--disable-gpu"])
        yield browser
        browser.close()


def axe() -> str:
    """Return axe-core's script."""
    import axe_playwright_python

    return (Path(axe_playwright_python.__file__).parent / "axe.min.js").read_text(encoding="utf-8")


class Sight:
    """One page as a person has it before them, and what went wrong on the way."""

    def __init__(self, browser: Any, path: Path, *, width: int, height: int, scheme: str = "light") -> None:
        # The page's own policy would keep axe out.
        self.context = browser.new_context(
            viewport={"width": width, "height": height}, color_scheme=scheme, bypass_csp=True
        )
        self.page = self.context.new_page()
        self.faults: list[str] = []
        self.page.on("console", lambda message: self.faults.append(message.text))
        self.page.on("pageerror", lambda error: self.faults.append(str(error)))
        self.page.on("request", lambda request: self._ask(request.url, path))
        self.page.on("dialog", lambda dialog: self.faults.append(f"dialog: {dialog.message}"))
        self.page.goto(path.as_uri())
        self.page.wait_for_selector("html[data-plots=drawn]")

    def _ask(self, url: str, path: Path) -> None:
        if url.split("#")[0] != path.as_uri() and not url.startswith("data:"):
            self.faults.append(f"asks for {url}")

    def unfold(self) -> None:
        """Open everything that can be opened."""
        self.page.evaluate("document.querySelectorAll('details').forEach((part) => { part.open = true; })")
        self.page.wait_for_function("[...document.querySelectorAll('.plot')].every((p) => p.querySelector('canvas'))")

    def violations(self, *, of_colours: bool = False) -> list[tuple[str, str, str]]:
        """What axe finds, of any impact: rule, impact, the first element; `of_colours`: by rules on colours alone.

        Contrast takes most of axe's time, and takes it for every cell: where rows of a table look alike to the last
        cell, one of them is held against it. All other rules see every row.
        """
        self.page.evaluate(axe())
        found = self._against(COLOURS[1:] if of_colours else None)
        self.page.evaluate(HIDE_ALIKE)
        found += self._against(COLOURS[:1])
        self.page.evaluate("for (const row of window.alike) row.style.removeProperty('display')")
        return [(rule["id"], rule["impact"], rule["nodes"][0]["html"][:200]) for rule in found]

    def _against(self, rules: Sequence[str] | None) -> list[dict[str, Any]]:
        """What axe finds by some rules, by all but contrast where none are given."""
        some = (
            {"rules": {COLOURS[0]: {"enabled": False}}}
            if rules is None
            else {"runOnly": {"type": "rule", "values": list(rules)}}
        )
        # Of what is right only the number: descriptions of all of it take most of the time.
        found = self.page.evaluate("(some) => axe.run({...some, resultTypes: ['violations']})", some)["violations"]
        assert isinstance(found, list)
        return found

    def too_wide(self) -> list[str]:
        """Elements that stand out to the right of the window and are in no box that scrolls; none if all fits."""
        return self.page.evaluate(
            """() => {
              const wide = document.documentElement.scrollWidth;
              if (wide <= innerWidth) return [];
              return [...document.querySelectorAll("body *")]
                .filter((e) => e.getBoundingClientRect().right > innerWidth + 1 && !e.closest(".scroll"))
                .map((e) => e.outerHTML.slice(0, 120)).slice(0, 5);
            }"""
        )

    def close(self) -> None:
        """Leave the page."""
        self.context.close()
