"""Whatever a file holds, a sentence about it is short and comes at once."""

import json
import shutil
import time

import pytest
from helpers.small_arm import dynid, refusal, study

from dynid_rs.base.quoting import shown, shown_ends
from dynid_rs.base.units import plain_unit
from dynid_rs.diagnosis.wording import effect_words, number_words


def test_versions_without_an_end_are_quoted_short(tmp_path):
    for name in ("result.json", "residuals.parquet", "model.json"):
        shutil.copy(study().output / name, tmp_path / name)
        if name.endswith(".json"):
            content = json.loads((tmp_path / name).read_text())
            (tmp_path / name).write_text(json.dumps(content | {"version": "9" * 1_000_000}))
    sentence = refusal(dynid("report", tmp_path))
    assert '"version" must be 1, found' in sentence
    assert len(sentence) < len(str(tmp_path)) + 200
    sentence = refusal(dynid("estimate", tmp_path / "model.json", study().runs[0]))
    assert "999" in sentence
    assert len(sentence) < len(str(tmp_path)) + 250


LONG = "9" * 400_000  # larger files are refused unread
FILES = {
    "limits_unit": (
        "l.toml",
        f'[units]\nangle = "{LONG}"\n',
        ("excite", "ROBOT", "-o", "DIR/p.csv", "--limits", "FILE"),
    ),
    "limits_table": ("l.toml", f"[{LONG}]\n", ("excite", "ROBOT", "-o", "DIR/p.csv", "--limits", "FILE")),
    "limits_twice": ("l.toml", f"[{LONG}]\n[{LONG}]\n", ("excite", "ROBOT", "-o", "DIR/p.csv", "--limits", "FILE")),
    "config_unit": (
        "c.toml",
        f'[units]\nangle = "{LONG}"\n',
        ("inspect", "RUN", "--robot", "ROBOT", "--config", "FILE"),
    ),
    "config_column": (
        "c.toml",
        f'[columns]\nq = "{{{LONG}}}"\n',
        ("inspect", "RUN", "--robot", "ROBOT", "--config", "FILE"),
    ),
    "fleet_name": ("f.toml", f'[[robot]]\nname = "!{LONG}"\n', ("fleet", "FILE", "-o", "DIR/out")),
    "fleet_key": ("f.toml", f"{LONG} = 1\n", ("fleet", "FILE", "-o", "DIR/out")),
    "fleet_twice": ("f.toml", f'[[robot]]\nname = "{LONG}"\n' * 2, ("fleet", "FILE", "-o", "DIR/out")),
    "known": (
        "k.toml",
        f'[[term]]\nkind = "{LONG}"\n',
        ("identify", "ROBOT", "RUN", "-o", "DIR/out", "--known", "FILE"),
    ),
}
"""Files that hold a word without an end, and commands that read them."""


@pytest.mark.parametrize(("name", "text", "arguments"), FILES.values(), ids=FILES)
def test_a_word_without_an_end_is_a_line_in_a_sentence(name, text, arguments, tmp_path):
    path = tmp_path / name
    path.write_text(text)
    places = {"ROBOT": study().robot, "RUN": study().runs[0], "FILE": path, "DIR/p.csv": tmp_path / "p.csv"}
    places["DIR/out"] = tmp_path / "out"
    done = dynid(*(places.get(word, word) for word in arguments), "--json")
    assert done.exit_code == 2
    error = json.loads(done.stdout)["error"]
    assert "999" in error["message"]
    assert len(error["message"]) < len(str(path)) + 400
    assert all(len(str(value)) < len(str(path)) + 400 for value in error.values())


CELL = "9" * 100_000 + "x"  # csv takes cells up to 131072 characters
RUNS = {
    "name": (f"{CELL},x,tau_0\n1,2,3\n", "run.csv: column tau_1 or tau_elbow"),
    "cell": (f"t,q_0,q_1,q_2,tau_0,tau_1,tau_2\n1,2,3,4,5,6,{CELL}\n", "run.csv, row 1 (line 2), column tau_2: "),
}


@pytest.mark.parametrize(("text", "words"), RUNS.values(), ids=RUNS)
def test_a_run_with_a_word_without_an_end_is_refused_at_once(text, words, tmp_path):
    """Reading it as a number took time by the square of its length."""
    (tmp_path / "run.csv").write_text(text)
    model = study().output / "model.json"
    begin = time.process_time()
    sentence = refusal(dynid("estimate", model, tmp_path / "run.csv"))
    assert time.process_time() - begin < 5.0
    assert words in sentence
    assert len(sentence) < 400


def test_long_words_of_a_library_keep_both_ends():
    long = shown_ends(f"Cannot declare ('{LONG}',) twice\n (at line 2, column 5)")
    assert long.startswith("Cannot declare ('999")
    assert long.endswith("999',) twice (at line 2, column 5)")
    assert len(long) <= 160
    assert shown_ends("a\nshort  one") == "a short one"
    assert shown("a\x1bb") == "a\\x1bb"


def test_a_unit_is_typed_without_needless_brackets():
    assert plain_unit("1/(A)^2") == "1/A^2"
    assert plain_unit("1/(N*m)^2") == "1/(N*m)^2"
    assert plain_unit("1") == ""
    number = {"name": "hysteresis_rate", "value": 2.0, "unit": "1/(A)^2"}
    assert number_words(number) == "hysteresis_rate 2.00 1/A^2"


def test_a_neighbour_is_said_by_its_name() -> None:
    numbers = [("bearing_friction", 0.008, "1"), ("side", -1.0, "1")]
    parameters = [{"name": name, "value": value, "unit": unit} for name, value, unit in numbers]
    entry = {"kind": "bearing_friction", "joints": ["elbow"], "parameters": parameters, "ties": []}
    said = effect_words(entry, ["shoulder", "elbow", "wrist"])
    assert said == "bearing friction on elbow under the torque of shoulder: bearing_friction 0.00800"
