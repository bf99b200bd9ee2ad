"""Memory that runs take one after the other is not given back in between: new pages cost more than what is done in them."""

from __future__ import annotations

from functools import cache

import numpy as np

LARGEST_KEPT = 2**25 - 2**13
"""Bytes: just below the largest block that the C library's allocator learns from."""


@cache
def keep_pages() -> None:
    """Make the allocator of this process keep up to twice `LARGEST_KEPT` of what is freed.

    glibc keeps as much as the largest block it has seen go back, and takes that for a habit. The block is never touched,
    so it takes no memory itself; elsewhere nothing happens.
    """
    np.empty(LARGEST_KEPT, dtype=np.uint8)
