"""Renders recorded states again with one thing truly changed; runs in the simulators' environment, without rpaug.

    python -m tools.bench.foreign.changed --recorded recorded/worked/robosuite.Lift/0 --changes changes.json --out truth

`changes.json` has `frames` and `changes`, by name some of: `colors` [{id, rgb}]; `covers` [{ids, image, side}]; `light`
[ratio a channel]; `lamp` [towards it: the only lamp then]; `bumps` {camera: 4 x 4 in its frame}; `extras` [{id, points,
normals, uv, faces, image, pose}]; `sizes` [{id, factor}], each about its foot; `shifts` [{id, by}] in metres; `shadows`
false: lamps cast none. OUT gets an `.npz` for each, and `albedos.json`: by name and instance id, the display color of
its surface before and after.
"""

import argparse
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from tools.bench.foreign import neutral, simulated
from tools.bench.foreign.record import open_world

GRAY = (0.5, 0.5, 0.5, 1.0)  # a geom's color where it has none of its own
COVER, EXTRA = "cover/", "extra/"
PARTS, SLICES = 4, 28  # of a box's edge and of a round shape, as MuJoCo's own
AMBIENT, LAMP = 0.3, 0.5  # of the only lamp, as on the twin
ENDLESS = 5.0  # metres: half a plane that has no size
NOWHERE = (
    1e-4  # the size of the lamps' maps: each lamp is still drawn by itself, so that none is cut off
)


