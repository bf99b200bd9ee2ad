"""Small changes to the Python that decides, drawn from a seed: places of the code first, then a change at each.

Operators are cosmic-ray's, and names that are as easily mixed up (`any` for `all`). A change that no reader could make
(`+` for `|`) only swells the share of those that are found.
"""

from __future__ import annotations

import ast
import random
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "python" / "dynid_rs"
ROOMS = ("regression", "identification", "diagnosis", "runs")
"""Rooms that decide."""
WORDS = {"words", "wording", "messages", "plots", "effect_plot", "about", "key_page"}
"""Modules in them which only say or show it."""
ALIKE = (
    ("Add", "Sub", "Mul", "Div"),
    ("FloorDiv", "Mod", "Mul", "Div"),
    ("Pow", "Mul"),
    ("BitOr", "BitAnd", "BitXor"),
    ("Eq", "NotEq", "Lt", "LtE", "Gt", "GtE"),
    ("Is", "IsNot"),
)
"""Operators that are taken for one another."""
OTHERS = (
    *("AddNot", "ReplaceTrueWithFalse", "ReplaceFalseWithTrue", "ReplaceAndWithOr", "ReplaceOrWithAnd"),
    *("ReplaceBreakWithContinue", "ReplaceContinueWithBreak", "NumberReplacer", "ZeroIterationForLoop"),
    *("ReplaceUnaryOperator_Delete_Not", "ReplaceUnaryOperator_Delete_USub", "ReplaceUnaryOperator_Delete_Invert"),
)
SWAPPED = {
    a: b
    for pair in (("any", "all"), ("min", "max"), ("minimum", "maximum"), ("argmin", "argmax"), ("sin", "cos"))
    for a, b in (pair, pair[::-1])
} | {"mean": "median", "median": "mean", "sqrt": "square", "square": "sqrt", "floor": "ceil"}
"""Functions for one another."""

IDLE = {"newline", "string", "endmarker", "error_leaf", "suite", "simple_stmt", "trailer", "arglist", "file_input"}
PUNCTUATION = set("()[]{},.:=;@") | {"->", "+=", "-=", "*=", "/=", "|=", "&="}
"""Nodes of a syntax tree that nothing is done to."""


@dataclass(frozen=True)
class Mutant:
    """One change: where (lines of the statement that it is in), by which operator, and the lines before and after."""

    module: str
    line: int
    statement: list[int]
    operator: str
    occurrence: int
    before: str
    after: str

    @property
    def name(self) -> str:
        """As a person finds it."""
        return f"{self.module}:{self.line} `{self.before.strip()}` -> `{self.after.strip()}`"


def modules() -> list[str]:
    """Files that are mutated, relative to the package."""
    files = (path for room in ROOMS for path in (PACKAGE / room).rglob("*.py"))
    return sorted(str(path.relative_to(PACKAGE)) for path in files if path.stem not in WORDS)


def draw(seed: int, count: int) -> tuple[list[Mutant], int]:
    """`count` changes, and the number of places they were drawn from."""
    rng = random.Random(seed)
    places = [(module, place) for module in modules() for place in sorted(_places(_source(module)))]
    mutants: list[Mutant] = []
    for module, place in rng.sample(places, len(places)):
        if len(mutants) == count:
            break
        operator, occurrence = rng.choice(sorted(_places(_source(module))[place]))
        mutant = _mutant(module, place, operator, occurrence)
        if mutant is not None:
            mutants.append(mutant)
    return mutants, len(places)


def changed(mutant: Mutant) -> str:
    """Source of its module with the change."""
    text = _mutated(_source(mutant.module), mutant.operator, mutant.occurrence)
    assert text is not None
    return text


def located(old: Mutant) -> Mutant | None:
    """The same change in the module as it is now; None where its line is gone."""
    if not (PACKAGE / old.module).exists():
        return None
    source = _source(old.module)
    found = [
        mutant
        for place, ways in sorted(_places(source).items())
        for operator, occurrence in ways
        if operator == old.operator and source.splitlines()[place[0] - 1] == old.before
        if (mutant := _mutant(old.module, place, operator, occurrence)) is not None and mutant.after == old.after
    ]
    return min(found, key=lambda mutant: abs(mutant.line - old.line), default=None)


def _source(module: str) -> str:
    return (PACKAGE / module).read_text(encoding="utf-8")


