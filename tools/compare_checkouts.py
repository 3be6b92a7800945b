"""Run two checkouts on the same datasets and recipes and compare what they write, byte by byte.

    python tools/compare_checkouts.py BEFORE [AFTER] [--work DIR] [--only NAME] [--json]
    python tools/compare_checkouts.py BEFORE AFTER --timing 5 [--only NAME]

BEFORE and AFTER are roots of checkouts, each with its own `.venv` as `make` makes it. RPAUG_TEST_DATA names the
folder of real recordings. Each pair of a dataset and a recipe is written to DIR/before and DIR/after. The output of
BEFORE is kept and used again while the checkout and the pair stay the same; AFTER always runs anew. Without AFTER the
outputs of BEFORE are made and kept.

Compared are exit codes, the skipped and the rejected episodes, and every file. `rpaug.json` and `rpaug.summary.json`
hold seconds, and are compared as JSON without them. Contact sheet, dataset card and the wording of messages are made
for people, and the journal holds processes and times: their differences are listed and do not count.

Exit code: 0 the same, 1 something differs, 2 a checkout could not run.

--timing measures one pair instead, on both checkouts in turn, one worker each: the main job (one real episode, one
recolor, one copy) unless --only names another.
"""

import argparse
import hashlib
import json
import os
import shutil
import statistics
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NoReturn

MANIPULATED = {"role": "manipulated"}
RECOLOR = {"op": "recolor", "target": MANIPULATED, "color": "blue"}
LIGHT = {"op": "light_color", "range": [[0.3, 0.3, 0.3], [0.5, 0.5, 0.5]]}
CAMERA = {"op": "camera_pose", "camera": "front", "shift": 0.05}
ONE = ("--set", "select.limit=1", "--set", "copies=1")  # of a shipped recipe
SMALL_VIDEO = {"width": 320, "features": 800, "overlap": 5}
CLIP = "version: 1\nclips:\n  - {video: video_0, start: 0.0, end: 0.8}\n"  # long enough to find its camera


@dataclass(frozen=True)
class Pair:
    """A dataset and a recipe: the name of one that ships, or the keys of one beside `version` and `seed`.

    Without a recipe the dataset is converted to the layout that `options` name.
    """

    name: str
    dataset: str
    recipe: str | dict[str, Any] | None
    options: tuple[str, ...] = ()


def edits(*steps: dict[str, Any], **keys: Any) -> dict[str, Any]:
    return {"edits": list(steps), **keys}


