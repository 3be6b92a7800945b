"""Which instance a target means in recordings of color images alone, held against outlines that were drawn by hand.

    python -m tools.bench.photographs_targets --data DATA --drawn tools/bench/bridge_outlines.json --out sheets

No model is asked. Of every episode that the file has, asked are `manipulated`, each drawn thing by its noun, and by its
color and noun. OUT gets a sheet of each that was not refused: first, middle and last frame of every camera, the chosen
instance outlined in red and the drawn one in yellow, for the eye. A target is right where at least half of chosen and
drawn pixels are shared in the first frame of all cameras that were drawn for it.

    python -m tools.bench.photographs_targets --data DATA --whole worked --out sheets

shows, of every second record, what edits of the table (red) and of the background (yellow) would paint, and whether
they are refused: `worked` are records 0, 2, 4 and so on, `closed` the others.
"""

import argparse
import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Bool, UInt8

import rpaug
from rpaug.core.errors import RpaugError
from rpaug.core.files import encode_png, write_atomic
from rpaug.core.types import Episode, Scene
from rpaug.scene import build
from rpaug.scene.targets.instruction import mentions
from rpaug.scene.targets.targets import Target, find

COLORS: Mapping[str, str] = {"carrot": "orange", "plate": "green", "cup": "blue", "pot": "silver"}
RIGHT = 0.5  # intersection over union
LARGER = 5
CHOSEN, DRAWN = (255, 0, 0), (255, 255, 0)
HALVES = ("worked", "closed")  # records 0, 2, 4 and so on, and the others
PAINTED = {"table": CHOSEN, "background": DRAWN}

Outlines = Mapping[str, Mapping[str, Sequence[Mapping[str, Any]]]]
Mask = Bool[np.ndarray, "h w"]


def asked(episode: Episode, outlines: Outlines) -> Iterator[tuple[str, str, Target]]:
    """The kind of question, the drawn thing that is its answer, and the target."""
    words = {
        one["words"] for frames in outlines.values() for some in frames.values() for one in some
    }
    handled = {
        one.noun
        for text in episode.descriptions
        for one in mentions(text)
        if one.place == "handled"
    }
    for noun in sorted(words):
        part = "what is moved" if noun in handled else "where it goes"
        if noun in handled:
            yield "manipulated", noun, Target(role="manipulated")
        yield f"{part}, by its noun", noun, Target(text=f"the {noun}")
        yield f"{part}, by color and noun", noun, Target(text=f"the {COLORS[noun]} {noun}")


def drawn(outlines: Outlines, camera: str, t: int, noun: str, shape: tuple[int, int]) -> Mask:
    """What was drawn of a thing in a frame."""
    mask = np.zeros(shape, np.uint8)
    for one in outlines.get(camera, {}).get(str(t), ()):
        if one["words"] == noun:
            for corners in one.get("polygons", [one.get("polygon")]):
                cv2.fillPoly(mask, [np.rint(np.array(corners)).astype(np.int32)], 1)
    return mask > 0


def overlaps(scene: Scene, outlines: Outlines, noun: str, chosen: frozenset[int]) -> list[float]:
    """Intersection over union with what was drawn in the first frame of each camera."""
    out = []
    for name, view in scene.episode.views.items():
        assert view.ids is not None
        found = np.isin(view.ids(0), list(chosen))
        true = drawn(outlines, name, 0, noun, found.shape)
        if true.any():
            out.append(float((found & true).sum() / (found | true).sum()))
    return out


