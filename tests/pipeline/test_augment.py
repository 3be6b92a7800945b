"""The whole job: same bytes however it is run, bad episodes skipped, killed runs resumed."""

import errno
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rpaug_adapters.rlbench import RLBench
from rpaug_adapters.rlbench.pickles import dump, load
from runs import GROUP, augment, contents

from rpaug.core import files, owner
from rpaug.core.errors import BadInput
from rpaug.core.files import decode_png, encode_png
from rpaug.pages import contact
from rpaug.pipeline import journal, recipe, report, workers, write
from rpaug.pipeline.augment import Run, execute
from rpaug.pipeline.job import Job
from rpaug.pipeline.run import Budget

RECIPE = {
    "version": 1,
    "seed": 3,
    "copies": 2,
    "edits": [
        {
            "op": "recolor",
            "target": {"handle": 300},
            "color": {"sample": "colosseum"},
            "probability": 0.9,
        },
        {"one_of": [{"op": "light_color"}, {"op": "camera_pose", "camera": "front", "weight": 2}]},
    ],
}


def made(**changes: object) -> recipe.Recipe:
    return recipe.build(RECIPE | changes)


def same_arrays(one: object, other: object) -> bool:
    if isinstance(one, np.ndarray):
        return (
            isinstance(other, np.ndarray)
            and one.dtype == other.dtype
            and np.array_equal(one, other)
        )
    if isinstance(one, dict):
        return (
            isinstance(other, dict)
            and one.keys() == other.keys()
            and all(same_arrays(one[k], other[k]) for k in one)
        )
    if isinstance(one, list | tuple):
        return (
            type(one) is type(other)
            and len(one) == len(other)
            and all(map(same_arrays, one, other))
        )
    if hasattr(one, "__dict__"):
        return same_arrays(one.__dict__, other.__dict__)
    return type(one) is type(other) and one == other


def test_an_empty_recipe_copies_every_pixel_and_number(template: Path, tmp_path: Path) -> None:
    summary = augment(template, recipe.build({"version": 1}), tmp_path / "out")
    assert (summary.copies, summary.exit_code) == (2, 0)
    for path in (template / GROUP / "episode0").rglob("*"):
        copy = (
            tmp_path / "out" / GROUP / "episode0" / path.relative_to(template / GROUP / "episode0")
        )
        if path.suffix == ".png":
            assert np.array_equal(decode_png(path), decode_png(copy))
        elif path.suffix == ".pkl":
            assert same_arrays(load(path), load(copy))


def test_workers_and_reruns_make_the_same_bytes(template: Path, tmp_path: Path) -> None:
    augment(template, made(), tmp_path / "one", workers=1)
    augment(template, made(), tmp_path / "again", workers=1)
    augment(template, made(), tmp_path / "two", workers=2)
    first = contents(tmp_path / "one")
    assert len([name for name in first if name.endswith(".json")]) == 4
    assert first == contents(tmp_path / "again")
    assert first == contents(tmp_path / "two")


def test_what_is_drawn_does_not_depend_on_the_other_episodes(
    template: Path, tmp_path: Path
) -> None:
    augment(template, made(), tmp_path / "all")
    augment(template, made(select={"episodes": ["*episode1"]}), tmp_path / "one")
    every = {}
    for path in (tmp_path / "all").rglob(report.NAME):
        described = json.loads(path.read_bytes())
        every[described["source"], described["copy"]] = described["draws"]
    for path in (tmp_path / "one").rglob(report.NAME):
        described = json.loads(path.read_bytes())
        assert described["draws"] == every[described["source"], described["copy"]]


