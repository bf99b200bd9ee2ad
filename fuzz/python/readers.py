"""A reader in Python under libFuzzer: `DYNID_TARGET=table python fuzz/python/readers.py fuzz/corpus/table`.

`fuzz/run.py` starts it. Atheris counts the branches of the package's bytecode.
"""

from __future__ import annotations

import importlib
import os
import pkgutil
import sys

import atheris

with atheris.instrument_imports(include=["dynid_rs", "tomllib"], enable_loader_override=False):
    import dynid_rs.base
    import dynid_rs.runs

    for room in (dynid_rs.base, dynid_rs.runs):  # what a reader imports late is to be counted too
        for module in pkgutil.walk_packages(room.__path__, f"{room.__name__}."):
            importlib.import_module(module.name)
    from ways_in import WAYS_IN


def main() -> None:
    """Try the way in that `DYNID_TARGET` names."""
    atheris.Setup(sys.argv, WAYS_IN[os.environ["DYNID_TARGET"]])
    atheris.Fuzz()


if __name__ == "__main__":
    main()
