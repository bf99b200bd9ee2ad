"""The catalogue of keys: parser, page and schema say the same."""

import json
import tomllib

import jsonschema
import pytest
from helpers.data import ROOT
from scipy import constants

from dynid_rs.base.errors import DataError
from dynid_rs.runs.readers import Config, read_config
from dynid_rs.runs.readers.config import UNITS
from dynid_rs.runs.readers.key_page import page, schema, schema_text
from dynid_rs.runs.readers.keys import KEYS


def test_the_page_and_the_schema_are_made_of_the_code():
    assert (ROOT / "docs" / "reference" / "dynid_toml.md").read_text(encoding="utf-8") == page()
    assert (ROOT / "docs" / "reference" / "dynid_toml.schema.json").read_text(encoding="utf-8") == schema_text()


@pytest.mark.parametrize("key", KEYS, ids=lambda key: f"{key.table}.{key.name}")
def test_every_example_is_read_and_fits_the_schema(key, tmp_path):
    text = f"[{key.table}]\n{key.name} = {key.example}\n"
    if (key.table, key.name) == ("gear", "apply_to"):
        text += "ratio = 100\n"
    (tmp_path / "dynid.toml").write_text(text)
    assert read_config(tmp_path / "dynid.toml") != Config()
    assert list(jsonschema.Draft202012Validator(schema()).iter_errors(tomllib.loads(text))) == []


WRONG = ['[columns]\nt = false', '[columns]\nx = "y"', '[units]\nangle = "turn"', "[robot]\ngravity = [0, 1]",
         "[robot]\ngravity = [0, 0, -981]", '[robot]\njoints = "a"', "[file]\ntopic = 3", "[drive]\ngain = 0",
         "[gear]\nratio = 1\napply_to = []", "[signs]\nq = 2"]  # fmt: skip


@pytest.mark.parametrize("text", WRONG)
def test_what_the_parser_refuses(text, tmp_path):
    (tmp_path / "dynid.toml").write_text(text)
    with pytest.raises(DataError, match=r"dynid\.toml, "):
        read_config(tmp_path / "dynid.toml")
    if "981" not in text:  # how strong gravity is no schema knows
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(tomllib.loads(text), schema())


def test_the_schema_is_one():
    jsonschema.Draft202012Validator.check_schema(json.loads(schema_text()))


def test_gears_that_a_robot_has_given_are_given_once(tmp_path):
    path = tmp_path / "dynid.toml"
    path.write_text('[gear]\napply_to = ["tau"]\n', encoding="utf-8")
    left_open = read_config(path)
    given = left_open.with_gears((50.0, 100.0))
    assert given.gear_ratio == (50.0, 100.0)
    assert given.with_gears((1.0, 1.0)) == given.with_gears(None) == given
    with pytest.raises(DataError, match="needs ratio beside it"):
        left_open.with_gears(None)


def test_what_a_ratio_alone_is_applied_to_is_what_the_page_says():
    (key,) = (key for key in KEYS if key.name == "apply_to")
    assert key.means.endswith(f"; left out beside `ratio`: {', '.join(Config().gear_apply_to)}")


def test_units_are_those_of_the_si():
    told = {
        "time": {
            "s": 1.0,
            "ms": constants.milli,
            "us": constants.micro,
            "ns": constants.nano,
            "100ns": 100 * constants.nano,
            "min": constants.minute,
            "h": constants.hour,
        },
        "angle": {"rad": 1.0, "deg": constants.degree, "mrad": constants.milli, "rev": 2 * constants.pi},
        "velocity": {
            "rad/s": 1.0,
            "deg/s": constants.degree,
            "rpm": 2 * constants.pi / constants.minute,
            "mrad/s": constants.milli,
            "rev/s": 2 * constants.pi,
        },
        "length": {"m": 1.0, "mm": constants.milli, "cm": constants.centi},
        "torque": {
            "N*m": 1.0,
            "mN*m": constants.milli,
            "kN*m": constants.kilo,
            "N*cm": constants.centi,
            "lbf*ft": constants.lbf * constants.foot,
            "lbf*in": constants.lbf * constants.inch,
            "kgf*m": constants.kgf,
            "kgf*cm": constants.kgf * constants.centi,
        },
        "current": {"A": 1.0, "mA": constants.milli},
    }
    assert UNITS.keys() == told.keys()
    for quantity, factors in told.items():
        assert UNITS[quantity] == pytest.approx(factors)
