"""Faults of time and of cells: what is no number, stamps that repeat, gaps, units of time, jitter."""

from __future__ import annotations

import numpy as np
from exam.draw import log_uniform

from bad_data.sets import Columns, RunSet
from bad_data.story import Story, Wanted, any_joint, any_run, files_of, inner_row, name_of, some_or_all

UNITS = {"ms": 1e3, "us": 1e6, "ns": 1e9, "ms since 1970": 1e3, "ns since 1970": 1e9}
EPOCH = 1_700_000_000


def not_a_number(rng: np.random.Generator, made: RunSet, variant: int) -> Story:
    """Cells that hold no number: NaN, infinity, nothing, a word."""
    spoiled, k = made.copied(), any_run(rng, made)
    names = [name for name in spoiled.columns[k] if name != "t"]
    column = str(rng.choice(names))
    row = inner_row(rng, len(spoiled.columns[k]["t"]))
    rows = row + np.arange(int(log_uniform(rng, 1, 40)))
    kind = ("NaN", "infinity", "empty cell", "word", "NaN in CSV")[variant % 5]
    wanted = Wanted(("not_finite", "bad_cell"), (name_of(k),), (column,), (row, int(rows[-1]) + 1))
    if kind in ("NaN", "infinity"):
        spoiled.columns[k][column][rows] = np.nan if kind == "NaN" else rng.choice([-np.inf, np.inf])
        return Story(f"{kind} in {column}", spoiled, wanted)
    suffixes = tuple(".csv" if run == k else ".parquet" for run in range(spoiled.n_runs))
    wanted = Wanted(wanted.codes, files_of((k,), suffixes), (column,), wanted.rows)
    word = {"empty cell": "", "word": str(rng.choice(["n/a", "ERR", "--"])), "NaN in CSV": "nan"}[kind]
    texts = {k: {(int(at), column): word for at in rows}}
    return Story(f"{kind} in {column}", spoiled, wanted, suffixes, texts)


def time_not_increasing(rng: np.random.Generator, made: RunSet, variant: int) -> Story:
    """Repeated stamps, repeated blocks, a clock that was set back, two logs in one file, rows in disorder."""
    spoiled, k = made.copied(), any_run(rng, made)
    columns = spoiled.columns[k]
    t, n = columns["t"], len(columns["t"])
    row = inner_row(rng, n)
    kind = ("stamp twice", "block twice", "clock set back", "two logs", "rows in disorder")[variant % 5]
    if kind == "stamp twice":
        length = int(rng.integers(1, 4))
        t[row : row + length] = t[row - 1]
    elif kind == "block twice":
        length = int(log_uniform(rng, 3, 200))
        order = np.concatenate([np.arange(row), np.arange(max(0, row - length), n)])
        columns.update({name: x[order] for name, x in columns.items()})
    elif kind == "clock set back":
        t[row:] -= float(log_uniform(rng, 0.1, 2.0))
    elif kind == "two logs":
        t[row:] -= t[row] - t[0]
    else:
        columns.update({name: _exchanged(x, row) for name, x in columns.items()})
    follows = ("run_twice",) if kind == "block twice" else ()
    wanted = Wanted(("time_backwards", "time_stands_still"), (name_of(k),), ("t",), (row - 1, row + 4), also=follows)
    return Story(kind, spoiled, wanted)


def _exchanged(x: np.ndarray, row: int) -> np.ndarray:
    x = x.copy()
    x[[row, row + 1]] = x[[row + 1, row]]
    return x


