"""How many threads the compiled module is asked for: a number that no machine has would be waited for without end."""

from __future__ import annotations

import os

_ASKED_BY = ("RAYON_NUM_THREADS", "RAYON_RS_NUM_CPUS")
"""Variables that the compiled module's pool of threads looks at."""
MOST = 1024
"""More threads than this, and than there are processors, are asked for by mistake."""


def limit() -> str | None:
    """Take an absurd number of threads out of the environment; returns a sentence, or None where there is none."""
    told = None
    for name in _ASKED_BY:
        asked = os.environ.get(name, "")
        if not (asked.isascii() and asked.isdigit()):
            continue  # the pool takes it for none
        if len(asked) > len(str(MOST)) * 4 or int(asked) > max(MOST, os.cpu_count() or 1):
            del os.environ[name]
            told = f"{name} asks for more than {MOST} threads; as many are used as there are processors"
    return told
