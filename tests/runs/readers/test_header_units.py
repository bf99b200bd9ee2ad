"""Units in headers: the usual ones are followed in every format, others are refused; columns by either name."""

import numpy as np
import pandas
import pytest
from scipy import constants

from dynid_rs.base.errors import DataError
from dynid_rs.base.findings import Finding
from dynid_rs.runs.readers import open_run, read_recording, read_run
from dynid_rs.runs.readers.columns import ColumnMap
from dynid_rs.runs.readers.file_words import in_file_words
from dynid_rs.runs.readers.key_page import page

JOINTS = ["a", "b"]
ROWS = np.arange(50)
SI = {
    "t": ROWS / 100,
    "q_0": np.sin(ROWS / 9),
    "q_1": np.cos(ROWS / 7),
    "tau_0": ROWS % 5 + 0.5,
    "tau_1": ROWS % 7 - 1.0,
}


def table(units=None, names=None, also=None):
    """The run in other units and under other names: signal -> (what stands behind its name, its factor to SI)."""
    made = {}
    for name, values in {**SI, **(also or {})}.items():
        signal = name.partition("_")[0]
        behind, factor = (units or {}).get(name, (units or {}).get(signal, ("", 1.0)))
        made[(names or {}).get(name, name) + behind] = values / factor
    return pandas.DataFrame(made)


def write(path, frame):
    if path.suffix == ".csv":
        frame.to_csv(path, index=False)
    elif path.suffix == ".jsonl":
        frame.to_json(path, orient="records", lines=True, double_precision=15)
    else:
        frame.to_parquet(path)
    return path


def assert_same(run):
    np.testing.assert_allclose(run.t, SI["t"], rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(run.q, np.column_stack([SI["q_0"], SI["q_1"]]), rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(run.tau, np.column_stack([SI["tau_0"], SI["tau_1"]]), rtol=1e-10, atol=1e-10)


KNOWN = [
    ("t", "[min]", constants.minute),
    ("t", "(h)", constants.hour),
    ("q", "[mrad]", constants.milli),
    ("q", "[rev]", 2 * np.pi),
    ("q", "[°]", constants.degree),
    ("tau", "[Ncm]", constants.centi),
    ("tau", "[N-cm]", constants.centi),
    ("tau", "[mNm]", constants.milli),
    ("tau", "[ft lb]", constants.lbf * constants.foot),
    ("tau", "(lbf·ft)", constants.lbf * constants.foot),
    ("tau", "[in-lb]", constants.lbf * constants.inch),
    ("tau", "[kgf*cm]", constants.kgf * constants.centi),
    ("tau", "[N⋅m]", 1.0),
    ("tau", "(N.m)", 1.0),
]


@pytest.mark.parametrize(("signal", "unit", "factor"), KNOWN)
@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".jsonl"])
def test_ordinary_units_are_followed_in_every_format(signal, unit, factor, suffix, tmp_path):
    path = write(tmp_path / f"run{suffix}", table({signal: (f" {unit}", factor)}))
    run = read_run(path, JOINTS)
    assert_same(run.recording)
    assert run.columns.used() == tuple(SI)


def test_ordinary_units_are_followed_in_a_data_frame():
    assert_same(read_recording(table({"t": (" [ms]", 1e-3), "q": ("[deg]", constants.degree)}), JOINTS))


UNKNOWN = {
    "torque": ({"tau": (" [furlong]", 1.0)}, "tau", "furlong, beside column {}, is no unit that is known, and tau is"),
    "angle": (
        {"q": (" [counts]", 1.0)},
        "q",
        "counts, beside column {}, is no unit that is known, and q is read in rad",
    ),
    "time": ({"t": (" (ticks)", 1.0)}, "t", "ticks, beside column {}, is no unit that is known, and t is read in s"),
    "comment": ({"q": (" (joint)", 1.0)}, "q", "joint, beside column {}, is no unit that is known"),
}


@pytest.mark.parametrize(("units", "signal", "said"), UNKNOWN.values(), ids=UNKNOWN)
@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_an_unknown_unit_is_said(units, signal, said, suffix, tmp_path):
    frame = table(units)
    columns = [name for name in frame if name.split(" ")[0].split("_")[0] == signal]
    rule = columns[0] if signal == "t" else columns
    run = read_run(write(tmp_path / f"run{suffix}", frame), JOINTS, {"columns": {signal: rule}})
    assert_same(run.recording)
    (finding,) = [one for one in run.findings() if one.code == "unknown_unit"]
    assert (finding.severity, finding.column) == ("warning", columns[0])
    assert said.format(columns[0]) in finding.message


