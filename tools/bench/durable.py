"""What it costs to see an episode's files onto the disk before it appears: seconds a folder, by the way it is done.

    python tools/bench/durable.py [--files 255] [--bytes 12000] [--repeats 9] [--json FILE]

Three ways by turns: each file asked for and waited for by itself; the whole file system by one call (`syncfs`); and
all files asked for before the first is waited for, as rpaug does. Medians.
"""

import argparse
import ctypes
import json
import os
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from rpaug.core.files import flush, flush_folder


def one_by_one(folder: Path) -> None:
    for path in folder.iterdir():
        flush(path)
    flush(folder)


def whole_file_system(folder: Path) -> None:
    descriptor = os.open(folder, os.O_RDONLY)
    assert ctypes.CDLL(None).syncfs(descriptor) == 0
    os.close(descriptor)


WAYS: dict[str, Callable[[Path], None]] = {
    "one by one": one_by_one,
    "the file system": whole_file_system,
    "all asked for first": flush_folder,
}


def measured(way: Callable[[Path], None], files: int, size: int) -> tuple[float, float]:
    """Wall and processor milliseconds for a fresh folder."""
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        for number in range(files):
            (folder / f"{number}.png").write_bytes(os.urandom(size))
        wall, processor = time.perf_counter(), time.process_time()
        way(folder)
        return 1e3 * (time.perf_counter() - wall), 1e3 * (time.process_time() - processor)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--files", type=int, default=255)
    parser.add_argument("--bytes", type=int, default=12_000)
    parser.add_argument("--repeats", type=int, default=9)
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    runs = [
        {name: measured(way, given.files, given.bytes) for name, way in WAYS.items()}
        for _ in range(given.repeats)
    ]
    found = {}
    for name in WAYS:
        wall, processor = (statistics.median(run[name][k] for run in runs) for k in (0, 1))
        found[name] = {"wall_ms": round(wall, 1), "processor_ms": round(processor, 1)}
        print(name, found[name], flush=True)
    if given.json:
        given.json.write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
