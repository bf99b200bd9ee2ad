"""One thing that runs say about themselves, and that is taken or not."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from dynid_rs.runs.readers import Config


@dataclass(frozen=True)
class Proposal:
    """One thing that the runs say about themselves.

    `key` of `dynid.toml`, its `value` there, the `evidence` in one sentence, and the rules once it is taken.
    """

    key: str
    value: Any
    evidence: str
    rules: Config
