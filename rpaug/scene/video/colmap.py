"""Structure from motion by COLMAP: SIFT, matches of neighbours in time, then mapping, incremental and global.

Schönberger and Frahm 2016 (Structure-from-Motion Revisited); the global mapper is GLOMAP (Pan et al. 2024, arXiv
2407.20219). The global one is tried where the incremental one leaves frames out, and the incremental one in pieces,
which makes several models, where neither is believed. Mapping runs in one thread, seeded: the same frames give the same
model.
"""

import contextlib
import itertools
import os
import sqlite3
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, TextIO

import cv2
import numpy as np
from jaxtyping import UInt8

from rpaug.core.errors import Unsupported
from rpaug.scene.video.model import Reconstruction, believed

MOST_FRAMES = 300
WATCHED = 1.0  # seconds between two looks at how far COLMAP is
DOUBLED = 800  # pixels: narrower images are doubled before features are looked for
Progress = Callable[[float, str], None]


@dataclass(frozen=True, kw_only=True)
class ColmapSettings:
    """How a video's frames are matched and mapped."""

    width: int = 640  # pixels: larger frames are made smaller
    features: int = 1500  # of a frame, at most
    overlap: int = (
        10  # neighbours in time that a frame is matched with, and further ones at powers of two
    )
    enough: float = 0.95  # share of registered frames from which on the global mapper is not tried
    threads: int = 2  # of features; results do not depend on it
    seed: int = 0


def reconstruct(
    frame: Callable[[int], UInt8[np.ndarray, "h w 3"]],
    times: Sequence[int],
    focal: float | None = None,
    settings: ColmapSettings | None = None,
    progress: Progress | None = None,
) -> Reconstruction:
    """The largest model of these frames. `focal`, in pixels of a frame, is where the search for it begins.

    Raises Unsupported where no model can be believed, with the numbers, and for more than MOST_FRAMES frames.
    """
    if len(times) > MOST_FRAMES:
        raise Unsupported(
            f"structure from motion of {len(times)} frames: at most {MOST_FRAMES}; cut clips (clips.yaml)"
        )
    settings, tell = settings or ColmapSettings(), progress or (lambda share, what: None)
    first = frame(times[0])
    full = (first.shape[1], first.shape[0])
    with tempfile.TemporaryDirectory(prefix="rpaug-sfm-") as folder, _quiet():
        work = Path(folder)
        factor = _lay_out(frame, times, work / "images", settings.width)
        tell(0.1, "features")
        start = None if focal is None else factor * focal
        with _watched(work, "descriptors", len(times), lambda d: tell(0.1 + 0.3 * d, "features")):
            _features(work, start, settings)
        tell(0.4, "matches")
        pairs = _pairs(len(times), settings.overlap)
        with _watched(work, "matches", pairs, lambda d: tell(0.4 + 0.2 * d, "matches")):
            _matches(work, settings)
        tell(0.6, "mapping")
        models = _mapped(work, "incremental", settings, _counting(tell, len(times)))
        if not _whole(models, settings.enough * len(times), len(times)):
            tell(0.8, "mapping at once")
            models += _mapped(work, "global", settings)
        if not _whole(models, 0, len(times)):
            tell(0.9, "mapping in pieces")
            models += _mapped(work, "pieces", settings)
    tell(1.0, "mapped")
    return believed([model.sized(*full) for model in models], len(times))


def _whole(models: Sequence[Reconstruction], least: float, frames: int) -> bool:
    """Whether one of the models can be believed, and has so many frames at least."""
    return any(len(model.times) >= least and not model.faults(frames) for model in models)


def _lay_out(
    frame: Callable[[int], UInt8[np.ndarray, "h w 3"]],
    times: Sequence[int],
    folder: Path,
    width: int,
) -> float:
    """Frames as files called by their numbers; by how much they were made smaller."""
    folder.mkdir()
    factor = 1.0
    for t in times:
        image = frame(t)
        factor = min(1.0, width / image.shape[1])
        if factor < 1:
            size = (round(image.shape[1] * factor), round(image.shape[0] * factor))
            image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
        cv2.imwrite(
            str(folder / f"{t:08d}.png"), image[..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 1]
        )
    return factor


def _features(work: Path, focal: float | None, settings: ColmapSettings) -> None:
    import pycolmap

    pycolmap.set_random_seed(settings.seed)
    extraction = pycolmap.FeatureExtractionOptions()
    extraction.use_gpu, extraction.num_threads = False, settings.threads
    extraction.sift.max_num_features = settings.features
    image = cv2.imread(str(next((work / "images").iterdir())))
    assert image is not None  # it was written just now
    height, width = image.shape[:2]
    extraction.sift.first_octave = -1 if width < DOUBLED else 0
    reader = pycolmap.ImageReaderOptions()
    reader.camera_model = "SIMPLE_RADIAL"
    if focal is not None:
        reader.camera_params = f"{focal},{width / 2},{height / 2},0"
    read: dict[str, Any] = {"camera_mode": pycolmap.CameraMode.SINGLE}
    # Numbered first: threads would number images as they come to them.
    pycolmap.Database.open(work / "features.db").close()
    pycolmap.import_images(work / "features.db", work / "images", options=reader, **read)
    pycolmap.extract_features(
        work / "features.db",
        work / "images",
        reader_options=reader,
        extraction_options=extraction,
        **read,
    )


