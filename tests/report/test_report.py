"""The report: whole, offline, safe against what files say, and clear about files it cannot use."""

from __future__ import annotations

import base64
import copy
import html.parser
import json
import os
import re
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from dynid_rs.base.errors import DataError
from dynid_rs.base.files import write_table
from dynid_rs.base.wording import NO_INTERVAL
from dynid_rs.report import write_report

TERMS = ("rigid_body", "rotor_inertia", "torque_offset", "friction", "residual_term")
FRICTION = ("coulomb_pos", "coulomb_neg", "viscous1_pos", "viscous1_neg", "viscous2_pos", "viscous2_neg")
HOSTILE = "<script>alert(1)</script>\"'&{run}$red@0/t"


def make_result(n_joints: int, seed: int = 0) -> dict[str, Any]:
    """A result as `identify` writes it, every part filled; numbers are made up."""
    rng = np.random.default_rng(seed)
    joints = [f"joint_{i}" for i in range(n_joints)]
    std = np.geomspace(40.0, 2.0, n_joints)
    floor = 0.03 * std
    after = floor * rng.uniform(1.0, 1.8, n_joints)
    wls = after * rng.uniform(1.1, 2.0, n_joints)
    wls[-1] = 0.97 * after[-1]

    def parameter(name: str, unit: str, scale: float = 1.0) -> dict[str, Any]:
        value = scale * float(rng.normal())
        error = abs(value) * float(rng.choice([0.01, 0.05, 0.2, 0.9]))
        return {
            "name": name,
            "value": value,
            "unit": unit,
            "std_error": error,
            "interval": [value - 1.96 * error, value + 1.96 * error],
        }

    base = [
        {"link": f"link_{i}", **parameter(f"{name}_{i} + " + f"0.25 m_{i} + " * k + f"Iyy_{i}", unit)}
        for i in range(n_joints)
        for k, (name, unit) in enumerate((("hx", "kg*m"), ("hy", "kg*m"), ("Ixx", "kg*m^2"), ("Izz", "kg*m^2")))
    ]
    joint = [
        {"joint": name, **parameter(kind, "N*m" if "coulomb" in kind else f"N*m*(s/rad)^{kind[7]}", 3.0)}
        for name in joints
        for kind in FRICTION
    ]
    return {
        "format": "dynid-result",
        "version": 1,
        "robot": "six_axis",
        "joints": joints,
        "torque_unit": "N*m",
        "data": {
            "train": ["a.parquet", "b.parquet"],
            "test": ["c.parquet", "d.parquet"],
            "n_samples": {"train": 12000, "test": 4000},
            "n_dropped": {"train": 300, "test": 120},
            "rate_hz": 95.2,
            "cutoff_hz": 8.0,
            "findings": [
                {
                    "code": "jitter",
                    "severity": "info",
                    "file": "a.parquet",
                    "column": "t",
                    "value": 0.0004,
                    "unit": "s",
                    "message": "The time stamps jitter by 0.4 ms; they were resampled to an even grid.",
                },
                {
                    "code": "torque_delay",
                    "severity": "warning",
                    "file": "a.parquet",
                    "column": "tau_1",
                    "rows": [0, 4000],
                    "value": 0.012,
                    "unit": "s",
                    "message": "The torque of joint_1 comes 12 ms late; shift it or say so in dynid.toml.",
                },
            ],
        },
        "rmse": {
            "train": {"before": (0.9 * after).tolist(), "after": (0.9 * after).tolist()},
            "test": {
                "torque_std": std.tolist(),
                "wls": wls.tolist(),
                "before": after.tolist(),
                "after": after.tolist(),
                "after_interval": np.column_stack([0.93 * after, 1.08 * after]).tolist(),
                "floor": floor.tolist(),
            },
        },
        "effects": [],
        "residual": {
            "kind": "gmr",
            "inputs": "deflection",
            "kept": [i % 2 == 0 for i in range(n_joints)],
            "reason": "on runs left out it lowers the error of these joints by more than its spread",
            "rmse_test_without": (1.1 * after).tolist(),
            "rmse_test_with": after.tolist(),
            "n_components": [4] * n_joints,
        },
        "unexplained": [
            {"joint": joints[0], "share": 0.12, "depends_on": [{"signal": f"q_{joints[0]}", "strength": 0.4}]}
        ],
        "parameters": {
            "base": base,
            "joint": joint,
            "friction_shape": [
                {"joint": name, "velocity_threshold": 0.01, "transition_width": 0.02, "unit": "rad/s"}
                for name in joints
            ],
        },
        "encoder_delay": {
            "value": [0.0029] * n_joints,
            "interval": [[0.0027, 0.0031]] * n_joints,
            "unit": "s",
        },
        "base_parameters": {
            "n_base": len(base),
            "n_standard": 10 * n_joints,
            "gap": 1e11,
            "condition_number": 120.0,
        },
        "history": [
            {
                "iteration": k,
                "rmse_train": (after * (1.0 + 0.5 * 0.2**k)).tolist(),
                "rmse_train_after": {
                    loop: (after * (1.0 + extra * 0.2**k)).tolist()
                    for loop, extra in (("friction", 0.7), ("links", 0.6), ("residual", 0.5))
                },
            }
            for k in range(1, 6)
        ],
        "loops": {
            "test": {"wls": wls.tolist(), "friction": wls.tolist(), "links": after.tolist(), "residual": after.tolist()}
        },
        "converged": True,
        "n_iter": 5,
        "floor_method": "Repeated periods of the trajectory",
        "verdict": "The three loops explain the torque to 4 % of its spread on unseen runs, "
        "a third less error than weighted least squares; two joints are at the floor.",
    }


