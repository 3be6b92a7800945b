"""What a viewer shows at each frame: where seen pixels lie, where cameras stand, what was put in, fitted Gaussians."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np
from jaxtyping import Float32, Float64, Int, UInt8

from rpaug.core import geometry, progress
from rpaug.core.types import Body, Episode, Gaussians
from rpaug.pages.session import Session, added_ids
from rpaug.pipeline.recipe import Recipe

RGB = tuple[int, int, int]
UNNAMED: RGB = (90, 90, 90)


@dataclass(frozen=True)
class Cloud:
    """Seen pixels of all cameras at one frame: metres in the world, their colors, and instance ids (0: none)."""

    points: Float32[np.ndarray, "n 3"]
    colors: UInt8[np.ndarray, "n 3"]
    ids: Int[np.ndarray, "n"]


@dataclass(frozen=True)
class PlacedSplats:
    """Gaussians at one frame: centers in metres, covariances in square metres, colors and opacities in 0..1."""

    centers: Float32[np.ndarray, "n 3"]
    covariances: Float32[np.ndarray, "n 3 3"]
    colors: Float32[np.ndarray, "n 3"]
    opacities: Float32[np.ndarray, "n"]


@dataclass(frozen=True)
class MeshInPlace:
    """What an edit put in, at one frame: its corners in the world, in metres, and its triangles."""

    name: str
    vertices: Float64[np.ndarray, "n 3"]
    faces: Int[np.ndarray, "m 3"]


@dataclass(frozen=True)
class Space:
    """An episode, or a fitted scene without one.

    `names` has a name and a color for each instance id. `gaussians` gives those of a frame, in the world.
    """

    title: str
    length: int
    episode: Episode | None = None
    names: Mapping[int, tuple[str, RGB]] | None = None
    bodies: Sequence[Body] = ()
    gaussians: Callable[[int], Gaussians] | None = None

    def cloud(self, t: int, most: int) -> Cloud:
        """At most about so many pixels of all cameras together, evenly spread over each; none where depth is not
        known."""
        seen = {} if self.episode is None else self.episode.views
        deep = [view for view in seen.values() if view.depth is not None]
        pixels = sum(view.camera.width * view.camera.height for view in deep)
        stride = max(1, int(np.ceil(np.sqrt(pixels / most)))) if pixels else 1
        points, colors, ids = [np.zeros((0, 3))], [np.zeros((0, 3), np.uint8)], [np.zeros(0, int)]
        for view in deep:
            assert view.depth is not None
            depth = np.asarray(view.depth(t), np.float64)
            known = np.zeros(depth.shape, bool)
            known[::stride, ::stride] = True
            known &= np.isfinite(depth) & (depth > 0)
            placed = geometry.world_points(np.where(known, depth, 0.0), view.camera, t)
            points.append(placed[known])
            colors.append(view.rgb(t)[known])
            ids.append(view.ids(t)[known] if view.ids else np.zeros(int(known.sum()), int))
        return Cloud(
            np.concatenate(points).astype(np.float32), np.concatenate(colors), np.concatenate(ids)
        )

    def by_instance(self, ids: Int[np.ndarray, "n"]) -> UInt8[np.ndarray, "n 3"]:
        """The color that stands for each instance."""
        known, place = np.unique(ids, return_inverse=True)
        names = self.names or {}
        table = [names.get(int(one), ("", UNNAMED))[1] for one in known]
        return np.array(table, np.uint8).reshape(-1, 3)[place]

    def meshes(self, t: int) -> list[MeshInPlace]:
        """What was put in."""
        return [
            MeshInPlace(
                f"new {min(body.instance_ids)}",
                geometry.transform(body.to_world[t], body.scale * body.mesh.points),
                body.mesh.faces,
            )
            for body in self.bodies
            if body.mesh is not None
        ]

    def splats(self, t: int) -> PlacedSplats | None:
        """The fitted Gaussians, None where none are known. Colors are those of no direction in particular."""
        if self.gaussians is None:
            return None
        from rpaug.gaussians import harmonics  # only here: an episode without Gaussians needs none

        found = self.gaussians(t)
        turned = geometry.pose_of(np.zeros((len(found), 3)), found.quats[:, [1, 2, 3, 0]])[
            :, :3, :3
        ]
        spread = turned * found.scales[:, None, :]
        return PlacedSplats(
            found.means,
            (spread @ np.swapaxes(spread, 1, 2)).astype(np.float32),
            np.clip(0.5 + harmonics.C0 * found.sh[:, 0], 0, 1),
            found.opacities,
        )


def of_episode(root: Path, key: str | None, recipe: Recipe | None, copy: int) -> Space:
    """An episode as recorded, or as copy number `copy` of a recipe has it. Raises RpaugError."""
    session = Session(root, key)
    title = PurePosixPath(session.episode.key).name
    progress.told(title, "finding what is in the scene")
    names = session.names
    if recipe is None:
        return Space(title, session.episode.length, session.found[2], names)
    progress.told(title, "making the copy")
    made = session.made(recipe, copy, judged=False)
    new = {one: (f"new {one}", (230, 60, 200)) for one in sorted(added_ids(made))}
    return Space(
        f"{title}, copy {copy}",
        made.episode.length,
        made.episode,
        {**names, **new},
        made.scene.bodies,
    )


def is_store(folder: Path) -> bool:
    """Whether fitted scenes lie there."""
    from rpaug.gaussians import store  # only here: it brings zarr

    return folder.is_dir() and bool(store.names(folder))


def of_store(folder: Path, start: str | None) -> Space:
    """A fitted scene of a store, by the beginning of its key. Raises RpaugError."""
    from rpaug.gaussians import gaussians, store  # only here: they bring zarr

    name = store.named(folder, start or store.names(folder)[0])
    progress.told(name, "reading")
    found = store.load(folder, name)
    assert found is not None
    length = len(found.bodies[0].to_world) if found.bodies else 1

    def at(t: int) -> Gaussians:
        return gaussians.standing_at(found.gaussians, found.bodies, t, found.irradiance)

    return Space(name[:12], length, gaussians=at)