def test_copies_are_numbered_from_zero_originals_first(template: Path, tmp_path: Path) -> None:
    augment(template, made(keep_originals=True), tmp_path / "out")
    keys = RLBench().episodes(tmp_path / "out")
    assert keys == [f"{GROUP}/episode{i}" for i in range(6)]
    reports = [json.loads((tmp_path / "out" / key / report.NAME).read_bytes()) for key in keys]
    assert [one["copy"] for one in reports] == [0, 0, 1, 1, 2, 2]
    assert [one["synthetic"] for one in reports] == [False, False, True, True, True, True]
    assert contents(tmp_path / "out" / keys[0]).keys() == contents(template / keys[0]).keys() | {
        report.NAME
    }


def test_a_report_replays_its_episode_exactly(template: Path, tmp_path: Path) -> None:
    augment(template, made(), tmp_path / "out")
    key = f"{GROUP}/episode3"
    described = json.loads((tmp_path / "out" / key / report.NAME).read_bytes())
    write.replay(RLBench(), template, described, tmp_path / "again", key)
    assert contents(tmp_path / "out" / key) == contents(tmp_path / "again" / key)


def test_a_moved_camera_keeps_its_holes_beside_the_episode(template: Path, tmp_path: Path) -> None:
    moving = made(
        copies=1, edits=[{"op": "camera_pose", "camera": "front", "shift": 0.1, "turn": 0.05}]
    )
    augment(template, moving, tmp_path / "out")
    folder = tmp_path / "out" / GROUP / "episode0"
    described = json.loads((folder / report.NAME).read_bytes())
    with np.load(folder / report.HOLES) as holes:
        share = np.mean(
            [np.unpackbits(holes[f"front/{t}"], axis=1, count=96).mean() for t in range(8)]
        )
    assert abs(share - described["hole_share"]["front"]) < 1e-5
    assert described["plan"]["carriers"]["front"] == "tier 1, surfels"
    assert described["plan"]["carriers"]["overhead"] == "tier 0, recorded pixels"
    before, after = (
        RLBench().read(root, f"{GROUP}/episode0") for root in (template, tmp_path / "out")
    )
    assert not np.array_equal(before.views["front"].rgb(0), after.views["front"].rgb(0))
    assert np.array_equal(before.views["overhead"].rgb(0), after.views["overhead"].rgb(0))


def test_a_bad_episode_among_good_ones_is_skipped_and_named(dataset: Path, tmp_path: Path) -> None:
    image = dataset / GROUP / "episode0/front_rgb/2.png"
    image.write_bytes(image.read_bytes()[:-9])
    summary = augment(dataset, made(), tmp_path / "out")
    assert summary.exit_code == 1
    assert list(summary.failures) == [f"{GROUP}/episode0"]
    assert "front_rgb/2.png" in summary.failures[f"{GROUP}/episode0"]
    assert RLBench().episodes(tmp_path / "out") == [
        f"{GROUP}/episode0",
        f"{GROUP}/episode1",
    ]  # no gap
    assert (
        json.loads((tmp_path / "out" / report.SUMMARY).read_bytes())["failures"] == summary.failures
    )


def test_nothing_good_leaves_nothing_behind(dataset: Path, tmp_path: Path) -> None:
    for pickled in dataset.rglob("low_dim_obs.pkl"):
        pickled.write_bytes(b"cos\nsystem\n.")
    summary = augment(dataset, made(), tmp_path / "out")
    assert summary.exit_code == 2
    assert all("os.system" in reason for reason in summary.failures.values())
    assert not (tmp_path / "out").exists()


