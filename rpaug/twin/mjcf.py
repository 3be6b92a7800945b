"""The world as MuJoCo's XML, and the compiled model."""

from collections.abc import Mapping
from dataclasses import replace
from xml.etree import ElementTree as Xml

import mujoco
import numpy as np
from jaxtyping import Float, Int32

from rpaug.core import geometry
from rpaug.core.files import encode_png
from rpaug.twin import covers
from rpaug.twin.look import LAMPS, Extra, Finish, Look, TwinLamp
from rpaug.twin.world import WHITE, Flex, Geom, Part, Print, TwinBody, Vector, World

SKIN = 0.0015  # metres: half the thickness of a sheet
SHINE = 1.2  # times its diffuse color: what a lamp's highlights show
# Of each finish: MuJoCo's specular and shininess, and how much of its color is matte.
FINISHED: Mapping[Finish, tuple[float, float, float]] = {
    "matte": (0.0, 0.2, 1.0),
    "satin": (0.5, 0.2, 1.0),
    "glossy": (0.8, 0.4, 1.0),
    "metallic": (0.8, 0.2, 0.4),
}
AMBIENT = 0.3  # display intensity, at the lamps' own brightness


def compile_model(world: World, look: Look, size: int) -> mujoco.MjModel:
    """The model of `world` under `look`, with offscreen buffers of `size` x `size` pixels."""
    laid = {_cover(name): cover.image for name, cover in _laid(world, look).items()}
    images = {**world.textures, **laid}
    images |= {f"extra-{extra.name}": extra.image for extra in look.extras}
    pictures = {f"{name}.png": encode_png(image, 0) for name, image in images.items()}
    return mujoco.MjModel.from_xml_string(to_xml(world, look, size), pictures)


def to_xml(world: World, look: Look, size: int) -> str:
    """The MJCF document. Each part has one material per texture, so that its tint is said once."""
    root = Xml.Element("mujoco", model="tabletop")
    Xml.SubElement(root, "compiler", angle="radian")
    visual = Xml.SubElement(root, "visual")
    Xml.SubElement(visual, "global", offwidth=str(size), offheight=str(size))
    Xml.SubElement(visual, "quality", shadowsize="4096" if look.shadows else "0")
    # The shadow map spans shadowclip * extent to either side: the whole room.
    Xml.SubElement(visual, "map", shadowclip="3")
    Xml.SubElement(root, "statistic", extent="1")
    ambient = AMBIENT * np.divide(look.light, LAMPS)
    carried = _text((look.headlight,) * 3)
    shine = carried if look.shines else "0 0 0"
    Xml.SubElement(visual, "headlight", ambient=_text(ambient), diffuse=carried, specular=shine)
    asset = Xml.SubElement(root, "asset")
    for name in world.textures:
        Xml.SubElement(asset, "texture", name=name, type="cube", file=f"{name}.png")
    for name in map(_cover, _laid(world, look)):
        Xml.SubElement(asset, "texture", name=name, type="2d", file=f"{name}.png")
    scene = Xml.SubElement(root, "worldbody")
    for lamp in look.lamps:
        _add_lamp(scene, lamp, look)
    elements: dict[str | None, Xml.Element] = {None: scene}
    for body in world.bodies:
        element = _add_body(elements, body)
        for part in body.parts:
            if part.name in look.absent:
                continue
            there = shifted(part, look.shifts.get(part.name, (0.0, 0.0, 0.0)))
            _add_part(asset, element, resized(there, look.scales.get(part.name, 1.0)), look)
            if part.flex:
                _add_flex(root, asset, part, part.flex, look)
    for extra in look.extras:
        _add_extra(asset, scene, extra)
    return Xml.tostring(root, encoding="unicode")


def part_of_geoms(model: mujoco.MjModel, world: World, look: Look) -> Int32[np.ndarray, "g"]:
    """The mask handle of every geom of the model."""
    handles = {**world.handles, **{f"extra-{extra.name}": extra.handle for extra in look.extras}}
    return np.array(
        [handles[model.geom(g).name.split("/")[0]] for g in range(model.ngeom)], np.int32
    )