def make_table(n_joints: int, n_per_run: int = 1000, seed: int = 0) -> dict[str, np.ndarray]:
    """Rows as in residuals.parquet: two training runs, two test runs, smooth motion, friction and noise."""
    rng = np.random.default_rng(seed)
    runs = [("a.parquet", "train"), ("b.parquet", "train"), ("c.parquet", "test"), ("d.parquet", "test")]
    n = n_per_run * len(runs)
    t = 1.7e9 + np.tile(np.arange(n_per_run) * 0.05, len(runs)) + np.repeat(np.arange(len(runs)) * 100.0, n_per_run)
    columns: dict[str, np.ndarray] = {
        "run": np.repeat([name for name, _ in runs], n_per_run),
        "set": np.repeat([kind for _, kind in runs], n_per_run),
        "t": t,
    }
    std = np.geomspace(40.0, 2.0, n_joints)
    for i in range(n_joints):
        phase = rng.uniform(0.0, 6.0, 3)
        time_ = (t - t[0])[:, None] * np.array([0.3, 0.7, 1.1]) * (1.0 + 0.1 * i) + phase
        q, dq = np.sin(time_).sum(axis=1), (0.7 * np.cos(time_)).sum(axis=1)
        terms = {
            "rigid_body": std[i] * np.cos(q),
            "rotor_inertia": -0.1 * std[i] * np.sin(time_).sum(axis=1),
            "torque_offset": np.full(n, 0.02 * std[i]),
            "friction": 0.2 * std[i] * np.clip(dq / 0.03, -1.0, 1.0) + 0.1 * std[i] * dq,
            "residual_term": (i % 2 == 0) * 0.01 * std[i] * np.sin(5.0 * q),
        }
        predicted = np.sum(list(terms.values()), axis=0)
        noise = 0.03 * std[i] * np.convolve(rng.normal(size=n), np.ones(4) / 2.0, mode="same")
        residual = noise + 0.04 * std[i] * np.sign(dq) * (np.abs(dq) < 0.2)
        columns |= {f"measured_{i}": predicted + residual, f"predicted_{i}": predicted}
        columns |= {f"{name}_{i}": values for name, values in terms.items()}
        columns |= {f"residual_{i}": residual, f"q_{i}": q, f"dq_{i}": dq}
    return columns


def write_inputs(directory: Path, result: dict[str, Any], columns: dict[str, np.ndarray]) -> Path:
    """Write both files of a result folder."""
    directory.mkdir(parents=True, exist_ok=True)
    (directory / "result.json").write_text(json.dumps(result), encoding="utf-8")
    write_table(directory / "residuals.parquet", columns)
    return directory


