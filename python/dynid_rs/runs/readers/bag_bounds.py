"""Limits for what a bag's chunks may unpack to: the library unpacks each one whole, whatever it grows to."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

LARGEST_CHUNK = 256 << 20
"""Bytes. Writers close a chunk at some megabytes."""


@contextmanager
def bounded(limit: int = LARGEST_CHUNK) -> Iterator[None]:
    """Let the library's unpackers raise `ValueError` for a chunk or message of more than `limit` bytes.

    The library has its unpackers in two tables, which are exchanged meanwhile, and uses one module by name.
    """
    from rosbags.rosbag1 import reader as one
    from rosbags.rosbag2 import reader, storage_mcap

    two: Any = reader
    small = _unpackers(two.zstd, limit)
    tables: tuple[dict[str, Any], ...] = (one.decompressors, storage_mcap.DECOMPRESSORS)
    before = [dict(table) for table in tables]
    module = two.zstd
    try:
        one.decompressors.update({name: small[name] for name in ("bz2", "lz4") if name in one.decompressors})
        storage_mcap.DECOMPRESSORS.update(
            {name: _with_size(small[name]) for name in ("lz4", "zstd") if name in storage_mcap.DECOMPRESSORS}
        )
        two.zstd = _Messages(small["zstd"])
        yield
    finally:
        two.zstd = module
        for table, kept in zip(tables, before, strict=True):
            table.clear()
            table.update(kept)


class _Messages:
    """Stands for the module that unpacks messages one by one."""

    def __init__(self, decompress: Callable[[bytes], bytes]) -> None:
        self.decompress = decompress


def _with_size(unpack: Callable[[bytes], bytes]) -> Callable[[bytes, int], bytes]:
    return lambda data, size: unpack(data)


def _unpackers(zstd: Any, limit: int) -> dict[str, Callable[[bytes], bytes]]:
    import bz2

    import lz4.frame

    makers: dict[str, Callable[[], Any]] = {
        "bz2": bz2.BZ2Decompressor,
        "lz4": lz4.frame.LZ4FrameDecompressor,
        "zstd": zstd.ZstdDecompressor,
    }

    def unpack(make: Callable[[], Any], data: bytes) -> bytes:
        unpacker = make()
        out: bytes = unpacker.decompress(data, max_length=limit)
        if not unpacker.eof:
            raise ValueError(f"a chunk grows beyond {limit} bytes, or is cut off")
        return out

    return {name: lambda data, make=make: unpack(make, data) for name, make in makers.items()}  # type: ignore[misc]
