"""The health page: it holds every change, hides no extreme, and stays small for a day."""

import base64
import json
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from helpers.link_models import bare_model
from helpers.small_arm import URDF
from helpers.watched_runs import CLOCK, DAY, DEVIATION, HOSTILE, ROW, both, change, run, watch

from dynid_rs import RobotModel, Watch, health_page
from dynid_rs.base.findings import Finding
from dynid_rs.report.health import write_health
from dynid_rs.report.health_source import Health, HealthRun, episodes
from dynid_rs.report.health_trend import axis_of, binned


class Page(HTMLParser):
    """Texts of a page by element, and its figures."""

    def __init__(self, path):
        super().__init__()
        self.html = path.read_text(encoding="utf-8")
        self.tags, self.rows, self.cell = [], [], None
        self.answers, self.open = [], None
        self.feed(self.html)
        data = json.loads(re.search(r'id="report-data">(.*?)</script>', self.html, re.S)[1])
        self.figures, self.pool = data["figures"], data["arrays"]

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        if tag == "tr":
            self.rows.append([])
        elif tag in ("td", "th"):
            self.rows[-1].append("")
            self.cell = True
        elif tag == "dd":
            self.answers.append("")
            self.open = True

    def handle_endtag(self, tag):
        self.cell = None if tag in ("td", "th") else self.cell
        self.open = None if tag == "dd" else self.open

    def handle_data(self, data):
        if self.cell:
            self.rows[-1][-1] += data
        if self.open:
            self.answers[-1] += data

    def array(self, name):
        return np.frombuffer(base64.b64decode(self.pool[name]), dtype="<f4")

    def changes(self):
        """Rows of the first table."""
        head = next(k for k, row in enumerate(self.rows) if row[0] == "No.")
        found = []
        for row in self.rows[head + 1 :]:
            if not row[0].isdecimal():
                break
            found.append(row)
        return found

    def marks(self, j):
        return [
            (mark["text"], mark["color"]) for mark in self.figures[f"trend-{j}"]["panels"][0]["marks"] if "text" in mark
        ]


def page(tmp_path, *runs, of=None, **more):
    return Page(health_page(of or watch(), runs, tmp_path / "health.html", **more))


def made(*runs):
    return [HealthRun(one.name, one.t, one.left / one.deviation, one.changes) for one in runs]


def test_every_change_is_in_the_table_with_what_to_do(tmp_path):
    first = run(
        *both("friction"),
        *both("gain", "joint_3", -0.1, t=50.0, either="a load"),
        *both("offset", "joint_4", 3.0, t=90.0, outcome="withdrawn"),
        name="first.csv",
    )
    second = run(
        *both("load", "joint_6", 2.0), change("unknown", "joint_1", 1.5, t=70.0, said="named"), name="second.csv"
    )
    rows = page(tmp_path, first, second).changes()
    assert [row[0] for row in rows] == ["1", "2", "3", "4", "5"]
    wanted = [
        (
            "first.csv10.0\u00a0s",
            "Frictionjoint_2",
            "+20\u00a0%+18 to +22\u00a0%",
            "settled, 30.0\u00a0s",
            "lubrication",
        ),
        ("first.csv50.0\u00a0s", "Gainjoint_3or a load", "\u221210\u00a0%", "settled, 70.0\u00a0s", "shows less"),
        (
            "first.csv90.0\u00a0s",
            "Constant torquejoint_4",
            "3.00\u00a0N\u00b7m2.98 to 3.02",
            "withdrawn, 110.0\u00a0s",
            "Nothing",
        ),
        ("second.csv10.0\u00a0s", "Loadthe last link", "2.00\u00a0kg", "settled, 30.0\u00a0s", "dynid payload"),
        ("second.csv70.0\u00a0s", "Unknown: the error has grownjoint_1", "+150\u00a0%", "named;", "dynid diagnose"),
    ]
    for row, texts in zip(rows, wanted, strict=True):
        for cell, text in zip(row[1:], texts, strict=True):
            assert text in cell
    assert "first moments 0.10, 0, \u22120.050\u00a0kg\u00b7m" in rows[3][3]


