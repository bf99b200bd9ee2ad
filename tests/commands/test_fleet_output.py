"""What `dynid fleet` writes of arms that it has compared: columns, fleet.json, quantities.parquet, words."""

from __future__ import annotations

import csv
import json

import jsonschema
import numpy as np
import pyarrow.parquet as pq
import pytest
from helpers.data import ROOT
from helpers.pooled_arms import N_ARMS, PLANTED, identified
from helpers.small_arm import dynid, refusal, snapshot

SCHEMA = json.loads((ROOT / "docs" / "reference" / "fleet.schema.json").read_text(encoding="utf-8"))


def answer():
    return json.loads((identified().output / "fleet.json").read_text(encoding="utf-8"))


def test_fleet_json_is_what_its_schema_says():
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    jsonschema.validate(answer(), SCHEMA)
    rows = answer()["robots"]
    assert [row["odd"] for row in rows] == ["yes" if k in PLANTED else "no" for k in range(N_ARMS)]
    assert answer()["odd"] == len(PLANTED)
    for number, odd in PLANTED.items():
        (cause,) = rows[number]["causes"]
        assert (cause["kind"], cause["place"]) == (odd.kind, odd.place)
        assert rows[number]["why"].startswith(f"{odd.place}: ")
        assert rows[number]["p_value"] < 0.05
    assert all("estimate" not in row for row in rows)


def test_tables_have_the_same_rows():
    output, rows = identified().output, answer()["robots"]
    text = list(csv.DictReader((output / "fleet.csv").read_text(encoding="utf-8").splitlines()))
    table = pq.read_table(output / "fleet.parquet").to_pydict()
    for key in ("name", "type", "odd"):
        assert [row[key] for row in text] == table[key] == [row[key] for row in rows]
    assert [row["why"] for row in text] == [row["why"] or "" for row in rows]
    np.testing.assert_allclose(table["deviations"], [row["deviations"] for row in rows])


def test_quantities_are_those_of_the_fleet():
    found = identified()
    (one,) = found.fleet.types_
    table = pq.read_table(found.output / "quantities.parquet").to_pydict()
    assert len(table["arm"]) == N_ARMS * len(one.quantities)
    for q, quantity in enumerate(one.quantities):
        part = slice(q * N_ARMS, (q + 1) * N_ARMS)
        assert set(table["kind"][part]) == {quantity.kind}
        np.testing.assert_allclose(table["estimate"][part], quantity.y)
        np.testing.assert_allclose(table["deviations"][part], one.judged[q].deviations)
        low, high = np.array(table["pooled_low"][part]), np.array(table["pooled_high"][part])
        assert np.all((low <= table["pooled"][part]) & (table["pooled"][part] <= high))
        for k in PLANTED:  # an odd arm keeps its own
            assert table["pooled"][part][k] == table["estimate"][part][k]


def test_the_command_says_it_and_a_new_type_identifies_nothing_again(tmp_path):
    """A quarter of the arms is said to be of another type, which is too small then; models stay as they are."""
    found = identified()
    text = found.toml.read_text(encoding="utf-8")
    for k in range(0, N_ARMS, 4):
        text = text.replace(f'name = "arm_{k:04d}"', f'name = "arm_{k:04d}"\ntype = "quarter"')
    toml = found.folder / "typed.toml"
    toml.write_text(text, encoding="utf-8")
    before = snapshot(found.output / "arm_0000")
    stamp = (found.output / "arm_0000" / "model.json").stat().st_mtime_ns
    kept = {name: (found.output / name).read_bytes() for name in ("fleet.json", "fleet.csv", "fleet.html")}
    printed = dynid("fleet", toml, "-o", found.output)
    assert printed.exit_code == 0, printed.output
    assert {row["type"] for row in answer()["robots"]} == {"light_arm", "quarter"}
    assert "too few arms of this type to say: 6, and" in printed.stdout
    assert (found.output / "arm_0000" / "model.json").stat().st_mtime_ns == stamp
    assert snapshot(found.output / "arm_0000") == before
    printed = dynid("fleet", found.toml, "-o", found.output)
    assert "arm_0008 is odd: wrist: gain +" in printed.stdout
    assert f"{len(PLANTED)} of {N_ARMS} arms are odd; chance of a false alarm in all at most 5.0 %" in printed.stdout
    assert {name: (found.output / name).read_bytes() for name in kept} == kept


def test_the_rate_is_an_option(tmp_path):
    found = identified()
    printed = dynid("fleet", found.toml, "-o", found.output, "--false-alarms", "0.5", "--json")
    assert printed.exit_code == 0
    assert json.loads(printed.stdout)["pooling"]["false_alarms"] == 0.5
    dynid("fleet", found.toml, "-o", found.output)
    for rate in ("0", "1", "nan"):
        said = refusal(dynid("fleet", found.toml, "-o", tmp_path / "out", "--false-alarms", rate))
        assert "--false-alarms must be a probability between 0 and 1" in said


@pytest.mark.parametrize("value", ["3", '""', "[1]"])
def test_a_type_is_a_word(tmp_path, value):
    path = tmp_path / "fleet.toml"
    path.write_text(f'[[robot]]\nname = "a"\ntype = {value}\n', encoding="utf-8")
    assert "robot 1: type must be a word" in refusal(dynid("fleet", path, "-o", tmp_path / "out"))


def test_a_fleet_of_which_none_could_be_identified(tmp_path):
    path = tmp_path / "fleet.toml"
    path.write_text('[[robot]]\nname = "a"\nrobot = "no.urdf"\nruns = "no.csv"\n', encoding="utf-8")
    printed = dynid("fleet", path, "-o", tmp_path / "out")
    assert printed.exit_code == 1
    told = json.loads((tmp_path / "out" / "fleet.json").read_text(encoding="utf-8"))
    jsonschema.validate(told, SCHEMA)
    assert told["pooling"] is None
    assert "No arm could be compared." in (tmp_path / "out" / "fleet.html").read_text(encoding="utf-8")