class Changed:
    """One episode's model, as recorded or with a change."""

    def __init__(self, folder: Path, change: Mapping[str, Any]) -> None:
        self.facts, self.change = neutral.facts(folder), change
        self.world = open_world(self.facts["world"])
        source = self.facts["model"]
        self.file = str(folder / source) if source == "model.xml" else source
        self.plain = simulated.hidden(mujoco.MjModel.from_xml_path(self.file), self.world.hidden)
        self.edits = neutral.arrays(folder, "model")
        simulated.apply(self.plain, self.edits)
        self.states = neutral.arrays(folder, "states")
        self.albedos: dict[int, tuple[list[float], list[float]]] = {}
        things = simulated.shown(self.plain, self.world.groups)
        self.ids = self.facts["ids"]
        self.eyes = {name: simulated.Eye(**eye) for name, eye in self.facts["cameras"].items()}
        self.geoms: dict[int, list[int]] = {}
        for name, geoms in things.items():
            self.geoms.setdefault(self.ids[name], []).extend(geoms)

    def film(self, frames: Sequence[int]) -> dict[str, dict[str, np.ndarray]]:
        """All cameras at `frames`."""
        model, by_geom = self.model()
        if lamp := self.change.get("lamp"):
            _only(model, lamp)
        if not self.change.get("shadows", True):
            model.vis.map.shadowclip = model.vis.map.shadowscale = NOWHERE
        ratio = np.array(self.change.get("light", (1, 1, 1)))
        for light in (model.light_diffuse, model.light_ambient, model.light_specular):
            light *= ratio
        for light in (
            model.vis.headlight.diffuse,
            model.vis.headlight.ambient,
            model.vis.headlight.specular,
        ):
            light *= ratio
        given = self.facts.get("studio", {})
        studio = simulated.Studio(model, by_geom, self.world.groups, **given)
        bumps = {name: np.array(bump) for name, bump in self.change.get("bumps", {}).items()}
        states = {name: value[list(frames)] for name, value in self.states.items()}
        out = studio.film(states, self.eyes, bumps)
        studio.close()
        return out

    def model(self) -> tuple[mujoco.MjModel, np.ndarray]:
        """The changed model and its instance ids by geom."""
        spec = mujoco.MjSpec.from_file(self.file)
        bodies = list(_bodies(spec.worldbody))
        for geom, mesh in self._covers():
            material = int(self.plain.geom_matid[geom])
            _add(
                spec,
                bodies[self.plain.geom_bodyid[geom]],
                f"{COVER}{geom}",
                mesh,
                self._shine(material),
            )
        for extra in self.change.get("extras", ()):
            name, pose = f"{EXTRA}{extra['id']}", np.array(extra["pose"])
            points = np.array(extra["points"]) @ pose[:3, :3].T + pose[:3, 3]
            normals = np.array(extra["normals"]) @ pose[:3, :3].T
            mesh = points, normals, np.array(extra["uv"]), np.array(extra["faces"]), extra["image"]
            _add(spec, spec.worldbody.add_body(name=name), name, mesh, {"specular": 0.0})
        model = simulated.hidden(spec.compile(), self.world.hidden)
        kept = _kept(self.plain, model)
        simulated.apply(model, {k: v for k, v in self.edits.items() if not k.startswith("geom_")})
        for name, value in self.edits.items():
            if name.startswith("geom_"):
                getattr(model, name)[kept] = value
        by_geom = np.zeros(model.ngeom, np.int32)
        for one, geoms in self.geoms.items():
            by_geom[kept[geoms]] = one
        old = {int(geom): one for one, geoms in self.geoms.items() for geom in geoms}
        for geom in range(model.ngeom):
            name = model.geom(geom).name
            if name.startswith(EXTRA):
                by_geom[geom] = int(name.removeprefix(EXTRA))
                model.geom_group[geom] = self.world.groups[0]
            elif name.startswith(COVER):
                covered = int(name.removeprefix(COVER))
                by_geom[geom] = old[covered]
                model.geom_group[geom] = model.geom_group[kept[covered]]
                model.geom_group[kept[covered]] = simulated.HIDDEN
        for color in self.change.get("colors", ()):
            self._paint(model, kept, color["id"], np.array(color["rgb"]))
        for size in self.change.get("sizes", ()):
            self._scale(model, kept, size["id"], size["factor"])
        for shift in self.change.get("shifts", ()):
            self._at(shift["id"])[:, :2] += shift["by"]
        return model, by_geom

    def _scale(self, model: mujoco.MjModel, kept: np.ndarray, one: int, factor: float) -> None:
        """One free body larger or smaller; what it stands on carries it as before."""
        data = mujoco.MjData(self.plain)
        simulated.restore(self.plain, data, self.states, 0)
        geoms, lowest = self.geoms[one], np.inf
        body = data.body(int(self.plain.geom_bodyid[geoms[0]]))
        for geom in geoms:
            points, _ = triangles(self.plain, geom)
            turn = data.geom_xmat[geom].reshape(3, 3)
            lowest = min(
                lowest, (points.reshape(-1, 3) @ turn.T + data.geom_xpos[geom])[:, 2].min()
            )
        covered = {f"{COVER}{geom}" for geom in geoms}
        laid = [geom for geom in range(model.ngeom) if model.geom(geom).name in covered]
        own = np.array([*kept[geoms], *laid])
        model.geom_size[own] *= factor
        model.geom_pos[own] *= factor
        for mesh in {int(model.geom_dataid[geom]) for geom in own} - {-1}:
            first = model.mesh_vertadr[mesh]
            model.mesh_vert[first : first + model.mesh_vertnum[mesh]] *= factor
        self._at(one)[:, 2] += (factor - 1) * (body.xpos[2] - lowest)

    def _at(self, one: int) -> np.ndarray:
        """Where a free body stands in every state, (t, 3), to be written to."""
        body = int(self.plain.geom_bodyid[self.geoms[one][0]])
        joint = int(self.plain.body_jntadr[body])
        if joint < 0 or self.plain.jnt_type[joint] != mujoco.mjtJoint.mjJNT_FREE:
            raise ValueError(f"instance {one} hangs on something and cannot stand elsewhere")
        first = int(self.plain.jnt_qposadr[joint])
        return self.states["qpos"][:, first : first + 3]

    def _paint(self, model: mujoco.MjModel, kept: np.ndarray, one: int, rgb: np.ndarray) -> None:
        """One color where the instance has one, a tint of each of its colors where it has several or a picture."""
        geoms = self.geoms[one]
        looks = [(_rgba(self.plain, geom), _texture(self.plain, geom)) for geom in geoms]
        plain = all(np.array_equal(look[0], looks[0][0]) and look[1] is None for look in looks)
        old = self._albedo(one)
        for geom, (rgba, _) in zip(geoms, looks, strict=True):
            model.geom_rgba[kept[geom]] = [*(rgb if plain else rgba[:3] * rgb), rgba[3]]
        self.albedos[one] = old.tolist(), (rgb if plain else old * rgb).tolist()

    def _covers(self) -> Iterator[tuple[int, "Mesh"]]:
        """The meshes that carry the picture, in their bodies' frames, by the geom that each takes the place of."""
        data = mujoco.MjData(self.plain)
        simulated.restore(self.plain, data, self.states, 0)
        by_id = {one: cover for cover in self.change.get("covers", ()) for one in cover["ids"]}
        for one, cover in by_id.items():
            for geom in self.geoms[one]:
                points, normals = triangles(self.plain, geom)
                body = data.body(int(self.plain.geom_bodyid[geom]))
                turn, shift = np.zeros(9), self.plain.geom_pos[geom]
                mujoco.mju_quat2Mat(turn, self.plain.geom_quat[geom])
                points, normals = (
                    points @ turn.reshape(3, 3).T + shift,
                    normals @ turn.reshape(3, 3).T,
                )
                world = points @ body.xmat.reshape(3, 3).T + body.xpos
                tiles = box(world) / cover["side"]
                faces = np.arange(points.shape[0] * 3).reshape(-1, 3)
                mesh = points.reshape(-1, 3), normals.reshape(-1, 3), tiles.reshape(-1, 2), faces
                yield geom, (*mesh, cover["image"])
            self.albedos[one] = self._albedo(one).tolist(), _mean(cover["image"]).tolist()

    def _albedo(self, one: int) -> np.ndarray:
        """The mean display color of an instance's surface, by area."""
        colors, areas = [], []
        for geom in self.geoms[one]:
            seen = _texture(self.plain, geom)
            colors.append(_rgba(self.plain, geom)[:3] * (1 if seen is None else seen))
            points, _ = triangles(self.plain, geom)
            across = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
            areas.append(np.linalg.norm(across, axis=1).sum())
        return np.average(colors, 0, areas)

    def _shine(self, material: int) -> dict[str, float]:
        """How a geom's surface glosses, but for mirrors."""
        if material < 0:
            return {}
        return {
            "specular": float(self.plain.mat_specular[material]),
            "shininess": float(self.plain.mat_shininess[material]),
        }


