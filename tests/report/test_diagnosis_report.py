"""The page of `dynid diagnose`: the answer first, every effect with its plot, and the same again from the files."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import made_diagnosis
from test_report import HOSTILE, Page, array_of, data_of, make_result, make_table, write_inputs

from dynid_rs.base.errors import DataError
from dynid_rs.base.numbers import significant
from dynid_rs.base.wording import NO_INTERVAL, worse_than_least_squares
from dynid_rs.report import write_report
from dynid_rs.report.bars import bar_chart
from dynid_rs.report.text import typeset


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
        "Friction grows with the torque that the gear carries.",
        "Not told apart from friction hysteresis",
        "dynid excite ROBOT -o separate.csv --separate stribeck:joint_0 friction_hysteresis:joint_0",
        "through the others",
        "dropped joint spring",
    ):
        assert text in page.text, text
    assert ("on the whole robot" in page.text) == (n_joints > 2)
    assert "NaN" not in page.text
    assert "None" not in page.text


def test_a_third_loop_that_was_switched_off_was_not_tried(tmp_path: Path) -> None:
    result = make_diagnosis(2)
    result["residual"] = {"kind": "gmr", "inputs": None, "kept": False, "kept_on": [], "switched_off": True}
    _, page = page_of(tmp_path, result)
    assert "It was switched off." in page.text
    assert "on runs that it had not seen" not in page.text


def test_what_was_added_is_told_from_the_declared_law_of_the_same_name(tmp_path: Path) -> None:
    result, table = make_diagnosis(2), make_residuals(2)
    rows = result["parameters"]["joint"]
    rows += [dict(rows[0], name="hysteresis", effect="friction_hysteresis", declared=kind) for kind in (True, False)]
    table |= {
        f"{name}_{j}": np.ones(len(table["t"]))
        for name in ("friction_hysteresis", "friction_hysteresis2")
        for j in range(2)
    }
    page = Page(write_report(write_inputs(tmp_path, result, table)).read_text("utf-8"))
    for said in ("hysteresis (added)", "friction hysteresis (added)"):
        assert said in page.text
    assert "hysteresis2" not in page.text


def test_all_terms_of_friction_are_drawn_over_speed(tmp_path: Path) -> None:
    """A diagnosed model holds several laws of friction, and none of them is called `friction`."""
    table = make_residuals(2)
    half = {}
    for j in range(2):
        whole = table.pop(f"friction_{j}")
        half |= {f"smooth_friction_{j}": 0.5 * whole, f"friction_hysteresis2_{j}": 0.3 * whole}
        half |= {f"stribeck_{j}": 0.2 * whole}
    result = make_diagnosis(2)
    folders = [tmp_path / name for name in ("one", "several")]
    curves = []
    for folder, columns in zip(folders, (make_residuals(2), table | half), strict=True):
        folder.mkdir()
        source = write_report(write_inputs(folder, result, columns)).read_text("utf-8")
        curves.append(array_of(source, "v/1/friction/y"))
    assert np.abs(curves[0]).max() > 0.1
    np.testing.assert_allclose(curves[1], curves[0], rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("alone", [True, False])
def test_what_an_effect_brings_is_said_in_words(tmp_path: Path, alone: bool) -> None:
    """One by one left out, as a diagnosis does; or one after the other, as changes since a reference are told."""
    result = make_diagnosis(2)
    entry = result["effects"][0]
    entry |= {"rmse_test_change_interval": [[-0.5, -0.25]] * len(entry["rmse_test_after"])} if alone else {}
    _, page = page_of(tmp_path, result)
    before, after = significant(entry["rmse_test_before"][0]), significant(entry["rmse_test_after"][0])
    assert f"Test error: without it {before}, with it {after}" in page.text
    assert ("all coefficients are fitted again" in page.text) == alone


def test_names_of_one_fit_have_one_number(tmp_path: Path) -> None:
    """Each of them was said to bring alone what all of them bring."""
    result = make_diagnosis(2)
    first, second = result["steps"]
    result["steps"] = [first, second, {**first, "rmse_train": [0.1, 0.2]}]
    source, page = page_of(tmp_path, result)
    rows = re.findall(r'<th scope="row">(\d)</th><td class="text">', source)
    assert rows == ["1", "1", "2"]
    assert "What was added or dropped at once has one number, and one fit behind it." in page.text
    result["steps"] = [first]
    assert "at once has one number" not in page_of(tmp_path, result)[1].text


@pytest.mark.parametrize(("left", "said"), [(3.0, True), (1.0, False)])
def test_what_is_above_the_noise_without_a_pattern_is_said(tmp_path: Path, left: float, said: bool) -> None:
    result = make_diagnosis(2)
    test = result["rmse"]["test"]
    after = left * np.array(test["floor"])
    test |= {"after": after.tolist(), "after_interval": np.column_stack([0.9 * after, 1.1 * after]).tolist()}
    _, page = page_of(tmp_path, result | {"unexplained": []})
    assert "Nothing that could be told from noise." in page.text
    assert ("no signal in these runs explains the rest" in page.text) == said


def test_bars_stand_for_their_numbers() -> None:
    """All bars are on one scale: widths are to each other as errors over the torque's standard deviation."""
    result = make_diagnosis(3)
    test = result["rmse"]["test"]
    shares = np.array([np.array(test[key]) / np.array(test["torque_std"]) for key in ("wls", "before", "after")])
    rows = re.findall(r"<li><div class=\"bar-joint\">.*?</li>", bar_chart(result), re.S)
    widths = [re.findall(r'class="fill (?:wls|before|after)" style="width:([\d.]+)%"', row) for row in rows]
    drawn = np.array(widths, dtype=float).T
    np.testing.assert_allclose(drawn / drawn.max(), shares / shares.max(), atol=2e-4)
    for j, row in enumerate(rows):
        left, width = map(float, re.search(r'class="whisker" style="left:([\d.]+)%;width:([\d.]+)%"', row).groups())
        per_percent = drawn[2, j] / test["after"][j]
        np.testing.assert_allclose([left, left + width], per_percent * np.array(test["after_interval"][j]), atol=0.05)
        floors = [float(at) for at in re.findall(r'class="floor" style="left:([\d.]+)%"', row)]
        np.testing.assert_allclose(floors, [per_percent * test["floor"][j]] * 3, atol=0.05)


