"""What this machine can do in one thread, and what share of it our kernels reach: a table and a picture (roofline).

Limits and operations come from the Rust bench (`rust/dynid-offline/benches/batch.rs`): it measures multiply-adds,
arithmetic of which half is additions, and bytes from and to every cache, and counts a kernel's operations by a number
that counts.
"""

from __future__ import annotations

import json
import math
import shutil
import subprocess
from dataclasses import dataclass

from measure import ROOT, Row, unit

FIGURE = ROOT / "docs" / "measured" / "figures" / "benchmarks.svg"
N = 6
"""Joints of the bench's arm."""
PLACES = ("first cache", "second cache", "memory")


@dataclass(frozen=True)
class Kernel:
    """What a sample costs: operations, bytes read and written, and where the bytes lie (index into [`PLACES`]).

    Of what is stored in memory the samples stay in the cache.
    """

    name: str
    time: float
    products: int
    others: int
    read: int
    written: int
    place: int

    @property
    def operations(self) -> int:
        """Of all kinds."""
        return self.products + self.others

    @property
    def bytes(self) -> int:
        """In and out."""
        return self.read + self.written

    def bounds(self, limits: dict) -> dict[str, float]:
        """Nanoseconds per sample that the machine takes at least, by what binds."""
        return {
            "multiply-adds": self.products / limits["multiply_adds"],
            "arithmetic": self.operations / max(limits["arithmetic"], limits["multiply_adds"]),
            f"bytes of the {PLACES[self.place]}": self.read / limits["read"][self.place]
            + self.written / limits["written"][self.place],
        }

    def share(self, limits: dict) -> tuple[float, str]:
        """Part of the limit that binds, and which one it is."""
        bounds = self.bounds(limits)
        binding = max(bounds, key=bounds.get)
        return bounds[binding] / self.time, binding


def figures_by_path() -> list[dict]:
    """What the Rust bench prints, narrowest registers first; nothing where there is no Rust."""
    if shutil.which("cargo") is None:
        return []
    command = ["cargo", "bench", "--quiet", "-p", "dynid-offline", "--bench", "batch"]
    lines = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout.splitlines()
    return [json.loads(line) for line in lines if line.startswith("{")]


def kernels(figures: dict) -> list[Kernel]:
    """The rows of the Rust bench: every number is one of a sample of six joints."""
    state, torque, columns = 8 * 3 * N, 8 * N, 8 * 10 * N * N
    filled = 8 * 10 * N * (N + 1) // 2
    products, others = figures["regressor_operations"]
    consumed = products + filled // 8
    return [
        Kernel("inverse dynamics", figures["rnea_ns"], *figures["rnea_operations"], state, torque, 0),
        Kernel("inverse dynamics, lanes", figures["rnea_in_lanes_ns"], *figures["rnea_operations"], state, torque, 0),
        Kernel("regressor, used up", figures["regressor_consumed_ns"], consumed, others, state + filled, filled, 0),
        Kernel("regressor, stored in cache", figures["regressor_stored_ns"], products, others, state, columns, 1),
        Kernel("regressor, stored in memory", figures["regressor_in_memory_ns"], products, others, 0, columns, 2),
    ]


def rows():
    """One row per limit of the widest registers, and one per kernel on every vector path; draws the picture."""
    by_path = [figures for figures in figures_by_path() if figures["path"] != "baseline"]
    if not by_path:
        yield Row("", "limits of this machine", "not measured here", "", note="needs Rust, and AVX2")
        return
    wide = by_path[-1]
    draw(wide)
    for figures in by_path:
        rate = 2 * figures["multiply_adds"]
        mixed = figures["arithmetic"]
        yield Row(
            "",
            f"multiply-adds, {figures['path']}",
            f"{rate:.3g} Gflop/s",
            "",
            note=f"mixed with as many additions {mixed:.3g} G operations/s",
        )
    for k, place in enumerate(PLACES):
        read, written = wide["read"][k], wide["written"][k]
        yield Row("", f"bytes of the {place}", f"read {read:.3g}, written {written:.3g} GB/s", "")
    yield Row("", "clock", f"{wide['clock']:.3g} GHz", "")
    for figures in by_path:
        for kernel in kernels(figures):
            yield row(kernel, figures)


