"""Meshes and Gaussians from files, as things of the library: glb, gltf, obj, stl, ply."""

import io
import logging
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int, UInt8

from rpaug.core import geometry
from rpaug.core.errors import BadInput
from rpaug.core.files import read_bytes
from rpaug.core.types import Gaussians, Mesh
from rpaug.gaussians import harmonics, ply
from rpaug.gaussians.gaussians import chosen, moved

ENDINGS = (".glb", ".gltf", ".obj", ".stl", ".ply")
FAINT = 0.3  # opacity: a Gaussian below shows too little to count as a surface
SEEN = 0.005  # opacity: one below shows nothing
MOST_GAUSSIANS = 2_000_000
MOST_FACES = 1_000_000  # of a mesh: some ten seconds to read and keep
MOST_BYTES = 2**29  # of a file
DISC = 1.6  # standard deviations: half a side of the square that stands for a Gaussian
LARGEST_IMAGE = 1024  # texels a side
MOST_METRES = 3.0
EVEN = 0.28209479  # of the harmonics' first coefficient, above 0.5


def read(path: Path, scale: float = 1.0, up: str = "z") -> tuple[Mesh, Gaussians | None]:
    """The thing in a file, `scale` metres to its unit, its `up` axis ("y" or "z") made z. Raises BadInput.

    Of a file of Gaussians, those that can be seen, and a mesh that says how far they reach.
    """
    if path.suffix.lower() not in ENDINGS:
        raise BadInput(path, "format", found=path.suffix, expected=", ".join(ENDINGS))
    if path.is_file() and (size := path.stat().st_size) > MOST_BYTES:
        raise BadInput(path, "size", found=f"{size} bytes", expected=f"at most {MOST_BYTES}")
    data = read_bytes(path)
    turn = np.eye(3) if up == "z" else geometry.rotation(np.array([np.pi / 2, 0.0, 0.0]))
    if path.suffix.lower() == ".ply" and b"f_dc_0" in data[:4096]:
        splats = _upright(_solid(path, ply.read(path)), scale, turn)
        return _checked(path, discs(splats), 1.0, np.eye(3)), splats
    return _checked(path, _triangles(path), scale, turn), None


def _solid(path: Path, found: Gaussians) -> Gaussians:
    """Those that show something. Raises BadInput if they are too many, or none."""
    seen = chosen(found, found.opacities > SEEN)
    if not 0 < len(seen) <= MOST_GAUSSIANS:
        raise BadInput(
            path,
            "Gaussians",
            found=f"{len(seen)} that can be seen",
            expected=f"1 to {MOST_GAUSSIANS}",
        )
    return replace(seen, ids=np.zeros(len(seen), np.int32))


def _upright(splats: Gaussians, scale: float, turn: Float[np.ndarray, "3 3"]) -> Gaussians:
    """Gaussians scaled and turned, their colors along."""
    motion = np.eye(4)
    motion[:3, :3] = turn
    there = moved(splats, motion)
    return replace(
        there,
        means=(scale * there.means).astype(np.float32),
        scales=(scale * there.scales).astype(np.float32),
        sh=harmonics.turned(there.sh, turn),
    )


def _checked(path: Path, thing: Mesh, scale: float, turn: Float[np.ndarray, "3 3"]) -> Mesh:
    """The mesh in metres, upright. Raises BadInput if it is no surface or of no likely size."""
    points = scale * thing.points @ turn.T
    if not len(points) or not np.isfinite(points).all():
        raise BadInput(
            path, "vertices", found="none, or some that are not finite", expected="a surface"
        )
    extent = float(np.ptp(points, axis=0).max())
    if not 1e-3 < extent < MOST_METRES:
        raise BadInput(
            path,
            "size",
            found=f"{extent:.3g} m",
            expected=f"0.001 to {MOST_METRES:g} m: give --scale, metres to a unit",
        )
    return Mesh(points, thing.normals @ turn.T, thing.uv, thing.faces, thing.image)


