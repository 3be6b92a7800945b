"""Reads a hundred thousand spoilt datasets: none may crash, hang, run code or fill the memory.

    python tools/fuzz/run.py [--cases 100000] [--state FILE] [--json FILE]

Each case takes a tiny whole dataset, spoils one file by that file's own structure (checksums and zlib streams stay
right where the format has them), and reads all of it: keys, episode, every image. It must be read, or be refused with
an error of rpaug that names a file and a place. A `clip` that is read is written again with one frame changed: the copy
must decode whole and show the other frames. Case number i is always the same. Cases run in a process of their own, so
that a crash of a C library is seen and counted; with `--state` a run that was stopped goes on where it was.
"""

import argparse
import json
import os
import re
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

BATCH = 5000  # cases of one process
SLOW, STUCK = 2.0, 30.0  # processor seconds of one case; wall seconds without one
GROWTH = 2**30  # bytes that a process may take beyond what it has when the cases begin
LAYOUTS = {
    "rlbench": "rlbench",
    "rlds": "rlds",
    "jpeg_rlds": "rlds",
    "rdt": "rdt",
    "latest_rdt": "rdt",
    "robomimic": "hdf5_sim",
    "latest_robomimic": "hdf5_sim",
    "maniskill": "hdf5_sim",
    "lerobot": "lerobot",
    "lerobot_v21": "lerobot",
    "ego4d": "video",
    "clip": "video",
    "droid": "droid",
    "recipe": "",
}  # and the adapter that reads each; recipes need none
SHARES = {
    "rlbench": 8,
    "rlds": 3,
    "jpeg_rlds": 6,
    "rdt": 2,
    "latest_rdt": 2,
    "robomimic": 2,
    "latest_robomimic": 2,
    "maniskill": 2,
    "lerobot": 1,
    "lerobot_v21": 1,
    "ego4d": 1,
    "clip": 1,
    "droid": 2,
    "recipe": 3,
}  # of 36: what is quick is tried more
TURNS = [name for name, share in SHARES.items() for _ in range(share)]
STARTS = ("os.system", "os.exec", "os.posix_spawn", "os.spawn", "os.fork", "subprocess.Popen", "pty.spawn",
          "socket.connect", "shutil.rmtree", "os.remove", "os.rename", "os.chmod")  # fmt: skip
WRITTEN, NEAR = (
    "written",
    8.0,
)  # where copies go; levels, on average, that a frame encoded anew is off at most


def read(layout: str, root: Path) -> str:
    """Read everything of a dataset; what came of it in a word. Raises what reading raises."""
    from rpaug.core.registry import adapter
    from rpaug.pipeline import recipe

    if not layout:
        recipe.load(root / "recipe.yaml")
        return "read"
    reader = adapter(layout)
    keys = reader.episodes(root)
    if not keys:
        return "none found"
    for key in list(keys)[:3]:
        episode = reader.read(root, key)
        reader.traps(episode)
        reader.untouched(episode, False)
        for view in episode.views.values():
            for image in (view.rgb, view.depth, view.ids):
                for t in range(min(episode.length, 4)) if image is not None else ():
                    image(t)
    return "read"


def spliced(root: Path) -> str:
    """Read a video, and write it with its middle frame black; what came of it. Raises what reading and writing raise,
    and ValueError where the copy does not show what it should."""
    import shutil
    from dataclasses import replace

    import numpy as np

    from rpaug.core.registry import adapter

    outcome, videos, out = read("video", root), adapter("video"), root.parent / WRITTEN
    for key in videos.episodes(root):
        episode = videos.read(root, key)
        ((name, view),) = episode.views.items()
        middle = episode.length // 2

        def shown(t: int, view: Any = view, middle: int = middle) -> np.ndarray:
            return view.rgb(t) if t != middle else np.zeros_like(view.rgb(t))

        try:
            changed = replace(episode, views={name: replace(view, rgb=shown)})
            videos.write(changed, out, key, lambda *words: {})
            made = videos.read(out, key)
            images = [made.views[name].rgb(t).astype(int) for t in range(made.length)]
        finally:
            shutil.rmtree(out, ignore_errors=True)
        if len(images) != episode.length:
            raise ValueError(f"{len(images)} frames written of {episode.length}")
        off = [abs(image - shown(t)).mean() for t, image in enumerate(images)]
        if max(off) > NEAR:
            raise ValueError(f"frame {int(np.argmax(off))} is {max(off):.0f} levels off")
        outcome = "written"
    return outcome


