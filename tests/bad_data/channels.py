"""Faults of one channel: encoders that hang, lost bits, angles that wrap, a range that ends, damaged cells."""

from __future__ import annotations

import numpy as np
from exam.draw import log_uniform

from bad_data.sets import RunSet, with_speed
from bad_data.story import (
    Story,
    Wanted,
    any_joint,
    any_run,
    columns_of,
    files_of,
    inner_row,
    name_of,
    some_or_all,
)

LEAST_TRAVEL = 0.1
"""Way of a joint [rad] while its encoder hangs: less does no harm that anybody could tell from a rest."""


def stuck_encoder(rng: np.random.Generator, made: RunSet, variant: int) -> Story:
    """A position that stays for a while, or from some row on, while the joint moves."""
    to_the_end = variant % 3 == 2
    spoiled = with_speed(made) if to_the_end else made.copied()
    k = any_run(rng, made)
    columns = spoiled.columns[k]
    signal = "q_motor" if "q_motor_0" in columns and rng.random() < 0.5 else "q"
    t = columns["t"]
    for _ in range(200):
        j, row = any_joint(rng, made), inner_row(rng, len(t))
        length = len(t) - row if to_the_end else int(float(log_uniform(rng, 0.15, 2.0)) * made.case.rate)
        held = columns[f"{signal}_{j}"][row : row + length + 1]
        if len(held) > length and abs(held[-1] - held[0]) > LEAST_TRAVEL:
            break
        if to_the_end and np.ptp(held) > 3 * LEAST_TRAVEL:
            break
    columns[f"{signal}_{j}"][row : row + length] = columns[f"{signal}_{j}"][row]
    what = f"{signal} {'to the end' if to_the_end else f'for {length / made.case.rate:.2f} s'}"
    return Story(what, spoiled, Wanted(("stuck",), (name_of(k),), (f"{signal}_{j}",), (row, row + length)))


def lost_bits(rng: np.random.Generator, made: RunSet, variant: int) -> Story:
    """The low bits of a position or a torque are gone, or one bit of a position hangs."""
    spoiled = made.copied()
    runs = some_or_all(rng, made)
    kind = ("low bits of q", "a bit hangs", "low bits of tau")[variant % 3]
    j = _busiest(rng, made)
    signal = "tau" if "tau" in kind else "q"
    column = f"{signal}_{j}"
    whole = np.concatenate([run[column] for run in made.columns])
    size = float(log_uniform(rng, 0.01, 0.15))
    step = float(log_uniform(rng, 2e-3, 2e-2)) if signal == "q" else float(np.ptp(whole) / rng.integers(8, 25))
    value = int(rng.integers(2))
    for k in runs:
        x = spoiled.columns[k][column]
        if kind == "a bit hangs":
            count = float(made.sensors.link_step[j])
            bit = 1 << max(4, round(np.log2(size / count)))
            counts = np.round(x / count).astype(np.int64)
            x[:] = (counts | bit if value else counts & ~bit) * count
        else:
            x[:] = np.round(x / step) * step
    return Story(kind, spoiled, Wanted(("lost_bits",), files_of(runs), (column,)))


def _busiest(rng: np.random.Generator, made: RunSet) -> int:
    """One of the joints that travel half a radian at least, in every run."""
    ways = np.min([[np.ptp(run[f"q_{j}"]) for j in range(made.n_joints)] for run in made.columns], axis=0)
    good = np.flatnonzero(ways > 0.5)
    return int(rng.choice(good)) if len(good) else int(np.argmax(ways))