MAIN_JOB = Pair("real_recolor", "real/rlbench_open_drawer", edits(RECOLOR, select={"limit": 1}))
# Datasets are `sample`, `clip` (of a real video), `real/FOLDER` of the real recordings, or BEFORE's output of a pair.
PAIRS = (
    Pair("to_rdt", "sample", None, ("--to", "rdt")),
    Pair("to_lerobot", "sample", None, ("--to", "lerobot", "--fps", "20")),
    Pair("to_rlds", "sample", None, ("--to", "rlds")),
    Pair("sample_demo", "sample", "demo"),
    Pair("sample_light", "sample", "light_color"),
    Pair("sample_camera", "sample", "camera_pose"),
    Pair("sample_remove", "sample", "remove"),
    Pair("sample_move", "sample", "move"),
    Pair("sample_duplicate", "sample", "duplicate"),
    Pair("sample_spread", "sample", "spread"),
    Pair("sample_insert", "sample", "insert"),
    Pair("sample_physics", "sample", "physics"),
    Pair("sample_robust", "sample", "robust"),
    Pair("sample_all", "sample", "colosseum/all"),
    Pair("sample_distractor", "sample", "colosseum/distractor", ("--workers", "2")),
    Pair("sample_size", "sample", "colosseum/manip_obj_size"),
    Pair("sample_task", "sample", "colosseum/tasks/open_drawer", ("--set", "copies=3")),
    Pair(
        "sample_paint",
        "sample",
        edits(
            {"op": "retexture", "target": MANIPULATED, "texture": {"sample": "wood"}},
            {"op": "recolor", "target": {"role": "receiver"}, "color": {"lab": [60, 30, 20]}},
            {"op": "table_color"},
            {"op": "background_texture"},
            {"op": "light_direction", "turn": 0.6},
        ),
    ),
    Pair(
        "sample_chance",
        "sample",
        edits(
            {"one_of": [{"op": "table_texture", "weight": 3}, RECOLOR], "probability": 0.8},
            {**CAMERA, "camera": "static", "probability": 0.5},
            {"op": "sensor_noise"},
            {"op": "sensor_blur"},
            {"op": "sensor_jpeg"},
            {"op": "sensor_exposure"},
            copies=3,
            keep_originals=True,
        ),
    ),
    Pair(
        "sample_gates",
        "sample",
        edits(
            {**RECOLOR, "color": {"sample": "colosseum"}},
            {**CAMERA, "camera": "static"},
            copies=3,
            gates={"tries": 3, "color": 1.5, "holes": 0.07},
        ),
    ),
    Pair("sample_ratio", "sample", edits(RECOLOR), ("--ratio", "1:2")),
    Pair("sample_accuracy", "sample", edits(CAMERA, accuracy={"psnr": 5, "depth_mm": 50})),
    Pair("sample_tier1", "sample", edits(RECOLOR), ("--tier", "1")),
    Pair("sample_tier3", "sample", edits(RECOLOR, CAMERA, refine=10), ("--tier", "3")),
    MAIN_JOB,
    Pair("real_robust", "real/rlbench_open_drawer", "robust", ONE),
    Pair("real_all", "real/rlbench_open_drawer", "colosseum/all", ONE),
    Pair("real_distractor", "real/rlbench_open_drawer", "colosseum/distractor", ONE),
    Pair("rlds_light", "real/rlds_bridge", "light_color"),
    Pair(
        "rlds_paint",
        "real/rlds_bridge",
        edits(
            {"op": "table_color"},
            {"op": "background_texture"},
            {"op": "sensor_noise"},
            select={"limit": 2},
        ),
    ),
    Pair("rlds_recolor", "real/rlds_bridge", edits(RECOLOR)),  # some episodes move nothing
    Pair("rdt_demo", "to_rdt", "demo"),
    Pair("rdt_camera", "to_rdt", edits(CAMERA, LIGHT, keep_originals=True)),
    Pair("lerobot_demo", "to_lerobot", "demo"),
    Pair("lerobot_remove", "to_lerobot", "remove"),
    Pair("video_light", "real/ego_lavila", edits(LIGHT, {"op": "sensor_exposure"}, copies=2)),
    Pair("video_table", "clip", edits({"op": "table_color"}, video=SMALL_VIDEO)),
)


@dataclass(frozen=True)
class Difference:
    """What differs in one place; `counts` is false for what is made for people, and for the journal."""

    where: str
    what: str
    counts: bool = True


# Comparing two outputs

TIMED = {"rpaug.json", "rpaug.summary.json"}
UNCOUNTED = {"rpaug.contact.html", "README.md", "rpaug.journal.jsonl"}
SENTENCES = {"failures", "rejected", "warnings", "faults", "assumed", "error", "aborted"}
IMAGES = {".png", ".jpg", ".jpeg"}
SHOWN = 5  # differences of a pair that are printed


def compare(before: Path, after: Path) -> list[Difference]:
    """What differs between two folders; nothing if every file is the same but for seconds."""
    left, right = _files(before), _files(after)
    found = [Difference(name, "only before") for name in sorted(left - right)]
    found += [Difference(name, "only after") for name in sorted(right - left)]
    for name in sorted(left & right):
        found += _file_differs(before, after, name)
    return found


def _files(root: Path) -> set[str]:
    return {path.relative_to(root).as_posix() for path in root.rglob("*") if path.is_file()}


def _file_differs(before: Path, after: Path, name: str) -> Iterator[Difference]:
    left, right = (before / name).read_bytes(), (after / name).read_bytes()
    if left == right:
        return
    if Path(name).name in TIMED:
        for where, what, counts in _values_differ(json.loads(left), json.loads(right)):
            yield Difference(f"{name}{where}", what, counts)
        return
    what = f"{len(left)} bytes before, {len(right)} after"
    if Path(name).suffix.lower() in IMAGES:
        what += f"; {_pixels_differ(before / name, after / name)}"
    yield Difference(name, what, counts=name not in UNCOUNTED)


