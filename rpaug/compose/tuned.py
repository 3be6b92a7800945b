"""Colors of an inserted thing's Gaussians, brought to the light of the scene that it stands in.

Each of a ring of views is rendered as the thing comes and refined: lit by the scene's light and held within its
colors. Then the harmonics alone are stepped until the Gaussians show the refined views; their shapes stay.
"""

from dataclasses import replace

import cv2
import numpy as np
from jaxtyping import Float32, Float64

from rpaug.compose.inserted import lit
from rpaug.compose.splatted import outward, small, standing
from rpaug.core import geometry
from rpaug.core.types import Ambience, Camera, Gaussians
from rpaug.gaussians.gaussian_view import view_of
from rpaug.render.splat import Adam, Loss, Rasteriser, Rates, Splats

AROUND, HEIGHTS = 6, (0.15, 0.6, 1.1)  # views on each ring, and the rings' heights in radians
SIDE = 96  # pixels
LENS = 1.9  # focal length in sides
AWAY = 2.2  # of the thing's diagonal: how far off the views are taken
PASSES = 3  # over all views
RATES = Rates(means=0, quats=0, scales=0, opacities=0, sh=0.12, sh_rest=0.01)
SMOOTH = 5  # pixels: Gaussians of a fit turn a little at random, their surface does not
FAINT = 0.02  # share of a pixel below which a color says nothing


def tuned(splats: Gaussians, to_world: Float64[np.ndarray, "4 4"], ambience: Ambience) -> Gaussians:
    """The Gaussians, in their own frame, with the colors that they have at that place in that light."""
    there = standing(splats, to_world)
    cameras = ring(there)
    goals = [refined(there, camera, ambience) for camera in cameras]
    state = Splats.of(there)
    engine, adam = Rasteriser(small(state)), Adam(state, RATES)
    order = np.argsort(np.random.default_rng(0).random((PASSES, len(cameras))), 1)
    for number, index in enumerate(order.ravel()):
        engine.forward(adam.splats, view_of(cameras[index], 0), surface=False)
        _, slopes = engine.backward_loss(Loss(), goals[index])
        adam.step(slopes, 1 - 0.9 * number / order.size)
    world = replace(there, sh=adam.splats.sh)
    back = geometry.inverse(to_world)
    return replace(splats, sh=standing(world, back).sh)


def ring(there: Gaussians, side: int = SIDE) -> list[Camera]:
    """Cameras all around a thing in the world, looking at its middle from a little and from far above."""
    low, high = there.means.min(0).astype(float), there.means.max(0).astype(float)
    middle, reach = (low + high) / 2, max(float(np.linalg.norm(high - low)), 1e-6)
    K = np.array([[LENS * side, 0, (side - 1) / 2], [0, LENS * side, (side - 1) / 2], [0, 0, 1.0]])
    found = []
    for up in HEIGHTS:
        for turn in 2 * np.pi * (np.arange(AROUND) + up) / AROUND:
            along = np.array([np.cos(up) * np.cos(turn), np.cos(up) * np.sin(turn), np.sin(up)])
            right = np.array([-np.sin(turn), np.cos(turn), 0.0])
            pose = np.eye(4)
            pose[:3, :3] = np.stack([right, np.cross(-along, right), -along], 1)
            pose[:3, 3] = middle + AWAY * reach * along
            found.append(Camera(K, pose[None], side, side))
    return found


def refined(there: Gaussians, camera: Camera, ambience: Ambience) -> Float32[np.ndarray, "h w 3"]:
    """The view as the light of the scene would show it, on black."""
    splats = Splats.of(there)
    drawn = Rasteriser(small(splats)).forward(splats, view_of(camera, 0))
    shown = drawn.alpha > FAINT
    known = drawn.surface_index >= 0
    faces = np.zeros((*known.shape, 3), np.float32)
    faces[known] = outward(there, camera, 0)[drawn.surface_index[known]]
    faces = np.asarray(cv2.blur(faces, (SMOOTH, SMOOTH)), np.float32)
    faces = faces / np.maximum(np.linalg.norm(faces, axis=-1, keepdims=True), 1e-6)
    color = np.clip(drawn.color[shown] / drawn.alpha[shown][:, None], 0, 1)
    out = np.zeros_like(drawn.color)
    out[shown] = lit(color, faces[shown], ambience) * drawn.alpha[shown][:, None]
    return out