def test_a_unit_that_the_rules_say_is_that(tmp_path):
    path = write(tmp_path / "run.csv", table({"tau": (" [furlong]", 1.0)}, {"tau_0": "M_1", "tau_1": "M_2"}))
    rules = {"columns": {"tau": "M_{n} [furlong]"}, "units": {"torque": "mN*m"}}
    run = read_run(path, JOINTS, rules)
    np.testing.assert_allclose(1e3 * run.recording.tau[:, 0], SI["tau_0"])
    assert "unknown_unit" not in {finding.code for finding in run.findings()}


def test_the_unit_of_another_quantity_is_refused(tmp_path):
    with pytest.raises(DataError, match=r"Nm, the unit of column q_0 \[Nm\], is none of q; write it in one of rad"):
        read_recording(write(tmp_path / "run.csv", table({"q": (" [Nm]", 1.0)})), JOINTS)


@pytest.mark.parametrize("other", ["inc", "raw"])
@pytest.mark.parametrize("space", ["", " "])
def test_a_column_in_a_known_unit_goes_before_one_in_another(other, space, tmp_path):
    frame = table({"q": (f"{space}[deg]", constants.degree)})
    for joint in range(2):
        frame[f"q_{joint}{space}[{other}]"] = 7.0 * ROWS
    assert_same(read_recording(write(tmp_path / "run.csv", frame), JOINTS))


def test_an_unknown_unit_of_what_is_not_read_is_nobodys_concern(tmp_path):
    also = {"force_0": ROWS * 1.0}
    assert_same(read_recording(write(tmp_path / "run.csv", table({"force": (" [furlong]", 1.0)}, also=also)), JOINTS))


def test_temperatures_are_in_degrees_celsius_or_left_out(tmp_path):
    also = {"temperature_0": 300.0 + ROWS, "temperature_1": 300.0 + ROWS}
    path = write(tmp_path / "run.csv", table({"temperature": (" [K]", 1.0)}, also=also))
    rules = {"columns": {"temperature": ["temperature_0 [K]", "temperature_1 [K]"]}}
    said = [one.message for one in read_run(path, JOINTS, rules).findings() if one.code == "unknown_unit"]
    assert ["write it in degC, or leave it out" in text for text in said] == [True]
    assert_same(read_recording(path, JOINTS, {"columns": {"temperature": False}}))


@pytest.mark.parametrize(
    ("q", "tau"),
    [("pos[{joint}]", "M[{joint}]"), ("pos[A{n}]", "M[A{n}]"), ("pos {n} (ist)", "M {n} (ist)")],
)
def test_what_stands_in_brackets_and_names_a_channel_is_no_unit(q, tau, tmp_path):
    rules = {"columns": {"q": q, "tau": tau}}
    names = {"q": q, "tau": tau}
    frame = table(
        names={
            f"{signal}_{i}": rule.format(i=i, n=i + 1, joint=joint)
            for signal, rule in names.items()
            for i, joint in enumerate(JOINTS)
        }
    )
    assert_same(read_recording(write(tmp_path / "run.csv", frame), JOINTS, rules))


def test_dates_need_no_unit(tmp_path):
    frame = table()
    frame["t"] = [f"2024-05-01T12:00:{k / 100:09.6f}" for k in ROWS]
    path = write(tmp_path / "run.csv", frame.rename(columns={"t": "stamp [UTC]"}))
    assert_same(read_recording(path, JOINTS, {"columns": {"t": "stamp [UTC]"}}))


GERMAN = {"t": "Zeit", "q_0": "Achse 1 Ist", "q_1": "Achse 2 Ist", "tau_0": "M 1", "tau_1": "M 2"}
UNITS = {"t": (" [ms]", 1e-3), "q": (" [°]", constants.degree), "tau": (" (Nm)", 1.0)}
RULES = [
    {"t": "Zeit [ms]", "q": "Achse {n} Ist [°]", "tau": "M {n} (Nm)"},
    {"t": "Zeit", "q": "Achse {n} Ist", "tau": "M {n}"},
    {"t": "Zeit [ms]", "q": ["Achse 1 Ist [°]", "Achse 2 Ist"], "tau": "M {n} (Nm)"},
]


