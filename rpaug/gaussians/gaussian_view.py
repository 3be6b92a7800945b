"""What a camera sees of a scene's Gaussians: color by blending, depth and instance id from one surface."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
from jaxtyping import Bool, Float32, Int32, UInt8

from rpaug.core import geometry
from rpaug.core.errors import TargetError, Unsupported
from rpaug.core.types import Body, Camera, Scene
from rpaug.gaussians import flowing, frame_residuals, ids_by_weight, untracked_gaussians
from rpaug.gaussians.gaussians import Placement, joined
from rpaug.render import denoise
from rpaug.render.composite import Surfaces, composite
from rpaug.render.splat import Rasteriser, Rendering, Settings, Splats, View
from rpaug.scene.recorded import surface

# Recorded images are sharp: the usual 0.3 px^2 would blur every outline by half a pixel.
SHARP = Settings(dilation=0.1)
NEAR = 3.0  # typical standard deviations: the near plane where scenes are smaller than metres
ROUGH = 2e-3  # of depth: how much, at least, the planes of neighbouring Gaussians stand apart
ROUNDS = 3  # of smoothing over 5x5 pixels, for normals that light can fall on
CLOSED = 0.9  # share of light that is gone where something closes the view
FRINGE = 0.05  # less of it than before the edit: something was taken away
REACH = 3.0  # standard deviations: how far from its middle a Gaussian's plane is followed


def sharp(splats: Splats) -> Settings:
    """SHARP with a near plane that suits the splats, whatever the scene's unit is."""
    assert splats.scales is not None
    return sharp_for(float(np.median(splats.scales.max(-1))) if len(splats) else SHARP.near)


def sharp_for(size: float) -> Settings:
    """The same for a typical standard deviation in the scene's unit."""
    return replace(SHARP, near=min(SHARP.near, NEAR * size))


def render_view(
    scene: Scene, camera: str, t: int
) -> tuple[UInt8[np.ndarray, "h w 3"], Float32[np.ndarray, "h w"], Int32[np.ndarray, "h w"]]:
    """Image, surface depth and instance ids of `scene.cameras[camera]` at t; depth 0 and instance id 0 where nothing
    is.

    Depth and instance id are those of the one Gaussian at which half of the light is gone, never blended; depth is
    where the pixel's ray meets its plane. Appearance edits are functions on the surface, applied to what each pixel
    shows: an edited thing does not shine through what stands before it.
    Raises TargetError for a camera that is not there and Unsupported if the scene has no Gaussians.
    """
    image, depth, ids = blended(scene, camera, t)
    if scene.appearance:
        where = surfaces(depth, ids, standing(scene, camera), t, scene.bodies)
        # Gaussians blend, so an outline's pixel is a mixture however sharp the recording was.
        image = composite(image, ids, scene.appearance, True, where)
    return image, depth, ids


def blended(
    scene: Scene, camera: str, t: int
) -> tuple[UInt8[np.ndarray, "h w 3"], Float32[np.ndarray, "h w"], Int32[np.ndarray, "h w"]]:
    """What `render_view` shows before appearance edits: the Gaussians with their bodies where they are now."""
    return seen(scene, camera, t)[:3]


def seen(
    scene: Scene, camera: str, t: int
) -> tuple[
    UInt8[np.ndarray, "h w 3"],
    Float32[np.ndarray, "h w"],
    Int32[np.ndarray, "h w"],
    Int32[np.ndarray, "h w"],
]:
    """The same, and which row of the edited scene's Gaussians each pixel's surface is, -1 for none."""
    if camera not in scene.cameras:
        known = ", ".join(scene.cameras)
        raise TargetError(f"no camera is called {camera!r}; there are: {known}")
    if scene.gaussians is None:
        raise Unsupported("this scene has no Gaussians: rpaug fit, or --tier 3, makes them")
    eye, then = standing(scene, camera), frame_residuals.at(scene.gaussians, t)
    now = untracked_gaussians.of(scene, camera, t)
    then = joined([then, now]) if now else then
    placement = Placement.of(then.ids, scene.tracked, scene.irradiance)
    there = placement.place(Splats.of(then), t)
    assert there.quats is not None
    unedited = then = replace(then, means=there.means, quats=there.quats, sh=there.sh)
    then = flowing.edited(then, scene, t, np.zeros(3))
    splats, names, before = Splats.of(then), then.ids, Splats.of(unedited)
    if scene.flowing is not None:
        now, middle = flowing.standing(scene.flowing, t), scene.flowing.origin
        before, _ = flowing.beside(before, unedited.ids, now, middle)
        splats, names = flowing.beside(splats, names, flowing.edited(now, scene, t, middle), middle)
    asked = ids_by_weight.asked(scene)
    shown = splats.with_features(ids_by_weight.marks(names, asked)) if asked else splats
    drawn = Rasteriser(sharp(splats)).forward(shown, view_of(eye, t))
    depth = plane_depth(drawn, splats, eye, t)
    ids = np.where(drawn.surface_index >= 0, names[drawn.surface_index], 0)
    ids = ids_by_weight.named(drawn, ids, asked) if asked else ids
    if then is not unedited:
        opened = _opened(drawn, before, eye, t)
        depth, ids = np.where(opened, 0, depth), np.where(opened, 0, ids)
    return to_bytes(drawn.color), depth, ids.astype(np.int32), drawn.surface_index