def test_a_baseline_far_off_is_cut_and_the_rest_stays_readable() -> None:
    result = make_diagnosis(2)
    result["rmse"]["test"]["wls"][0] *= 100
    html = bar_chart(result)
    assert html.count("fill wls cut") == 1
    assert html.count(" cut") == 1
    assert max(float(width) for width in re.findall(r'fill before" style="width:([\d.]+)%"', html)) > 40


def test_a_change_has_its_interval_and_what_cannot_be_said_is_a_dash(tmp_path: Path) -> None:
    result = make_diagnosis(3)
    result["rmse"]["test"]["change_interval"] = [[-0.5, -0.25], [-0.1, 0.2], None]
    said = re.findall(r'<span class="change (\w+)">(.*?)</span></div>', bar_chart(result))
    assert [style for style, _ in said] == ["better", "soft", "soft"]  # the second may be none, the third is not known
    assert "\u221250 to \u221225\u00a0%" in said[0][1]
    assert "\u221210 to +20\u00a0%" in said[1][1]
    assert " to " not in said[2][1]
    _, page = page_of(tmp_path, result)
    assert NO_INTERVAL in page.text
    result["rmse"]["test"]["change_interval"][2] = [0.0, 0.0]
    assert NO_INTERVAL not in page_of(tmp_path, result)[1].text


def test_a_reference_is_no_declared_model(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its errors were told as those of a fit of the robot file, and another model's parameters as its own."""
    from dynid_rs.commands._diagnose_view import show

    result = make_diagnosis(3) | {"covariance": None, "next_experiment": []}
    result["rmse"]["test"]["before"] = [3.0 * error for error in result["rmse"]["test"]["wls"]]
    assert worse_than_least_squares(result).startswith("Worse than the simplest model: the reference leaves more")
    _, page = page_of(tmp_path, result)
    for said in (
        "(the reference ",
        "against the reference",
        "Reference: the model that was given, as it is; nothing of it was fitted to these runs.",
        "model.json is another one: the reference with what has changed.",
    ):
        assert said in page.text, said
    assert "eclared model:" not in page.text
    show(result, tmp_path)
    assert "before: the reference as it is, after: with what has changed" in capsys.readouterr().out.replace("\n", " ")
    _, declared = page_of(tmp_path, make_diagnosis(3))
    assert "model.json is another one" not in declared.text
    assert "Declared model: what the robot file" in declared.text


def test_the_page_has_every_number_of_the_terminal(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Made odd, so that none is there by chance; print differs in its minus sign, its spaces and its powers of ten."""
    from dynid_rs.commands._diagnose_view import show

    result = make_diagnosis(3)
    test = result["rmse"]["test"]
    for k, key in enumerate(("wls", "before", "after")):
        test[key] = [0.08137 + 0.01 * k, 12.3456 + k, 4567.89 + 10 * k]
    test["after_interval"] = [[0.0731, 0.1234], [11.11, 15.678], None]
    test["change_interval"] = [[-0.231, 0.0456], [-0.5123, -0.2345], None]
    test["floor"] = [3.21e-6, 7.0, None]
    result["effects"][0]["parameters"][0] |= {"value": -0.00098765}
    show(result, tmp_path)
    printed = capsys.readouterr().out.partition("RMSE")[2].partition("report:")[0]
    table = [line for line in printed.splitlines() if line.startswith("\u2502")]
    sizes = [line for line in printed.splitlines() if re.match(r"\d+\. |unexplained", line)]
    assert len(table) == 3
    assert len(sizes) >= 4
    numbers = {n for line in table for n in re.findall(r"(?<![\w.])[-+]?\d[\d.]*(?:e[-+]\d+)?(?: %)?", line)}
    numbers |= {n for line in sizes for n in re.findall(r" ([-+]?\d+\.\d+(?:e[-+]\d+)?)", line)}
    assert {"0.0914", "0.0731", "-51", "-23 %", "3.21e-06", "4578", "-0.000988"} <= numbers
    text = page_of(tmp_path, result)[1].text
    missing = [n for n in numbers if typeset(n).replace("\u00a0", " ") not in text.replace("\u00a0", " ")]
    assert missing == []


def test_nothing_to_add(tmp_path: Path) -> None:
    result = make_diagnosis(2) | {"effects": [], "unexplained": [], "steps": [], "next_experiment": []}
    result |= {"nothing_to_add": True, "verdict": "Nothing to add: noise."}
    result["rmse"]["test"]["after"] = result["rmse"]["test"]["before"]
    source, page = page_of(tmp_path, result)
    assert "declared model" in page.text
    assert "effects found" not in page.text  # there are none, so that no bar is of them
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
        (lambda r: r["data"].pop("findings"), "data.findings"),
        (lambda r: r.pop("effects"), "effects"),
        (lambda r: r.pop("unexplained"), "unexplained"),
    ],
)
def test_damaged_parts_are_named(tmp_path: Path, spoil: Any, where: str) -> None:
    result = make_diagnosis(2)
    spoil(result)
    with pytest.raises(DataError, match=re.escape(f'"{where}"')):
        write_report(write_inputs(tmp_path, result, make_residuals(2)))