class Page(html.parser.HTMLParser):
    """Elements, texts and attributes of a page; fails on end tags that match nothing."""

    VOID = frozenset({"meta", "link", "br", "input", "wbr", "line", "rect", "circle", "hr", "img"})

    def __init__(self, source: str) -> None:
        super().__init__(convert_charrefs=True)
        self.open: list[str] = []
        self.elements: list[tuple[str, dict[str, str]]] = []
        self.texts: list[str] = []
        self.feed(source)
        self.close()
        assert not self.open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, {key: value or "" for key, value in attrs}))
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, {key: value or "" for key, value in attrs}))

    def handle_endtag(self, tag: str) -> None:
        assert self.open, f"</{tag}> closes nothing"
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] not in ("script", "style"):
            self.texts.append(data)

    @property
    def text(self) -> str:
        """Text that people see, spaces made equal."""
        return " ".join("".join(self.texts).split())


def data_of(source: str) -> dict[str, Any]:
    """Figures and arrays that the page carries."""
    found = re.search(r'<script type="application/json" id="report-data">(.*?)</script>', source, re.S)
    assert found
    parsed: dict[str, Any] = json.loads(found[1])
    return parsed


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return write_inputs(tmp_path / "out", make_result(2), make_table(2, 200))


@pytest.mark.parametrize("n_joints", [1, 2, 7, 12])
def test_every_joint_has_its_row_and_its_plots(tmp_path: Path, n_joints: int) -> None:
    result = make_result(n_joints)
    path = write_report(write_inputs(tmp_path, result, make_table(n_joints, 200)))
    source = path.read_text(encoding="utf-8")
    page = Page(source)
    assert path == tmp_path / "report.html"
    assert result["verdict"] in page.text
    drawn = {attrs["data-figure"] for _, attrs in page.elements if "data-figure" in attrs}
    assert drawn == set(data_of(source)["figures"])
    for j, joint in enumerate(result["joints"]):
        assert joint in page.text
        assert {f"time-{j}", f"velocity-{j}", f"noise-{j}"} <= drawn


def test_page_asks_nothing_of_the_network(folder: Path) -> None:
    source = write_report(folder).read_text(encoding="utf-8")
    page = Page(source)
    for tag, attrs in page.elements:
        for name in ("src", "srcset", "href", "action", "data", "poster", "formaction", "style"):
            value = attrs.get(name, "")
            assert not re.search(r"//|url\(|@import", value), f"<{tag} {name}={value!r}>"
        assert not any(name.startswith("on") for name in attrs)
    styles = "".join(re.findall(r"<style>(.*?)</style>", source, re.S))
    assert not re.search(r"https?:|url\(|@import|@font-face", styles)
    policy = next(a["content"] for _, a in page.elements if a.get("http-equiv") == "Content-Security-Policy")
    assert policy.startswith("default-src 'none'")
    assert "http" not in policy
    assert source.count("https://github.com/leeoniya/uPlot (v") == 1
    assert "plotly" not in source.lower()


def test_texts_of_files_are_never_markup(tmp_path: Path) -> None:
    result = make_result(2)
    result = json.loads(json.dumps(result).replace("joint_0", "@@"))

    def poison(value: Any) -> Any:
        if isinstance(value, dict):
            kept = {"format", "version", "severity"}
            return {key: item if key in kept else poison(item) for key, item in value.items()}
        if isinstance(value, list):
            return [poison(item) for item in value]
        return HOSTILE if isinstance(value, str) else value

    columns = make_table(2, 200)
    columns["run"] = np.char.add(columns["run"], HOSTILE)
    columns[HOSTILE + "_0"] = columns["friction_0"]
    source = write_report(write_inputs(tmp_path, poison(result), columns)).read_text(encoding="utf-8")
    page = Page(source)
    assert [tag for tag, _ in page.elements].count("script") == 3
    assert HOSTILE in page.text
    assert "alert(1)</script>" not in source