def _matches(work: Path, settings: ColmapSettings) -> None:
    import pycolmap

    matching = pycolmap.FeatureMatchingOptions()
    # Of several threads a match is another now and then: 5 of 180 small models were.
    matching.use_gpu, matching.num_threads = False, 1
    pairs = pycolmap.SequentialPairingOptions()
    pairs.overlap, pairs.quadratic_overlap = settings.overlap, True
    verification = pycolmap.TwoViewGeometryOptions()
    verification.ransac.random_seed = settings.seed  # each pair's own, whichever thread comes to it
    pycolmap.match_sequential(
        work / "features.db",
        matching_options=matching,
        pairing_options=pairs,
        verification_options=verification,
    )


def _pairs(frames: int, overlap: int) -> int:
    """How many pairs of frames are matched: neighbours, and those at powers of two beyond."""
    apart = {*range(1, overlap + 1), *(2**n for n in range(overlap))}
    return sum(max(0, frames - away) for away in apart)


@contextlib.contextmanager
def _watched(work: Path, table: str, total: int, tell: Callable[[float], None]) -> Iterator[None]:
    """Tell every WATCHED seconds which share of a table's rows COLMAP has written, which it does not say itself.

    Only those that left its write-ahead log count: whoever opens that takes locks, and COLMAP, which does not wait for
    them, lost pairs of frames, or failed.
    """
    done, path = threading.Event(), work / "features.db"

    def watch() -> None:
        while not done.wait(WATCHED):
            with contextlib.suppress(sqlite3.Error), contextlib.closing(_reader(path)) as read:
                (rows,) = read.execute(f"SELECT count(*) FROM {table}").fetchone()
                tell(min(1.0, rows / max(1, total)))

    thread = threading.Thread(target=watch, daemon=True)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()


def _reader(path: Path) -> sqlite3.Connection:
    return sqlite3.connect(f"file:{path}?mode=ro&immutable=1", uri=True)


def _counting(tell: Progress, frames: int) -> Callable[[], None]:
    """Called for each frame that the incremental mapper adds: from 0.6 to 0.8 of the whole."""
    added = itertools.count(1)
    return lambda: tell(0.6 + 0.2 * min(1, next(added) / frames), "mapping")


def _mapped(
    work: Path,
    mapper: str,
    settings: ColmapSettings,
    added: Callable[[], None] = lambda: None,
) -> list[Reconstruction]:
    """All models that one of the mappers makes; none where the installed version lacks it or it fails. `added` is
    called for each frame that the incremental one adds."""
    import pycolmap

    out = work / mapper
    out.mkdir()
    options: Any
    run: Any
    if mapper in ("incremental", "pieces"):
        options = pycolmap.IncrementalPipelineOptions()
        options.multiple_models = mapper == "pieces"
        run = partial(pycolmap.incremental_mapping, next_image_callback=added)
    elif hasattr(pycolmap, "global_mapping"):
        options, run = pycolmap.GlobalPipelineOptions(), pycolmap.global_mapping
    else:
        return []
    options.num_threads, options.random_seed = 1, settings.seed
    try:
        found = run(work / "features.db", work / "images", out, options)
    except (RuntimeError, ValueError):  # too few matches for it to begin
        return []
    return [replace(_model(one), facts={"mapper": mapper, **_given(one)}) for one in found.values()]


def _given(found: Any) -> dict[str, Any]:
    return {"reprojection_px": round(float(found.compute_mean_reprojection_error()), 3)}


def _model(found: Any) -> Reconstruction:
    (camera,) = found.cameras.values()
    focal, x, y, radial = camera.params.tolist()
    images = sorted((im for im in found.images.values() if im.has_pose), key=lambda im: im.name)
    points = [(point.xyz, point.color, point.track) for _, point in sorted(found.points3D.items())]
    place = {image.image_id: k for k, image in enumerate(images)}
    seen = np.zeros((len(images), len(points)), bool)
    for j, (_, _, track) in enumerate(points):
        for element in track.elements:
            if element.image_id in place:
                seen[place[element.image_id], j] = True
    poses = np.tile(np.eye(4), (len(images), 1, 1))
    for k, image in enumerate(images):
        poses[k, :3] = image.cam_from_world().inverse().matrix()
    return Reconstruction(
        times=np.array([int(Path(image.name).stem) for image in images], np.int32),
        cam_to_world=poses,
        focal=focal,
        middle=(x - 0.5, y - 0.5),  # COLMAP's pixel centres lie half a pixel in
        radial=radial,
        width=camera.width,
        height=camera.height,
        points=np.array([xyz for xyz, _, _ in points]).reshape(-1, 3),
        colors=np.array([color for _, color, _ in points], np.uint8).reshape(-1, 3),
        seen=seen,
    )


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Without COLMAP's own log on the terminal, which does not ask Python; what Python says there is still shown."""
    import pycolmap

    before, said = pycolmap.logging.minloglevel, sys.stderr
    pycolmap.logging.minloglevel = 2
    said.flush()
    kept, null = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 2)
    try:
        with contextlib.ExitStack() as stack:
            if _is_terminals(said):
                sys.stderr = stack.enter_context(open(os.dup(kept), "w", buffering=1))
            yield
    finally:
        sys.stderr = said
        os.dup2(kept, 2)
        os.close(kept)
        os.close(null)
        pycolmap.logging.minloglevel = before


def _is_terminals(stream: TextIO) -> bool:
    """Whether a stream goes where the process's errors go, rather than to whoever took its place."""
    try:
        return stream.fileno() == 2
    except OSError:
        return False