def discs(gaussians: Gaussians) -> Mesh:
    """Gaussians as squares across their shortest axis, in their even color: how far a thing reaches, and its hue."""
    keep = gaussians.opacities > FAINT
    means, scales = gaussians.means[keep].astype(float), gaussians.scales[keep].astype(float)
    xyzw = gaussians.quats[keep][:, [1, 2, 3, 0]].astype(float)
    axes = geometry.pose_of(means, xyzw)[:, :3, :3]
    order = scales.argsort(1)
    rows = np.arange(len(means))
    normal, wide, long = (axes[rows, :, order[:, k]] for k in range(3))
    a = DISC * scales[rows, order[:, 1]][:, None] * wide
    b = DISC * scales[rows, order[:, 2]][:, None] * long
    outwards = np.sign(((means - means.mean(0)) * normal).sum(1))[:, None] if len(means) else 1.0
    points = np.stack([means - a - b, means + a - b, means + a + b, means - a + b], 1).reshape(
        -1, 3
    )
    normals = np.repeat(normal * np.where(outwards == 0, 1.0, outwards), 4, 0)
    corners = np.array([[0, 1, 2], [0, 2, 3]])
    faces = (4 * rows[:, None, None] + corners).reshape(-1, 3).astype(np.int32)
    color = np.clip(0.5 + EVEN * gaussians.sh[keep][:, 0], 0, 1)
    image, uv = palette(np.rint(color * 255).astype(np.uint8))
    return Mesh(points, normals, np.repeat(uv, 4, 0), faces, image)


def palette(
    colors: UInt8[np.ndarray, "n 3"],
) -> tuple[UInt8[np.ndarray, "h w 3"], Float[np.ndarray, "n 2"]]:
    """An image with one texel a color, and where each lies."""
    side = max(1, int(np.ceil(np.sqrt(len(colors)))))
    image = np.zeros((side * side, 3), np.uint8)
    image[: len(colors)] = colors
    rows, columns = np.divmod(np.arange(len(colors)), side)
    uv = np.stack([(columns + 0.5) / side, 1 - (rows + 0.5) / side], -1)
    return image.reshape(side, side, 3), uv


def _triangles(path: Path) -> Mesh:
    import trimesh  # only here: it takes half a second to load

    class Beside(trimesh.resolvers.FilePathResolver):
        def get(self, name: str) -> bytes:
            try:
                return _unicode(name, _beside(path, name))
            except BadInput as error:  # trimesh goes on without a picture that it cannot have
                refused.append(error)
                raise

    refused: list[BadInput] = []
    logging.getLogger("trimesh").setLevel(logging.CRITICAL)  # it logs tracebacks of what it raises
    try:
        loaded = trimesh.load(
            io.BytesIO(_unicode(path.name, path.read_bytes())),
            file_type=path.suffix[1:].lower(),
            resolver=Beside(str(path)),
            force="mesh",
            process=False,
        )
        if not isinstance(loaded, trimesh.Trimesh):
            raise ValueError("no triangles")
        points, faces = np.asarray(loaded.vertices, float), np.asarray(loaded.faces)
        if points.shape[1:] != (3,) or faces.shape[1:] != (3,) or not len(faces):
            raise ValueError("no triangles")
        if not np.isfinite(points).all():
            raise ValueError("vertices that are not finite")
        if not 0 <= faces.min() <= faces.max() < len(points):
            raise ValueError(f"a corner {faces.max()} of {len(points)} vertices")
        stated = "vertex_normals" in loaded._cache  # else trimesh would work them out, with scipy
        normals = np.asarray(loaded.vertex_normals, float) if stated else _normals(points, faces)
        image, uv = _picture(loaded)
        if normals.shape != points.shape or not (
            np.isfinite(normals).all() and np.isfinite(uv).all()
        ):
            raise ValueError("normals or texture coordinates that are not finite")
    except ModuleNotFoundError:  # of what guesses encodings
        raise BadInput(path, "text", found="bytes that are no UTF-8", expected="UTF-8") from None
    except Exception as error:  # trimesh's readers raise whatever their formats' libraries do
        found = (str(error).splitlines() or [type(error).__name__])[0][:120]
        raise BadInput(path, "mesh", found=found, expected="a readable mesh") from None
    if refused:
        raise refused[0]
    if len(faces) > MOST_FACES:
        expected = f"at most {MOST_FACES}: simplify the mesh"
        raise BadInput(path, "faces", found=str(len(faces)), expected=expected)
    return Mesh(points, normals, uv, faces.astype(np.int32), image)