def test_numbers_units_and_words(folder: Path) -> None:
    text = Page(write_report(folder).read_text(encoding="utf-8")).text
    assert "N\u00b7m" in text
    assert "N*m" not in text
    assert "40.0" in text  # torque std of the first joint
    assert "3.0 %" in text  # floor over torque std
    assert "c.parquet" in text
    assert "It pays on joint_0 and is part of the model there" in text
    assert "2.90" in text  # encoder delay, ms
    assert "Samples12 000 train, 4 000 test" in text
    assert "Of these at standstill300 train, 120 test, neither fitted nor scored" in text
    assert "12 ms late" in text
    assert "rows 1 to 4 000" in text  # counted from 1, as in sentences
    assert text.index("12 ms late") < text.index("jitter")
    assert "NaN" not in text
    assert "None" not in text


def test_errors_in_the_data_are_not_called_warnings(tmp_path: Path) -> None:
    result = make_result(2)
    findings = result["data"]["findings"]
    findings.append({"code": "frozen", "severity": "error", "message": "The torque of joint_0 hangs."})
    page = Page(write_report(write_inputs(tmp_path, result, make_table(2))).read_text(encoding="utf-8"))
    assert "1 error and 1 warning about the data: The torque of joint_0 hangs." in page.text
    assert "1 error and 1 warning, 1 note." in page.text
    findings[:] = findings[2:]
    page = Page(write_report(write_inputs(tmp_path, result, make_table(2))).read_text(encoding="utf-8"))
    assert "1 error, 0 notes." in page.text


def test_the_shape_of_a_smooth_law_is_shown_whole(tmp_path: Path) -> None:
    result = make_result(2)
    shapes = result["parameters"]["friction_shape"]
    plain = write_report(write_inputs(tmp_path / "plain", result, make_table(2, 200))).read_text(encoding="utf-8")
    shapes[1] |= {"sharpness": 1.75}
    text = write_report(write_inputs(tmp_path / "smooth", result, make_table(2, 200))).read_text(encoding="utf-8")
    assert "Sharpness" in text
    assert "1.75" in text
    assert "Sharpness" not in plain


def test_units_of_current_and_prismatic_joints(tmp_path: Path) -> None:
    result = make_result(2)
    result["torque_unit"] = "A"
    result["parameters"]["friction_shape"][1]["unit"] = "m/s"
    source = write_report(write_inputs(tmp_path, result, make_table(2, 200))).read_text(encoding="utf-8")
    figures = data_of(source)["figures"]
    assert [panel["y"] for panel in figures["time-0"]["panels"]] == ["torque [A]", "residual [A]"]
    assert "rad/s" in figures["velocity-0"]["panels"][-1]["x"]
    assert "[m/s]" in figures["velocity-1"]["panels"][-1]["x"]


def test_only_the_required_parts(tmp_path: Path) -> None:
    full = make_result(2)
    test = {key: full["rmse"]["test"][key] for key in ("torque_std", "wls", "before", "after")}
    result = {key: full[key] for key in ("format", "version", "robot", "joints", "torque_unit")}
    result |= {"data": {"train": ["a.parquet"], "test": []}, "rmse": {"test": test}, "encoder_delay": None}
    columns = make_table(2, 200)
    terms = {f"{name}_{i}" for name in (*TERMS, "q") for i in range(2)}
    columns = {name: values for name, values in columns.items() if name not in terms}
    columns["set"] = np.full(columns["t"].size, "train")
    text = Page(write_report(write_inputs(tmp_path, result, columns)).read_text(encoding="utf-8")).text
    assert "there is no test run in the table" in text
    assert "Third loop" not in text
    assert "two encoders" not in text
    assert "No findings" in text


def test_third_loop_left_out_and_joint_that_never_moved(tmp_path: Path) -> None:
    result, columns = make_result(2), make_table(2, 200)
    result["residual"] |= {"kept": False, "reason": "no gain on runs left out"}
    result["rmse"]["test"]["torque_std"][1] = 0.0
    result["rmse"]["test"]["after_interval"][1] = None
    result["parameters"]["joint"][0] |= {"value": 0.0, "std_error": 0.0, "interval": [0.0, 0.0]}
    for name in columns:
        if name.endswith("_1"):
            columns[name] = np.zeros_like(columns[name])
    text = Page(write_report(write_inputs(tmp_path, result, columns)).read_text(encoding="utf-8")).text
    assert "It was left out of the model" in text
    assert "no gain on runs left out" in text
    assert NO_INTERVAL in text


