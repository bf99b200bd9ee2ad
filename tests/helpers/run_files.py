"""One valid run, to be spoiled: every test of a reader breaks one thing of it."""

from __future__ import annotations

import contextlib
import os
import tempfile
from pathlib import Path

import numpy as np

JOINTS = ("shoulder", "elbow", "wrist")
N_SAMPLES = 400
RATE = 100.0

Columns = dict[str, np.ndarray]


def motion(n_samples=N_SAMPLES, n_joints=3, rate=RATE):
    """A smooth exciting motion: t (n,), q, dq, ddq (n, n_joints)."""
    t = np.arange(n_samples) / rate
    omega = 2.0 * np.pi * (0.7 + 0.33 * np.arange(n_joints))
    phase = 0.4 * np.arange(n_joints)
    angle = t[:, None] * omega + phase
    return t, 0.8 * np.sin(angle), 0.8 * omega * np.cos(angle), -0.8 * omega**2 * np.sin(angle)


def valid_columns(**kwargs) -> Columns:
    """Columns of a run without any fault: t, q_i, dq_i, tau_i."""
    t, q, dq, ddq = motion(**kwargs)
    rng = np.random.default_rng(7)
    tau = 3.0 * ddq + 0.5 * dq + 2.0 * np.cos(q) + 0.05 * rng.standard_normal(q.shape)
    columns = {"t": t}
    for signal, values in (("q", q), ("dq", dq), ("tau", tau)):
        columns |= {f"{signal}_{j}": values[:, j].copy() for j in range(q.shape[1])}
    return columns


def renamed(columns: Columns, **names: str) -> Columns:
    """The same columns with some prefixes replaced: `renamed(c, tau="current")`."""
    table = {}
    for name, values in columns.items():
        signal, _, joint = name.rpartition("_")
        table[f"{names[signal]}_{joint}" if signal in names else names.get(name, name)] = values
    return table


def write_parquet(path: Path, columns: Columns) -> Path:
    import pyarrow as pa
    import pyarrow.parquet as pq

    pq.write_table(pa.table(list(columns.values()), names=list(columns)), path)
    return path


def csv_text(columns: Columns) -> str:
    """CSV with the shortest decimals that come back bit for bit."""
    rows = zip(*(values.tolist() for values in columns.values()), strict=True)
    return "\n".join([",".join(columns), *(",".join(map(repr, row)) for row in rows)]) + "\n"


def write_csv(path: Path, columns: Columns) -> Path:
    path.write_text(csv_text(columns))
    return path


def write_npz(path: Path, columns: Columns) -> Path:
    np.savez(path, **columns)
    return path


WRITERS = {".parquet": write_parquet, ".csv": write_csv, ".npz": write_npz}


def write(path: Path, columns: Columns) -> Path:
    """Write by suffix."""
    return WRITERS[path.suffix](path, columns)


@contextlib.contextmanager
def folder_of_another_user(mode):
    """A folder with these rights, seen by somebody whom they bind: root may do everything."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        user = os.geteuid()
        write_csv(folder / "run.csv", valid_columns()).chmod(0)
        folder.chmod(mode)
        if user == 0:
            os.seteuid(65534)
        try:
            yield folder
        finally:
            os.seteuid(user)
            folder.chmod(0o700)