def part_of_flexes(model: mujoco.MjModel, world: World) -> Int32[np.ndarray, "f"]:
    """The mask handle of every flex of the model."""
    kind = mujoco.mjtObj.mjOBJ_FLEX
    names = [mujoco.mj_id2name(model, kind, f) for f in range(model.nflex)]
    return np.array([world.handles[name] for name in names], np.int32)


def metals(
    model: mujoco.MjModel, world: World, look: Look
) -> dict[tuple[float, float, float], set[int]]:
    """Geoms of metal, by the color in which they mirror lamps. Pictures on them do not color that."""
    color = {
        f"{part.name}/{number}": np.multiply(look.tints.get(part.name, part.tint), geom.color)
        for body in world.bodies
        for part in body.parts
        if look.finish(part.name) == "metallic"
        for number, geom in enumerate(part.geoms)
    }
    found: dict[tuple[float, float, float], set[int]] = {}
    for number in range(model.ngeom):
        if model.geom(number).name in color:
            red, green, blue = color[model.geom(number).name].tolist()
            found.setdefault((red, green, blue), set()).add(number)
    return found


def _laid(world: World, look: Look) -> dict[str, covers.Cover | Print]:
    """The images laid on parts: what bends has one of its own."""
    parts = [part for body in world.bodies for part in body.parts]
    own: dict[str, covers.Cover | Print] = {p.name: p.flex.printed for p in parts if p.flex}
    return own | dict(look.covers)


def _add_flex(root: Xml.Element, asset: Xml.Element, part: Part, flex: Flex, look: Look) -> None:
    """A mesh whose vertices are put in place frame by frame."""
    specular, shininess, matte = FINISHED[look.finish(part.name)]
    tint = np.multiply(look.tints.get(part.name, part.tint), matte)
    Xml.SubElement(
        asset,
        "material",
        name=part.name,
        rgba=_text((*tint, 1)),
        texture=_cover(part.name),
        specular=repr(specular),
        shininess=repr(shininess),
    )
    group = root.find("deformable")
    element = Xml.SubElement(
        Xml.SubElement(root, "deformable") if group is None else group,
        "flex",
        name=part.name,
        dim=str(flex.dim),
        body="world",
        radius=str(SKIN),
        material=part.name,
        vertex=_text(flex.points.ravel()),
        element=" ".join(map(str, flex.elements.ravel())),
        texcoord=_text(flex.tiles.ravel()),
    )
    Xml.SubElement(element, "contact", contype="0", conaffinity="0")


def foot(part: Part) -> float:
    """The lowest z of a part's boxes and upright cylinders in its body's frame."""
    return min(
        geom.start[2] - geom.size[2]
        if geom.shape == "box"
        else min(geom.start[2], (geom.end or geom.start)[2])
        for geom in part.geoms
    )


def shifted(part: Part, by: Vector) -> Part:
    """The part elsewhere in its body's frame."""

    def moved(point: Vector) -> Vector:
        x, y, z = np.add(point, by)
        return float(x), float(y), float(z)

    if not any(by):
        return part
    geoms = tuple(
        replace(g, start=moved(g.start), end=None if g.end is None else moved(g.end))
        for g in part.geoms
    )
    return replace(part, geoms=geoms)


def resized(part: Part, scale: float) -> Part:
    """The part `scale` times as large, about the point of its frame's z axis that it stands on."""
    if scale == 1.0:
        return part
    middle = np.array([0.0, 0.0, foot(part)])

    def moved(point: tuple[float, float, float]) -> tuple[float, float, float]:
        x, y, z = middle + scale * (np.array(point) - middle)
        return float(x), float(y), float(z)

    geoms = tuple(
        replace(
            geom,
            size=tuple(scale * side for side in geom.size),
            start=moved(geom.start),
            end=None if geom.end is None else moved(geom.end),
        )
        for geom in part.geoms
    )
    return replace(part, geoms=geoms)


