"""Memory that run after run takes is not given back in between: new pages cost as much as what is done in them."""

from __future__ import annotations

from functools import cache

import numpy as np

LARGEST_KEPT = 2**25 - 2**13
"""Bytes: just below the largest block that the C library's allocator learns from."""


@cache
def keep_pages() -> None:
    """Make the allocator of this process keep up to twice `LARGEST_KEPT` of what is freed.

    glibc takes the largest block that went back to it for a habit. This one is never touched, so it takes no memory
    itself; elsewhere nothing happens.
    """
    np.empty(LARGEST_KEPT, dtype=np.uint8)
