"""Files that mean harm or lie, of every kind that is read: what they are, and what is said of them."""

from __future__ import annotations

import gzip
import hashlib
import json
import re
from collections.abc import Callable
from typing import Any, NamedTuple

from helpers.small_arm import URDF


class Hostile(NamedTuple):
    """A file and the sentence about it, a regular expression; None: it is sound, only strange."""

    name: str
    content: bytes
    sentence: str | None


ARM = URDF.encode()


def _urdf(old: str, new: str) -> bytes:
    assert URDF.count(old) >= 1, old
    return URDF.replace(old, new, 1).encode()


ROBOTS = (
    Hostile("utf16.urdf", URDF.encode("utf-16"), r"utf16\.urdf:1:1: .*UTF-"),
    Hostile("bom.urdf", b"\xef\xbb\xbf" + ARM, None),
    Hostile("latin.urdf", ARM.replace(b"<link", b"<!-- caf\xe9 --><link", 1), r"latin\.urdf:2:11: .*UTF-8"),
    Hostile("two.urdf", ARM + ARM, r"two\.urdf:16:1: .*second root"),
    Hostile("comma.urdf", _urdf('xyz="0 0 0.05"', 'xyz="0 0 0,05"'), r"comma\.urdf:3:40: .*0,05"),
    Hostile("minus.urdf", _urdf('xyz="0 0 0.05"', 'xyz="0 0 \u22120.05"'), r"minus\.urdf:3:40: "),
    Hostile("arabic.urdf", _urdf('value="8"', 'value="\u0668"'), r"arabic\.urdf:3:62: "),
    Hostile("hex.urdf", _urdf('value="8"', 'value="0x8"'), r"hex\.urdf:3:62: .*0x8"),
    Hostile("xacro.urdf", _urdf('value="8"', 'value="${mass}"'), r"xacro\.urdf:3:62: .*xacro"),
    Hostile("tiny_axis.urdf", _urdf('xyz="0 0 1"', 'xyz="0 0 1e-320"'), r"tiny_axis\.urdf:6:34: .*axis has no length"),
    Hostile(
        "own_parent.urdf",
        _urdf('<parent link="base"/>', '<parent link="upper"/>'),
        r"own_parent\.urdf:5:71: .*to itself",
    ),
    Hostile("escape.urdf", _urdf('name="upper"', 'name="up\u009b2Jper"'), r"escape\.urdf:3:9: .*U\+009B may not stand"),
    Hostile("escaped_name.urdf", _urdf("ixz=", "i\x1b[2Jz="), r"escaped_name\.urdf:4:32: .*i\\u\{1b\}\[2Jz"),
    Hostile(
        "swapped.urdf", _urdf('lower="-3" upper="3"', 'lower="3" upper="-3"'), r"swapped\.urdf:6:54: .*above upper"
    ),
    Hostile("mujoco.urdf", b'<mujoco model="arm"><worldbody/></mujoco>', r"mujoco\.urdf:1:1: .*<robot>"),
    Hostile(
        "mimic.urdf",
        _urdf('<axis xyz="0 0 1"/>', '<axis xyz="0 0 1"/><mimic joint="elbow"/>'),
        r"mimic\.urdf:6:47: .*delete <mimic>",
    ),
)


