"""Seconds to compile the CPU kernels, and to load them from the cache, in fresh processes.

    python tools/bench/raster_jit.py [--features 0 16] [--json FILE]

`import` is the import of numba, torch and rpaug, which both share. Processor time, so that other work on
the machine does not count.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

PROGRAM = """
import sys, time
from rpaug.render.splat import warm
begin = time.process_time()
warm(int(sys.argv[1]))
print(begin, time.process_time() - begin)
"""


def seconds(features: int, cache: str) -> tuple[float, float]:
    """Processor seconds of the import and of `warm`."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": cache}
    command = [sys.executable, "-c", PROGRAM, str(features)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    begin, spent = map(float, done.stdout.split())
    return begin, spent


def main() -> None:
    """Print one line for each number of features."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--features", type=int, nargs="+", default=[0, 16])
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    rows = []
    print("features   import     cold   cached   (processor seconds)")
    for features in given.features:
        with tempfile.TemporaryDirectory() as cache:
            began, cold = seconds(features, cache)
            _, cached = seconds(features, cache)
        rows.append({"features": features, "import": began, "cold": cold, "cached": cached})
        print(f"{features:8d} {began:8.2f} {cold:8.2f} {cached:8.2f}", flush=True)
    if given.json:
        given.json.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
