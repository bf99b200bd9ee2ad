"""The files that a command writes as its result, and the published schema of result.json."""

import functools
import json

import jsonschema

from helpers.data import ROOT

FILES = ["model.json", "report.html", "residuals.parquet", "result.json"]


@functools.cache
def validator():
    schema = json.loads((ROOT / "docs" / "reference" / "result.schema.json").read_text())
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)