def models(valid: str) -> tuple[Hostile, ...]:
    """Damaged copies of a model's text; the checksum is right again where a forger would have made it so."""

    def forged(change: Callable[[dict[str, Any]], object]) -> bytes:
        model = json.loads(valid)
        change(model)
        return checked(json.dumps(model, indent=2))

    def coefficient(value: float) -> Callable[[dict[str, Any]], object]:
        def change(model: dict[str, Any]) -> None:
            model["effects"][0]["coefficients"][0][0] = value

        return change

    def entry(name: str, value: object) -> Callable[[dict[str, Any]], object]:
        return lambda model: model.__setitem__(name, value)

    twice = re.sub(r'("version": \d+,)', r"\1\n  \1", valid, count=1)
    return (
        Hostile("coefficient.json", forged(coefficient(1e150)), r"coefficient\.json: a coefficient .*beyond 1e9"),
        Hostile("phi.json", forged(entry("phi", [[1e200] * 10] * 3)), r"phi\.json: a number .*beyond 1e9"),
        Hostile("noise.json", forged(entry("noise_std", [-1.0, 1.0, 1.0])), r"noise\.json: "),
        Hostile(
            "version.json",
            forged(entry("version", "9" * 1_000_000)),
            r"version\.json: .*string \"9999.*expected u32 at line 3 column 1000015",
        ),
        Hostile(
            "unit.json", forged(entry("torque_unit", "x" * 1_000_000)), r"unit\.json: torque_unit is outside its range"
        ),
        Hostile("twice.json", checked(twice), r"twice\.json: .*duplicate.* line 4 column "),
        Hostile(
            "nan.json",
            checked(re.sub(r'"phi": \[\s*[-\d.e]+', '"phi": [NaN', valid)),
            r"nan\.json: .* line \d+ column ",
        ),
        Hostile("deep.json", b'{"format":' + b"[" * 200_000, r"deep\.json: .*expected a string at line 1 column 10"),
        Hostile("cut.json", valid.encode()[: len(valid) // 2], r"cut\.json: .*ends too early \(line \d+\)"),
        Hostile("more.json", valid.encode() + b"{}", r"more\.json: .*trailing characters at line \d+ column 1"),
    )


def checked(text: str) -> bytes:
    """The text with the checksum that belongs to it."""
    blank = re.sub(r"sha256:[0-9a-f]{64}", "sha256:" + 64 * "0", text, count=1)
    return blank.replace(64 * "0", hashlib.sha256(blank.encode()).hexdigest(), 1).encode()


HEADER = "t,q_0,q_1,q_2,tau_0,tau_1,tau_2"
ROWS = [f"{k / 100},{k % 7},{k % 5},{k % 3},1,2,3" for k in range(200)]


def _csv(*changes: tuple[int, str]) -> bytes:
    """The run with lines replaced; line 1 is the header."""
    lines = [HEADER, *ROWS]
    for line, text in changes:
        lines[line - 1] = text
    return "\n".join(lines).encode() + b"\n"


RUNS = (
    Hostile("joined.csv", _csv((100, HEADER)), r"joined\.csv, row 99 \(line 100\): the header appears a second time"),
    Hostile(
        "decimal_comma.csv",
        _csv().replace(b".", b","),
        r"row 1 \(line 2\): .*decimal commas",
    ),
    Hostile("sep.csv", b"sep=,\n" + _csv(), None),
    Hostile("old_mac.csv", _csv().replace(b"\n", b"\r"), None),
    Hostile("utf16.csv", _csv().decode().encode("utf-16"), None),
    Hostile("utf16_cut.csv", _csv().decode().encode("utf-16")[:-3], r"utf16_cut\.csv.*row 200 \(line 201\).*tau_2"),
    Hostile("utf32.csv", _csv().decode().encode("utf-32"), r"utf32\.csv: .*UTF-32"),
    Hostile("zipped.csv", gzip.compress(_csv()), r"zipped\.csv: .*"),
    Hostile("nul.csv", _csv((50, "0.48,\0,3,0,1,2,3")), r"nul\.csv: .*line 50 holds a NUL byte"),
    Hostile("quote.csv", _csv((50, '0.48,"6,3,0,1,2,3')), r"quote\.csv.*row 49 \(line 50\)"),
    Hostile("short.csv", _csv((50, "0.48,6,3")), r"short\.csv.*row 49 \(line 50\)"),
    Hostile("dots.csv", _csv((50, "0.48,6,1.2.3,0,1,2,3")), r"dots\.csv.*row 49 \(line 50\).*q_1"),
    Hostile(
        "megabyte.csv", _csv((50, f"0.48,6,{'9' * 1_000_000}x,0,1,2,3")), r"megabyte\.csv.*row 49 \(line 50\).*q_1"
    ),
    Hostile("escape.csv", _csv((50, "0.48,6,\x1b[2J,0,1,2,3")), r"escape\.csv.*row 49 \(line 50\).*q_1.*\\x1b"),
    Hostile("underscore.csv", _csv((50, "0.48,6,1_000,0,1,2,3")), r"underscore\.csv.*row 49 \(line 50\).*q_1"),
    Hostile("still.csv", _csv((50, "0.47,6,3,0,1,2,3")), r"still\.csv.*row 49 \(line 50\).*t"),
    Hostile("column_twice.csv", _csv((1, HEADER.replace("q_1", "q_0"))), r"column_twice\.csv.*q_0"),
)

CONFIGS = (
    Hostile("bomb.toml", b'[columns]\nq = "{i:1000000000}"\n', r"bomb\.toml.*q.*"),
    Hostile("attribute.toml", b'[columns]\nq = "{i.__class__.__mro__}"\n', r"attribute\.toml.*q.*"),
    Hostile("index.toml", b'[columns]\nq = "{0}"\n', r"index\.toml.*q.*"),
    Hostile("no_joint.toml", b'[columns]\nq = "position"\n', r"no_joint\.toml.*q.*"),
    Hostile("twice.toml", b"[units]\ntime = 's'\n[units]\ntime = 'ms'\n", r"twice\.toml.*line 3"),
    Hostile("unit.toml", b"[units]\nangle = 'gon'\n", r"unit\.toml.*angle.*gon"),
    Hostile("nan_gain.toml", b"[drive]\ngain = [nan, 1.0, 1.0]\n", r"nan_gain\.toml.*gain"),
    Hostile("no_ratio.toml", b"[gear]\nratio = 0\n", r"no_ratio\.toml.*ratio"),
    Hostile("sign.toml", b"[signs]\nq = [1, 2, 1]\n", r"sign\.toml.*q"),
    Hostile("key.toml", b"[colums]\nq = 'a_{i}'\n", r"key\.toml.*colums.*columns"),
    Hostile("bytes.toml", b"[units]\n# \xff\n", r"bytes\.toml.*"),
    Hostile("deep.toml", b"a = " + b"[" * 100_000, r"deep\.toml.*"),
    Hostile("escape.toml", b'[units]\nangle = "\\u001B[2J"\n', r"escape\.toml.*angle.*x1b"),
)