def test_output_is_never_written_over_or_into_the_dataset(dataset: Path, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    with pytest.raises(BadInput, match="--resume"):
        augment(dataset, made(), tmp_path / "out")
    with pytest.raises(BadInput, match="outside"):
        augment(dataset, made(), dataset / "out")
    assert not (dataset / "out").exists()


def test_selecting_nothing_is_an_error(template: Path, tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="episode1"):
        augment(template, made(select={"episodes": ["none*"]}), tmp_path / "out")


def test_a_full_disk_stops_the_run_and_removes_the_half_episode(
    template: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = Path.write_bytes
    written = []

    def fill(path: Path, data: bytes) -> int:
        written.append(path)
        if len(written) > 12:
            raise OSError(28, "No space left on device", str(path))
        return whole(path, data)

    monkeypatch.setattr(Path, "write_bytes", fill)
    summary = augment(template, made(), tmp_path / "out")
    assert summary.exit_code == 2
    assert "No space left" in str(summary.aborted)
    assert not (tmp_path / "out").exists()


def test_a_run_that_a_full_disk_stopped_goes_on_to_the_same_bytes(
    template: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Until then episodes keep the numbers that they have in the whole."""
    whole = Path.write_bytes

    def fill(path: Path, data: bytes) -> int:
        if ".episode1-" in str(path):
            raise OSError(28, "No space left on device", str(path))
        return whole(path, data)

    monkeypatch.setattr(Path, "write_bytes", fill)
    found = augment(template, made(), tmp_path / "out")
    assert (found.exit_code, found.copies) == (1, 2)
    assert RLBench().episodes(tmp_path / "out") == [f"{GROUP}/episode0", f"{GROUP}/episode2"]
    monkeypatch.setattr(Path, "write_bytes", whole)
    assert augment(template, made(), tmp_path / "out", resume=True).resumed == 2
    augment(template, made(), tmp_path / "fresh")
    assert contents(tmp_path / "out") == contents(tmp_path / "fresh")


@contextmanager
def no_file_can_be_opened() -> Iterator[None]:
    """As many files are open as this process may have."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(256, hard), hard))
    held: list[int] = []
    try:
        with suppress(OSError):
            while True:
                held.append(os.open(os.devnull, os.O_RDONLY))
        yield
    finally:
        for one in held:
            os.close(one)
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


def test_a_limit_of_handles_is_no_episode_s_fault(template: Path, tmp_path: Path) -> None:
    """A reader calls the file unreadable that it could not open; the next episode would come to the same."""
    key = f"{GROUP}/episode0"
    job = Job("rlbench", template, key, tmp_path / "out", ((1, key),), RECIPE, 0)
    journal.begin(tmp_path / "out", {}, template)
    with no_file_can_be_opened():
        found = workers.attempt(job)
    assert (found.fatal, found.copies) == (True, 0)
    assert found.error == f"{tmp_path / 'out'}: Too many open files"
    assert workers.attempt(job).error is None  # nothing else was wrong


def test_an_output_that_may_not_be_written_ends_the_run(
    template: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def forbidden(path: Path, data: bytes) -> int:
        raise PermissionError(errno.EACCES, "Permission denied", str(path))

    monkeypatch.setattr(Path, "write_bytes", forbidden)
    found = augment(template, made(), tmp_path / "out")
    assert str(found.aborted).startswith(str(tmp_path / "out"))
    assert str(found.aborted).endswith(": Permission denied")
    assert not found.failures


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="looks for processes in /proc")
def test_a_killed_run_is_resumed_to_the_same_bytes(template: Path, tmp_path: Path) -> None:
    many = tmp_path / "many"
    for number in range(6):
        shutil.copytree(
            template / GROUP / f"episode{number % 2}", many / GROUP / f"episode{number}"
        )
    (tmp_path / "r.yaml").write_text(json.dumps(RECIPE))
    out = tmp_path / "out"
    command = [
        sys.executable,
        "-m",
        "rpaug",
        "augment",
        str(many),
        "--recipe",
        str(tmp_path / "r.yaml"),
        "--out",
        str(out),
    ]
    run = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    while run.poll() is None and not (out / GROUP / "episode1").exists():
        time.sleep(0.01)
    at_work = workers_of(run.pid)
    run.send_signal(signal.SIGKILL)
    run.wait()
    ended(at_work)  # they note what they have written until they see that they are alone
    done = RLBench().episodes(out)
    assert 2 <= len(done) < 12
    for key in done:
        assert (out / key / report.NAME).exists()  # what appears is whole
    noted = len(journal.read(out).made)  # what was written and not noted is made again
    assert len(done) - 1 <= noted <= len(done)
    (out / GROUP / ".episode9-dead.part").mkdir(exist_ok=True)
    resumed = subprocess.run(
        [*command, "--resume", "--json"], capture_output=True, text=True, check=True
    )
    assert json.loads(resumed.stdout)["resumed"] == noted
    assert not list(out.rglob("*.part"))
    fresh = tmp_path / "fresh"
    augment(many, recipe.load(tmp_path / "r.yaml"), fresh)
    names = ("rpaug.contact.html",)
    assert {k: v for k, v in contents(out).items() if k not in names} == contents(fresh)
    other = tmp_path / "other.yaml"
    other.write_text(json.dumps(RECIPE | {"seed": 4}))
    with pytest.raises(BadInput, match="another recipe"):
        augment(many, recipe.load(other), out, resume=True)


def long_run(template: Path, tmp_path: Path) -> tuple[list[str], Path, Path]:
    """A command that augments six episodes on two workers, its input and its output."""
    many, out = tmp_path / "many", tmp_path / "out"
    for number in range(6):
        shutil.copytree(
            template / GROUP / f"episode{number % 2}", many / GROUP / f"episode{number}"
        )
    (tmp_path / "r.yaml").write_text(json.dumps(RECIPE))
    command = [sys.executable, "-m", "rpaug", "augment", str(many), "--workers", "2"]
    return [*command, "--recipe", str(tmp_path / "r.yaml"), "--out", str(out)], many, out


def workers_of(pid: int) -> list[int]:
    """The processes of a run's pool."""
    children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return [
        int(one)
        for one in children
        if b"resource_tracker" not in Path(f"/proc/{one}/cmdline").read_bytes()
    ]


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False


def ended(processes: list[int]) -> None:
    """Wait until none of them is at work any more."""
    ends = time.monotonic() + 5
    while time.monotonic() < ends and any(map(alive, processes)):
        time.sleep(0.05)
    assert not any(map(alive, processes))


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="looks for processes in /proc")
@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_workers_end_with_a_killed_run_and_nothing_more_is_written(
    template: Path, tmp_path: Path, sent: signal.Signals
) -> None:
    command, many, out = long_run(template, tmp_path)
    run = subprocess.Popen(
        command,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # tests may ignore it
    )
    while run.poll() is None and not (out / GROUP / "episode1").exists():
        time.sleep(0.01)
    at_work = workers_of(run.pid)
    run.send_signal(sent)
    said = run.communicate()[1]
    assert len(at_work) == 2
    assert ("the same command with --resume goes on" in said) == (sent != signal.SIGKILL)
    ended(at_work)
    there = RLBench().episodes(out)
    assert len(there) < 12
    augment(many, recipe.load(tmp_path / "r.yaml"), out, resume=True)
    assert not list(out.rglob("*.part"))
    assert not (tmp_path / ".out.lock").exists()
    fresh = tmp_path / "fresh"
    augment(many, recipe.load(tmp_path / "r.yaml"), fresh)
    assert contents(out) == contents(fresh)


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="looks for processes in /proc")
def test_a_killed_worker_costs_nothing_that_can_be_done_again(
    template: Path, tmp_path: Path
) -> None:
    command, many, out = long_run(template, tmp_path)
    run = subprocess.Popen([*command, "--json"], stdout=subprocess.PIPE, text=True)
    while run.poll() is None and not (out / GROUP / "episode0").exists():
        time.sleep(0.01)
    os.kill(workers_of(run.pid)[0], signal.SIGKILL)
    printed, _ = run.communicate()
    assert run.returncode == 0
    assert not json.loads(printed)["failures"]
    fresh = tmp_path / "fresh"
    augment(many, recipe.load(tmp_path / "r.yaml"), fresh)
    names = ("rpaug.contact.html",)
    assert {k: v for k, v in contents(out).items() if k not in names} == contents(fresh)


def test_numbers_do_not_depend_on_when_an_episode_was_lost(
    template: Path, dataset: Path, tmp_path: Path
) -> None:
    """One that took its workers with it, after all others, and one that cannot be read."""

    def losing(jobs: Iterable[Job], _: int, __: Budget | None) -> Iterator[workers.Outcome]:
        first, *rest = jobs
        for job in reversed(rest):
            yield workers.attempt(job)
        yield workers.Outcome(first, 0, f"{first.key}: {workers.DIED}")

    found = augment(template, made(), tmp_path / "lost", engine=losing)
    assert list(found.failures) == [f"{GROUP}/episode0"]
    image = dataset / GROUP / "episode0/front_rgb/2.png"
    image.write_bytes(b"")
    augment(dataset, made(), tmp_path / "unread")
    card = "README.md"  # names the dataset
    lost, unread = (contents(tmp_path / name) for name in ("lost", "unread"))
    assert {**lost, card: b""} == {**unread, card: b""}
    assert f"{GROUP}/episode1/{report.NAME}" in lost


def test_what_cannot_be_read_back_is_taken_back(
    template: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def cut(image: np.ndarray, level: int = 3) -> bytes:
        data = encode_png(image, level)
        return data if image.shape[-1:] != (3,) else data[: len(data) // 2]

    monkeypatch.setattr(files, "encode_png", cut)
    summary = augment(template, made(copies=1, edits=[{"op": "light_color"}]), tmp_path / "out")
    assert summary.exit_code == 2
    assert len(summary.failures) == 2
    for words in summary.failures.values():
        assert "what was written cannot be read back" in words
        assert "cut off" in words
    assert not (tmp_path / "out").exists()


def test_a_file_system_without_locks_is_told(
    template: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def none(*_: object) -> None:
        raise OSError(errno.ENOLCK, "no locks")

    monkeypatch.setattr(owner.fcntl, "flock", none)
    summary = augment(template, made(copies=1), tmp_path / "out")
    assert any("knows no locks" in words for said in summary.warnings.values() for words in said)


def test_a_name_is_nothing_but_text_in_card_and_pages(template: Path, tmp_path: Path) -> None:
    evil = tmp_path / "ds<script>alert(1)<\x1b[31m|`q`"
    shutil.copytree(template, evil)
    write_to = f"{GROUP}/episode0/variation_descriptions.pkl"
    (evil / write_to).write_bytes(dump(["push <script>alert(2)</script>\x1b[31m"]))
    augment(evil, made(copies=1, edits=[{"op": "light_color"}]), tmp_path / "out")
    text = (tmp_path / "out/README.md").read_text()
    assert "\x1b" not in text
    assert "<script>" not in text.split("---")[2]
    page = contact.write(RLBench(), evil, tmp_path / "out").read_text()
    assert r"push &lt;script&gt;alert(2)&lt;/script&gt;\x1b[31m" in page
    assert "\x1b" not in page
    assert "<script>alert" not in page


def test_one_run_at_a_time_writes_to_a_folder(template: Path, tmp_path: Path) -> None:
    with (
        owner.owned(tmp_path / "out"),
        pytest.raises(BadInput, match=rf"process {os.getpid()} of .* expected one run at a time"),
    ):
        augment(template, made(), tmp_path / "out")
    assert not (tmp_path / "out").exists()
    augment(template, made(), tmp_path / "out")


def test_resuming_touches_nothing_that_is_not_its_own(template: Path, tmp_path: Path) -> None:
    precious = tmp_path / "precious"
    (precious / ".thing.part").mkdir(parents=True)
    (precious / "thesis.txt").write_text("years of work")
    before = sorted(path.relative_to(precious) for path in precious.rglob("*"))
    with pytest.raises(BadInput, match="no run of rpaug here"):
        augment(template, made(), precious, resume=True)
    assert sorted(path.relative_to(precious) for path in precious.rglob("*")) == before


def test_resuming_wants_the_same_dataset_version_and_tier(
    template: Path, dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    augment(template, made(copies=1), tmp_path / "out")
    moved = Path(shutil.copytree(template, tmp_path / "elsewhere/moved"))
    assert augment(moved, made(copies=1), tmp_path / "out", resume=True).resumed == 2
    image = moved / GROUP / "episode1/front_rgb/3.png"
    image.write_bytes(encode_png(255 - decode_png(image)))
    with pytest.raises(BadInput, match="another dataset, or this one with files that were changed"):
        augment(moved, made(copies=1), tmp_path / "out", resume=True)
    with pytest.raises(BadInput, match="another tier"):
        execute(Run(template, made(copies=1), tmp_path / "out", tier=1), resume=True)
    monkeypatch.setattr("rpaug.pipeline.run.__version__", "0.0.1")
    with pytest.raises(BadInput, match="another version"):
        augment(template, made(copies=1), tmp_path / "out", resume=True)


def test_an_episode_whose_report_was_emptied_is_made_again(template: Path, tmp_path: Path) -> None:
    augment(template, made(copies=1), tmp_path / "out")
    before = contents(tmp_path / "out")
    (tmp_path / "out" / GROUP / "episode1" / report.NAME).write_bytes(b"")
    assert augment(template, made(copies=1), tmp_path / "out", resume=True).resumed == 1
    assert contents(tmp_path / "out") == before


def test_resuming_a_finished_run_keeps_its_summary(template: Path, tmp_path: Path) -> None:
    first = augment(template, made(copies=1), tmp_path / "out")
    again = augment(template, made(copies=1), tmp_path / "out", resume=True)
    assert (again.copies, again.resumed) == (first.copies, 2)
    assert again.changed_share == first.changed_share


def test_a_dangling_link_spoils_its_own_episode_only(dataset: Path, tmp_path: Path) -> None:
    (dataset / GROUP / "episode0/extra").symlink_to(tmp_path / "nowhere")
    summary = augment(dataset, made(copies=1), tmp_path / "out")
    assert (summary.copies, summary.exit_code, list(summary.failures)) == (
        1,
        1,
        [f"{GROUP}/episode0"],
    )


def test_linked_folders_are_followed_once(template: Path, tmp_path: Path) -> None:
    (tmp_path / "linked").mkdir()
    (tmp_path / "linked/episodes").symlink_to(template / GROUP)
    (tmp_path / "linked/again").symlink_to(tmp_path / "linked")
    assert RLBench().episodes(tmp_path / "linked") == ["episodes/episode0", "episodes/episode1"]


def test_a_target_that_only_some_draws_need_is_missed_before_anything_is_written(
    template: Path, tmp_path: Path
) -> None:
    rare = {"op": "recolor", "target": {"handle": 4711}, "color": "red", "probability": 0.01}
    summary = augment(template, made(edits=[rare]), tmp_path / "out")
    assert summary.exit_code == 2
    assert not (tmp_path / "out").exists()


def test_a_fault_of_ours_is_one_episode_less(
    template: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = RLBench.read

    def read(self: RLBench, root: Path, key: str) -> Any:
        return 1 / 0 if key.endswith("episode0") else whole(self, root, key)

    monkeypatch.setattr(RLBench, "read", read)
    monkeypatch.delenv("RPAUG_DEBUG", raising=False)
    summary = augment(template, made(copies=1, edits=[]), tmp_path / "out")
    assert "ZeroDivisionError" in summary.failures[f"{GROUP}/episode0"]


def test_the_environment_is_left_as_it_was(template: Path, tmp_path: Path) -> None:
    before = dict(os.environ)
    augment(template, made(copies=1), tmp_path / "out", workers=2)
    assert dict(os.environ) == before