def test_a_frozen_channel_is_open_beside_other_changes(tmp_path):
    named, settled = both("frozen", "joint_4", 2.5)
    over = change("frozen", "joint_4", 1.0, t=60.0, said="withdrawn")
    other, outcome = both("friction", t=12.0)
    rows = page(tmp_path, run(named, other, settled, outcome)).changes()
    assert [(row[2], row[4].strip()) for row in rows] == [
        ("Frozen channeljoint_4", "settled, 30.0\u00a0s"),
        ("Frictionjoint_2", "settled, 32.0\u00a0s"),
    ]
    assert rows[0][3].startswith("2.50")
    assert "to" not in rows[0][3]
    rows = page(tmp_path, run(named, other, settled, outcome, over)).changes()
    assert [row[4].strip() for row in rows] == ["withdrawn, 60.0\u00a0s", "settled, 32.0\u00a0s"]


def test_the_first_screen_answers(tmp_path):
    found = page(tmp_path, run(*both("friction"), name="a.csv"), run(name="b.csv")).answers
    assert found[0] == "No: in 1 of 2\u00a0runs something has changed: friction of joint_2 +20\u00a0%."
    assert found[1] == "At the end of b.csv: nothing."
    assert found[2].startswith("Nothing now; where it comes again: joint_2: Look at lubrication")
    many = [one for j in range(1, 6) for one in both("friction", f"joint_{j}", t=40.0 * j)]
    found = page(tmp_path, run(*many, rows=2000)).answers
    assert found[0].endswith("2\u00a0more changes below.")
    assert "in 1 of" not in found[0]
    assert "joint_5" in found[1]
    found = page(tmp_path, run(*both("friction", outcome="withdrawn")), run()).answers
    assert found[0] == "Yes: nothing has changed in 2\u00a0runs; 1\u00a0change passed again."
    assert found[2] == "Nothing: go on using the model."
    found = page(tmp_path, run(unseen=range(6))).answers
    assert found[0].startswith("Not known: no joint moved")
    assert found[2].startswith("Record a run")
    assert page(tmp_path, run(*both("gain")), run(*both("gain"))).answers[0].endswith("+20\u00a0% (in 2\u00a0runs).")


def test_a_change_that_settles_under_another_name_says_both(tmp_path):
    (row,) = page(tmp_path, run(both("gain", "joint_3")[0], both("friction")[1])).changes()
    assert row[2] == "Frictionjoint_2named first as gain of joint_3 +22\u00a0%"


def test_changes_are_marked_on_their_joints_and_a_load_on_all(tmp_path):
    seen = page(
        tmp_path,
        run(*both("friction"), *both("load", "joint_6", 2.0, t=50.0), *both("gain", outcome="withdrawn", t=80.0)),
    )
    load = [("2", "red"), ("2", "green")]
    assert seen.marks(0) == seen.marks(5) == load
    assert seen.marks(1) == [("1", "red"), ("1", "green"), *load, ("3", "red"), ("3", "faint")]
    xs = [mark["x"] for mark in seen.figures["trend-1"]["panels"][0]["marks"]]
    assert xs == [10.0, 30.0, 50.0, 70.0, 80.0, 100.0]


