"""The site is built as `make docs` builds it, and fetches nothing; every path to a page that a text names is there."""

import re
import subprocess
import sys
from html.parser import HTMLParser
from urllib.parse import unquote, urlsplit

import pytest
import real_identify
import results_page
from helpers.data import ROOT

import dynid_rs

DOCS = ROOT / "docs"
NOTEBOOKS = ("rtde_log", "what_is_missing", "feed_forward_and_contact", "to_mujoco")


pytestmark = pytest.mark.timeout(900)  # building takes a minute of processor time, and others may use it too


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The folder of the built site; building executes the tutorial's commands and the notebooks."""
    folder = tmp_path_factory.mktemp("site")
    before = sources()
    command = (sys.executable, "-m", "sphinx", "-b", "html", "-W", "--keep-going", "-n", "-q", DOCS, folder)
    done = subprocess.run(command, capture_output=True, text=True, timeout=880, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert sources() == before, "building writes into the checkout"
    return folder


def sources():
    """Every file below docs/ and when it was written; what Python compiles is not meant."""
    files = (path for path in DOCS.rglob("*") if path.is_file() and "__pycache__" not in path.parts)
    return {path: path.stat().st_mtime_ns for path in files}


class Page(HTMLParser):
    """What a page fetches, what it links to, and where its own text can be linked to."""

    def __init__(self, path):
        super().__init__()
        self.fetched, self.links, self.anchors, self.formulas = [], [], set(), 0
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attributes):
        values = dict(attributes)
        self.anchors |= {values[key] for key in ("id", "name") if values.get(key)}
        self.formulas += tag == "math"
        if tag in ("script", "img", "iframe", "source", "video", "audio", "embed"):
            self.fetched += [values["src"]] if values.get("src") else []
        if tag == "link" and values.get("rel") not in ("canonical", "search", "index", "next", "prev"):
            self.fetched.append(values["href"])
        if tag == "a" and values.get("href"):
            self.links.append(values["href"])


def pages_of(site):
    reports = {site / "tutorial" / "index.result.html", site / "tutorial" / "index.found.html"}
    assert all(report.is_file() for report in reports)
    return {path.resolve(): Page(path) for path in site.rglob("*.html") if path not in reports}


def test_nothing_is_fetched_from_elsewhere(site):
    for path, page in pages_of(site).items():
        for address in page.fetched:
            assert not urlsplit(address).netloc, f"{path}: fetches {address}"
            assert address.startswith("data:") or (path.parent / unquote(urlsplit(address).path)).exists(), address
    for style in site.rglob("*.css"):
        for address in re.findall(r"(?:@import\s+|url\(\s*)['\"]?([^'\")\s]+)", style.read_text(encoding="utf-8")):
            assert address.startswith(("data:", "#")) or not urlsplit(address).netloc, f"{style}: fetches {address}"


def test_every_link_leads_somewhere(site):
    pages = pages_of(site)
    links = [(path, address) for path, page in pages.items() for address in page.links]
    assert len(links) > 1000
    for path, address in links:
        where = urlsplit(address)
        if where.scheme or where.netloc:
            continue
        target = (path.parent / unquote(where.path)).resolve() if where.path else path
        assert target.exists(), f"{path.relative_to(site)}: {address}"
        if where.fragment and target in pages:
            assert unquote(where.fragment) in pages[target].anchors, f"{path.relative_to(site)}: {address}"


def test_formulas_are_drawn_by_the_browser(site):
    pages = pages_of(site)
    assert pages[(site / "explanation" / "model.html").resolve()].formulas > 10
    assert not any("mathjax" in address.lower() for page in pages.values() for address in page.fetched)


@pytest.mark.parametrize("name", NOTEBOOKS)
def test_notebooks_were_executed_and_can_be_taken_along(site, name):
    import json

    text = (site / "notebooks" / f"{name}.html").read_text(encoding="utf-8")
    assert 'class="cell_output' in text
    notebook = json.loads((site / "notebooks" / f"{name}.ipynb").read_text(encoding="utf-8"))
    assert any(cell["cell_type"] == "code" for cell in notebook["cells"])
    assert "notebook-file" not in json.dumps(notebook)


def test_the_commands_are_the_program_s(site):
    from typer.main import get_command

    from dynid_rs.cli import app

    text = (site / "reference" / "cli.html").read_text(encoding="utf-8")
    for name, command in get_command(app).commands.items():
        for option in (name for parameter in command.params for name in parameter.opts if name.startswith("--")):
            assert f'id="cmdoption-dynid-{name}-{option.removeprefix("--")}"' in text or option == "--help", (
                name,
                option,
            )


def test_every_public_name_has_its_entry(site):
    text = "".join(path.read_text(encoding="utf-8") for path in (site / "reference" / "api").glob("*.html"))
    for name in dynid_rs.__all__:
        assert name == "__version__" or f'id="dynid_rs.{name}"' in text, name
    # Words of the compiled classes come out of the stub.
    assert "Acceleration of free fall in the base frame" in text


def test_the_tutorial_finds_what_was_put_in(site):
    text = re.sub(r"<[^>]+>", "", (site / "tutorial" / "index.html").read_text(encoding="utf-8"))
    (found,) = re.findall(r"1\. friction hysteresis on joint_3: hysteresis ([\d.]+) N\*m", text)
    (truth,) = re.findall(
        r"friction_hysteresis on joint_3: presliding_distance [\d.]+ rad, hysteresis ([\d.]+) N", text
    )
    assert float(found) == pytest.approx(float(truth), rel=0.05)


def named_pages():
    """Every mention of a file below docs/ in a tracked text: (where, which)."""
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=False)
    names = listed.stdout.splitlines() or [str(path.relative_to(ROOT)) for path in ROOT.rglob("*") if path.is_file()]
    for name in names:
        path = ROOT / name
        if path.suffix not in {".py", ".pyi", ".md", ".rs", ".toml", ".txt", ".h", ".json", ".cff", ".yml"}:
            continue
        text = path.read_text(encoding="utf-8")
        for mention in re.findall(r"(?<![\w/.-])docs/[\w/.-]+\.(?:md|json|svg)\b", text):
            yield name, mention


def test_every_page_that_is_named_is_there():
    mentions = list(named_pages())
    assert len(mentions) > 50
    missing = [(name, page) for name, page in mentions if not (ROOT / page).is_file()]
    assert missing == []


@pytest.mark.parametrize("written", [results_page, real_identify], ids=["results", "identified"])
def test_pages_of_measured_arms_say_that_their_runs_are_not_blind(written):
    """As the README does of its table, and as the program says that wrote them."""
    page, readme = written.PAGE.read_text(encoding="utf-8"), (ROOT / "README.md").read_text(encoding="utf-8")
    assert page.startswith(written.HEAD)
    for text in (page, readme):
        assert "runs are not blind" in " ".join(text.split())
    assert "chosen on" not in written.HEAD
