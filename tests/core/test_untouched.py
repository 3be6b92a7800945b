"""What no edit reaches comes into a copy as it was: cloned, copied, or as a second name of the same file."""

import errno
import os
from pathlib import Path

import pytest

from rpaug.core import untouched
from rpaug.core.errors import RpaugError


@pytest.fixture
def recorded(tmp_path: Path) -> Path:
    path = tmp_path / "recorded.png"
    path.write_bytes(b"pixels" * 1000)
    return path


def failing(monkeypatch: pytest.MonkeyPatch, module: object, name: str, number: int) -> None:
    def fail(*_: object) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(module, name, fail)


def test_a_file_is_passed_on_with_its_bytes(recorded: Path, tmp_path: Path) -> None:
    untouched.pass_on(recorded, tmp_path / "copy.png")
    assert (tmp_path / "copy.png").read_bytes() == recorded.read_bytes()
    assert not (tmp_path / "copy.png").samefile(recorded)


def test_it_is_copied_where_nothing_can_be_cloned(
    recorded: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    failing(monkeypatch, untouched.fcntl, "ioctl", errno.EOPNOTSUPP)
    untouched.pass_on(recorded, tmp_path / "copy.png")
    assert (tmp_path / "copy.png").read_bytes() == recorded.read_bytes()


def test_a_full_disk_is_no_reason_to_try_otherwise(
    recorded: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    failing(monkeypatch, untouched.fcntl, "ioctl", errno.ENOSPC)
    with pytest.raises(OSError, match="No space"):
        untouched.pass_on(recorded, tmp_path / "copy.png")


def test_a_link_is_the_same_file_and_only_where_it_was_asked_for(
    recorded: Path, tmp_path: Path
) -> None:
    (tmp_path / "pointer.png").symlink_to(recorded)
    with untouched.hard_links(True):
        untouched.pass_on(tmp_path / "pointer.png", tmp_path / "link.png")
    assert (tmp_path / "link.png").samefile(recorded)
    assert not (tmp_path / "link.png").is_symlink()
    untouched.pass_on(recorded, tmp_path / "copy.png")
    assert not (tmp_path / "copy.png").samefile(recorded)


def test_a_file_of_too_many_names_is_copied(
    recorded: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    failing(monkeypatch, untouched.os, "link", errno.EMLINK)
    with untouched.hard_links(True):
        untouched.pass_on(recorded, tmp_path / "copy.png")
    assert (tmp_path / "copy.png").read_bytes() == recorded.read_bytes()


@pytest.mark.parametrize("number", [errno.EXDEV, errno.EPERM])
def test_where_no_link_can_be_made_it_is_said(
    recorded: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    failing(monkeypatch, untouched.os, "link", number)
    with untouched.hard_links(True), pytest.raises(RpaugError, match="--untouched copy"):
        untouched.pass_on(recorded, tmp_path / "copy.png")
