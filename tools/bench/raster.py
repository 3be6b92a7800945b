"""Compositing forward and backward: ours against C++ and against plain numba, in one run.

    python tools/bench/raster.py [--threads 2] [--repeats 15] [--clock wall|cpu] [--json FILE]

Every engine gets the same projected splats and tile lists; the three take turns within each repeat, and the
fastest repeat counts, so that other work on the machine hits all alike. `cpu` sums the processor time of all
threads instead of the time on the wall. Gates: ours <= 1.1 x C++ and plain >= 4 x ours, as geometric means.
"""

import argparse
import ctypes
import json
import math
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
import raster_plain

from rpaug.render.splat import Rasteriser, Splats, View, _compositing, _compositing_backward
from rpaug.render.splat._numba import _on_cache_line
from rpaug.render.splat._threads import together

SIZES = [  # width, height, Gaussians, channels
    (128, 128, 10_000, 3),
    (128, 128, 10_000, 19),
    (256, 256, 50_000, 3),
    (640, 480, 50_000, 19),
    (640, 480, 200_000, 3),
    (640, 480, 200_000, 19),
]
ENGINES = ("ours", "native", "plain")


def scene(width: int, height: int, count: int) -> tuple[Splats, View]:
    """Gaussians about as large as their share of the image, strewn over depths of 0.8 to 3 m."""
    rng = np.random.default_rng(0)
    focal = 0.9 * width
    z = rng.uniform(0.8, 3.0, count)
    u, v = rng.uniform(-0.05, 1.05, (2, count)) * [[width], [height]]
    means = np.stack([(u - width / 2) / focal * z, (v - height / 2) / focal * z, z], 1)
    footprint = z / focal * math.sqrt(width * height / count)
    scales = np.exp(rng.normal(0, 0.4, (count, 3))) * footprint[:, None]
    K = np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1.0]])
    splats = Splats(
        means.astype(np.float32),
        rng.uniform(0.1, 0.95, count).astype(np.float32),
        np.zeros((count, 1, 3), np.float32),
        rng.normal(size=(count, 4)).astype(np.float32),
        scales.astype(np.float32),
    )
    return splats, View(K, np.eye(4), width, height)


def build_native(folder: Path) -> ctypes.CDLL:
    """The C++ kernels, compiled for this machine."""
    library = folder / "raster_native.so"
    source = Path(__file__).with_name("raster_native.cpp")
    command = ["g++", "-O3", "-march=native", "-std=c++17", "-shared", "-fPIC", "-pthread"]
    subprocess.run([*command, "-Wno-psabi", "-o", str(library), str(source)], check=True)
    return ctypes.CDLL(str(library))


def pointers(*values: object) -> list[object]:
    """Arrays as pointers, integers as they are."""
    return [
        v.ctypes.data_as(ctypes.c_void_p) if isinstance(v, np.ndarray) else ctypes.c_int(v)  # type: ignore[arg-type]
        for v in values
    ]