def _beside(path: Path, name: str) -> bytes:
    """A file that a mesh names: in its folder or below, where a path of another machine is looked for by its last part.
    Raises FileNotFoundError for one that is not there, and BadInput for one outside."""
    folder = path.parent.resolve()
    plain = name.strip().replace("\\", "/")
    places = [(folder / one).resolve() for one in (plain, plain.rsplit("/", 1)[-1])]
    for place in places:
        if place.is_relative_to(folder) and place.exists():
            return read_bytes(place)
    for place in places:
        if not place.is_relative_to(folder):
            expected = "a file in the folder of the mesh or below"
            raise BadInput(path, "a file that it names", found=name[:120], expected=expected)
    raise FileNotFoundError(name)


def _unicode(name: str, data: bytes) -> bytes:
    """Text as UTF-8, of old files too: trimesh would guess their encoding by a package of its own. A binary STL, which
    is as long as it says, without the words at its head."""
    ending = Path(name).suffix.lower()
    if ending == ".stl" and len(data) == 84 + 50 * int.from_bytes(data[80:84], "little"):
        return bytes(80) + data[80:]
    if ending not in (".obj", ".mtl", ".gltf", ".stl"):
        return data
    try:
        return data.decode().encode()
    except UnicodeDecodeError:
        return data.decode("latin-1").encode()


def _normals(
    points: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"]
) -> Float[np.ndarray, "n 3"]:
    """Of each vertex: those of its faces, weighed by their angles there."""
    corners = points[faces]
    flat = _unit(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    found = np.zeros((len(points), 3))
    for k in range(3):
        one, other = (_unit(corners[:, k - 1 - i] - corners[:, k]) for i in range(2))
        angle = np.arccos(np.clip((one * other).sum(1), -1, 1))
        for axis in range(3):
            found[:, axis] += np.bincount(faces[:, k], angle * flat[:, axis], len(points))
    return _unit(found)


def _unit(vectors: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-300)


def _picture(loaded) -> tuple[np.ndarray, np.ndarray]:
    """The image on a mesh and where its vertices lie in it; a palette where it has colors and no image."""
    import cv2

    visual, count = loaded.visual, len(loaded.vertices)
    material = getattr(visual, "material", None)
    found = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
    uv = getattr(visual, "uv", None)
    if found is not None and uv is not None and len(uv) == count:
        image = np.asarray(found.convert("RGB"))
        if max(image.shape[:2]) > LARGEST_IMAGE:
            share = LARGEST_IMAGE / max(image.shape[:2])
            image = cv2.resize(image, None, fx=share, fy=share, interpolation=cv2.INTER_AREA)
        return image, np.asarray(uv, float)
    if getattr(visual, "kind", None) == "vertex":
        return palette(np.asarray(visual.vertex_colors)[:, :3].astype(np.uint8))
    plain = (
        getattr(visual, "main_color", None)
        if material is None
        else getattr(material, "main_color", None)
    )
    color = np.asarray(plain if plain is not None else (160, 160, 160, 255))[:3].astype(np.uint8)
    return np.tile(color, (2, 2, 1)), np.full((count, 2), 0.5)