def _add_lamp(scene: Xml.Element, lamp: TwinLamp, look: Look) -> None:
    along = np.cos(lamp.height)
    source = np.array(
        [along * np.cos(lamp.heading), along * np.sin(lamp.heading), np.sin(lamp.height)]
    )
    color = np.multiply(look.light, lamp.gain)
    Xml.SubElement(
        scene,
        "light",
        type="directional",
        pos=_text(1.4 * source + [0.2, 0, 0.8]),  # further away than all that casts shadows
        dir=_text(-source),
        diffuse=_text(color),
        specular=_text(SHINE * color if look.shines else np.zeros(3)),
        castshadow="true" if look.shadows else "false",
    )


def _add_body(elements: dict[str | None, Xml.Element], body: TwinBody) -> Xml.Element:
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, body.pose[:3, :3].ravel())
    element = Xml.SubElement(
        elements[body.parent],
        "body",
        name=body.name,
        pos=_text(body.pose[:3, 3]),
        quat=_text(quaternion),
        mocap="true" if body.movable else "false",
    )
    if body.joint:
        kind, axis = body.joint
        Xml.SubElement(element, "joint", name=body.name, type=kind, axis=_text(axis))
    elements[body.name] = element
    return element


def _add_part(asset: Xml.Element, body: Xml.Element, part: Part, look: Look) -> None:
    cover = look.covers.get(part.name)
    tint = look.tints.get(part.name, WHITE if cover else part.tint)
    specular, shininess, matte = FINISHED[look.finish(part.name)]
    for number, geom in enumerate(part.geoms):
        name = f"{part.name}/{number}"
        material = Xml.SubElement(
            asset,
            "material",
            name=name,
            rgba=_text((*np.multiply(matte, tint if cover else np.multiply(tint, geom.color)), 1)),
            specular=repr(specular),
            shininess=repr(shininess),
        )
        if cover:
            material.set("texture", _cover(part.name))
            _add_mesh(asset, body, covers.mesh(part, number, cover.side), name)
            continue
        if geom.texture:
            material.set("texture", geom.texture)
        _add_geom(body, geom, name)


def _add_mesh(asset: Xml.Element, body: Xml.Element, mesh: covers.CoverMesh, name: str) -> None:
    downwards = mesh.tiles * (1, -1)  # MuJoCo's images begin with their first row, at the top
    Xml.SubElement(
        asset,
        "mesh",
        name=name,
        inertia="shell",
        vertex=_text(mesh.points.ravel()),
        normal=_text(mesh.normals.ravel()),
        texcoord=_text(downwards.ravel()),
        face=" ".join(map(str, mesh.faces.ravel())),
    )
    _add_shape(body, name, type="mesh", mesh=name)


def _add_extra(asset: Xml.Element, scene: Xml.Element, extra: Extra) -> None:
    name = f"extra-{extra.name}"
    Xml.SubElement(asset, "texture", name=name, type="2d", file=f"{name}.png")
    Xml.SubElement(asset, "material", name=f"{name}/0", texture=name, specular="0")
    points = geometry.transform(extra.pose, extra.points)
    tiles = np.asarray(extra.uv, float)
    body = Xml.SubElement(scene, "body", name=name)
    mesh = covers.CoverMesh(points, extra.normals @ extra.pose[:3, :3].T, tiles, extra.faces)
    _add_mesh(asset, body, mesh, f"{name}/0")


def _add_geom(body: Xml.Element, geom: Geom, name: str) -> None:
    element = _add_shape(body, name, type=geom.shape, size=_text(geom.size))
    if geom.end is not None:
        element.set("fromto", _text((*geom.start, *geom.end)))
        return
    element.set("pos", _text(geom.start))
    if geom.yaw:
        element.set("euler", _text((0.0, 0.0, geom.yaw)))


def _add_shape(body: Xml.Element, name: str, **shape: str) -> Xml.Element:
    common = {"name": name, "material": name, "contype": "0", "conaffinity": "0"}
    return Xml.SubElement(body, "geom", common | shape)


def _cover(part: str) -> str:
    """The name of a covered part's texture."""
    return f"cover-{part}"


def _text(numbers: Float[np.ndarray, "n"] | tuple[float, ...]) -> str:
    return " ".join(repr(float(number)) for number in numbers)