def named(error: Any, root: Path) -> bool:
    """Whether an error says where: a file of the dataset, and a place in it."""
    if type(error).__name__ == "BadRecipe":
        place = re.escape(str(root)) + r"/recipe/recipe\.yaml:\d+: "
        # A fault goes on to a second line where what was found has one.
        return re.match(place, str(error)) is not None
    if type(error).__name__ == "Unsupported":
        return str(root) in str(error)
    return bool(getattr(error, "field", "")) and str(root) in str(getattr(error, "where", ""))


def work(first: int, end: int, progress: Path) -> None:
    """Run some cases; writes a line of JSON for each that went wrong, and at the end one of counts."""
    import numpy as np
    import seeds
    from binaries import spoilt
    from rpaug_adapters.shared.hdf5 import CHILD

    from rpaug.core.errors import RpaugError

    started: list[str] = []
    armed = False

    def watch(event: str, about: tuple[Any, ...]) -> None:
        ours = event == "subprocess.Popen" and str(CHILD) in about[1]
        # What is written, and what the removal of a folder, seen itself, removes in it.
        ours |= bool(about) and str(about[0]).startswith(str(base / WRITTEN))
        ours |= event == "os.remove" and about[1] != -1
        if armed and event in STARTS and not ours:
            started.append(event)

    base = Path(tempfile.mkdtemp(dir="/dev/shm" if os.path.isdir("/dev/shm") else None))
    sys.addaudithook(watch)
    places: dict[str, list[tuple[Path, bytes]]] = {}
    for name in LAYOUTS:
        getattr(seeds, name)(base / name)
        files = sorted(path for path in (base / name).rglob("*") if path.is_file())
        places[name] = [(path, path.read_bytes()) for path in files]
        assert read(LAYOUTS[name], base / name) == "read"
    own = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    resource.setrlimit(resource.RLIMIT_AS, (own + GROWTH, own + GROWTH))
    counts: Counter[str] = Counter()
    mark = os.open(progress, os.O_WRONLY | os.O_CREAT)
    for case in range(first, end):
        os.pwrite(mark, f"{case:12d}".encode(), 0)
        rng = np.random.default_rng([7, case])
        name = TURNS[case % len(TURNS)]
        kinds = sorted(
            {path.suffix if "tfrecord" not in path.name else "tfrecord" for path, _ in places[name]}
        )
        kinds += [
            one for one in kinds if one in (".hdf5", ".h5", "tfrecord", ".pkl", ".parquet", ".mp4")
        ] * 2
        kind = kinds[int(rng.integers(len(kinds)))]
        among = [one for one in places[name] if (one[0].suffix == kind or kind in one[0].name)]
        path, data = among[int(rng.integers(len(among)))]
        path.write_bytes(spoilt(path)(data, rng))
        os.utime(path, ns=(case * 10**6, case * 10**6))  # caches go by it
        begun, wrong = time.process_time(), None
        armed = True
        try:
            whole = base / name
            outcome = spliced(whole) if name == "clip" else read(LAYOUTS[name], whole)
        except RpaugError as error:
            outcome = "refused"
            if not named(error, base):
                wrong = f"names no place: {error}"
        except BaseException as error:
            outcome, wrong = "raised", f"{type(error).__name__}: {error}"
        armed = False
        seconds = time.process_time() - begun
        path.write_bytes(data)
        os.utime(path, ns=(case * 10**6 + 1, case * 10**6 + 1))
        if started:
            wrong = f"started {started[0]}"
            started.clear()
        if seconds > SLOW:
            wrong = f"took {seconds:.1f} processor seconds"
        counts[f"{name} {kind}: {outcome}"] += 1
        if case % 200 == 199 or case == end - 1:
            print(json.dumps({"counts": counts}), flush=True)
            counts.clear()
        if wrong:
            found = {"case": case, "file": str(path.relative_to(base)), "wrong": wrong[:300]}
            print(json.dumps(found), flush=True)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    grown = peak - before
    print(json.dumps({"peak": peak, "grown": grown, "seconds": time.process_time()}), flush=True)
    import shutil

    shutil.rmtree(base)


