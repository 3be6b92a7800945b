"""Processor seconds from calling a command until it has said its help.

    python tools/bench/start.py [--repeat 9]

Median over the repeats of user and system time of `rpaug --help` and `rpaug inspect --help`, and of a command line of
typer's with one empty command, which is the least that any of them can take; and of importing what understands wishes.
"""

import argparse
import os
import statistics
import subprocess
import sys

BARE = "import typer; app = typer.Typer(); app.command()(lambda: None); app()"
COMMANDS = {
    "rpaug --help": ["-m", "rpaug", "--help"],
    "rpaug inspect --help": ["-m", "rpaug", "inspect", "--help"],
    "typer alone": ["-c", BARE, "--help"],
    "words, imported": ["-c", "import rpaug.language.asking"],
}


def seconds(arguments: list[str]) -> float:
    """Processor seconds of one process."""
    child = subprocess.Popen([sys.executable, *arguments], stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(child.pid, 0)
    if status:
        raise SystemExit(f"{arguments} ended with {status}")
    return usage.ru_utime + usage.ru_stime


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeat", type=int, default=9)
    repeat = parser.parse_args().repeat
    for name, arguments in COMMANDS.items():
        print(f"{name:24}{statistics.median(seconds(arguments) for _ in range(repeat)):8.2f}")