@cache
def _operators() -> dict[str, Any]:
    """Every operator, ready to use, by its name."""
    from cosmic_ray.operators.operator import Operator
    from cosmic_ray.plugins import get_operator

    class SwapName(Operator):  # type: ignore[misc]
        """One function for another."""

        def mutation_positions(self, node: Any) -> Iterator[tuple[Any, Any]]:
            if node.type == "name" and node.value in SWAPPED and not node.is_definition():
                yield node.start_pos, node.end_pos

        def mutate(self, node: Any, index: int) -> Any:
            node.value = SWAPPED[node.value]
            return node

        @classmethod
        def examples(cls) -> tuple[()]:
            return ()

    names = list(OTHERS)
    for family in ALIKE:
        kind = "Comparison" if family[0] in ("Eq", "Is") else "Binary"
        names += [f"Replace{kind}Operator_{a}_{b}" for a in family for b in family if a != b]
    found = {name: get_operator(f"core/{name}")() for name in dict.fromkeys(names)}
    return found | {"SwapName": SwapName()}


@cache
def _places(source: str) -> dict[tuple[int, int], list[tuple[str, int]]]:
    """Line and column of all that can be changed: (operator, occurrence). Annotations and imports decide nothing."""
    from cosmic_ray.ast import ast_nodes, get_ast

    # Most of a tree's nodes are names and punctuation, which no operator looks at.
    nodes = [node for node in ast_nodes(get_ast(source)) if node.type not in IDLE and _is_changed(node)]
    without = _undecided(source)
    found: dict[tuple[int, int], list[tuple[str, int]]] = {}
    for name, operator in _operators().items():
        starts = (start for node in nodes for start, _ in operator.mutation_positions(node))
        for occurrence, start in enumerate(starts):
            if not any(first <= tuple(start) < last for first, last in without):
                found.setdefault(tuple(start), []).append((name, occurrence))
    return found


def _is_changed(node: Any) -> bool:
    if node.type == "name":
        return node.value in SWAPPED
    return node.type != "operator" or node.value not in PUNCTUATION


def _undecided(source: str) -> list[tuple[tuple[int, int], tuple[int, int]]]:
    """From where to where a source holds annotations, imports, sentences, and what only a type checker sees."""
    spans = []
    for node in ast.walk(ast.parse(source)):
        part: ast.stmt | ast.expr | ast.keyword | None = None
        if isinstance(node, ast.FunctionDef):
            part = node.returns
        elif isinstance(node, ast.ClassDef):  # whether a record is frozen decides nothing
            part = node.decorator_list[0] if node.decorator_list else None
        elif isinstance(node, ast.arg | ast.AnnAssign):
            part = node.annotation
        elif (
            isinstance(node, ast.Import | ast.ImportFrom | ast.JoinedStr)
            or (isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test))
            or (isinstance(node, ast.keyword) and node.arg == "strict")
        ):
            part = node
        if part is not None:
            last = part.end_lineno or part.lineno, part.end_col_offset or 0
            spans.append(((part.lineno, part.col_offset), last))
    return spans


def _mutated(source: str, operator: str, occurrence: int) -> str | None:
    from cosmic_ray.mutating import mutate_code

    text: str | None = mutate_code(source, _operators()[operator], occurrence)
    return text


def _mutant(module: str, place: tuple[int, int], operator: str, occurrence: int) -> Mutant | None:
    """Return the change as text; None where nothing is another than before, or where it is no Python."""
    source = _source(module)
    text = _mutated(source, operator, occurrence)
    if text is None or text == source:
        return None
    try:
        ast.parse(text)
    except SyntaxError:
        return None
    differing = [pair for pair in zip(source.splitlines(), text.splitlines(), strict=True) if pair[0] != pair[1]]
    before, after = differing[0]
    return Mutant(module, place[0], _statement(source, place[0]), operator, occurrence, before, after)


def _statement(source: str, line: int) -> list[int]:
    """First and last line of the innermost statement there; of one with a body its head."""
    best = (1, source.count("\n") + 1)
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.stmt):
            body = getattr(node, "body", None)
            last = body[0].lineno - 1 if body else node.end_lineno or node.lineno
            span = node.lineno, max(last, node.lineno)
            if span[0] <= line <= span[1] and span[1] - span[0] < best[1] - best[0]:
                best = span
    return list(best)