def _values_differ(
    left: Any, right: Any, where: str = "", sentences: bool = False
) -> Iterator[tuple[str, str, bool]]:
    """Where two JSON values differ in anything but seconds, the order of keys included."""
    if isinstance(left, dict) and isinstance(right, dict):
        keys, others = ([key for key in one if key != "seconds"] for one in (left, right))
        if keys != others:
            yield where, f"keys {keys} before, {others} after", True
        for key in (key for key in keys if key in right):
            within = sentences or key in SENTENCES
            yield from _values_differ(left[key], right[key], f"{where}:{key}", within)
    elif isinstance(left, list) and isinstance(right, list) and len(left) == len(right):
        for index, (one, other) in enumerate(zip(left, right, strict=True)):
            yield from _values_differ(one, other, f"{where}:{index}", sentences)
    elif json.dumps(left) != json.dumps(right):
        wording = sentences and isinstance(left, str) and isinstance(right, str)
        yield where, f"{left!r} before, {right!r} after", not wording


def _pixels_differ(before: Path, after: Path) -> str:
    import cv2

    left, right = (cv2.imread(str(path), cv2.IMREAD_UNCHANGED) for path in (before, after))
    if left is None or right is None or left.shape != right.shape:
        return "images of different shapes"
    differ = (left != right).reshape(*left.shape[:2], -1).any(-1)
    return f"{int(differ.sum())} of {differ.size} pixels differ"


# Running a checkout

MISLEADING = {"PYTHONPATH", "NUMBA_CACHE_DIR"}  # another checkout's code, another code's cache


@dataclass(frozen=True)
class Side:
    """A checkout, and the folder of what it writes; `code` stands for all its files."""

    checkout: Path
    outputs: Path
    code: str

    @classmethod
    def of(cls, checkout: Path, outputs: Path) -> "Side":
        """Raises SystemExit where there is no checkout with a `.venv`."""
        checkout = checkout.resolve()
        if not (checkout / ".venv" / "bin" / "rpaug").is_file():
            _stop(f"{checkout}: no .venv/bin/rpaug; run `make .venv/.installed` there")
        outputs.mkdir(parents=True, exist_ok=True)
        side = cls(checkout, outputs, _digest_of_files(checkout))
        asked = [
            str(checkout / ".venv" / "bin" / "python"),
            "-c",
            "import rpaug; print(rpaug.__path__[0])",
        ]
        package = subprocess.run(
            asked, check=True, capture_output=True, text=True, cwd=outputs, env=side.environment
        ).stdout.strip()
        if not Path(package).is_relative_to(checkout):
            _stop(f"{checkout}: its .venv runs the code of {package}")
        return side

    def command(self, pair: Pair, out: str, inputs: Path) -> list[str]:
        """The command line, to be run in `outputs`: messages then name the same paths on both sides."""
        program = str(self.checkout / ".venv" / "bin" / "rpaug")
        dataset = _dataset(pair, inputs)
        if pair.recipe is None:
            return [program, "convert", dataset, *pair.options, "--out", out, "--json"]
        recipe = pair.recipe
        if isinstance(recipe, dict):
            file = inputs / f"{pair.name}.yaml"
            file.write_text(json.dumps({"version": 1, "seed": 5, **recipe}))
            recipe = str(file)
        return [
            *(program, "augment", dataset, "--recipe", recipe),
            *(*pair.options, "--out", out, "--json"),
        ]

    @property
    def environment(self) -> dict[str, str]:
        """One thread, and a cache of this code's own: no side reads what another's code worked out."""
        cache = self.outputs.parent / "cache" / f"{self.outputs.name}-{self.code[:12]}"
        kept = {name: value for name, value in os.environ.items() if name not in MISLEADING}
        return {**kept, "OMP_NUM_THREADS": "1", "XDG_CACHE_HOME": str(cache)}

    def run(self, pair: Pair, inputs: Path, again: bool) -> dict[str, Any]:
        """Write the output of `pair`, unless it is there and need not be made `again`.

        Returns `exit_code`, processor `seconds`, and whether it was `kept` from an earlier run.
        """
        command = self.command(pair, pair.name, inputs)
        marker = self.outputs / f"{pair.name}.json"
        wanted = {"code": self.code, "pair": _digest(asdict(pair))}
        if not again and marker.is_file():
            found = json.loads(marker.read_text())
            if wanted.items() <= found.items():
                return {**found, "kept": True}
        marker.unlink(missing_ok=True)
        shutil.rmtree(self.outputs / pair.name, ignore_errors=True)
        with (self.outputs / f"{pair.name}.log").open("wb") as log:
            code, seconds, _ = measured(command, self.outputs, self.environment, log)
        done = {**wanted, "exit_code": code, "seconds": round(seconds, 1)}
        if code in (0, 1):
            marker.write_text(json.dumps(done))
        return {**done, "kept": False}


