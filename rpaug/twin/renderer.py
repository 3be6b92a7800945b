"""Pictures of the world by OpenGL in software: color, depth in metres, and the handle under each pixel."""

import os
from collections.abc import Mapping
from contextlib import suppress
from importlib import import_module
from types import MappingProxyType
from typing import Any

import mujoco
import numpy as np
from jaxtyping import Float32, Float64, Int32, UInt8

from rpaug.core.errors import Unsupported
from rpaug.core.types import Camera
from rpaug.twin import mjcf
from rpaug.twin.look import Look
from rpaug.twin.world import World

QUADS = 16  # a side of a box, where highlights are drawn

Frame = tuple[UInt8[np.ndarray, "h w 3"], Float32[np.ndarray, "h w"], Int32[np.ndarray, "h w"]]


def open_gl(size: int) -> Any:
    """A current OpenGL context without a window. Raises Unsupported naming the packages that bring one."""
    with suppress(ImportError):
        # CUDA builds of torch bring it. Loaded after Mesa it takes Mesa's LLVM for its own, and the process dies.
        import_module("triton")
    try:
        if os.environ.get("MUJOCO_GL", "egl") == "egl":
            from mujoco.egl import GLContext
        else:
            from mujoco import GLContext
        context = GLContext(size, size)
        context.make_current()
    except (ImportError, AttributeError, RuntimeError, OSError) as error:
        raise Unsupported(
            "the twin needs OpenGL to render: on Debian or Ubuntu, "
            f"apt-get install libegl1 libgl1-mesa-dri and set MUJOCO_GL=egl ({error})"
        ) from error
    return context