def sheet(
    scene: Scene, outlines: Outlines, noun: str, chosen: frozenset[int]
) -> UInt8[np.ndarray, "h w 3"]:
    """Three frames of every camera that shows anything, outlined."""
    rows = []
    for name, view in scene.episode.views.items():
        if np.ptp(view.rgb(0)) < 8:
            continue
        assert view.ids is not None
        tiles = []
        for t in (0, scene.episode.length // 2, scene.episode.length - 1):
            image = view.rgb(t)
            true = drawn(outlines, name, t, noun, image.shape[:2])
            found = np.isin(view.ids(t), list(chosen))
            tiles.append(outlined(image, ((true, DRAWN), (found, CHOSEN))))
        rows.append(np.concatenate(tiles, 1))
    return np.concatenate(rows)


def outlined(
    image: UInt8[np.ndarray, "h w 3"], masks: Sequence[tuple[Mask, tuple[int, int, int]]]
) -> UInt8[np.ndarray, "h w 3"]:
    """The image, larger, with the outlines of masks."""
    out = cv2.resize(image, None, fx=LARGER, fy=LARGER, interpolation=cv2.INTER_CUBIC)
    for mask, color in masks:
        large = cv2.resize(mask.astype(np.uint8), out.shape[1::-1], interpolation=cv2.INTER_NEAREST)
        found, _ = cv2.findContours(large, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        cv2.drawContours(out, found, -1, color, 1)
    return out


def whole(data: Path, half: str, out: Path) -> None:
    """What edits of the table and of the background paint, or would paint, in one half of the records."""
    for key in rpaug.episodes(data)[HALVES.index(half) :: len(HALVES)]:
        scene = build.build(rpaug.read(data, key), with_bodies=True)
        told = {
            role: "painted" if role in scene.roles else f"refused: {scene.beliefs[role].reasons[0]}"
            for role in PAINTED
            if role in scene.beliefs
        }
        for role, became in told.items():
            sys.stdout.write(f"{key} | {role}: {became}\n")
        path = out / half / f"{key.replace('/', '_')}.png"
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(path, encode_png(_painted(scene)))


def _painted(scene: Scene) -> UInt8[np.ndarray, "h w 3"]:
    """The first frame of every camera that shows anything, beside it table and background outlined."""
    rows = []
    for view in scene.episode.views.values():
        if np.ptp(view.rgb(0)) < 8:
            continue
        assert view.ids is not None
        ids, image = view.ids(0), view.rgb(0)
        masks = [
            (np.isin(ids, list(scene.beliefs[role].instance_ids)), color)
            for role, color in PAINTED.items()
            if role in scene.beliefs
        ]
        rows.append(np.concatenate([outlined(image, ()), outlined(image, masks)], 1))
    return np.concatenate(rows)


def main() -> None:
    """Ask, judge, and draw."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, required=True)
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--drawn", type=Path)
    what.add_argument("--whole", choices=HALVES)
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args()
    if given.whole:
        whole(given.data, given.whole, given.out)
        return
    counts: dict[str, list[int]] = {}
    for key, outlines in json.loads(given.drawn.read_text()).items():
        episode = rpaug.read(given.data, key)
        scene = build.build(episode, with_bodies=True)
        for kind, noun, target in asked(episode, outlines):
            row = counts.setdefault(kind, [0, 0, 0])
            row[0] += 1
            try:
                chosen = find(scene, target)
            except RpaugError as refusal:
                sys.stdout.write(f"{key} | {target}: refused: {str(refusal).partition('; ')[0]}\n")
                continue
            shares = overlaps(scene, outlines, noun, chosen)
            right = bool(shares) and min(shares) >= RIGHT
            row[1] += 1
            row[2] += right
            told = ", ".join(f"{one:.2f}" for one in shares)
            sys.stdout.write(f"{key} | {target}: {'right' if right else 'wrong'}: {told}\n")
            path = given.out / f"{key.replace('/', '_')}_{str(target).strip(chr(39))}.png"
            path.parent.mkdir(parents=True, exist_ok=True)
            write_atomic(path, encode_png(sheet(scene, outlines, noun, chosen)))
    for kind, (count, chosen_of, right) in counts.items():
        sys.stdout.write(f"|{kind}|{count}|{chosen_of}|{right}|{count - chosen_of}|\n")


if __name__ == "__main__":
    main()