def test_what_a_joint_leaves_at_rest_is_in_no_picture_of_friction_or_noise(tmp_path: Path) -> None:
    """It is not scored: a picture with it showed another error than the one beside it."""
    result, columns = make_result(3), make_table(3, 200)
    rests = np.arange(columns["t"].size) % 200 < 50
    error = columns["residual_0"].copy()
    columns["residual_0"] = np.where(rests, 100.0, error)
    columns |= {f"moves_{j}": ~rests & (j < 2) for j in range(3)}
    source = write_report(write_inputs(tmp_path, result, columns)).read_text(encoding="utf-8")
    scored = error[~rests & (columns["set"] == "test")]
    np.testing.assert_allclose(np.sort(array_of(source, "v/0/residual")), np.sort(scored), rtol=1e-5, atol=1e-6)
    assert np.abs(array_of(source, "n/0/bin")).max() < 5.0 * np.abs(scored).max()
    lags = array_of(source, "n/0/acf")
    assert lags[0] == pytest.approx(1.0)
    assert abs(lags[-1]) < 0.5  # a rest of 2.5 s at one value would be remembered over all lags
    assert array_of(source, "v/2/residual").size == 0  # it never moved
    assert "Where a joint stands still nothing is shown" in Page(source).text


def test_effects_are_shown(tmp_path: Path) -> None:
    result = make_result(2)
    result["effects"] = [
        {
            "rank": 1,
            "kind": "load_dependent_friction",
            "joints": ["joint_1"],
            "rmse_test_before": [2.4, 1.9],
            "rmse_test_after": [2.4, 1.234],
            "p_value": 1e-9,
            "parameters": [{"name": "m0", "value": 0.061, "unit": "1", "interval": [0.058, 0.064]}],
            "ties": [{"kind": "position_dependent_friction", "joints": ["joint_1"], "rmse_test_after": [1.3]}],
        }
    ]
    text = Page(write_report(write_inputs(tmp_path, result, make_table(2, 200))).read_text(encoding="utf-8")).text
    for said in (
        "Load-dependent friction",
        "0.0610",
        "without it 1.90, with it 1.23",
        "Not told apart from position-dependent friction",
        "with effects",
    ):
        assert said in text


def test_long_runs_stay_small_and_keep_their_peaks(tmp_path: Path) -> None:
    columns = make_table(6, 20_000)
    peak = 2 * 20_000 + 7_777  # in the first test run
    columns["residual_3"][peak] = 99.0
    folder = write_inputs(tmp_path, make_result(6), columns)
    source = write_report(folder).read_text(encoding="utf-8")
    assert len(source.encode()) < 1_500_000
    assert "time slices" in Page(source).text
    residual = array_of(source, "0/3/residual")
    assert residual.size < 5000
    assert residual.max() == 99.0
    t = array_of(source, "0/t")
    assert t[0] == 0.0
    assert (np.diff(t) > 0.0).all()


def test_gaps_in_time_break_the_line(tmp_path: Path) -> None:
    columns = make_table(2, 300)
    keep = np.ones(columns["t"].size, dtype=bool)
    keep[2 * 300 + 100 : 2 * 300 + 150] = False
    columns = {name: values[keep] for name, values in columns.items()}
    source = write_report(write_inputs(tmp_path, make_result(2), columns)).read_text(encoding="utf-8")
    assert np.flatnonzero(np.isnan(array_of(source, "0/0/measured"))).tolist() == [100]
    assert not np.isnan(array_of(source, "1/0/measured")).any()


@pytest.mark.parametrize("n_rows", [1, 2, 3])
def test_a_handful_of_rows_is_enough(tmp_path: Path, n_rows: int) -> None:
    columns = make_table(2, 200)
    first = np.flatnonzero(columns["set"] == "test")[:n_rows]
    folder = write_inputs(tmp_path, make_result(2), {name: values[first] for name, values in columns.items()})
    assert array_of(write_report(folder).read_text(encoding="utf-8"), "0/t").size == n_rows


