"""What a viewer shows at each frame: where seen pixels lie, where cameras stand, what was put in, fitted Gaussians."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path, PurePosixPath

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int, UInt8

from rpaug.core import geometry, progress
from rpaug.core.types import Body, CameraView, Episode, Gaussians, Mesh
from rpaug.pages.session import Session, added_ids
from rpaug.pipeline.recipe import Recipe
from rpaug.scene import sampled_frames

RGB = tuple[int, int, int]
UNNAMED: RGB = (90, 90, 90)
REST = "rest"  # what has no name
ROBOT = "robot"
SPREAD = 0.6  # a disc's deviation over the distance to the next one: together they close
THIN = 0.02  # a disc's thickness over its deviation
GRAZING = 0.3  # the least cosine by which a disc is widened


@dataclass(frozen=True)
class Cloud:
    """Seen pixels of all cameras at one frame as discs: metres in the world, colors, instance ids (0: none), and which
    way each faces. `radii` are standard deviations, so that neighbours close."""

    points: Float32[np.ndarray, "n 3"]
    colors: UInt8[np.ndarray, "n 3"]
    ids: Int[np.ndarray, "n"]
    normals: Float32[np.ndarray, "n 3"]
    radii: Float32[np.ndarray, "n"]

    def of(self, keep: Bool[np.ndarray, "n"]) -> "Cloud":
        """Those rows alone."""
        return Cloud(*(getattr(self, one.name)[keep] for one in fields(self)))

    @property
    def covariances(self) -> Float32[np.ndarray, "n 3 3"]:
        """Flat Gaussians that show the discs, in square metres."""
        across = self.normals[:, :, None] * self.normals[:, None, :]
        flat = np.eye(3, dtype=np.float32) - (1 - THIN**2) * across
        return (self.radii[:, None, None] ** 2 * flat).astype(np.float32)


@dataclass(frozen=True)
class PlacedSplats:
    """Gaussians at one frame: centers in metres, covariances in square metres, colors and opacities in 0..1."""

    centers: Float32[np.ndarray, "n 3"]
    covariances: Float32[np.ndarray, "n 3 3"]
    colors: Float32[np.ndarray, "n 3"]
    opacities: Float32[np.ndarray, "n"]


@dataclass(frozen=True)
class MeshInPlace:
    """What an edit put in, at one frame: `to_world` carries its mesh, which is `scale` times as large, into the world.

    Where it is not `solid` its Gaussians are what is seen of it, and the mesh only says how far it reaches.
    """

    name: str
    instance_ids: frozenset[int]
    mesh: Mesh
    to_world: Float64[np.ndarray, "4 4"]
    scale: float
    solid: bool

    @property
    def vertices(self) -> Float64[np.ndarray, "n 3"]:
        """Its corners in the world, in metres."""
        return geometry.transform(self.to_world, self.scale * self.mesh.points)

    @property
    def faces(self) -> Int[np.ndarray, "m 3"]:
        """Its triangles."""
        return self.mesh.faces


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
        parts = [NOTHING, *(_discs(view, t, stride) for view in deep)]
        return Cloud(
            *(np.concatenate([getattr(part, one.name) for part in parts]) for one in fields(Cloud))
        )

    def entities(self) -> dict[str, tuple[frozenset[int], RGB]]:
        """By name, as roles and colors give it: the instance ids that have it (all links of a robot do), and the color
        that stands for it."""
        found: dict[str, tuple[frozenset[int], RGB]] = {}
        for one, (name, color) in (self.names or {}).items():
            found[name] = found.get(name, (frozenset(), color))[0] | {one}, color
        return found

    def apart(self, cloud: Cloud) -> dict[str, Cloud]:
        """The cloud by name, in the order of `entities`; `rest` is what has none."""
        named = {name: np.isin(cloud.ids, list(ids)) for name, (ids, _) in self.entities().items()}
        named[REST] = ~np.any([*named.values(), np.zeros(len(cloud.ids), bool)], axis=0)
        return {name: cloud.of(keep) for name, keep in named.items()}

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
                body.instance_ids,
                body.mesh,
                body.to_world[t],
                body.scale,
                solid=body.splats is None and body.soft is None,
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


def _discs(view: CameraView, t: int, stride: int) -> Cloud:
    """Every `stride`-th pixel that has depth. Where its neighbours do not tell how it is turned it faces the camera."""
    assert view.depth is not None
    depth = np.asarray(view.depth(t), np.float32)[::stride, ::stride]
    depth = np.where(np.isfinite(depth) & (depth > 0), depth, np.float32(0))
    ids = np.zeros(depth.shape, np.int32)
    if view.ids is not None:
        ids = np.ascontiguousarray(view.ids(t)[::stride, ::stride], np.int32)
    pose = view.camera.cam_to_world[t]
    K = np.diag([1 / stride, 1 / stride, 1.0]) @ view.camera.K
    points, normals = sampled_frames.lift(depth, ids, K, pose)
    known = depth > 0
    points, normals = points[known], normals[known]
    away = (points - pose[:3, 3]).astype(np.float32)
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    normals = np.where(normals.any(axis=1, keepdims=True), normals, -away)
    slant = np.maximum(np.abs((normals * away).sum(1)), GRAZING)
    radii = SPREAD * depth[known] / np.float32(K[0, 0]) / slant
    colors = view.rgb(t)[::stride, ::stride][known]
    return Cloud(points, colors, ids[known], normals, radii.astype(np.float32))


def of_episode(root: Path, key: str | None, recipe: Recipe | None, copy: int) -> Space:
    """An episode as recorded, or as copy number `copy` of a recipe has it. Raises RpaugError."""
    session = Session(root, key)
    title = PurePosixPath(session.episode.key).name
    progress.told(title, "finding what is in the scene")
    names = session.names
    links = (row.instance_id for row in session.found[1] if row.role == ROBOT)
    names |= {one: (ROBOT, names[one][1]) for one in links}
    if recipe is None:
        return Space(title, session.episode.length, session.found[2], names)
    progress.told(title, "making the copy")
    made = session.copy(recipe, copy).made
    new = {one: (f"new {one}", (230, 60, 200)) for one in sorted(added_ids(made))}
    return Space(
        f"{title}, copy {copy}",
        made.episode.length,
        made.episode,
        {**names, **new},
        made.scene.bodies,
    )


NOTHING = Cloud(
    np.zeros((0, 3), np.float32),
    np.zeros((0, 3), np.uint8),
    np.zeros(0, np.int32),
    np.zeros((0, 3), np.float32),
    np.zeros(0, np.float32),
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
