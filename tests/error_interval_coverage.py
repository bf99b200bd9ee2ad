"""How often 95 % intervals of an error hold, on simulated errors whose true size is known.

`python tests/error_interval_coverage.py [--own] [RUNS] [SEED ...]` prints the table: per length of the run, kind of
error and memory, the coverage [%] of candidates (`--own`: not of them), and of what the package says: how many runs get
an interval, and how many of those intervals hold the truth; of an RMSE, and of the change between two models' RMSE on
the same run.
"""

from __future__ import annotations

import sys

import numpy as np
from scipy.fft import dct
from scipy.signal import butter, lfilter, sosfilt
from scipy.stats import t as student

from dynid_rs.base.memory import flat_top
from dynid_rs.regression.error_interval import change_interval, rmse_interval
from dynid_rs.regression.evaluation import Comparison
from dynid_rs.runs.preprocessing import ROW_RATE, Band, States

BAND = Band(5.0)
RATE = ROW_RATE * BAND.cutoff
"""Rows per second [Hz]."""
LENGTHS = (15.0, 30.0, 60.0)
MEMORIES = (0.0, 0.1, 0.5, 1.0, 2.0, 5.0)
"""Time constants [s] of the autocorrelation; of band-limited noise, one over its cutoff [rad/s]."""
PERIOD = 5.0
"""Of a motion [s] along which the size of the error goes from half to one and a half times its mean."""
DRIFT = 0.3
"""Standard deviation of the logarithm of a size that drifts: 95 % lie within a factor of 1.8."""
CHANGE = -0.4
"""True change of the RMSE from the model before to the one after."""
SHARED = 0.8
"""Correlation of the two models' errors."""


def exponential(rng, n, n_runs, memory):
    """AR(1) noise (n, n_runs) of unit variance whose autocorrelation is exp(-t / memory)."""
    pole = np.exp(-1 / (RATE * memory)) if memory else 0.0
    start, noise = rng.standard_normal((1, n_runs)), rng.standard_normal((n, n_runs))
    return lfilter([1], [1, -pole], noise * np.sqrt(1 - pole**2), axis=0, zi=pole * start)[0]


def limited(rng, n, n_runs, memory):
    """White noise below a cutoff of 1 / (2 pi memory), two poles, of unit variance."""
    if not memory or 1 / (2 * np.pi * memory) > 0.9 * RATE / 2:
        return rng.standard_normal((n, n_runs))
    sections, warm_up = butter(2, 1 / (np.pi * memory * RATE), output="sos"), int(40 * memory * RATE)
    response = sosfilt(sections, np.eye(1, 2 * warm_up)[0])
    noise = sosfilt(sections, rng.standard_normal((warm_up + n, n_runs)), axis=0)[warm_up:]
    return noise / np.sqrt(np.sum(response**2))


def along_the_motion(rng, n, n_runs, _):
    """Size (n, n_runs) that follows a periodic motion; its mean square over the run is 1."""
    size = 1 + 0.5 * np.sin(2 * np.pi * (np.arange(n)[:, None] / RATE / PERIOD + rng.uniform(size=n_runs)))
    return size / np.sqrt(np.mean(size**2, axis=0))


def drifting(rng, n, n_runs, memory):
    """Size (n, n_runs) that drifts by chance with the same memory; its expected mean square is 1."""
    return np.exp(DRIFT * exponential(rng, n, n_runs, memory) - DRIFT**2)


def constant(rng, n, n_runs, memory):
    """Size 1."""
    return np.ones((n, n_runs))


KINDS = {
    "AR(1)": (exponential, constant),
    "band-limited": (limited, constant),
    "AR(1), size along the motion": (exponential, along_the_motion),
    "AR(1), size drifts": (exponential, drifting),
    "white, size drifts": (lambda rng, n, n_runs, _: exponential(rng, n, n_runs, 0.0), drifting),
}


def as_runs(errors):
    """Comparison whose joints are the runs: `errors` (n, n_runs) at rows of the band's rate."""
    still = np.zeros(errors.shape)
    moving = np.ones(len(errors), dtype=bool)
    time = np.arange(len(errors)) / RATE
    states = States("simulated", time, *[still] * 6, errors, RATE, BAND, moving, two_encoders=False)
    return Comparison(states, errors, still, errors)


def held(intervals, truth):
    """Runs with an interval [%], and those of them whose interval holds `truth` [%]."""
    said = [interval for interval in intervals if interval is not None]
    good = sum(low <= truth <= high for low, high in said)
    return 100 * len(said) / len(intervals), 100 * good / len(said) if said else np.nan


def simulated(rng, kind, length, memory, n_runs):
    """Errors of two models on the same runs, (n, n_runs) each; RMS 1 before, 1 + CHANGE after."""
    noise, size = KINDS[kind]
    n = int(length * RATE)
    before, own = noise(rng, n, n_runs, memory), noise(rng, n, n_runs, memory)
    sizes = size(rng, n, n_runs, memory)
    after = (1 + CHANGE) * (SHARED * before + np.sqrt(1 - SHARED**2) * own)
    return before * sizes, after * sizes


