"""docs/reference/dynid_toml.md and docs/reference/dynid_toml.schema.json, made of the catalogue of keys."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from dynid_rs._core import __version__
from dynid_rs.runs.readers.config import GEARED, UNITS
from dynid_rs.runs.readers.keys import KEYS, KINDS, TABLES, Key

SCHEMA_URL = f"https://raw.githubusercontent.com/dynid-rs/dynid_rs/v{__version__}/docs/reference/dynid_toml.schema.json"
"""Where editors find the schema of this version: a `dynid.toml` is read where no package is installed, and the path of
one is nobody else's. Releases are tagged with their version."""
_HEAD = """# dynid.toml

How the columns of somebody's files become signals in SI on the link side, and which arm they are of. Commands take it
as `--config dynid.toml`; every table and every key may be left out. `dynid init ROBOT RUN...` looks at runs and writes
one, with the evidence for each rule. Editors that know JSON schemas (taplo, Even Better TOML) check it as it is written
with [dynid_toml.schema.json](dynid_toml.schema.json): `#:schema` and its address, or its path, on the first line.
`dynid init` writes the address of the schema of its own version, `{schema_url}`.

What a header says itself (`q_0 [deg]`, `time_ms`, a row of units) is followed, and said; what stands here wins. A unit
of another quantity in brackets is refused; what is none of those below, in any spelling, may be a comment, and is a
warning where its column is read and nothing here says the unit. Columns may be named as they stand in the file, or less
a unit in brackets: `q_{i} [deg]` or `q_{i}`.

This page is made of the code: `python -m dynid_rs.runs.readers.key_page` prints it.
"""
_NUMBER = {"type": "number"}


def page() -> str:
    """Text of docs/reference/dynid_toml.md."""
    parts = [_HEAD.replace("{schema_url}", SCHEMA_URL.replace(f"v{__version__}", "vVERSION"))]
    for table, about in TABLES.items():
        rows = [_row(key) for key in KEYS if key.table == table]
        parts.append(
            f"\n## [{table}]\n\n{about}\n\n| key | value | meaning | example |\n|---|---|---|---|\n" + "".join(rows)
        )
    return "".join(parts)


def schema() -> dict[str, Any]:
    """JSON schema of `dynid.toml`, draft 2020-12."""
    tables = {}
    for table, about in TABLES.items():
        keys = {key.name: _schema_of(key) | {"description": key.means} for key in KEYS if key.table == table}
        tables[table] = {
            "type": "object",
            "description": about,
            "additionalProperties": False,
            "properties": keys,
        }
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "dynid.toml",
        "type": "object",
        "additionalProperties": False,
        "properties": tables,
    }


def _row(key: Key) -> str:
    kind = ", ".join(f"`{unit}`" for unit in UNITS[key.name]) if key.kind == "unit" else KINDS[key.kind]
    return f"| `{key.name}` | {kind} | {key.means} | `{key.name} = {key.example}` |\n"


def _schema_of(key: Key) -> dict[str, Any]:
    text: dict[str, Any] = {"type": "string", "minLength": 1}
    texts = {"type": "array", "minItems": 1, "items": text}
    if key.kind == "unit":
        return {"enum": list(UNITS[key.name])}
    numbers: Mapping[str, Any] = {
        "numbers": _NUMBER | {"minimum": 0},
        "positive": _NUMBER | {"exclusiveMinimum": 0},
        "signs": {"enum": [1, -1]},
    }
    if key.kind in numbers:
        one = numbers[key.kind]
        return {"anyOf": [one, {"type": "array", "minItems": 1, "items": one}]}
    return {
        "column": {"anyOf": [text, texts, {"const": False}]},
        "time_column": text,
        "signals": {"type": "array", "minItems": 1, "items": {"enum": list(GEARED)}},
        "name": text,
        "names": texts,
        "vector": {"type": "array", "minItems": 3, "maxItems": 3, "items": _NUMBER},
    }[key.kind]


def schema_text() -> str:
    """Text of docs/reference/dynid_toml.schema.json."""
    return json.dumps(schema(), indent=2) + "\n"


if __name__ == "__main__":
    print(page(), end="")