def gaps(rng: np.random.Generator, made: RunSet, variant: int) -> Story:
    """Rows that are missing: a few here and there, or seconds at once."""
    spoiled, k = made.copied(), any_run(rng, made)
    columns = spoiled.columns[k]
    n = len(columns["t"])
    kept = np.ones(n, dtype=bool)
    many = variant % 2 == 0
    first = n
    for _ in range(int(rng.integers(1, 6)) if many else 1):
        row = inner_row(rng, n)
        length = int(rng.integers(2, 9)) if many else int(rng.integers(10, max(12, n // 4)))
        length = min(length, n - row - 10)  # what is missing at the end is no gap
        kept[row : row + length] = False
        first = min(first, row)
    rows = (first - 1, int(kept.sum())) if many else (first - 1, first + 1)
    columns.update({name: x[kept] for name, x in columns.items()})
    what = "some rows missing" if many else "seconds missing"
    return Story(what, spoiled, Wanted(("gap", "long_gap"), (name_of(k),), ("t",), rows))


def unit_of_time(rng: np.random.Generator, made: RunSet, variant: int) -> Story:
    """Time in ms, us, ns, or in ticks since 1970, in one run or in all."""
    spoiled = made.copied()
    name = list(UNITS)[variant % 5]
    runs = some_or_all(rng, made)
    for k in runs:
        _in_unit(spoiled.columns[k], name)
    word = {"ms": "milliseconds", "us": "microseconds", "ns": "nanoseconds"}[name.split()[0]]
    wanted = Wanted(("sampling_rate", "time_unit"), files_of(runs), ("t",), words=(word,))
    return Story(f"{name} in {'one run' if len(runs) == 1 else 'all runs'}", spoiled, wanted)


def _in_unit(columns: Columns, name: str) -> None:
    factor = UNITS[name]
    if "1970" in name:
        columns["t"] = EPOCH * int(factor) + np.round(columns["t"] * factor).astype(np.int64)
    else:
        columns["t"] = columns["t"] * factor


def jitter(rng: np.random.Generator, made: RunSet, variant: int) -> Story:
    """Stamps that are not those of the samples: random, in bursts, in pairs."""
    spoiled = made.copied()
    runs = some_or_all(rng, made)
    kind = ("random", "bursts", "pairs")[variant % 3]
    size, count = float(rng.uniform(0.3, 0.49)), int(rng.integers(3, 9))
    for k in runs:
        t = spoiled.columns[k]["t"]
        step = float(np.median(np.diff(t)))
        number = np.arange(len(t))
        if kind == "random":
            t += step * rng.uniform(-size, size, len(t))
        elif kind == "bursts":  # sent when `count` of them are there
            t += step * ((count - 1 - number % count) * 0.9)
        else:
            t += step * 2 * size * 0.9 * (number % 2)
    what = f"{kind}{f' of {count}' if kind == 'bursts' else ''}"
    return Story(what, spoiled, Wanted(("jitter",), files_of(runs), ("t",)))


def degrees(rng: np.random.Generator, made: RunSet, variant: int) -> Story:
    """Angles in degrees: positions, with or without the speeds, in one run or in all."""
    spoiled = made.copied()
    runs = some_or_all(rng, made)
    signals = ("q", "q_motor", "dq") if variant % 2 == 0 else ("q", "q_motor")
    for k in runs:
        for name, x in spoiled.columns[k].items():
            if name.rpartition("_")[0] in signals:
                spoiled.columns[k][name] = np.degrees(x)
    what = f"{' and '.join(signals)} in {'one run' if len(runs) == 1 else 'all runs'}"
    columns = tuple(f"q_{j}" for j in range(made.n_joints))
    return Story(what, spoiled, Wanted(("units_degrees",), files_of(runs), columns))


def run_twice(rng: np.random.Generator, made: RunSet, variant: int) -> Story:
    """The run to test on is one to learn from: copied, cut, or with a clock of its own."""
    spoiled = made.copied()
    k, last = int(rng.integers(made.n_runs - 1)), made.n_runs - 1
    copied = {name: x.copy() for name, x in made.columns[k].items()}
    kind = ("copied", "another clock", "a part of it", "saved as CSV", "other samples at its start")[variant % 5]
    n = len(copied["t"])
    if kind == "another clock":
        copied["t"] = copied["t"] + float(rng.uniform(1.0, 1000.0))
    elif kind == "a part of it":
        start = int(rng.integers(n // 5, n // 2))
        copied = {name: x[start : start + n // 3] for name, x in copied.items()}
    elif kind == "other samples at its start":
        copied[f"tau_{any_joint(rng, made)}"][: n // 10] *= 1.01
    spoiled.columns[last] = copied
    suffixes = tuple(".csv" if kind == "saved as CSV" and run == last else ".parquet" for run in range(made.n_runs))
    wanted = Wanted(("run_twice",), files_of((k, last), suffixes))
    return Story(kind, spoiled, wanted, suffixes)