@pytest.mark.parametrize("rows", [300, 5000, 100_000])
@pytest.mark.parametrize("spike", [30.0, -3000.0])
def test_no_extreme_is_hidden(tmp_path, rows, spike):
    """One row of a fifth of a second, in a run of any length; where it dwarfs all else a second panel shows that."""
    one = run(rows=rows)
    one.left[rows // 3, 2] = spike * DEVIATION
    seen = page(tmp_path, one)
    drawn = seen.array("h/2/low" if spike < 0 else "h/2/high") if rows > 3000 else seen.array("h/2/mean")
    assert (drawn.min() if spike < 0 else drawn.max()) == pytest.approx(spike)
    at = seen.array("h/x")[np.nanargmax(np.abs(drawn))] * (1 if rows <= 2900 else 60 if rows < 80_000 else 3600)
    assert at == pytest.approx(ROW * rows / 3, abs=ROW * (2 + rows / 1000))
    panels = seen.figures["trend-2"]["panels"]
    low, high = panels[0]["range"]
    assert low < spike < high
    assert len(panels) == (2 if abs(spike) > 40 else 1)
    assert panels[-1]["range"][1] - panels[-1]["range"][0] < 60
    assert len(seen.figures["trend-1"]["panels"]) == 1


def test_bins_are_means_and_ends_of_their_rows():
    rng = np.random.default_rng(3)
    ratio = rng.normal(size=(1000, 2))
    ratio[rng.random((1000, 2)) < 0.4] = np.nan
    ratio[200:300, 1] = np.nan
    one = HealthRun("run", ROW * np.arange(1, 1001), ratio, ())
    axis = axis_of([one], ROW)
    bins = binned([one], axis, ROW, 100)
    assert (bins.rows, bins.begins) == (10, ())
    for k, rows in enumerate(np.split(ratio, 100)):
        for j in range(2):
            known = rows[np.isfinite(rows[:, j]), j]
            found = [bins.mean[k, j], bins.low[k, j], bins.high[k, j]]
            wanted = [known.mean(), known.min(), known.max()] if known.size else [np.nan] * 3
            np.testing.assert_allclose(found, wanted)
    assert np.isnan(bins.mean[20:30, 1]).all()
    np.testing.assert_allclose(bins.x, ROW * (np.arange(100) * 10 + 5.5))


def test_runs_stand_one_after_the_other_with_gaps_between():
    runs = made(run(start=500.0), run(rows=0), run(start=0.0, rows=300))
    axis = axis_of(runs, ROW)
    assert (axis.order, axis.label, axis.is_clock) == ((0, 2), "time, run after run [s]", False)
    assert axis.at(0, runs[0].t[0]) == pytest.approx(ROW)
    assert axis.at(2, runs[2].t[-1]) == pytest.approx(ROW * 900)
    bins = binned(runs, axis, ROW, 90)
    assert bins.begins == (pytest.approx(120.0),)
    assert np.isnan(bins.mean[bins.between]).all()
    assert np.isfinite(bins.mean[~bins.between]).all()
    assert (np.diff(bins.x) > 0).all()


def test_runs_with_a_clock_stand_on_it():
    runs = made(run(start=CLOCK + 50_000), run(start=CLOCK + 3600))
    axis = axis_of(runs, ROW)
    assert (axis.order, axis.label, axis.is_clock) == ((1, 0), "time [h since 2026-03-01 00:00 UTC]", True)
    assert axis.at(1, CLOCK + 5400) == pytest.approx(1.5)
    short = axis_of(made(run(start=CLOCK + 3600 + 120)), ROW)
    assert (short.label, short.at(0, CLOCK + 3600 + 120)) == ("time [min since 2026-03-01 01:00 UTC]", 2.0)
    for other in (run(start=0.0), run(start=CLOCK + 50_010)):  # no clock, and one that runs beside another
        assert not axis_of([*runs, *made(other)], ROW).is_clock


def test_times_of_a_clock_are_said_as_such(tmp_path):
    ((_, when, _, _, state, _),) = page(
        tmp_path, run(*both("friction", t=CLOCK + 50.0), start=CLOCK, rows=900)
    ).changes()
    assert "2026-03-01 00:00:50 UTC" in when
    assert state.endswith("settled, 2026-03-01 00:01:10 UTC")


def test_a_day_of_seven_joints_is_a_small_page(tmp_path):
    runs, n = [], 7
    for k in range(24):
        changes = both("friction", t=CLOCK + 3600.0 * k + 60)
        runs += made(run(*changes, rows=DAY // 24, start=CLOCK + 3600.0 * k, n=n, seed=k))
    joints = tuple(f"joint_{j}" for j in range(n))
    settings = {"row": ROW, "false_alarms_per_day": 1.0, "tolerated": {"gain": 0.1}, "healthy": None, "findings": ()}
    health = Health("arm", "N*m", joints, runs, (), np.ones(n), np.ones(n), **settings)
    seen = Page(write_health(tmp_path / "health.html", health))
    assert sum(len(one.t) for one in runs) == DAY
    assert len(seen.html) < 2_000_000
    assert len(seen.changes()) == 24
    assert seen.array("h/x").size > 2000


def test_parts_that_were_not_watched_are_gaps(tmp_path):
    one = run(unseen=(3,))
    one.watched[100:200, 0] = False
    seen = page(tmp_path, one)
    gap = np.isnan(seen.array("h/0/mean"))
    assert gap[100:200].all()
    assert not gap[:100].any()
    assert "trend-3" not in seen.html.split("report-data")[0]
    shares = {row[0]: row[1] for row in seen.rows if row[0].startswith("joint_")}
    assert (shares["joint_1"], shares["joint_4"], shares["joint_5"]) == ("83\u00a0%", "0\u00a0%", "100\u00a0%")


def test_hostile_names_are_texts(tmp_path):
    finding = Finding("gap", "warning", f"Bad {HOSTILE}", file=HOSTILE)
    one = run(*both("friction", HOSTILE, either=f"gain of {HOSTILE}"), name=HOSTILE)
    seen = page(tmp_path, one, of=watch(second=HOSTILE), findings=[finding])
    assert "alert(" not in re.sub(r"&lt;script&gt;alert\(", "", seen.html)
    assert seen.tags.count("script") == 3
    ((_, when, what, *_),) = seen.changes()
    assert when.startswith(HOSTILE)
    assert HOSTILE in what.replace("\u200b", "")
    assert sum(HOSTILE in answer for answer in seen.answers) >= 2


def test_the_page_says_how_it_was_watched(tmp_path):
    text = page(tmp_path, run()).html
    assert "at most 1.00 per day, of all tests together" in text
    assert "Friction 10\u00a0%, gain 5.0\u00a0%, constant torque 2.00\u00a0deviations, load 0.100\u00a0kg" in text
    assert "there was no healthy run" in text
    fitted = Watch(watch().model)
    fitted.inflation_, fitted.memory_, fitted.healthy_ = np.ones(6), np.ones(6), ("good.csv",)
    assert "<code>good.csv</code>" in page(tmp_path, run(), of=fitted).html
    fitted.save(tmp_path / "watch.json")
    loaded = Watch.load(tmp_path / "watch.json", watch().model)
    assert "as healthy runs said that settings were made from" in page(tmp_path, run(), of=loaded).html


def test_what_stood_before_a_run_still_stands(tmp_path):
    """The page said that the model holds, beside what stands at the end."""
    stood = (change("friction", "joint_2", 0.25, t=0.0, said="named"),)
    text = page(tmp_path, replace(run(), before=stood), goes_on=True).html
    assert (
        "<b>No:</b> nothing new in 1\u00a0run, but what stood before still does: friction of joint_2 +25\u00a0%."
        in text
    )
    assert "<b>Yes:</b>" not in text
    assert "Every run goes on with what the one before has shown." in text
    assert "goes on with what" in page(tmp_path, replace(run(), before=stood)).html  # else nothing could have stood
    alone = page(tmp_path, run()).html
    assert "<b>Yes:</b> nothing has changed in 1\u00a0run." in alone
    assert "Every run is watched on its own, from its beginning." in alone


def test_an_encoder_of_a_slide_slips_by_metres(tmp_path):
    for tip, unit in (("upper", "m"), ("fore", "rad or m")):
        slide = RobotModel.from_urdf_string(URDF.replace('"revolute"', '"prismatic"', 1), tip=tip)
        text = page(tmp_path, run(n=slide.n_joints), of=Watch(bare_model(slide, slide.phi))).html
        assert f"encoder slip 0.00500\u00a0{unit}, " in text


def test_a_tolerated_load_has_the_unit_of_changes_of_load(tmp_path):
    for torque_unit, unit in (("N*m", "kg"), ("A", "kg A/(N\u00b7m)")):
        assert f"load 0.100\u00a0{unit}, " in page(tmp_path, run(), of=watch(torque_unit)).html


def test_findings_are_on_the_page(tmp_path):
    findings = [Finding("gap", "warning", "Half is missing.", file="run.csv"), Finding("note", "info", "Fine.")]
    text = page(tmp_path, run(), findings=findings).html
    assert "1\u00a0warning about the data:</b> Half is missing." in text
    assert "Fine." in text
    assert 'id="findings"' not in page(tmp_path, run()).html


def test_without_a_run_there_is_no_page_and_without_a_row_no_chart(tmp_path):
    with pytest.raises(ValueError, match="no run was watched"):
        health_page(watch(), [], tmp_path / "health.html")
    assert not (tmp_path / "health.html").exists()
    assert "No run is long enough for one row." in page(tmp_path, run(rows=0)).html


def test_a_page_takes_no_place_of_something_else(tmp_path):
    (tmp_path / "real").write_text("kept")
    (tmp_path / "link.html").symlink_to(tmp_path / "real")
    with pytest.raises(FileExistsError, match="symbolic link"):
        health_page(watch(), [run()], tmp_path / "link.html")
    assert (tmp_path / "real").read_text() == "kept"


def test_a_name_without_an_end_is_an_episode_of_its_own():
    first, last = both("friction")
    alone = change("gain", "joint_3", said="named", t=5.0)
    found = episodes(made(run(alone, first, last), run(alone)))
    assert [(one.number, one.run, one.named.kind, one.outcome is None) for one in found] == [
        (1, 0, "gain", True),
        (2, 0, "friction", False),
        (3, 1, "gain", True),
    ]
