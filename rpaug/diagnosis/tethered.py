"""Commands of others that end when we do, however that is: with all processes that they began."""

import subprocess
import sys
from collections.abc import Sequence
from typing import IO

# Reads the number of a group of processes, and then waits for a word that its leader is done. If none comes, whoever
# was to say it is gone.
WATCH = """
import os, signal, sys, time
group = int(sys.stdin.readline() or 0)
if group and not sys.stdin.readline():
    for sent, tries in ((signal.SIGTERM, 30), (signal.SIGKILL, 1)):
        for _ in range(tries):
            try:
                os.killpg(group, sent if _ == 0 else 0)
            except OSError:
                sys.exit()
            time.sleep(0.1)
"""


def run(command: Sequence[str], output: IO[bytes]) -> int:
    """The exit code of a command that has no input; what it prints goes to `output`.

    It is the first of a group of processes. If this process is killed, or the wait interrupted, the group is asked to
    end, and ended after three seconds. Raises OSError for what is no program.
    """
    watching = subprocess.Popen(
        [sys.executable, "-ISc", WATCH],
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    with watching:
        assert watching.stdin is not None
        with subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        ) as started:
            try:
                watching.stdin.write(b"%d\n" % started.pid)
                watching.stdin.flush()
                code = started.wait()
                watching.stdin.write(b"done\n")
            finally:
                watching.stdin.close()
        return code