def wrapped(rng: np.random.Generator, made: RunSet, variant: int) -> Story:
    """An angle that starts again after a turn, within the motion."""
    spoiled = made.copied()
    j = _busiest(rng, made)
    whole = np.concatenate([run[f"q_{j}"] for run in made.columns])
    edge = float(np.quantile(whole, rng.uniform(0.2, 0.8)))
    runs = tuple(k for k, run in enumerate(made.columns) if run[f"q_{j}"].min() < edge < run[f"q_{j}"].max())
    down = variant % 2 == 0
    for k in runs:
        for signal in ("q", "q_motor"):
            if f"{signal}_{j}" in spoiled.columns[k]:
                x = spoiled.columns[k][f"{signal}_{j}"]
                x[:] = np.where(x > edge, x - 2 * np.pi, x) if down else np.where(x < edge, x + 2 * np.pi, x)
    signals = ("q", "q_motor")
    columns = tuple(f"{signal}_{j}" for signal in signals)
    return Story(f"at {edge:.2f} rad", spoiled, Wanted(("wrapped",), files_of(runs), columns))


def saturated(rng: np.random.Generator, made: RunSet, variant: int) -> Story:
    """A torque channel that ends at a number, on one side or on both."""
    spoiled = made.copied()
    j = any_joint(rng, made)
    both = variant % 2 == 0
    whole = np.concatenate([run[f"tau_{j}"] for run in made.columns])
    share = float(rng.uniform(0.03, 0.15))
    if both:
        limit = float(np.quantile(np.abs(whole), 1 - share))
        low, high = -limit, limit
    elif rng.random() < 0.5:
        low, high = -np.inf, float(np.quantile(whole, 1 - share))
    else:
        low, high = float(np.quantile(whole, share)), np.inf
    changed = []
    for k, columns in enumerate(spoiled.columns):
        x = columns[f"tau_{j}"]
        if np.any((x > high) | (x < low)):
            changed.append(k)
        columns[f"tau_{j}"] = np.clip(x, low, high)
    return Story(
        f"tau, {'both sides' if both else 'one side'}",
        spoiled,
        Wanted(("saturated",), files_of(tuple(changed)), (f"tau_{j}",)),
    )


def absurd_samples(rng: np.random.Generator, made: RunSet, variant: int) -> Story:
    """Cells that no arm wrote: spikes, sentinels, drop-outs to zero."""
    kind = ("spike of q", "spike of tau", "drop-out of tau", "sentinel", "spike of dq")[variant % 5]
    spoiled = with_speed(made) if kind == "spike of dq" else made.copied()
    k, j = any_run(rng, made), any_joint(rng, made)
    columns = spoiled.columns[k]
    row, sign = inner_row(rng, len(columns["t"])), rng.choice([-1.0, 1.0])
    rows = slice(row, row + int(rng.integers(1, 4)))
    if kind == "spike of q":
        column = f"q_{j}"
        columns[column][rows] += sign * float(log_uniform(rng, 0.3, 50.0))
    elif kind == "spike of tau":
        column = f"tau_{j}"
        columns[column][rows] = sign * float(log_uniform(rng, 3, 1000)) * np.ptp(columns[column])
    elif kind == "drop-out of tau":
        j, row = _loaded(rng, made, k)
        column, rows = f"tau_{j}", slice(row, row + 1)
        columns[column][rows] = 0.0
    elif kind == "sentinel":
        column = f"{rng.choice(['q', 'tau'])}_{j}"
        columns[column][rows] = float(rng.choice([-9999.0, 65535.0, 2147483647.0, 3.4e38]))
    else:
        column = f"dq_{j}"
        columns[column][rows] = sign * float(log_uniform(rng, 3, 300)) * np.ptp(columns[column])
    codes = ("absurd_value", "torque_spike", "position_jump", "velocity_spike")
    return Story(kind, spoiled, Wanted(codes, (name_of(k),), (column,), (rows.start, rows.stop)))


def _loaded(rng: np.random.Generator, made: RunSet, k: int) -> tuple[int, int]:
    """A joint and a row at which its torque is far from zero, against its noise and against its size."""
    for _ in range(500):
        j, row = any_joint(rng, made), inner_row(rng, len(made.columns[k]["t"]))
        tau = made.columns[k][f"tau_{j}"]
        noise = np.hypot(made.sensors.noise[j], made.sensors.quantum[j])
        if abs(tau[row]) > max(30 * noise, tau.std()):
            break
    return j, row