def test_absurd_but_finite_numbers(tmp_path: Path) -> None:
    result = make_result(2)
    result["rmse"]["test"] |= {"torque_std": [1e-300, 1e300], "wls": [1e300, 1e-300], "floor": [0.0, None]}
    result["parameters"]["base"][0] |= {"value": 5e-324, "std_error": 1e300, "interval": [-1e300, 1e300]}
    result["history"][0]["rmse_train_after"]["friction"] = [5e-324, 0.0]
    result["loops"]["test"]["wls"] = [1e300, 5e-324]
    path = write_report(write_inputs(tmp_path, result, make_table(2, 200)))
    text = Page(path.read_text(encoding="utf-8")).text
    assert not re.search(r"\b(inf|nan)\b", text)
    assert max(map(len, text.split())) < 60  # no number written out with its 300 zeros


def array_of(source: str, key: str) -> np.ndarray:
    """One array of the page's pool."""
    return np.frombuffer(base64.b64decode(data_of(source)["arrays"][key]), dtype="<f4")


def test_same_input_same_bytes(folder: Path) -> None:
    first = write_report(folder).read_bytes()
    assert write_report(folder).read_bytes() == first


def test_report_is_quick(tmp_path: Path) -> None:
    folder = write_inputs(tmp_path, make_result(6), make_table(6, 1000))
    write_report(folder)
    start = time.process_time()
    write_report(folder)
    assert time.process_time() - start < 2.0  # 0.15 s on an idle machine


def spoil(result: dict[str, Any], path: str, value: Any) -> dict[str, Any]:
    """Copy of `result` with one value replaced; ``...`` removes it."""
    spoiled: Any = copy.deepcopy(result)
    *way, last = (int(step) if step.isdecimal() else step for step in path.split("."))
    inner = spoiled
    for step in way:
        inner = inner[step]
    if value is ...:
        del inner[last]
    else:
        inner[last] = value
    result = spoiled
    return result


@pytest.mark.parametrize(
    ("path", "value", "said"),
    [
        ("format", "other", '"format" must be "dynid-result"'),
        ("version", 2, '"version" must be 1, found 2'),
        ("joints", [], '"joints" must be a list of at least one name'),
        ("joints", [1, 2], '"joints[0]" must be text, found 1'),
        ("robot", ..., '"robot" is missing'),
        ("data.train", "a.parquet", '"data.train" must be a list, found "a.parquet"'),
        ("data.findings", [{"severity": "info"}], '"data.findings[0].message" is missing'),
        ("rmse.test.after", [1.0], '"rmse.test.after" must hold one entry per joint (2), found 1'),
        ("rmse.test.floor", [1.0, "x"], '"rmse.test.floor[1]" must be a finite number, found "x"'),
        ("rmse.test.floor", [1.0, 10**400], '"rmse.test.floor[1]" must be a finite number'),
        ("rmse.test.after_interval", [[1.0], None], '"rmse.test.after_interval[0]" must be two numbers'),
        ("residual.kept", "yes", '"residual.kept" must be true or false, found "yes"'),
        ("residual.kept", [True], '"residual.kept" must hold one entry per joint (2), found 1'),
        ("encoder_delay", 0.003, '"encoder_delay" must be an object, found 0.003'),
        ("parameters.base.3.value", None, '"parameters.base[3].value" is missing'),
        ("history.1.rmse_train", [1.0], '"history[1].rmse_train" must hold one entry per joint (2), found 1'),
    ],
)
def test_result_that_is_not_one(folder: Path, path: str, value: Any, said: str) -> None:
    (folder / "result.json").write_text(json.dumps(spoil(make_result(2), path, value)), encoding="utf-8")
    refused(folder, DataError, "result.json: " + said)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (b'{"format": "dynid-result",\n "joints": [', "line 2, column 13: this is not JSON"),
        (b"\xff\xfe{}", "byte 0 is not UTF-8 text"),
        (b"", "the file is empty"),
        (b"[]", '"format" must be "dynid-result"'),
        (b'{"format": NaN}', "NaN is not a JSON number"),
        (b"[" * 200_000, "this is not JSON that can be read"),
        (b'{"version": ' + b"9" * 5000 + b"}", "this is not JSON that can be read"),
    ],
)
def test_result_that_cannot_be_read(folder: Path, text: bytes, said: str) -> None:
    (folder / "result.json").write_bytes(text)
    refused(folder, DataError, said)


