"""`dynid cache`: what a cache of intermediate results holds, and making it smaller."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from dynid_rs.commands import _options
from dynid_rs.commands._run import print_json, run_command


@run_command
def cache(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="The folder given as --cache")],
    keep: Annotated[
        str | None, typer.Option(metavar="SIZE", help="Remove the oldest entries until the others take this: 10GB")
    ] = None,
    clear: Annotated[bool, typer.Option("--clear", help="Remove all entries")] = False,
    json_output: _options.Json = False,
) -> None:
    """Say how much a cache holds, or remove entries; what is removed is made again when it is needed.

    Other files in the folder are left alone.
    """
    from dynid_rs.archive.cache import Cache
    from dynid_rs.commands._inputs import size_in_bytes

    if clear and keep is not None:
        raise ValueError("--clear removes everything and --keep a part; give one of them")
    limit = 0 if clear else None if keep is None else size_in_bytes("--keep", keep)
    if not folder.is_dir():
        raise FileNotFoundError(f"{folder}: there is no such folder; name the one that --cache was given")
    held = Cache(folder)
    removed = 0 if limit is None else held.keep(limit)
    answer = {"entries": len(held.entries()), "bytes": held.n_bytes(), "removed": removed}
    if json_output:
        print_json(answer)
        return
    if limit is not None:
        print(f"{removed} entries removed")
    print(f"{folder}: {answer['entries']} entries, {answer['bytes'] / 1e6:.1f} MB")
