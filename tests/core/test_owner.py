"""One owner for what is being written."""

import fcntl
import getpass
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

from rpaug.core import owner
from rpaug.core.errors import BadInput
from rpaug.core.owner import owned

YEAR_BACK = time.time() - 365 * 86400
HOLDS = """
import sys, time
from pathlib import Path
from rpaug.core.owner import owned
with owned(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(600)
"""


def test_a_second_owner_is_refused_and_a_killed_one_leaves_no_lock(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By name, host and age, also where the clock was set back meanwhile."""
    target = tmp_path / "deep" / "out"
    command = [sys.executable, "-c", HOLDS, str(target)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout
        assert other.stdout.readline() == "held\n"
        who = f"process {other.pid} of {getpass.getuser()} on {socket.gethostname()}, for 0 minutes"
        with pytest.raises(BadInput, match=who), owned(target):
            pass
        monkeypatch.setattr(owner.time, "time", lambda: YEAR_BACK)
        with pytest.raises(BadInput, match="for 0 minutes"), owned(target):
            pass
        other.kill()
        other.wait()
    with owned(target):
        assert (tmp_path / "deep" / ".out.lock").exists()
    assert not (tmp_path / "deep" / ".out.lock").exists()


def test_a_lock_whose_file_its_last_owner_took_away_is_taken_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lock, take, gone = tmp_path / ".out.lock", fcntl.flock, list[None]()

    def last_owner_ends(descriptor: int, how: int) -> None:
        take(descriptor, how)
        if not gone:
            gone.append(lock.unlink())

    monkeypatch.setattr(fcntl, "flock", last_owner_ends)
    with owned(tmp_path / "out"):
        assert gone
        assert lock.exists()


def test_folders_that_were_made_for_the_lock_alone_are_gone(tmp_path: Path) -> None:
    with owned(tmp_path / "a" / "b" / "out"):
        pass
    assert not list(tmp_path.iterdir())
    with owned(tmp_path / "a" / "b" / "out"):
        (tmp_path / "a" / "kept").write_text("")
    assert [path.name for path in (tmp_path / "a").iterdir()] == ["kept"]


BEGINS = """
import os, sys, time
from multiprocessing import get_context
from pathlib import Path
from rpaug.core import owner
def target(link):
    try:
        return os.readlink(link)
    except FileNotFoundError:  # closed since it was listed
        return ""
with owner.owned(Path(sys.argv[1])):
    child = get_context("fork").Process(target=owner.child, args=("time", "sleep", 600), daemon=True)
    child.start()
    ends, open_there = time.monotonic() + 10, [".lock"]
    while open_there and time.monotonic() < ends:
        links = [f"/proc/{child.pid}/fd/{one}" for one in os.listdir(f"/proc/{child.pid}/fd")]
        open_there = [one for one in map(target, links) if one.endswith(".lock")]
    print(child.is_alive(), open_there)
    child.kill()
"""


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="looks for open files in /proc")
def test_a_forked_child_holds_nothing_of_what_its_parent_owns(tmp_path: Path) -> None:
    command = [sys.executable, "-c", BEGINS, str(tmp_path / "out")]
    assert subprocess.run(command, capture_output=True, text=True).stdout == "True []\n"