Mesh = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, str]
"""Points (v, 3), normals (v, 3), tiles to the right and up (v, 2), faces (f, 3), and the picture's file."""


def _bodies(body: mujoco.MjsBody) -> Iterator[mujoco.MjsBody]:
    """A body and what hangs on it, in the order of the compiled model."""
    yield body
    for child in body.bodies:
        yield from _bodies(child)


def _add(
    spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str, mesh: Mesh, shine: Mapping[str, float]
) -> None:
    points, normals, tiles, faces, image = mesh
    spec.add_mesh(
        name=name, uservert=points.ravel().tolist(), usernormal=normals.ravel().tolist(),
        usertexcoord=(tiles * (1, -1)).ravel().tolist(), userface=faces.ravel().tolist(),
        inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
    )  # fmt: skip
    spec.add_texture(
        name=name, type=mujoco.mjtTexture.mjTEXTURE_2D, file=str(Path(image).resolve())
    )
    textures = [""] * 10
    textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name
    spec.add_material(name=name, textures=textures, **shine)
    body.add_geom(
        name=name, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, material=name, contype=0, conaffinity=0, mass=0,
    )  # fmt: skip


def _kept(plain: mujoco.MjModel, model: mujoco.MjModel) -> np.ndarray:
    """Where each recorded geom is now: new ones come last in their bodies."""
    body = plain.geom_bodyid
    return model.body_geomadr[body] + np.arange(plain.ngeom) - plain.body_geomadr[body]


def _only(model: mujoco.MjModel, towards: Sequence[float]) -> None:
    """One parallel lamp without shadows, and ambient light."""
    model.light_active[1:] = 0
    model.light_directional[0] = model.light_active[0] = 1
    model.light_castshadow[0] = 0
    model.light_mode[0] = mujoco.mjtCamLight.mjCAMLIGHT_FIXED
    model.light_bodyid[0] = 0
    model.light_dir[0] = -np.array(towards)
    model.light_dir0[0] = -np.array(towards)
    model.light_diffuse[0], model.light_ambient[0], model.light_specular[0] = LAMP, 0, 0
    model.vis.headlight.ambient[:] = AMBIENT
    model.vis.headlight.diffuse[:] = model.vis.headlight.specular[:] = 0


def _rgba(model: mujoco.MjModel, geom: int) -> np.ndarray:
    own, material = model.geom_rgba[geom], int(model.geom_matid[geom])
    return np.array(own if material < 0 or not np.allclose(own, GRAY) else model.mat_rgba[material])


def _texture(model: mujoco.MjModel, geom: int) -> np.ndarray | None:
    """The mean display color of a geom's picture, if it has one."""
    material = int(model.geom_matid[geom])
    number = (
        -1 if material < 0 else int(model.mat_texid[material, mujoco.mjtTextureRole.mjTEXROLE_RGB])
    )
    if number < 0:
        return None
    channels = int(model.tex_nchannel[number])
    start, count = (
        int(model.tex_adr[number]),
        int(model.tex_width[number] * model.tex_height[number]),
    )
    pixels = model.tex_data[start : start + count * channels].reshape(-1, channels)
    return pixels[:, :3].mean(0) / 255


def _mean(image: str) -> np.ndarray:
    from PIL import Image

    return np.asarray(Image.open(image).convert("RGB")).reshape(-1, 3).mean(0) / 255


def box(points: np.ndarray) -> np.ndarray:
    """Metres to the right and up on the picture that each triangle (n, 3, 3) shows: rpaug's mapping `box`."""
    normal = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
    axis = (
        np.abs(normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12))
        .round(9)
        .argmax(1)
    )
    facing = np.sign(np.take_along_axis(normal, axis[:, None], 1))
    x, y, z = np.moveaxis(points, -1, 0)
    right = np.choose(axis[:, None], [y, -x, x]) * facing
    return np.stack([right, np.where(axis[:, None] == 2, y, z)], -1)