class Renderer:
    """Renders one world under one look; close it, or use it in a `with` block, to free its OpenGL context."""

    def __init__(self, world: World, look: Look, size: int) -> None:
        self.size = size
        self.model = mjcf.compile_model(world, look, size)
        self.data = mujoco.MjData(self.model)
        self._instance_ids = mjcf.part_of_geoms(self.model, world, look)
        kind = int(mujoco.mjtObj.mjOBJ_GEOM)
        metals = mjcf.metals(self.model, world, look).items()
        self._metals = {color: {(kind, one) for one in group} for color, group in metals}
        self._soft = mjcf.part_of_flexes(self.model, world)
        still = {world.handles[p.name] for b in world.bodies for p in b.parts if not p.casts}
        self._no_casters = frozenset(
            np.flatnonzero(np.isin(self._instance_ids, list(still))).tolist()
        )
        self._scene = mujoco.MjvScene(self.model, maxgeom=self.model.ngeom + self.model.nflex + 8)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = look.shadows
        self._scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = False
        self._option = mujoco.MjvOption()
        for flag in ("VERT", "EDGE", "FACE"):
            self._option.flags[getattr(mujoco.mjtVisFlag, f"mjVIS_FLEX{flag}")] = False
        self._option.flags[mujoco.mjtVisFlag.mjVIS_FLEXSKIN] = True
        self._whole = mujoco.MjrRect(0, 0, size, size)
        self._gl = open_gl(size)
        self._color = self._buffer(4 if look.antialias else 0)
        # Depth and ids must name one surface per pixel, so they never share a multisampled buffer.
        self._exact = self._buffer(0) if look.antialias else self._color
        self._shine = self._shine_buffer(4 if look.antialias else 0) if look.shines else None
        self._rgb = np.empty((size, size, 3), np.uint8)
        self._depth = np.empty((size, size), np.float32)

    def pose(
        self,
        q: Float64[np.ndarray, "7"],
        opening: float,
        objects: dict[str, Float64[np.ndarray, "4 4"]],
        shapes: Mapping[str, Float64[np.ndarray, "v 3"]] = MappingProxyType({}),
    ) -> None:
        """Put arm, fingers (metres each from the middle), movable bodies and what bends where they belong."""
        self.data.qpos[:] = (*q, opening, opening)
        for name, where in objects.items():
            slot = self.model.body(name).mocapid[0]
            self.data.mocap_pos[slot] = where[:3, 3]
            mujoco.mju_mat2Quat(self.data.mocap_quat[slot], where[:3, :3].ravel())
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)
        for name, points in shapes.items():
            number = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_FLEX, name)
            first = self.model.flex_vertadr[number]
            self.data.flexvert_xpos[first : first + len(points)] = points
        mujoco.mjv_updateScene(
            self.model,
            self.data,
            self._option,
            None,
            mujoco.MjvCamera(),
            mujoco.mjtCatBit.mjCAT_ALL,
            self._scene,
        )
        for one in self._scene.geoms[: self._scene.ngeom]:
            if one.objtype == mujoco.mjtObj.mjOBJ_GEOM and one.objid in self._no_casters:
                one.category = (
                    mujoco.mjtCatBit.mjCAT_DECOR
                )  # the kind that MuJoCo casts no shadow of

    def render(self, camera: Camera, t: int, near: float, far: float) -> Frame:
        """Color, depth (0 where nothing is) and handles (0 there) as `camera` sees the posed world at t."""
        self._aim(camera, t, near, far)
        return self._draw_color(), *self._draw_surfaces(near, far)

    def close(self) -> None:
        """Free the OpenGL context."""
        self._color.free()
        self._exact.free()
        if self._shine is not None:
            self._shine.free()
        self._gl.free()

    def _buffer(self, samples: int) -> mujoco.MjrContext:
        self.model.vis.quality.offsamples = samples
        context = mujoco.MjrContext(self.model, mujoco.mjtFontScale.mjFONTSCALE_100)
        context.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZEROFAR
        return context

    def _shine_buffer(self, samples: int) -> mujoco.MjrContext:
        """One whose boxes have finer sides: highlights are worked out at their corners."""
        coarse, self.model.vis.quality.numquads = self.model.vis.quality.numquads, QUADS
        context = self._buffer(samples)
        self.model.vis.quality.numquads = coarse
        return context

    def _aim(self, camera: Camera, t: int, near: float, far: float) -> None:
        """Give the scene a frustum under which K holds with pixel centres at integers: OpenGL's are at + 1/2."""
        K, pose = camera.K, camera.cam_to_world[t]
        left, right = (np.array([-0.5, camera.width - 0.5]) - K[0, 2]) / K[0, 0] * near
        top, bottom = (K[1, 2] - np.array([-0.5, camera.height - 0.5])) / K[1, 1] * near
        for eye in self._scene.camera:
            eye.pos, eye.forward, eye.up = pose[:3, 3], pose[:3, 2], -pose[:3, 1]
            eye.frustum_center, eye.frustum_width = (left + right) / 2, (right - left) / 2
            eye.frustum_bottom, eye.frustum_top = bottom, top
            eye.frustum_near, eye.frustum_far = near, far

    def _draw(self, context: mujoco.MjrContext) -> None:
        """Render into that context's own buffer; which one is bound is OpenGL's state, not the context's."""
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, context)
        mujoco.mjr_render(self._whole, self._scene, context)

    def _draw_color(self) -> UInt8[np.ndarray, "h w 3"]:
        """Matte light and highlights apart, and then their sum: OpenGL would lay a surface's picture over both."""
        if self._shine is None:
            return self._drawn(self._color)
        lights = list(self._scene.lights[: self._scene.nlight])
        kept = [(one.ambient.copy(), one.diffuse.copy(), one.specular.copy()) for one in lights]
        for one in lights:
            one.specular[:] = 0
        matte = self._drawn(self._color)
        for one, (_, _, specular) in zip(lights, kept, strict=True):
            one.ambient[:] = one.diffuse[:] = 0
            one.specular[:] = specular
        shine = self._mirrored(self._shine)
        for one, (ambient, diffuse, _) in zip(lights, kept, strict=True):
            one.ambient[:], one.diffuse[:] = ambient, diffuse
        return np.minimum(matte.astype(np.uint16) + shine, 255).astype(np.uint8)

    def _mirrored(self, context: mujoco.MjrContext) -> UInt8[np.ndarray, "h w 3"]:
        """The lamps' highlights alone, of the lamps' color and on metals of theirs: no picture is laid over them."""
        geoms = list(self._scene.geoms[: self._scene.ngeom])
        kept = [(one.matid, one.specular) for one in geoms]
        lights = list(self._scene.lights[: self._scene.nlight])
        colors = [one.specular.copy() for one in lights]
        metals = set().union(*self._metals.values())
        groups = [((1.0, 1.0, 1.0), {*map(_named, geoms)} - metals), *self._metals.items()]
        total = np.zeros(self._rgb.shape, np.uint16)
        for color, group in groups:
            for one, (_, specular) in zip(geoms, kept, strict=True):
                one.matid, one.specular = -1, specular if _named(one) in group else 0.0
            for light, own in zip(lights, colors, strict=True):
                light.specular[:] = own * np.array(color, np.float32)
            total += self._drawn(context)
        for one, (matid, specular) in zip(geoms, kept, strict=True):
            one.matid, one.specular = matid, specular
        for light, own in zip(lights, colors, strict=True):
            light.specular[:] = own
        return np.minimum(total, 255).astype(np.uint8)

    def _drawn(self, context: mujoco.MjrContext) -> UInt8[np.ndarray, "h w 3"]:
        self._draw(context)
        mujoco.mjr_readPixels(self._rgb, None, self._whole, context)
        return self._rgb[::-1].copy()

    def _draw_surfaces(
        self, near: float, far: float
    ) -> tuple[Float32[np.ndarray, "h w"], Int32[np.ndarray, "h w"]]:
        for flag in (mujoco.mjtRndFlag.mjRND_SEGMENT, mujoco.mjtRndFlag.mjRND_IDCOLOR):
            self._scene.flags[flag] = True
        self._draw(self._exact)
        mujoco.mjr_readPixels(self._rgb, self._depth, self._whole, self._exact)
        for flag in (mujoco.mjtRndFlag.mjRND_SEGMENT, mujoco.mjtRndFlag.mjRND_IDCOLOR):
            self._scene.flags[flag] = False
        number = self._rgb[::-1].astype(np.int32) @ (1, 1 << 8, 1 << 16)
        ids = np.array([0, *map(self._instance_id, range(self._scene.ngeom))], np.int32)[number]
        # Reversed depth is 1 at near and 0 at far: solved for z in double, as 32-bit floats are
        # densest at far.
        z = near * far / (near + self._depth[::-1].astype(np.float64) * (far - near))
        return np.where(ids > 0, z, 0).astype(np.float32), ids

    def _instance_id(self, drawn: int) -> int:
        """The handle of one thing in OpenGL's list."""
        thing = self._scene.geoms[drawn]
        bends = thing.objtype == mujoco.mjtObj.mjOBJ_FLEX
        return int((self._soft if bends else self._instance_ids)[thing.objid])


def _named(thing: mujoco.MjvGeom) -> tuple[int, int]:
    """What a thing in OpenGL's list shows: its kind and number in the model."""
    return thing.objtype, thing.objid