@pytest.mark.parametrize("name", ["result.json", "residuals.parquet"])
def test_missing_file(folder: Path, name: str) -> None:
    (folder / name).unlink()
    refused(folder, FileNotFoundError, f"{name}: cannot read this file: it does not exist")


def test_missing_folder(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="there is no such folder"):
        write_report(tmp_path / "nowhere")


@pytest.mark.parametrize(
    ("column", "values", "said"),
    [
        ("measured_1", None, "column measured_1 is missing"),
        ("set", None, "column set is missing"),
        ("dq_0", np.full(800, "x"), "column dq_0 must hold numbers"),
        (
            "t",
            np.where(np.arange(800) == 17, np.nan, np.arange(800.0)),
            "column t, row 17: not a finite number",
        ),
    ],
)
def test_table_that_does_not_fit(folder: Path, column: str, values: np.ndarray | None, said: str) -> None:
    columns = make_table(2, 200)
    del columns[column]
    write_table(folder / "residuals.parquet", columns if values is None else columns | {column: values})
    refused(folder, DataError, "residuals.parquet: " + said)


@pytest.mark.parametrize("cut", [5, 1000, -20])
def test_table_cut_off(folder: Path, cut: int) -> None:
    path = folder / "residuals.parquet"
    path.write_bytes(path.read_bytes()[:cut])
    refused(folder, DataError, "this is not a readable Parquet file")


def test_table_without_rows(folder: Path) -> None:
    write_table(folder / "residuals.parquet", {name: values[:0] for name, values in make_table(2, 200).items()})
    refused(folder, DataError, "it holds no rows")


def refused(folder: Path, kind: type[Exception], said: str) -> None:
    """One sentence, and no file that was not there before."""
    before = sorted(path.name for path in folder.iterdir())
    with pytest.raises(kind) as caught:
        write_report(folder)
    sentence = str(caught.value)
    assert said in sentence
    assert "\n" not in sentence
    assert sorted(path.name for path in folder.iterdir()) == before


def test_old_report_stays_when_writing_fails(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    old = write_report(folder).read_bytes()

    def full(self: Path, data: bytes) -> int:
        with self.open("wb") as file:
            file.write(data[:100])
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(OSError, match=r"report\.html: cannot write this file: no space left on device"):
        write_report(folder)
    monkeypatch.undo()
    assert (folder / "report.html").read_bytes() == old
    assert sorted(path.name for path in folder.iterdir()) == [
        "report.html",
        "residuals.parquet",
        "result.json",
    ]


def test_command_says_where(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from dynid_rs.commands.report import report

    report(folder)
    assert capsys.readouterr().out.strip() == str(folder / "report.html")
    report(folder, json_output=True)
    assert json.loads(capsys.readouterr().out) == {"report": str(folder / "report.html")}


def test_command_refuses_with_one_sentence(folder: Path) -> None:
    from dynid_rs.commands.report import report

    app = typer.Typer()
    app.command()(report)
    (folder / "result.json").unlink()
    answer = CliRunner().invoke(app, [str(folder), "--json"])
    assert answer.exit_code == 2
    assert answer.stderr.count("\n") == 1
    error = json.loads(answer.stdout)["error"]
    assert error["class"] == "FileNotFoundError"
    assert error["message"] in answer.stderr


def test_nothing_heavy_is_imported(folder: Path) -> None:
    code = (
        "import sys; from pathlib import Path; from dynid_rs.report import write_report; "
        f"write_report(Path({str(folder)!r})); "
        "print([name for name in sys.modules if name.split('.')[0] in ('matplotlib', 'sklearn', 'scipy')])"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment())
    assert run.stdout.strip() == "[]"


def environment() -> dict[str, str]:
    """Environment in which a child finds this very package."""
    import dynid_rs

    return {**os.environ, "PYTHONPATH": str(Path(dynid_rs.__file__).parents[1])}
