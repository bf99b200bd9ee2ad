"""Every kind that may be hidden, and who places it."""

from __future__ import annotations

from exam import channels, frictions, mechanics, outside
from exam.draw import NAMED, STRANGE

MAKERS = {
    kind: getattr(room, kind) for kind in NAMED for room in (channels, frictions, mechanics) if hasattr(room, kind)
}
"""Kinds of the product's catalogue."""
STRANGERS = {kind: getattr(outside, kind) for kind in STRANGE}
"""Kinds that have no name."""