@pytest.mark.parametrize("rules", RULES)
@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
@pytest.mark.parametrize("joints", [JOINTS, None])
def test_columns_are_named_as_they_stand_in_the_file_or_less_their_units(rules, suffix, joints, tmp_path):
    path = write(tmp_path / f"run{suffix}", table(UNITS, GERMAN))
    assert_same(read_recording(path, joints, {"columns": rules}))


def test_messages_name_columns_as_they_stand_in_the_file(tmp_path):
    path = write(tmp_path / "run.csv", table(UNITS, GERMAN))
    with pytest.raises(DataError) as caught:
        read_recording(path, JOINTS, {"columns": {**RULES[0], "t": "Zeit [s]"}})
    said = str(caught.value)
    assert "the time column is missing, expected Zeit [s]; the file has Zeit [ms], Achse 1 Ist [°]," in said
    frame = table(UNITS, GERMAN).astype(object)
    frame.iloc[7, 1] = "x"
    with pytest.raises(DataError, match=r"column Achse 1 Ist \[°\]: 'x' is not a number"):
        read_recording(write(path, frame), JOINTS, {"columns": RULES[1]})


def test_two_columns_that_only_their_units_tell_apart_keep_them(tmp_path):
    frame = table({"q": (" [rad]", 1.0)})
    for joint in range(2):
        frame[f"q_{joint} [deg]"] = np.rad2deg(SI[f"q_{joint}"])
    path = write(tmp_path / "run.csv", frame)
    assert {"q_0 [rad]", "q_0 [deg]", "t"} <= set(open_run(path, JOINTS).names)
    for unit in ("rad", "deg"):
        assert_same(read_recording(path, JOINTS, {"columns": {"q": f"q_{{i}} [{unit}]"}}))


def test_a_mend_for_two_units_is_one_that_works(tmp_path):
    path = write(tmp_path / "run.csv", table({"q_0": (" [rad]", 1.0), "q_1": (" [deg]", constants.degree)}))
    with pytest.raises(DataError, match=r"write them again in one unit$"):
        read_recording(path, JOINTS)
    also = {"qm_0": SI["q_0"], "qm_1": SI["q_1"]}
    units = {"q": (" [rad]", 1.0), "qm": (" [deg]", constants.degree)}
    path = write(tmp_path / "run.csv", table(units, also=also))
    with pytest.raises(DataError, match=r"or leave q_motor out in dynid.toml: \[columns\] q_motor = false$"):
        read_recording(path, JOINTS)
    assert_same(read_recording(path, JOINTS, {"columns": {"q_motor": False}}))


@pytest.mark.parametrize(
    ("unit", "factor"), [("[deg/s]", constants.degree), ("[deg]", constants.degree), ("[m/s]", 1.0)]
)
def test_a_velocity_may_be_an_angle_a_second_or_that_of_a_slide(unit, factor, tmp_path):
    also = {f"dq_{joint}": np.gradient(SI[f"q_{joint}"], SI["t"]) for joint in range(2)}
    run = read_recording(write(tmp_path / "run.csv", table({"dq": (f" {unit}", factor)}, also=also)), JOINTS)
    np.testing.assert_allclose(run.dq[:, 1], also["dq_1"], rtol=1e-9, atol=1e-9)


def test_a_file_that_is_called_like_a_channel_keeps_its_name():
    columns = ColumnMap("t", {"q": ("Winkel A", "Winkel B")}, ())
    finding = Finding(
        "copied", "warning", "all of q_0 and q_1. are in q_0.csv, a/q_0 and run-q_1 too", "q_1.csv", "q_1"
    )
    told = in_file_words(finding, columns)
    assert told.message == "all of Winkel A and Winkel B. are in q_0.csv, a/q_0 and run-q_1 too"
    assert told.column == "Winkel B"


def test_the_page_says_what_becomes_of_units():
    text = " ".join(page().split())
    assert "A unit of another quantity in brackets is refused" in text
    assert "may be a comment, and is a warning where its column is read" in text
