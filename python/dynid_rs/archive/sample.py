"""A bounded sample of an archive in place of all of it: pieces of runs, even over the joints' states.

A piece visits cells of the state space, joint by joint: a stretch of positions, and an octave of speed in one
direction. The sample gives every cell its turn, the rarest first, and takes of the pieces that visit it the one whose
content hashes lowest: as good as drawn by lot, and the same for any order of the runs and any number of processes.
"""

from __future__ import annotations

import hashlib
from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid_rs.runs.cells import MIN_SAMPLES
from dynid_rs.runs.checks.motion import block_edges, block_velocity
from dynid_rs.runs.recording import Recording

KEPT_RATE = 200.0
"""Rate [Hz] that states have at the default band."""
PER_SAMPLE = 750
"""Bytes per joint and sample at that rate: measured, `python benches/stream.py --space`."""
PIECE = 20.0
"""Duration of a piece [s]: long against the band's filter, short against a run that warms up."""
POSITION_CELL = 0.5
"""Width of a position's cell [rad, m]."""
N_POSITIONS = 32
"""Cells of positions; what lies beyond counts to the last one."""
SLOWEST, N_OCTAVES = -8, 12
"""Speeds up to 2**SLOWEST [rad/s, m/s] are rest; above it, so many octaves."""


@dataclass(frozen=True, eq=False)
class Piece:
    """Rows `start` to `stop` of a run.

    `key`: a hash of its samples; `cells`: where it goes, ascending; `n_bytes`: memory that learning from it takes.
    """

    start: int
    stop: int
    key: str
    cells: NDArray[np.uint16]
    n_bytes: int


def recording_bytes(recording: Recording) -> int:
    """Memory of a run's signals."""
    return sum(value.nbytes for value in vars(recording).values() if isinstance(value, np.ndarray))


def work_space(recording: Recording) -> int:
    """Memory [bytes] that identification takes for a run: its signals, and states, columns, rows, predictions.

    An estimate for the default band; what is kept has the rate that the band asks for.
    """
    n_kept = recording.duration * min(recording.rate, KEPT_RATE)
    return recording_bytes(recording) + int(n_kept * recording.n_joints * PER_SAMPLE)


def pieces_of(recording: Recording, duration: float = PIECE) -> list[Piece]:
    """Cut a run into pieces of about `duration` [s] in equal numbers of rows."""
    cuts = _cuts(recording, duration)
    per_row = work_space(recording) / recording.n_samples
    pieces = []
    for start, stop in cuts:
        part = recording if len(cuts) == 1 else recording.slice(start, stop)
        key = _key(recording, start, stop)
        pieces.append(Piece(start, stop, key, _cells(part), int(per_row * (stop - start))))
    return pieces


def _cuts(recording: Recording, duration: float) -> list[tuple[int, int]]:
    n = recording.n_samples
    count = max(1, min(int(recording.duration / duration), n // (4 * MIN_SAMPLES)))
    return list(pairwise(np.linspace(0, n, count + 1).astype(int).tolist()))


def cut_out(recording: Recording, piece: Piece) -> Recording:
    """Return a piece with memory of its own: a view would hold the whole run."""
    part = recording.slice(piece.start, piece.stop)
    own: dict[str, Any] = {name: x.copy() for name, x in vars(part).items() if isinstance(x, np.ndarray)}
    return replace(part, **own)


def content_key(recording: Recording) -> str:
    """Hash of what a run measured: time, position and torque."""
    return run_key([_key(recording, start, stop) for start, stop in _cuts(recording, PIECE)])


def run_key(keys: Sequence[str]) -> str:
    """`content_key` of a run whose pieces have these keys: its samples are hashed once."""
    return keys[0] if len(keys) == 1 else hashlib.sha256("".join(keys).encode()).hexdigest()


def _key(recording: Recording, start: int, stop: int) -> str:
    state = hashlib.sha256()
    for signal in (recording.t, recording.q, recording.tau):
        state.update(signal[start:stop].data.cast("B"))
    return state.hexdigest()


def _cells(recording: Recording) -> NDArray[np.uint16]:
    speed = block_velocity(recording)
    position = recording.q[block_edges(recording)][: len(speed)]
    place = np.clip(np.floor(position / POSITION_CELL) + N_POSITIONS // 2, 0, N_POSITIONS - 1)
    octave = np.floor(np.log2(np.maximum(np.abs(speed), 2.0**SLOWEST))) - SLOWEST
    pace = np.sign(speed) * np.where(np.abs(speed) > 2.0**SLOWEST, np.clip(octave, 0, N_OCTAVES - 1) + 1, 0)
    joint = np.arange(speed.shape[1])
    cells = (joint * N_POSITIONS + place) * (2 * N_OCTAVES + 1) + pace + N_OCTAVES
    return np.unique(cells).astype(np.uint16)


def choose_pieces(pieces: Sequence[Piece], n_bytes: int) -> list[int]:
    """Indices of the pieces of a sample of at most `n_bytes`, ascending; at least one.

    Depends on the pieces' keys, cells and sizes alone, not on their order.
    """
    visitors: dict[int, list[int]] = defaultdict(list)
    for index in sorted(range(len(pieces)), key=lambda k: pieces[k].key):
        for cell in pieces[index].cells.tolist():
            visitors[cell].append(index)
    order = sorted(visitors, key=lambda cell: (len(visitors[cell]), cell))
    waiting = {cell: iter(visitors[cell]) for cell in order}
    chosen: set[int] = set()
    served: Counter[int] = Counter()
    left, turn = n_bytes, 0
    while waiting:
        for cell in [cell for cell in order if cell in waiting]:
            if served[cell] > turn:
                continue
            found = next((k for k in waiting[cell] if k not in chosen), None)
            if found is None:
                del waiting[cell]
                continue
            if pieces[found].n_bytes > left and chosen:
                return sorted(chosen)
            chosen.add(found)
            served.update(pieces[found].cells.tolist())
            left -= pieces[found].n_bytes
        turn += 1
    return sorted(chosen)
