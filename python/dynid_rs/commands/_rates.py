"""How often something without a cause may be said: `1/day`, `2/week`, `1/2weeks`."""

from __future__ import annotations

import math
import re

DAYS = {"hour": 1 / 24, "day": 1.0, "week": 7.0, "month": 30.0, "year": 365.0}


def per_day(text: str, option: str) -> float:
    """Times per day that the text of an option says.

    Raises
    ------
    ValueError
        One sentence.
    """
    found = re.fullmatch(r"\s*(\d+(?:\.\d*)?|\.\d+)\s*/\s*(\d*)\s*([a-z]+?)s?\s*", text)
    rate = 0.0
    if found is not None and found[3] in DAYS and int(found[2] or 1):
        rate = float(found[1]) / (float(found[2] or 1) * DAYS[found[3]])
    if not 0 < rate < math.inf:
        raise ValueError(
            f"{option}: expected a number above 0 per {', '.join(DAYS)}, as 1/day or 1/2weeks, got {text[:40]!r}"
        )
    return rate