def _opened(drawn: Rendering, before: Splats, eye: Camera, t: int) -> Bool[np.ndarray, "h w"]:
    """Where an edit took away what closed the view, and left a fringe that no longer does."""
    closed = Rasteriser(sharp(before)).forward(before, view_of(eye, t)).alpha
    return (drawn.alpha < CLOSED) & (drawn.alpha < closed - FRINGE)


def surfaces(
    depth: Float32[np.ndarray, "h w"],
    ids: Int32[np.ndarray, "h w"],
    camera: Camera,
    t: int,
    bodies: Sequence[Body],
) -> Surfaces:
    """Where the pixels of a rendering lie: neighbouring Gaussians' planes, brought to one surface."""

    @cache
    def even() -> Float32[np.ndarray, "h w"]:
        level, smooth = max(denoise.noise(depth, ids), ROUGH), depth
        for _ in range(ROUNDS):
            smooth = denoise.smooth(smooth, ids, level)
        return smooth

    return surface.of_image(even, ids, camera, t, bodies)


def standing(scene: Scene, name: str) -> Camera:
    """The camera where it truly stood, as far as is known."""
    camera = scene.cameras[name]
    if name not in scene.pose_correction:
        return camera
    return replace(camera, cam_to_world=scene.pose_correction[name] @ camera.cam_to_world)


def view_of(camera: Camera, t: int) -> View:
    """The rasteriser's view of a camera at t."""
    pose = geometry.inverse(camera.cam_to_world[t])
    return View(camera.K, pose, camera.width, camera.height)


def to_bytes(color: Float32[np.ndarray, "h w 3"]) -> UInt8[np.ndarray, "h w 3"]:
    """Display colors 0..1 as 8-bit pixels."""
    return (np.clip(color, 0, 1) * 255 + 0.5).astype(np.uint8)


def plane_depth(
    drawn: Rendering, splats: Splats, camera: Camera, t: int
) -> Float32[np.ndarray, "h w"]:
    """Depth at which each pixel's ray meets the plane of its surface Gaussian, in metres; 0 where there is none.

    The plane lies across the Gaussian's shortest axis. Where the ray meets it too far from the Gaussian's
    middle, or hardly at all, the middle's depth is kept.
    """
    assert splats.scales is not None
    assert splats.quats is not None
    rows, columns = np.nonzero(drawn.surface_index >= 0)
    index = drawn.surface_index[rows, columns]
    back = geometry.inverse(camera.cam_to_world[t])
    middle = geometry.transform(back, splats.means[index].astype(np.float64))
    normal = _axes(splats.quats[index], splats.scales[index].argmin(-1)) @ back[:3, :3].T
    ray = geometry.rays(columns, rows, camera.K)
    facing = (normal * ray).sum(-1)
    met = (normal * middle).sum(-1) / np.where(np.abs(facing) < 1e-6, 1e-6, facing)
    reach = REACH * splats.scales[index].max(-1)
    good = np.linalg.norm(ray * met[:, None] - middle, axis=-1) < reach
    out = np.zeros(drawn.surface_index.shape, np.float32)
    out[rows, columns] = np.where(good, met, middle[:, 2])
    return out


def _axes(quats: Float32[np.ndarray, "n 4"], which: np.ndarray) -> Float32[np.ndarray, "n 3"]:
    """One column of each rotation."""
    w, x, y, z = (quats / np.linalg.norm(quats, axis=-1, keepdims=True)).T
    columns = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)],
            [2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)],
            [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    return columns[which, :, np.arange(len(quats))]