def bad_velocity(rng: np.random.Generator, made: RunSet, variant: int) -> Story:
    """A speed channel that is late, held, in another unit, of another joint or turned round."""
    spoiled = with_speed(made)
    runs = some_or_all(rng, made)
    kind = ("late", "held", "another unit", "turned round", "of another joint")[variant % 5]
    moves = _moving(made)
    joints = moves if rng.random() < 0.5 else [int(rng.choice(moves))]
    period = max(3, round(float(rng.uniform(0.03, 0.1)) * made.case.rate))
    late = float(rng.uniform(0.03, 0.1))
    factor, word = [(180 / np.pi, "deg/s"), (30 / np.pi, "rpm"), (1e3, "1e+03 times")][int(rng.integers(3))]
    if kind == "of another joint":
        joints = [int(j) for j in rng.permutation(moves)[:2]]
    for k in runs:
        columns = spoiled.columns[k]
        before = {j: columns[f"dq_{j}"].copy() for j in range(made.n_joints)}
        for place, j in enumerate(joints):
            if kind == "late":
                columns[f"dq_{j}"] = np.interp(columns["t"] - late, columns["t"], before[j])
            elif kind == "held":
                columns[f"dq_{j}"] = before[j][np.arange(len(before[j])) // period * period]
            elif kind == "of another joint":
                columns[f"dq_{j}"] = before[joints[1 - place]]
            else:
                columns[f"dq_{j}"] = (factor if kind == "another unit" else -1.0) * before[j]
    words = {
        "late": ("late", "after"),
        "held": ("held", "holds"),
        "another unit": (word, f"{factor:.3g} times", f"{factor:.4g} times"),
        "turned round": ("sign",),
        "of another joint": tuple(f"joint_{j + 1}" for j in joints),
    }[kind]
    size = {"late": f" {1e3 * late:.0f} ms", "held": f" {period} rows", "another unit": f" {word}"}.get(kind, "")
    wanted = Wanted(("dq_disagrees",), files_of(runs), columns_of("dq", joints), words=words)
    return Story(kind + size, spoiled, wanted)


def _moving(made: RunSet) -> list[int]:
    """Joints that travel a quarter of a radian in every run: of others a speed says nothing."""
    return [j for j in range(made.n_joints) if min(np.ptp(run[f"q_{j}"]) for run in made.columns) > 0.25]


def filtered(rng: np.random.Generator, made: RunSet, variant: int) -> Story:
    """Torques or speeds that went through a slow filter of the maker's on their way."""
    from scipy.signal import butter, lfilter

    kind = ("first order", "moving average", "second order", "speed, first order", "first order, one joint")[
        variant % 5
    ]
    spoiled = with_speed(made) if "speed" in kind else made.copied()
    signal = "dq" if "speed" in kind else "tau"
    joints = [int(rng.choice(_moving(made)))] if "one joint" in kind else _moving(made) if signal == "dq" else None
    joints = list(range(made.n_joints)) if joints is None else joints
    cutoff = min(float(log_uniform(rng, 1.5, 5.0)), made.case.rate / 10)
    length = max(4, round(0.44 / cutoff * made.case.rate))
    order = 2 if "second" in kind else 1
    b, a = (np.full(length, 1 / length), [1.0]) if "average" in kind else butter(order, cutoff / (made.case.rate / 2))
    for columns in spoiled.columns:
        for j in joints:
            x = columns[f"{signal}_{j}"]
            padded = np.concatenate([np.full(10 * length, x[0]), x])
            columns[f"{signal}_{j}"] = lfilter(b, a, padded)[10 * length :]
    codes = ("dq_disagrees",) if signal == "dq" else ("torque_filtered",)
    words = ("late", "filter") if signal == "dq" else ()
    runs = tuple(range(made.n_runs))
    wanted = Wanted(codes, files_of(runs), columns_of(signal, joints), words=words)
    return Story(f"{kind}, {cutoff:.1f} Hz", spoiled, wanted)
