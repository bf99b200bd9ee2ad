"""A user's Dask cluster, for units of work."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from dynid_rs.base.errors import MissingLibraryError

SECONDS = 30.0
"""How long a scheduler may take to answer."""


@contextmanager
def on_cluster(scheduler: str | None) -> Iterator[None]:
    """Let joblib's work be done by the cluster whose scheduler has this address; by nobody else without one.

    Raises
    ------
    MissingLibraryError
        Dask is not installed.
    OSError
        No scheduler answers there; the text is a sentence.
    """
    if scheduler is None:
        yield
        return
    with _client(scheduler):
        from joblib import parallel_config

        with parallel_config(backend="dask"):
            yield


def _client(scheduler: str) -> Any:
    try:
        from dask.distributed import Client
    except ImportError:
        raise MissingLibraryError("dask.distributed", extra="cluster", purpose="clusters (--scheduler)") from None
    try:
        connect: Any = Client
        return connect(scheduler, timeout=SECONDS)
    except (OSError, ValueError, TypeError) as error:
        reason = str(error).split("\n")[0] or type(error).__name__
        raise OSError(f"--scheduler {scheduler}: no scheduler answers there ({reason})") from None