def bootstrap(errors, rng, length=None, n_resamples=300):
    """Circular block bootstrap; blocks of `length` rows, or as long as Politis and White 2004 choose."""
    for error in errors.T:
        squares, n = error**2, len(error)
        if length is None:
            spectrum = np.abs(np.fft.rfft(squares - squares.mean(), 2 * n)) ** 2
            covariances = np.fft.irfft(spectrum)[:n] / n
            taper = flat_top(covariances, n)
            lags = taper * covariances[: len(taper)]
            slope, level = 2 * np.sum(np.arange(len(lags)) * lags), 2 * lags.sum() - lags[0]
            best = (1.5 * (slope / level) ** 2 * n) ** (1 / 3) if level > 0 else n / 2
            size = int(np.clip(best, 1, n / 2))
        else:
            size = length
        ahead = np.cumsum(np.concatenate([[0.0], squares, squares]))
        starts = rng.integers(0, n, (n_resamples, -(-n // size)))
        means = np.mean((ahead[starts + size] - ahead[starts]) / size, axis=1)
        yield tuple(np.sqrt(np.percentile(means, [2.5, 97.5])))


def bartlett(errors):
    """Newey-West variance of the squares over 1.3 sqrt(n) lags, critical values of fixed-b theory, on the log scale."""
    n = len(errors)
    lags = int(1.3 * np.sqrt(n))
    b = lags / n
    critical = 1.96 + 2.9694 * b + 0.416 * b**2 - 0.5324 * b**3  # Kiefer and Vogelsang 2005, Table 1
    for error in errors.T:
        squares = error**2
        covariances = np.fft.irfft(np.abs(np.fft.rfft(squares - squares.mean(), 2 * n)) ** 2)[:lags] / n
        variance = covariances[0] + 2 * np.sum((1 - np.arange(1, lags) / lags) * covariances[1:])
        half = np.exp(critical * np.sqrt(variance / n) / squares.mean() / 2)
        yield np.sqrt(squares.mean()) / half, np.sqrt(squares.mean()) * half


def cosines(errors, n_cosines=4):
    """Equal-weighted cosines and Student's t, nothing said of the memory, on the log scale."""
    squares = errors**2
    waves = dct(squares, norm="ortho", axis=0)[1 : n_cosines + 1] / np.sqrt(len(errors)) / squares.mean(axis=0)
    half = np.exp(student.ppf(0.975, n_cosines) * np.sqrt(np.mean(waves**2, axis=0)) / 2)
    return zip(np.sqrt(squares.mean(axis=0)) / half, np.sqrt(squares.mean(axis=0)) * half, strict=True)


def candidates(errors, rng):
    """Intervals by method."""
    return {
        "blocks of 1 s": list(bootstrap(errors, rng, int(RATE))),
        "blocks, automatic": list(bootstrap(errors, rng)),
        "Bartlett": list(bartlett(errors)),
        "four cosines": list(cosines(errors)),
    }


def rows(rng, n_runs, *, own_alone=False):
    """Length, kind, memory, coverage of every candidate, and (said, held) of RMSE and change."""
    for length in LENGTHS:
        for kind in KINDS:
            for memory in MEMORIES:
                before, after = simulated(rng, kind, length, memory, n_runs)
                found_by = {} if own_alone else candidates(before, rng)
                others = {name: held(found, 1.0)[1] for name, found in found_by.items()}
                own = held(rmse_interval([as_runs(before)]), 1.0)
                change = held(change_interval([as_runs(after)], [as_runs(before)]), CHANGE)
                yield length, kind, memory, others, own, change


def main(n_runs=400, seeds=(0, 1, 2), *, own_alone=False):
    """Print the table as Markdown, mean over the seeds."""
    tables = [list(rows(np.random.default_rng(seed), n_runs, own_alone=own_alone)) for seed in seeds]
    names = list(tables[0][0][3])
    heads = ["run [s]", "error", "memory [s]", *names, "RMSE: said", "held", "change: said", "held"]
    print(f"| {' | '.join(heads)} |")
    print("|---" * (7 + len(names)) + "|")
    for same in zip(*tables, strict=True):
        length, kind, memory = same[0][:3]
        means = [np.mean([row[3][name] for row in same]) for name in names]
        for place in (4, 5):
            said = np.array([row[place][0] for row in same])
            good = np.array([np.nan_to_num(row[place][1]) for row in same])
            means += [said.mean(), (said * good).sum() / said.sum() if said.any() else np.nan]
        cells = " | ".join("-" if np.isnan(mean) else f"{mean:.1f}" for mean in means)
        print(f"| {length:g} | {kind} | {memory:g} | {cells} |", flush=True)


if __name__ == "__main__":
    given = [int(word) for word in sys.argv[1:] if word != "--own"]
    asked = [given[0]] if given else []
    main(*asked, *([tuple(given[1:])] if given[1:] else []), own_alone="--own" in sys.argv)