def triangles(model: mujoco.MjModel, geom: int) -> tuple[np.ndarray, np.ndarray]:
    """A geom's surface in its own frame: corners and their normals, (n, 3, 3) both."""
    shapes = mujoco.mjtGeom
    size, kind = model.geom_size[geom], shapes(int(model.geom_type[geom]))
    if kind == shapes.mjGEOM_MESH:
        mesh = int(model.geom_dataid[geom])
        part = slice(model.mesh_faceadr[mesh], model.mesh_faceadr[mesh] + model.mesh_facenum[mesh])
        corners = model.mesh_face[part] + model.mesh_vertadr[mesh]
        facing = model.mesh_facenormal[part] + model.mesh_normaladr[mesh]
        return model.mesh_vert[corners].astype(float), model.mesh_normal[facing].astype(float)
    if kind == shapes.mjGEOM_PLANE:
        half = np.where(size[:2] > 0, size[:2], ENDLESS)
        return _grids([np.array([[[x, y, 0] for x in _steps(half[0])] for y in _steps(half[1])])])
    if kind == shapes.mjGEOM_BOX:
        return _grids(_faces(size))
    around = np.linspace(0, 2 * np.pi, SLICES + 1)
    ring = np.stack([np.cos(around), np.sin(around), 0 * around], -1)
    if kind == shapes.mjGEOM_CYLINDER:
        radius, half = size[0], np.array([0, 0, size[1]])
        side = np.stack([radius * ring - half, radius * ring + half])
        points, normals = _grids([side])
        normals = points * (1, 1, 0) / radius
        caps = _grids(
            [
                np.stack([0 * ring + half, radius * ring + half])[::-1],
                np.stack([0 * ring - half, radius * ring - half]),
            ]
        )
        return np.concatenate([points, caps[0]]), np.concatenate([normals, caps[1]])
    if kind not in (shapes.mjGEOM_SPHERE, shapes.mjGEOM_CAPSULE, shapes.mjGEOM_ELLIPSOID):
        raise ValueError(f"no picture can be laid on a geom of type {kind}")
    radii = size if kind == shapes.mjGEOM_ELLIPSOID else np.full(3, size[0])
    up = np.linspace(
        -np.pi / 2, np.pi / 2, SLICES + 1
    )  # an even number of rings: none is cut by the capsule's middle
    ball = np.cos(up)[:, None, None] * ring + np.sin(up)[:, None, None] * [0.0, 0, 1]
    lift = (
        size[1] * np.sign(ball[..., 2:].round(9)) * [0, 0, 1]
        if kind == shapes.mjGEOM_CAPSULE
        else 0 * ball
    )
    points, _ = _grids([ball * radii + lift])
    normals, _ = _grids([ball / radii])
    return points, normals / np.linalg.norm(normals, axis=-1, keepdims=True)


def _steps(half: float) -> np.ndarray:
    return np.linspace(-half, half, PARTS + 1)


def _faces(size: np.ndarray) -> list[np.ndarray]:
    out = []
    for axis in range(3):
        for sign in (-1, 1):
            right, up = ((axis + 1) % 3, (axis + 2) % 3)[::sign]  # right x up faces outwards
            unit = np.empty((PARTS + 1, PARTS + 1, 3))
            unit[..., axis], unit[..., right], unit[..., up] = sign, _steps(1), _steps(1)[:, None]
            out.append(unit * size)
    return out


def _grids(grids: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Triangles of grids of corners (rows, columns, 3), columns x rows facing outwards, with flat normals."""
    found = []
    for grid in grids:
        a, b, c, d = grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]
        found += [np.stack(corners, 2).reshape(-1, 3, 3) for corners in ((a, b, c), (a, c, d))]
    points = np.concatenate(found)
    normal = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
    area = np.linalg.norm(normal, axis=1)
    points, normal = points[area > 1e-12], normal[area > 1e-12] / area[area > 1e-12, None]
    return points, np.repeat(normal[:, None], 3, 1)


def main() -> None:
    """Render every change that is not there yet."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--recorded", type=Path, required=True, help="one episode's neutral folder")
    parser.add_argument("--changes", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args()
    asked = json.loads(given.changes.read_text())
    given.out.mkdir(parents=True, exist_ok=True)
    albedos = {}
    for name, change in asked["changes"].items():
        one = Changed(given.recorded, change)
        films = one.film(asked["frames"])
        flat = {
            f"{camera}/{key}": value
            for camera, film in films.items()
            for key, value in film.items()
        }
        np.savez(given.out / f"{name}.npz", **flat)
        albedos[name] = one.albedos
    (given.out / "albedos.json").write_text(json.dumps(albedos))


if __name__ == "__main__":
    main()