class Case:
    """One row of the table: its inputs, and a forward and backward call for each engine."""

    def __init__(self, native: ctypes.CDLL, size: tuple[int, int, int, int], threads: int) -> None:
        width, height, count, channels = size
        engine = Rasteriser(threads=threads)
        engine.forward(*scene(width, height, count), surface=False)
        rng = np.random.default_rng(1)
        values = rng.uniform(0, 1, (count, channels)).astype(np.float32)
        d_out = rng.normal(size=(height, width, channels)).astype(np.float32)
        d_left = rng.normal(size=(height, width)).astype(np.float32)
        rules = _compositing.rules(engine.settings)
        flat_rules = np.array(rules, np.float32)
        grid, starts, entries = engine._grid, engine._starts, engine._entries
        records, order, slot_of = engine._records, engine._order, engine._slot_of
        stride = 16 * math.ceil((6 + channels) / 16)
        self.entries, changed = len(entries), np.empty(len(entries), np.int64)
        self.results = {
            name: (
                np.empty((height, width, channels), np.float32),
                np.empty((height, width), np.float32),
                _on_cache_line(len(entries) * stride, np.float32).reshape(-1, stride),
            )
            for name in ENGINES
        }
        none = np.zeros((0, 0), np.int32)
        boxed = records.copy()  # the others read half width and half height last
        boxed[:, 6:] = np.stack([records[:, 7], np.sqrt(records[:, 6]) / records[:, 4]], 1)

        def ours(backward: bool) -> None:
            out, left, slots = self.results["ours"]
            ticket = np.zeros(1, np.int64)
            given = (ticket, order, records, values, *grid, starts, entries, rules, changed)
            if backward:
                job, given = (
                    _compositing_backward.backward_kernel(channels),
                    (*given, slot_of, out, left, d_out, d_left, slots.reshape(-1)),
                )
            else:
                job, given = _compositing.forward_kernel(channels), (*given, out, left, none)
            together(job, [given] * threads)

        def cplusplus(backward: bool) -> None:
            out, left, slots = self.results["native"]
            given = [channels, threads, len(order), order, boxed, values, *grid, starts, entries]
            given += [flat_rules]
            if backward:
                given += [slot_of, out, left, d_out, d_left, slots, stride]
            else:
                given += [out, left]
            failed = (native.composite_backward if backward else native.composite)(
                *pointers(*given)
            )
            assert not failed

        def plain(backward: bool) -> None:
            out, left, slots = self.results["plain"]
            given = (boxed, values, *grid, starts, entries, flat_rules)
            more = (slot_of, out, left, d_out, d_left, slots) if backward else (out, left)
            given = (*given, *more)
            job = raster_plain.backward if backward else raster_plain.forward
            together(job, [(part, threads, *given) for part in range(threads)])

        self.calls: dict[str, Callable[[bool], None]] = dict(
            zip(ENGINES, (ours, cplusplus, plain), strict=True)
        )

    def check(self) -> None:
        """The three agree, but for splats on a threshold; also compiles what is not compiled yet."""
        for call in self.calls.values():
            call(False)
            call(True)
        out, _, slots = self.results["ours"]
        for name in ("native", "plain"):
            far = (np.abs(out - self.results[name][0]) > 1e-4).mean()
            other = self.results[name][2]
            assert far < 1e-3, f"{name}: {far:.2%} of the values differ"
            apart = np.linalg.norm(slots - other) / np.linalg.norm(other)
            assert apart < 1e-2, f"{name}: gradients are {apart:.1e} apart"

    def time(self, repeats: int, clock: Callable[[], float]) -> dict[str, tuple[float, float]]:
        """Milliseconds of forward and backward, the fastest of `repeats`."""
        best = {name: [math.inf, math.inf] for name in ENGINES}
        for _ in range(repeats):
            for name, call in self.calls.items():
                for way in (False, True):
                    begin = clock()
                    call(way)
                    best[name][way] = min(best[name][way], 1e3 * (clock() - begin))
        return {name: (times[0], times[1]) for name, times in best.items()}


def geometric_mean(values: list[float]) -> float:
    """The n-th root of the product."""
    return math.exp(sum(map(math.log, values)) / len(values))


def main() -> None:
    """Print the table, and write it as JSON if asked to."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--repeats", type=int, default=15)
    parser.add_argument("--clock", choices=("wall", "cpu"), default="wall")
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    clock = time.perf_counter if given.clock == "wall" else time.process_time
    rows = []
    print(
        f"forward + backward, ms ({given.clock} clock, {given.threads} threads, best of {given.repeats})"
    )
    print(
        "   image        N   ch   entries |      ours          C++         plain   | ours/C++  plain/ours"
    )
    with tempfile.TemporaryDirectory() as folder:
        native = build_native(Path(folder))
        for size in SIZES:
            case = Case(native, size, given.threads)
            case.check()
            times = case.time(given.repeats, clock)
            ours, cplusplus, plain = (sum(times[name]) for name in ENGINES)
            rows.append(
                {"size": size, "ms": times, "of_native": ours / cplusplus, "gain": plain / ours}
            )
            cells = "  ".join(f"{f:5.1f} +{b:6.1f}" for f, b in (times[name] for name in ENGINES))
            print(
                f"{size[0]:4d}x{size[1]:<4d} {size[2]:7d} {size[3]:4d} {case.entries:9d} | {cells} |"
                f" {ours / cplusplus:6.2f}  {plain / ours:8.1f}",
                flush=True,
            )
    of_native, gain = (geometric_mean([row[key] for row in rows]) for key in ("of_native", "gain"))
    worst = max(row["of_native"] for row in rows)
    print(f"geometric means: {of_native:.2f} x C++ (gate 1.10, worst row {worst:.2f}), ")
    print(f"                 plain numba takes {gain:.1f} x as long (gate 4.0)")
    if given.json:
        summary = {
            "clock": given.clock,
            "threads": given.threads,
            "of_native": of_native,
            "gain": gain,
        }
        given.json.write_text(json.dumps({**summary, "rows": rows}, indent=1))


if __name__ == "__main__":
    main()