def measured(
    command: Sequence[str], folder: Path, environment: dict[str, str], log: Any
) -> tuple[int, float, float]:
    """Run a command; its exit code, processor seconds (its children's too) and peak resident megabytes."""
    process = subprocess.Popen(command, cwd=folder, env=environment, stdout=log, stderr=log)
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    return process.returncode, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024


def _dataset(pair: Pair, inputs: Path) -> str:
    if pair.dataset.startswith("real/"):
        return str(_recordings() / pair.dataset.removeprefix("real/"))
    if any(pair.dataset == earlier.name for earlier in PAIRS):
        return str(inputs.parent / "before" / pair.dataset)
    return str(inputs / pair.dataset)


def _recordings() -> Path:
    folder = os.environ.get("RPAUG_TEST_DATA")
    return Path(folder) if folder else _stop("RPAUG_TEST_DATA names no folder of real recordings")


def _lay_out(inputs: Path, before: Path) -> None:
    """The datasets that both sides read: the sample of BEFORE, and a clip of a video that moves."""
    if not (inputs / "sample").is_dir():
        shutil.copytree(before / "rpaug" / "sample", inputs / "sample")
    (inputs / "clip").mkdir(exist_ok=True)
    shutil.copy(_recordings() / "ego_hawor" / "video_0.mp4", inputs / "clip")
    (inputs / "clip" / "clips.yaml").write_text(CLIP)


def _digest_of_files(checkout: Path) -> str:
    """Of all files that git knows or does not ignore, by name and content."""
    listed = ["git", "-C", str(checkout), "ls-files", "-z", "-co", "--exclude-standard"]
    names = subprocess.run(listed, check=True, capture_output=True).stdout.decode().split("\0")
    content = {
        name: hashlib.sha256((checkout / name).read_bytes()).hexdigest()
        for name in sorted(names)
        if (checkout / name).is_file()
    }
    return _digest(content)


def _digest(value: Any) -> str:
    return hashlib.sha256(json.dumps(value).encode()).hexdigest()


def _stop(why: str) -> NoReturn:
    sys.stderr.write(why + "\n")
    raise SystemExit(2)


# The two things that are asked for


def prepared(before: Side, pair: Pair, inputs: Path) -> dict[str, Any]:
    """The run of BEFORE, after that of the pair which makes its dataset."""
    for earlier in PAIRS:
        if earlier.name == pair.dataset:
            prepared(before, earlier, inputs)
    return before.run(pair, inputs, again=False)


def compared(before: Side, after: Side, pair: Pair, inputs: Path) -> dict[str, Any]:
    """Both outputs of a pair, and what differs. Two outputs without an episode prove nothing and count as differing."""
    one, other = prepared(before, pair, inputs), after.run(pair, inputs, again=True)
    found = compare(before.outputs / pair.name, after.outputs / pair.name)
    if one["exit_code"] != other["exit_code"]:
        codes = f"{one['exit_code']} before, {other['exit_code']} after"
        found.insert(0, Difference("exit code", codes))
    if not any(after.outputs.glob(f"{pair.name}/**/rpaug.json")):
        found.insert(0, Difference("episodes", f"none after; {pair.name}.log says why"))
    return {
        "pair": pair.name,
        "kept": one["kept"],
        "exit_code": other["exit_code"],
        "seconds": {"before": one["seconds"], "after": other["seconds"]},
        "files": len(_files(after.outputs / pair.name)),
        "differences": [asdict(difference) for difference in found],
        "same": not any(difference.counts for difference in found),
    }