def batch(first: int, end: int) -> dict[str, Any]:
    """Some cases in processes of their own; one that dies is named, and the rest go on in the next."""
    wrong: list[dict[str, Any]] = []
    counts: Counter[str] = Counter()
    peak, grown, seconds = 0, 0, 0.0
    while first < end:
        with tempfile.TemporaryDirectory() as folder:
            progress = Path(folder) / "progress"
            out = Path(folder) / "out"
            with out.open("wb") as stream, (Path(folder) / "err").open("wb") as errors:
                command = [
                    sys.executable,
                    __file__,
                    "--worker",
                    str(first),
                    str(end),
                    str(progress),
                ]
                child = subprocess.Popen(command, stdout=stream, stderr=errors)
                died = _watched(child, progress)
            lines = [json.loads(line) for line in out.read_text().splitlines()]
            wrong += [line for line in lines if "case" in line]
            for line in lines:
                counts.update(line.get("counts", {}))
                if "peak" in line:
                    peak, grown = max(peak, line["peak"]), max(grown, line["grown"])
                    seconds += line["seconds"]
            if not died:
                break
            last = int(progress.read_text()) if progress.exists() else -1
            words = (Path(folder) / "err").read_text(errors="replace")[-300:]
            if last < 0:
                raise SystemExit(f"the cases cannot begin: {words}")
            wrong.append({"case": last, "file": "?", "wrong": f"{died}: {words}"})
            first = last + 1
    counted = {"counts": dict(counts), "seconds": seconds}
    return {"wrong": wrong, "peak": peak, "grown": grown, **counted}


def _watched(child: subprocess.Popen, progress: Path) -> str:
    """Wait; how the process ended if not well."""
    seen, since = "", time.monotonic()
    while True:
        try:
            code = child.wait(timeout=1)
        except subprocess.TimeoutExpired:
            now = progress.read_text() if progress.exists() else ""
            if now != seen:
                seen, since = now, time.monotonic()
            if now and time.monotonic() - since > STUCK:
                child.kill()
                child.wait()
                return "stuck"
            continue
        if code < 0:
            return f"killed by {signal.Signals(-code).name}"
        return "" if code == 0 else f"ended with {code}"


def main() -> None:
    """Parse, run, print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--cases", type=int, default=100_000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--state", type=Path)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--worker", nargs=3)
    given = parser.parse_args()
    if given.worker:
        work(int(given.worker[0]), int(given.worker[1]), Path(given.worker[2]))
        return
    state = {"next": given.first, "wrong": [], "counts": {}, "peak": 0, "grown": 0, "seconds": 0.0}
    if given.state and given.state.exists():
        state = json.loads(given.state.read_text())
    end = given.first + given.cases
    while state["next"] < end:
        done = batch(state["next"], min(state["next"] + BATCH, end))
        state["next"] = min(state["next"] + BATCH, end)
        state["wrong"] += done["wrong"]
        state["counts"] = dict(Counter(state["counts"]) + Counter(done["counts"]))
        for name in ("peak", "grown"):
            state[name] = max(state[name], done[name])
        state["seconds"] += done["seconds"]
        if given.state:
            given.state.write_text(json.dumps(state))
        sys.stderr.write(f"{state['next']} cases, {len(state['wrong'])} wrong\n")
    for name, count in sorted(state["counts"].items()):
        sys.stdout.write(f"{count:8d}  {name}\n")
    for one in state["wrong"]:
        sys.stdout.write(f"WRONG case {one['case']}, {one['file']}: {one['wrong']}\n")
    cases = sum(state["counts"].values())
    words = (
        f"{cases} cases, {len(state['wrong'])} wrong, {state['seconds']:.0f} processor seconds, "
    )
    words += f"{state['peak'] / 1024:.0f} MiB at most, {state['grown'] / 1024:.0f} of them cases'"
    sys.stdout.write(words + "\n")
    if given.json:
        given.json.write_text(json.dumps(state, indent=1))
    raise SystemExit(1 if state["wrong"] else 0)


if __name__ == "__main__":
    main()
