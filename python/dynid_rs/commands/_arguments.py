"""What no command takes, whichever it is."""

from __future__ import annotations

from typing import Any

import typer
from typer.core import TyperCommand

from dynid_rs.commands._run import failed


class Command(TyperCommand):
    """A command that refuses empty arguments: as a path, one would be the folder that the shell stands in."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read the arguments of one call."""
        for before, text in zip([self.name or "", *args], args, strict=False):
            if not text or (text.startswith("--") and text.endswith("=")):
                error = ValueError(
                    f"an empty argument stands after {text.removesuffix('=') or before}; give it a value or leave it "
                    "out (is a variable of the shell not set?)"
                )
                raise typer.Exit(failed(error, as_json="--json" in args))
        return super().parse_args(ctx, args)
