"""Evaluations for tests: the embedded sample's first pictures, changed or not, as rollouts in files."""

from collections.abc import Callable
from pathlib import Path

import av
import numpy as np

import rpaug
from rpaug.core.files import encode_png
from rpaug.core.registry import adapter_for
from rpaug.diagnosis import FrameImages, Line, write

SAMPLE = Path(rpaug.__file__).parent / "sample"
Change = Callable[[np.ndarray], np.ndarray]


def first() -> np.ndarray:
    """The sample's first picture from the front."""
    source = adapter_for(SAMPLE)
    return source.read(SAMPLE, source.episodes(SAMPLE)[0]).views["front"].rgb(0)


def painted(mask: np.ndarray, rgb: tuple[float, float, float]) -> Change:
    """Multiplies what a mask shows."""
    return lambda image: np.where(mask[..., None], image * np.array(rgb), image).astype(np.uint8)


def evaluation(
    folder: Path, change: Change, failures: int = 8, successes: int = 8, factor: str | None = None
) -> Path:
    """Rollouts that begin as the sample does and succeed, and changed ones that fail."""
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(0)
    image, lines = first(), []
    for number in range(failures + successes):
        failed = number < failures
        noisy = np.clip(image + rng.normal(0, 2, image.shape), 0, 255).astype(np.uint8)
        name = f"{number}.png"
        (folder / name).write_bytes(encode_png(change(noisy) if failed else noisy))
        lines.append(
            Line(
                episode=f"open_drawer/{number}",
                success=not failed,
                instruction="open the drawer",
                frames=(FrameImages(t=0, images={"front": name}),),
                factor=factor,
            )
        )
    write(folder / "eval.jsonl", lines)
    return folder / "eval.jsonl"


def video(path: Path, levels: list[int], side: int = 64) -> None:
    """A video whose frames are plain greys, with a white square that moves while the grey changes."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with av.open(str(path), "w") as container:
        stream = container.add_stream("mpeg4", rate=10)
        stream.width, stream.height, stream.pix_fmt = side, side, "yuv420p"
        for level in levels:
            image = np.full((side, side, 3), level, np.uint8)
            image[level % 40 : level % 40 + 20, 10:30] = 255
            for packet in stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")):
                container.mux(packet)
        for packet in stream.encode():
            container.mux(packet)