def timed(before: Side, after: Side, pair: Pair, inputs: Path, runs: int) -> dict[str, Any]:
    """A pair on both in turn, after one run each that fills the caches: medians, and after over before."""
    taken: dict[str, list[tuple[float, float]]] = {"before": [], "after": []}
    for turn in range(runs + 1):
        for name, side in (("before", before), ("after", after)):
            out = side.outputs / "timed"
            shutil.rmtree(out, ignore_errors=True)
            with (side.outputs / "timed.log").open("wb") as log:
                command = side.command(pair, "timed", inputs)
                code, *figures = measured(command, side.outputs, side.environment, log)
            if code != 0:
                _stop(f"{name}: exit code {code}; {log.name} says why")
            if turn:
                taken[name].append((round(figures[0], 2), round(figures[1], 1)))
    result: dict[str, Any] = {"runs": taken}
    for index, what in enumerate(("processor_seconds", "peak_mb")):
        median = {name: statistics.median(run[index] for run in taken[name]) for name in taken}
        result[what] = {**median, "ratio": round(median["after"] / median["before"], 3)}
    return result


def main() -> int:
    """Compare or measure, and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("before", type=Path)
    parser.add_argument("after", type=Path, nargs="?")
    parser.add_argument("--work", type=Path, default=Path("bench-output/compare"))
    parser.add_argument("--only", action="append", help="Names of pairs; all by default.")
    parser.add_argument("--timing", type=int, metavar="N", help="Measure one pair N times.")
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    work = arguments.work.resolve()
    before = Side.of(arguments.before, work / "before")
    after = Side.of(arguments.after, work / "after") if arguments.after else None
    inputs = work / "inputs"
    _lay_out(inputs, before.checkout)
    unknown = set(arguments.only or ()) - {pair.name for pair in PAIRS}
    if unknown:
        _stop(f"--only {', '.join(sorted(unknown))}: no such pair")
    pairs = [pair for pair in PAIRS if not arguments.only or pair.name in arguments.only]
    if arguments.timing:
        pair = pairs[0] if arguments.only else MAIN_JOB
        result = timed(before, after or before, pair, inputs, arguments.timing)
        print(json.dumps(result, indent=1) if arguments.json else _timing_table(result))
        return 0
    if after is None:
        for pair in pairs:
            done = prepared(before, pair, inputs)
            print(f"{pair.name:18}exit code {done['exit_code']}   {done['seconds']} s", flush=True)
        return 0
    results = []
    for pair in pairs:
        results.append(compared(before, after, pair, inputs))
        if not arguments.json:
            print(_line(results[-1]), flush=True)
    differing = [result["pair"] for result in results if not result["same"]]
    if arguments.json:
        print(json.dumps({"pairs": results, "differing": differing}, indent=1))
    else:
        print(f"{len(results)} pairs, {len(differing)} differ {' '.join(differing)}".rstrip())
    return 1 if differing else 0


def _line(result: dict[str, Any]) -> str:
    """One pair, with the first differences that count and the first that do not."""
    seconds = "{before} s, {after} s".format(**result["seconds"])
    word = "same" if result["same"] else "DIFFERS"
    lines = [f"{word:8}{result['pair']:18}{result['files']:5} files   {seconds}"]
    for counts, label in ((True, "differs"), (False, "does not count")):
        found = [one for one in result["differences"] if one["counts"] is counts]
        lines += [f"    {label}: {one['where']}: {one['what']}" for one in found[:SHOWN]]
        if len(found) > SHOWN:
            lines.append(f"    {label}: {len(found) - SHOWN} more")
    return "\n".join(lines)


def _timing_table(result: dict[str, Any]) -> str:
    lines = [f"{'':20}{'before':>10}{'after':>10}{'ratio':>8}"]
    for what in ("processor_seconds", "peak_mb"):
        row = result[what]
        lines.append(f"{what:20}{row['before']:10.2f}{row['after']:10.2f}{row['ratio']:8.3f}")
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
