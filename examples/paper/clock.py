"""How long things take: the steps of an identification, one online cycle, and whose processor it was."""

from __future__ import annotations

import os
import platform
import time
from pathlib import Path

from errors import LAW

from dynid_rs import Recording, RobotModel, ThreeLoopIdentifier, TorqueModel
from dynid_rs.runs.preprocessing import States


class Clock:
    """Time of every step that an identification reports; pass it as `on_progress` and `stop` it."""

    def __init__(self) -> None:
        self.began = time.perf_counter()
        self.marks: list[tuple[str, float]] = []

    def __call__(self, step: str) -> None:
        """A step begins."""
        self.marks.append((step, time.perf_counter()))

    def stop(self) -> None:
        """The last step has ended."""
        self.marks.append(("", time.perf_counter()))

    def seconds(self, word: str) -> float:
        """Time of all steps whose name holds a word [s]."""
        steps = zip(self.marks, self.marks[1:], strict=False)
        return sum(after - before for (step, before), (_, after) in steps if word in step)

    @property
    def total(self) -> float:
        """From the first step to the end [s]."""
        return self.marks[-1][1] - self.began


def identification(robot: RobotModel, run: Recording, repeats: int) -> Clock:
    """Identify from one run as the paper does; the quickest of some repeats."""
    clocks = []
    for _ in range(repeats):
        clock = Clock()
        ThreeLoopIdentifier(robot, friction_law=LAW).fit(run, on_progress=clock)
        clock.stop()
        clocks.append(clock)
    return min(clocks, key=lambda clock: clock.total)


def online_cycle(model: TorqueModel, states: States, repeats: int) -> float:
    """Time of one sample of the torque model when a run is evaluated sample after sample [s]."""
    signals = states.signals()
    times = []
    for _ in range(max(3, repeats)):
        began = time.perf_counter()
        model.evaluate(*signals)
        times.append(time.perf_counter() - began)
    return min(times) / len(states.t)


def machine() -> str:
    """Name of the processor and number of cores."""
    name = platform.processor() or platform.machine()
    described = Path("/proc/cpuinfo")
    if described.is_file():
        for line in described.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                name = line.partition(":")[2].strip()
                break
    return f"{name}, {os.cpu_count()} cores"
