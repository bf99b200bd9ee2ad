"""The page of `dynid diagnose`: the answer first, every effect with its plot, and the same again from the files."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import made_diagnosis
import numpy as np
import pytest
from test_report import BROWSER, HOSTILE, Page, data_of, make_result, make_table, write_inputs

from dynid_rs.base.errors import DataError
from dynid_rs.base.wording import NO_INTERVAL
from dynid_rs.report import write_report
from dynid_rs.report.before_after import before_after_table


def make_diagnosis(n_joints: int) -> dict[str, Any]:
    """A result as `diagnose` writes it, every part filled; numbers are made up."""
    result = make_result(n_joints)
    joints, test = result["joints"], result["rmse"]["test"]
    after = np.array(test["after"])
    before = after * np.linspace(1.8, 1.0, n_joints)
    where = joints[:1]
    test |= {
        "before": before.tolist(),
        "before_interval": np.column_stack([0.95 * before, 1.05 * before]).tolist(),
        "change_interval": [[-0.5, -0.25]] * n_joints,
        "floor_interval": [[0.9 * x, 1.1 * x] for x in test["floor"]],
    }
    ties = [made_diagnosis.tie("friction_hysteresis", where[0], after.tolist())]
    unknown = {"depends_on": made_diagnosis.leftover(where[0])["depends_on"], "told_apart_from": []}
    return result | {
        "effects": [
            made_diagnosis.entry("load_dependent_friction", where, before.tolist(), after.tolist(), ties=ties),
            made_diagnosis.entry("gravity_tilt", joints, before.tolist(), after.tolist(), rank=2, plot=None),
            made_diagnosis.entry("unknown", where, before.tolist(), after.tolist(), rank=3, **unknown),
        ],
        "unexplained": [made_diagnosis.leftover(joints[-1])],
        "steps": [
            {"action": "added", "kind": "load_dependent_friction", "joints": where, "rmse_train": after.tolist()},
            {"action": "dropped", "kind": "joint_spring", "joints": where, "rmse_train": after.tolist()},
        ],
        "nothing_to_add": False,
        "next_experiment": ["Run `dynid excite ROBOT --separate a b` and add the run."],
        "verdict": "Two effects explain 83 % of what could be explained.",
    }


def make_residuals(n_joints: int, n_per_run: int = 200) -> dict[str, np.ndarray]:
    table = make_table(n_joints, n_per_run)
    return table | {f"residual_before_{j}": 1.5 * table[f"residual_{j}"] for j in range(n_joints)}


def page_of(folder: Path, result: dict[str, Any]) -> tuple[str, Page]:
    source = write_report(write_inputs(folder, result, make_residuals(len(result["joints"])))).read_text("utf-8")
    return source, Page(source)


@pytest.mark.parametrize("n_joints", [1, 3, 7])
def test_the_answer_comes_first_and_everything_else_is_folded(tmp_path: Path, n_joints: int) -> None:
    result = make_diagnosis(n_joints)
    source, page = page_of(tmp_path, result)
    folded = source[source.index('<details id="steps">') :]
    answer = source[: source.index('<details id="steps">')]
    for key in ("errors", "effects", "sensors", "left", "next"):
        assert f'<section id="{key}">' in answer
    for key in ("torque", "velocity", "parameters", "data", "provenance"):
        assert f'<details id="{key}">' in folded
    drawn = {attrs["data-figure"] for _, attrs in page.elements if "data-figure" in attrs}
    assert drawn == set(data_of(source)["figures"])
    assert {"effect-0", "effect-2", "left-0"} <= drawn
    assert "effect-1" not in drawn  # it has no plot
    for text in (
        result["verdict"],
        "Load-dependent friction",
        "1.90 N\u00b7m",
        "1.70 to 2.10",
        "Told apart from torque ripple",
        "Not told apart from friction hysteresis",
        "dynid excite ROBOT -o separate.csv --separate stribeck:joint_0 friction_hysteresis:joint_0",
        "through the others",
        "dropped joint spring",
    ):
        assert text in page.text, text
    assert ("on whole robot" in page.text) == (n_joints > 2)
    assert "NaN" not in page.text
    assert "None" not in page.text


def test_bars_stand_for_their_numbers() -> None:
    """Widths of the bars of a joint are to each other as its errors; the floor's band ends at the floor's line."""
    result = make_diagnosis(3)
    html = before_after_table(result)
    test = result["rmse"]["test"]
    rows = re.findall(r"<svg.*?</svg>", html)
    assert len(rows) == 3
    for j, row in enumerate(rows):
        width = {
            kind: float(re.search(rf'class="{kind}"[^>]*? width="([\d.]+)"', row)[1]) for kind in ("before", "after")
        }
        assert width["after"] / width["before"] == pytest.approx(test["after"][j] / test["before"][j], abs=2e-3)
        band = re.search(r'class="floor" x="([\d.]+)"[^>]*? width="([\d.]+)"', row)
        line = re.search(r'class="floor-line" x1="([\d.]+)"', row)
        assert float(band[1]) + float(band[2]) == pytest.approx(float(line[1]), abs=0.11)


def test_a_change_has_its_interval_and_what_cannot_be_said_is_a_dash(tmp_path: Path) -> None:
    result = make_diagnosis(3)
    result["rmse"]["test"]["change_interval"] = [[-0.5, -0.25], [-0.1, 0.2], None]
    cells = re.findall(r"<td[^>]*>(?:(?!</td>).)*(?:less|more|same)(?:(?!</td>).)*</td>", before_after_table(result))
    assert len(cells) == 3
    assert "\u221250\u00a0% to \u221225\u00a0%" in cells[0]
    assert 'class="num better"' in cells[0]
    assert "\u221210\u00a0% to +20\u00a0%" in cells[1]
    assert 'class="num soft"' in cells[1]  # it may be none
    assert " to " not in cells[2]
    _, page = page_of(tmp_path, result)
    assert NO_INTERVAL in page.text
    result["rmse"]["test"]["change_interval"][2] = [0.0, 0.0]
    assert NO_INTERVAL not in page_of(tmp_path, result)[1].text


def test_dots_and_curve_reach_the_page(tmp_path: Path) -> None:
    import base64

    result = make_diagnosis(2)
    source, _ = page_of(tmp_path, result)
    data = data_of(source)

    def array(name: str) -> np.ndarray:
        return np.frombuffer(base64.b64decode(data["arrays"][name]), dtype="<f4")

    plot = result["effects"][0]["plot"]
    dots, curve = data["figures"]["effect-0"]["traces"]
    np.testing.assert_allclose(array(dots["y"][1:]), plot["partial"], rtol=1e-6)
    np.testing.assert_allclose(array(curve["x"][1:]), plot["curve_x"], rtol=1e-6)
    assert data["figures"]["effect-0"]["layout"]["xaxis"]["title"]["text"] == "dq_joint_0 [rad/s]"
    before = [trace for trace in data["figures"]["time-0"]["traces"] if trace["name"] == "residual before"]
    assert len(before) == 1


def test_nothing_to_add(tmp_path: Path) -> None:
    result = make_diagnosis(2) | {"effects": [], "unexplained": [], "steps": [], "next_experiment": []}
    result |= {"nothing_to_add": True, "verdict": "Nothing to add: noise."}
    source, page = page_of(tmp_path, result)
    assert "Nothing was added" in page.text
    assert "Nothing that could be told from noise" in page.text
    assert "What would tell more" not in page.text
    assert 'id="steps"' not in source


def test_texts_of_files_are_never_markup(tmp_path: Path) -> None:
    def poison(value: Any, key: str = "") -> Any:
        if isinstance(value, dict):
            return {k: item if k in ("format", "version", "severity") else poison(item, k) for k, item in value.items()}
        if isinstance(value, list):
            return [poison(item) for item in value]
        return HOSTILE if isinstance(value, str) else value

    source, page = page_of(tmp_path, poison(make_diagnosis(2)))
    assert [tag for tag, _ in page.elements].count("script") == 3
    assert "alert(1)</script>" not in source
    for figure in data_of(source)["figures"].values():
        titles = [
            axis["title"]["text"] for axis in figure["layout"].values() if isinstance(axis, dict) and "title" in axis
        ]
        assert all("<script" not in title for title in titles)


def test_report_is_the_same_again_from_the_files(tmp_path: Path) -> None:
    folder = write_inputs(tmp_path, make_diagnosis(3), make_residuals(3))
    first = write_report(folder).read_bytes()
    assert write_report(folder).read_bytes() == first


@pytest.mark.parametrize(
    ("spoil", "where"),
    [
        (lambda r: r["effects"][0]["plot"].update(x="no"), "effects[0].plot.x"),
        (lambda r: r["effects"][0]["plot"]["curve"].append(None), "effects[0].plot.curve[60]"),
        (lambda r: r["unexplained"][0]["depends_on"][0].update(direct=3), "unexplained[0].depends_on[0].direct"),
        (lambda r: r["steps"][0].update(rmse_train=[1.0]), "steps[0].rmse_train"),
        (lambda r: r.update(next_experiment=[3]), "next_experiment[0]"),
    ],
)
def test_damaged_parts_are_named(tmp_path: Path, spoil: Any, where: str) -> None:
    result = make_diagnosis(2)
    spoil(result)
    with pytest.raises(DataError, match=re.escape(f'"{where}"')):
        write_report(write_inputs(tmp_path, result, make_residuals(2)))


@pytest.mark.skipif(BROWSER is None, reason="no browser to draw the page with")
def test_browser_draws_every_plot_that_is_not_folded(tmp_path: Path) -> None:
    import subprocess

    folder = write_inputs(tmp_path / "out", make_diagnosis(3), make_residuals(3))
    options = ["--headless=new", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path / 'browser'}"]
    options += ["--virtual-time-budget=10000", "--enable-logging=stderr", "--dump-dom", write_report(folder).as_uri()]
    assert BROWSER
    run = subprocess.run([BROWSER, *options], capture_output=True, text=True, timeout=120, check=False)
    assert "CONSOLE" not in run.stderr
    assert 'data-plots="drawn"' in run.stdout
    for name in ("effect-0", "effect-2", "left-0"):
        assert re.search(rf'class="plot js-plotly-plot" data-figure="{name}"', run.stdout), name
