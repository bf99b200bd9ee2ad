"""Results of units of work on disk, each under the hash of all that it depends on; whole, or not there.

An entry is one file: a line that says what it is, the SHA-256 of the rest, and arrays as NPZ. What a kill, a full disk
or another program leaves behind is detected by that hash and made again.
"""

from __future__ import annotations

import hashlib
import io
import json
import re
import zipfile
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dynid_rs.archive.survey import Entry
from dynid_rs.base.files import atomic_path, with_sentence
from dynid_rs.base.held import clear_leftovers

MARK = b"dynid-cache 1\n"
SUFFIX = ".dynid"
_PLAIN = "plain"
_NAME = re.compile(r"[0-9a-f]{64}" + re.escape(SUFFIX))


@dataclass(frozen=True)
class Cache:
    """A folder of entries; several processes may share it.

    Parameters
    ----------
    folder : Path
        Where they are; made when the first one is written.
    """

    folder: Path

    def path(self, key: str) -> Path:
        """Place of an entry; `key` is a fingerprint."""
        return self.folder / key[:2] / f"{key}{SUFFIX}"

    def get(self, key: str) -> Entry | None:
        """Entry of this key; None if there is none, or one that is damaged, which is removed."""
        path = self.path(key)
        try:
            content = path.read_bytes()
        except FileNotFoundError:
            return None
        except OSError as error:
            raise with_sentence(error, path, "read") from None
        entry = unpacked(content)
        if entry is None:
            with suppress(OSError):
                path.unlink()
        return entry

    def put(self, key: str, entry: Entry) -> None:
        """Keep an entry, whole or not at all.

        Raises
        ------
        OSError
            It cannot be written; the text is a sentence.
        """
        path = self.path(key)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise with_sentence(error, path, "write") from None
        with atomic_path(path) as temporary:
            temporary.write_bytes(packed(entry))

    def entries(self) -> list[Path]:
        """All entries, the oldest first."""
        return list(self._sizes())

    def n_bytes(self) -> int:
        """Size of all entries."""
        return sum(self._sizes().values())

    def keep(self, n_bytes: int) -> int:
        """Remove the oldest entries until the others take at most `n_bytes`; and how many were removed."""
        sizes = self._sizes()
        left, removed = sum(sizes.values()), 0
        for path, size in sizes.items():
            if left <= n_bytes:
                break
            left -= size
            path.unlink(missing_ok=True)
            removed += 1
        self.sweep()
        return removed

    def sweep(self) -> None:
        """Remove what killed writers left behind; an empty folder stays, others may be about to write there."""
        for folder in self._folders():
            clear_leftovers(folder)

    def _sizes(self) -> dict[Path, int]:
        """Bytes of all entries, the oldest first; another process may remove them meanwhile."""
        found = []
        for path in self._files():
            if _NAME.fullmatch(path.name):
                with suppress(FileNotFoundError):
                    info = path.stat()
                    found.append((info.st_mtime_ns, path.name, path, info.st_size))
        return {path: size for _, _, path, size in sorted(found)}

    def _folders(self) -> list[Path]:
        if not self.folder.is_dir():
            return []
        return [path for path in sorted(self.folder.iterdir()) if re.fullmatch("[0-9a-f]{2}", path.name)]

    def _files(self) -> Iterator[Path]:
        for folder in self._folders():
            with suppress(FileNotFoundError, NotADirectoryError):
                yield from sorted(folder.iterdir())


def packed(entry: Entry) -> bytes:
    """Bytes of an entry."""
    plain, arrays = entry
    text = json.dumps(plain).encode()
    buffer = io.BytesIO()
    named: dict[str, Any] = {_PLAIN: np.frombuffer(text, dtype=np.uint8), **arrays}
    np.savez(buffer, **named)
    content = buffer.getvalue()
    return MARK + hashlib.sha256(content).digest() + content


def unpacked(content: bytes) -> Entry | None:
    """Inverse of `packed`; None where these are not the bytes that were written."""
    edge = len(MARK) + hashlib.sha256().digest_size
    digest, rest = content[len(MARK) : edge], content[edge:]
    if not content.startswith(MARK) or hashlib.sha256(rest).digest() != digest:
        return None
    try:
        with np.load(io.BytesIO(rest), allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        plain = json.loads(arrays.pop(_PLAIN).tobytes())
    except (ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None
    return plain, arrays
