"""Rollouts of the twin with factors changed, as a policy would meet them; every case takes some of them."""

from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rpaug.core import geometry
from rpaug.twin import cameras, factors, tabletop
from rpaug.twin.look import Look
from rpaug.twin.panda import HOME, OPEN
from rpaug.twin.renderer import Renderer
from rpaug.twin.tasks import TASKS

TASK, CAMERA, SIZE, LAYOUTS = "slide_block", "front", 128, 7
WALLS = 5  # the training room's texture seed
ROOM = 100  # apart lie the seeds of two rooms

EXTRA = ("cup_large", "cup_small", "button")
CHANGES: Mapping[str, tuple[str, ...]] = {
    "object position": (),
    "object color": ("object_color",),
    "object texture": ("object_texture",),
    "object size": ("object_size",),
    "lighting": ("light_color", "light_direction"),
    "table": ("table_color", "table_texture"),
    "background": ("background_texture",),
    "distractor": (),
    "camera": ("camera_pose",),
}  # what the twin changes for each factor of a diagnosis; of several, one is drawn


@dataclass(frozen=True)
class Seen:
    """One rollout's first picture, and what a simulator knows of it. `changed` is never shown to an analyst."""

    rgb: np.ndarray  # (h, w, 3) uint8
    ids: np.ndarray  # (h, w) int32
    handles: Mapping[str, int]
    place: np.ndarray  # (3,) where the block's middle is, metres
    pose: np.ndarray  # (4, 4) camera to world
    changed: tuple[str, ...]

    def mask(self, *names: str) -> np.ndarray:
        return np.isin(self.ids, [self.handles[name] for name in names if name in self.handles])


def meet(number: int, changed: tuple[str, ...], room: int = 0) -> Seen:
    """Rollout `number` with these factors changed, each by a draw of its own.

    Another `room` has other walls and other draws of everything.
    """
    rng = np.random.default_rng([LAYOUTS + ROOM * room, number])
    job = TASKS[TASK](rng)
    placing = dict(job.placing)
    if "object position" in changed:
        placing["block_plain"] = _elsewhere(placing, rng)
    if "distractor" in changed:
        for name in rng.choice(EXTRA, 2, replace=False):
            placing[str(name)] = _free(placing, rng, str(name))
    walls = WALLS + ROOM * room
    world = tabletop.build(placing, rng, walls)
    look = Look(texture_seed=walls)
    for name in changed:
        kinds = CHANGES[name]
        if kinds:
            factor = factors.FACTORS[str(rng.choice(kinds))]
            parts = factors.parts(factor, None, world, job)
            look = factor.change(look, parts, _value(name, rng), rng)
    rig = cameras.rig(tabletop.ARM.tip(HOME)[None], SIZE, look.bumps)
    with closing(Renderer(world, look, SIZE)) as renderer:
        renderer.pose(HOME, OPEN, placing)
        rgb, _, ids = renderer.render(rig[CAMERA], 0, cameras.NEAR, cameras.FAR[CAMERA])
    place = placing["block_plain"][:3, 3]
    return Seen(rgb, ids, dict(world.handles), place, rig[CAMERA].cam_to_world[0], changed)


def _value(name: str, rng: np.random.Generator) -> float | None:
    """Sizes beyond what a gripper set to the recorded one would bear; all else is the factor's own draw."""
    return (
        float(rng.choice([rng.uniform(0.6, 0.8), rng.uniform(1.25, 1.5)]))
        if name == "object size"
        else None
    )


def _elsewhere(placing: Mapping[str, np.ndarray], rng: np.random.Generator) -> np.ndarray:
    """The block out of the range it was recorded in."""
    for _ in range(200):
        way, far = rng.uniform(0, 2 * np.pi), rng.uniform(0.08, 0.14)
        x, y = np.array([0.20, -0.14]) + far * np.array([np.cos(way), np.sin(way)])
        if _clear(placing, x, y, "block_plain"):
            break
    turn = np.array([0, 0, rng.uniform(-0.25, 0.25)])
    return geometry.rigid(turn, np.array([x, y, placing["block_plain"][2, 3]]))


def _free(placing: Mapping[str, np.ndarray], rng: np.random.Generator, name: str) -> np.ndarray:
    for _ in range(200):
        x, y = rng.uniform(-0.02, 0.42), rng.uniform(-0.3, 0.3)
        if _clear(placing, x, y, name):
            break
    return tabletop.upright(x, y, tabletop.resting_height(name), rng.uniform(-0.5, 0.5))


def _clear(placing: Mapping[str, np.ndarray], x: float, y: float, name: str) -> bool:
    others = [pose[:2, 3] for other, pose in placing.items() if other != name]
    return bool(min(np.hypot(*(at - (x, y))) for at in others) > 0.10)


def pool(
    count: int, share: float, single: bool, cache: Path | None, first: int = 0, room: int = 0
) -> list[Seen]:
    """`count` rollouts. Each factor is changed in a `share` of them; if `single`, one factor at a time, or none."""
    kind = "single" if single else f"{share:g}"
    file = None if cache is None else cache / f"pool-{room}-{first}-{count}-{kind}.npz"
    if file is not None and file.exists():
        with np.load(file, allow_pickle=False) as kept:
            return [_loaded(kept, k) for k in range(count)]
    out = []
    for number in range(first, first + count):
        rng = np.random.default_rng([LAYOUTS + ROOM * room, 1, number])
        names = list(CHANGES)
        if single:
            drawn = int(rng.integers(len(names) + 2))
            changed = (names[drawn],) if drawn < len(names) else ()
        else:
            changed = tuple(name for name in names if rng.random() < share)
        out.append(meet(number, changed, room))
    if file is not None:
        cache.mkdir(parents=True, exist_ok=True)
        np.savez_compressed(file, **{k: v for n, one in enumerate(out) for k, v in _kept(one, n)})
    return out


def _kept(one: Seen, number: int) -> list[tuple[str, np.ndarray]]:
    names = sorted(one.handles)
    return [
        (f"{number}-rgb", one.rgb), (f"{number}-ids", one.ids), (f"{number}-place", one.place),
        (f"{number}-pose", one.pose), (f"{number}-names", np.array(names)),
        (f"{number}-numbers", np.array([one.handles[n] for n in names])),
        (f"{number}-changed", np.array(one.changed, dtype="U40")),
    ]  # fmt: skip


def _loaded(kept: Mapping[str, np.ndarray], number: int) -> Seen:
    at = lambda name: kept[f"{number}-{name}"]  # noqa: E731
    handles = dict(zip(at("names").tolist(), at("numbers").tolist(), strict=True))
    return Seen(
        at("rgb"), at("ids"), handles, at("place"), at("pose"), tuple(at("changed").tolist())
    )
