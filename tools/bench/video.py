"""Videos: frames registered, trajectory error, processor seconds, and how well Gaussians show frames kept back.

python tools/bench/video.py walk FOLDER     # RGB-D frames with poses (7-Scenes layout), their colors made a video
python tools/bench/video.py clip VIDEO      # any video: registered or refused, and why
Add --gaussians for the fit, --edit RECIPE for an edited copy at tier 4 in a folder that is thrown away (or --keep OUT),
--json for one JSON value. But for --edit nothing is taken from or left in the user's cache.
"""

import argparse
import json
import tempfile
import time
from pathlib import Path

import av
import cv2
import numpy as np
from rpaug_adapters.video import Videos

from rpaug.core.errors import Unsupported
from rpaug.gaussians import fit_video
from rpaug.pipeline import recipe
from rpaug.pipeline.augment import Run, execute
from rpaug.scene.video import reconstruct, world


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("kind", choices=("walk", "clip"))
    parser.add_argument("path", type=Path)
    parser.add_argument("--gaussians", action="store_true", help="fit them too")
    parser.add_argument("--edit", type=Path, help="a recipe: write a copy, Gaussians throughout")
    parser.add_argument("--tier", type=int, default=4, help="least tier of that copy")
    parser.add_argument("--keep", type=Path, help="new folder for the copy")
    parser.add_argument("--scenes", type=Path, help="store to take that copy's Gaussians from")
    parser.add_argument("--width", type=int, default=320, help="pixels: of the images fitted")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = given.path
        if given.kind == "walk":
            path = as_video(given.path, Path(folder) / "walk.mp4")
        if given.edit:
            facts = edited(given, path, given.keep or Path(folder) / "out")
        else:
            facts = measured(given, path, Path(folder) / "cache")
    if given.json:
        print(json.dumps(facts))
        return
    for name, value in facts.items():
        print(f"{name:32} {value}")


def measured(given: argparse.Namespace, path: Path, cache: Path) -> dict[str, object]:
    adapter = Videos()
    episode = adapter.read(path, adapter.episodes(path)[0])
    start = time.process_time()
    try:
        found = reconstruct.develop(episode, threads=given.threads, cache=cache)
    except Unsupported as error:
        return {"refused": str(error), "processor_s": round(time.process_time() - start, 1)}
    facts: dict[str, object] = {
        **found.describe(),
        "processor_s": round(time.process_time() - start, 1),
    }
    if given.kind == "walk":
        truth = np.array([np.loadtxt(p)[:3, 3] for p in sorted(given.path.glob("*.pose.txt"))])
        truth = truth[found.model.times]
        at = found.model.cam_to_world[:, :3, 3]
        motion, scale = world.aligned(at, truth)
        off = scale * at @ motion[:3, :3].T + motion[:3, 3] - truth
        facts["trajectory_rmse_cm"] = round(100 * float(np.sqrt((off**2).sum(1).mean())), 2)
    if given.gaussians:
        start = time.process_time()
        rule = fit_video.SplatSettings(threads=given.threads, width=given.width)
        _, given = fit_video.fitted(found.scene(), found, rule)
        facts |= {
            f"gaussians_{name}": given[name] for name in ("gaussians", "train_db", "held_out_db")
        }
        facts["hands"] = given.get("four")
        facts["gaussians_processor_s"] = round(time.process_time() - start, 1)
    return facts


def edited(given: argparse.Namespace, path: Path, out: Path) -> dict[str, object]:
    """A copy by a recipe, and whether it is the recording's in frames, rate and duration."""
    start = time.process_time()
    run = Run(path, recipe.load(given.edit), out, given.tier, given.scenes)
    summary = execute(run)
    spent = time.process_time() - start
    facts: dict[str, object] = {"failures": summary.failures, "warnings": summary.warnings}
    for made in sorted(out.glob("*.mp4")):
        given = [_given(one) for one in (path, made)]
        facts[made.name] = {
            "recorded": given[0],
            "written": given[1],
            "alike": given[0] == given[1],
        }
        report = json.loads((made.with_suffix("") / "rpaug.json").read_bytes())
        facts[made.name] |= {"fit": report["plan"].get("fit"), "film": report["plan"].get("film")}
    return facts | {"processor_min": round(spent / 60, 1)}


def _given(path: Path) -> list[object]:
    """Codec, size, rate, frames that decode, and duration in seconds."""
    with av.open(str(path)) as file:
        stream = file.streams.video[0]
        times = [frame.pts for frame in file.decode(video=0)]
        assert stream.time_base is not None
        lasted = float((times[-1] - times[0]) * stream.time_base)
        size = f"{stream.width}x{stream.height}"
        return [stream.codec_context.name, size, str(stream.average_rate), len(times), lasted]


def as_video(folder: Path, path: Path) -> Path:
    """The color images of a folder as an MP4 of three frames a second."""
    images = sorted(folder.glob("*.color.*"))
    with av.open(str(path), "w") as made:
        stream = made.add_stream("libx264", rate=3, options={"crf": "10"})
        stream.height, stream.width = cv2.imread(str(images[0])).shape[:2]
        stream.pix_fmt = "yuv420p"
        for image in images:
            rgb = np.ascontiguousarray(cv2.imread(str(image))[..., ::-1])
            for packet in stream.encode(av.VideoFrame.from_ndarray(rgb, format="rgb24")):
                made.mux(packet)
        for packet in stream.encode():
            made.mux(packet)
    return path


if __name__ == "__main__":
    main()
