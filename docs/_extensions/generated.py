"""Parts of pages that are made of the program: the commands, and the fields of its JSON files."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import typer
from sphinx.application import Sphinx


def commands(_: Path) -> str:
    """Every command of `dynid` with every argument and option, as the program itself explains them."""
    from dynid_rs.cli import app

    group = typer.main.get_command(app)
    context = group.make_context("dynid", [], resilient_parsing=True)
    text = [_command("dynid", group, context, level=2)]
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        inner = command.make_context(name, [], parent=context, resilient_parsing=True)
        text.append(_command(f"dynid {name}", command, inner, level=2))
    return "\n".join(text)


def _command(name: str, command: Any, context: Any, level: int) -> str:
    usage = " ".join([name, *command.collect_usage_pieces(context)]).replace("{", "").replace("}", "")
    text = [
        f"({name.replace(' ', '-')})=",
        f"{'#' * level} `{name}`\n",
        f"{_marked(command.help or '')}\n",
        f"```text\n{usage}\n```\n",
        f"```{{program}} {name}\n```\n",
    ]
    for parameter in command.get_params(context):
        record = parameter.get_help_record(context)
        if record is None:
            continue
        names, words = record
        if parameter.param_type_name == "argument":
            text.append(f"`{names.strip()}`\n: {_marked(words)}\n")
        else:
            text.append(f"````{{option}} {names.strip()}\n{_marked(words)}\n````\n")
    return "\n".join(text)


def _marked(words: str) -> str:
    """Help with its options as code, which Markdown would not know for what they are."""
    return re.sub(r"(?<![\w`-])(--[a-z][\w-]*)", r"`\1`", words.strip())


def fields(schema: Path) -> str:
    """Every field of a JSON schema: its path, its type, what it says."""
    root = json.loads(schema.read_text(encoding="utf-8"))
    rows = ["| field | type | meaning |", "|---|---|---|"]
    rows += [f"| `{path}` | {kind} | {meaning} |" for path, kind, meaning in _fields(root, root, "")]
    return "\n".join([f"{root.get('description', '')}\n", *rows, ""])


def _fields(root: dict[str, Any], node: dict[str, Any], path: str) -> Iterator[tuple[str, str, str]]:
    required = set(node.get("required", ()))
    for name, field in node.get("properties", {}).items():
        there = f"{path}.{name}" if path else name
        kind = _kind(root, field) + ("" if name in required else ", optional")
        yield there, kind, _meaning(root, field)
        yield from _inside(root, field, there)
    for pattern, field in node.get("patternProperties", {}).items():
        yield f"{path}.<{pattern}>", _kind(root, field), _meaning(root, field)
        yield from _inside(root, field, f"{path}.*")


def _inside(root: dict[str, Any], field: dict[str, Any], path: str) -> Iterator[tuple[str, str, str]]:
    target = _target(root, field)
    yield from _fields(root, target, path)
    items = target.get("items")
    if isinstance(items, dict):
        yield from _inside(root, items, f"{path}[]")
    for choice in (*target.get("oneOf", ()), *target.get("anyOf", ())):
        yield from _inside(root, choice, path)
    more = target.get("additionalProperties")
    if isinstance(more, dict):
        yield from _inside(root, more, f"{path}.*")


def _target(root: dict[str, Any], field: dict[str, Any]) -> dict[str, Any]:
    """The field with what it refers to."""
    reference = field.get("$ref")
    if reference is None:
        return field
    found: Any = root
    for step in reference.removeprefix("#/").split("/"):
        found = found[step]
    return {**_target(root, found), **{key: value for key, value in field.items() if key != "$ref"}}


def _meaning(root: dict[str, Any], field: dict[str, Any]) -> str:
    return str(_target(root, field).get("description", "")).replace("|", "\\|").replace("\n", " ")


def _kind(root: dict[str, Any], field: dict[str, Any]) -> str:
    target = _target(root, field)
    if "const" in target:
        return f"`{json.dumps(target['const'])}`"
    if "enum" in target:
        return ", ".join(f"`{json.dumps(value)}`" for value in target["enum"])
    choices = (*target.get("oneOf", ()), *target.get("anyOf", ()))
    if choices:
        return " or ".join(dict.fromkeys(_kind(root, choice) for choice in choices))
    kind = target.get("type", "any")
    kinds = [kind] if isinstance(kind, str) else list(kind)
    items = target.get("items")
    if "array" in kinds and isinstance(items, dict):
        kinds[kinds.index("array")] = f"array of {_kind(root, items)}"
    return " or ".join(kinds)


PAGES = {
    "reference/cli": (commands, ""),
    "reference/fleet_json": (fields, "fleet.schema.json"),
    "reference/model_json": (fields, "model.schema.json"),
    "reference/result_json": (fields, "result.schema.json"),
}
"""Page: what is put in the place of its line `<<generated>>`, and of which file beside it."""


def fill(app: Sphinx, page: str, source: list[str]) -> None:
    """Put the generated part into its page."""
    if page in PAGES:
        make, name = PAGES[page]
        before, mark, after = source[0].partition("<<generated>>")
        assert mark, f"{page} has no line <<generated>>"
        source[0] = before + make(Path(app.srcdir) / "reference" / name) + after


def setup(app: Sphinx) -> dict[str, Any]:
    """Fill pages as they are read."""
    app.connect("source-read", fill)
    return {"parallel_read_safe": True}