GOALS = {
    "inverse dynamics": 0.7,
    "inverse dynamics, lanes": 0.7,
    "regressor, used up": 0.6,
    "regressor, stored in cache": 0.6,
    "regressor, stored in memory": 0.8,
}


def row(kernel: Kernel, figures: dict) -> Row:
    """A kernel's time, and what part it is of the least that the limit allows."""
    share, binding = kernel.share(figures)
    goal = GOALS[kernel.name] if figures["path"] == "avx512" else None
    return Row(
        "",
        f"{kernel.name}, {figures['path']}: share of the limit",
        f"{100 * share:.0f} % of {binding}",
        "",
        limit="" if goal is None else f">= {100 * goal:.0f} %",
        met=None if goal is None else share >= goal,
        note=f"{unit(1e-9 * kernel.time)} a sample of {kernel.operations} operations, {kernel.bytes} bytes",
    )


WIDTH, HEIGHT, LEFT, BOTTOM = 720, 400, 64, 48
INTENSITY, RATE = (0.02, 20.0), (1.0, 400.0)
"""Ends of the axes: operations per byte, operations per nanosecond."""
COLOURS = ("#4c78a8", "#b279a2", "#f58518", "#54a24b", "#e45756")


def draw(figures: dict) -> None:
    """Write the picture of the widest registers."""
    flat = max(figures["arithmetic"], figures["multiply_adds"])
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" font-family="sans-serif">',
        f"<title>Operations per nanosecond over operations per byte, one thread, {figures['path']}</title>",
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="#fff"/>',
        *axes(),
    ]
    for k, place in enumerate(PLACES):
        slope = figures["read"][k]
        start = max(INTENSITY[0], RATE[0] / slope)
        corners = (at(start, slope * start), at(flat / slope, flat), at(INTENSITY[1], flat))
        points = " ".join(f"{x:.1f},{y:.1f}" for x, y in corners)
        parts.append(f'<polyline points="{points}" fill="none" stroke="#888" stroke-width="1.5"/>')
        x, y = corners[0]
        parts.append(text(x + 12, y - 2, f"{place}, {slope:.3g} GB/s", "#555"))
    x, y = at(INTENSITY[1], flat)
    parts.append(text(x, y - 8, f"{flat:.0f} G operations/s", "#555", "end"))
    for k, (kernel, colour) in enumerate(zip(kernels(figures), COLOURS, strict=True)):
        x, y = at(kernel.operations / kernel.bytes, kernel.operations / kernel.time)
        share, binding = kernel.share(figures)
        parts.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="5" fill="{colour}"/>')
        line = HEIGHT - BOTTOM - 16 * (len(COLOURS) - k)
        label = f"{kernel.name}: {100 * share:.0f} % of {binding}"
        parts.append(text(WIDTH - 24, line, label, colour, "end"))
    FIGURE.write_text("\n".join([*parts, "</svg>"]) + "\n", encoding="utf-8")


def text(x: float, y: float, words: str, colour: str = "#333", anchor: str = "start", more: str = "") -> str:
    """Words in the picture."""
    return f'<text x="{x:.1f}" y="{y:.1f}" font-size="12" text-anchor="{anchor}" fill="{colour}"{more}>{words}</text>'


def at(intensity: float, rate: float) -> tuple[float, float]:
    """Place in the picture."""
    part = [math.log(x / low) / math.log(high / low) for x, (low, high) in ((intensity, INTENSITY), (rate, RATE))]
    return LEFT + part[0] * (WIDTH - LEFT - 24), HEIGHT - BOTTOM - part[1] * (HEIGHT - BOTTOM - 24)


def axes():
    """Ticks at powers of ten, and what is on the axes."""
    low, high = HEIGHT - BOTTOM, 24
    yield f'<path d="M{LEFT} {high} V{low} H{WIDTH - 24}" fill="none" stroke="#333"/>'
    for value in (0.1, 1.0, 10.0):
        yield text(at(value, RATE[0])[0], low + 18, f"{value:g}", anchor="middle")
    for value in (1.0, 10.0, 100.0):
        yield text(LEFT - 8, at(INTENSITY[0], value)[1] + 4, f"{value:g}", anchor="end")
    yield text((LEFT + WIDTH) / 2, HEIGHT - 8, "operations per byte", anchor="middle")
    turned = f' transform="rotate(-90 16 {HEIGHT / 2})"'
    yield text(16, HEIGHT / 2, "operations per nanosecond", anchor="middle", more=turned)
