"""The values that flow through rpaug: episodes as recorded, and scenes as rebuilt.

Conventions, everywhere: metres, radians, seconds; right-handed world; cameras look along +z with x to
the right and y down (OpenCV); **pixel centres lie at integer coordinates**, so pixel (0, 0) covers
[-0.5, 0.5] x [-0.5, 0.5] and a point projects by `K @ p / p_z` without any half-pixel shift. Depth is
the z coordinate in the camera's frame, not the ray's length. Colors are display sRGB: uint8 in images,
float in 0..1 elsewhere. Arrays are never written to after they were handed over.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Flag, auto
from pathlib import Path
from typing import Any, ClassVar, Protocol

import numpy as np
from jaxtyping import Float16, Float32, Float64, Int32, UInt8

from rpaug.core import arrays
from rpaug.core.errors import BadInput


class Effect(Flag):
    """What an operator may change; everything else must come back bit for bit."""

    NONE = 0
    RGB = auto()
    DEPTH = auto()
    MASK = auto()
    CAMERA = auto()
    BODIES = auto()
    WORDS = auto()
    PIXELS = RGB | DEPTH | MASK


@dataclass(frozen=True)
class Camera:
    """Intrinsics and pose track of one camera (OpenCV axes, integer pixel centres).

    `assumed` is set where a source says neither and both are stand-ins that nothing may be measured by; `unplaced`
    where it knows the intrinsics alone.
    """

    K: Float64[np.ndarray, "3 3"]
    cam_to_world: Float64[np.ndarray, "t 4 4"]
    width: int
    height: int
    assumed: bool = False
    unplaced: bool = False

    @property
    def placed(self) -> bool:
        """True if the source says where the camera is."""
        return not (self.assumed or self.unplaced)

    @property
    def fixed(self) -> bool:
        """True if the camera never moves during the episode."""
        return bool((self.cam_to_world == self.cam_to_world[:1]).all())


@dataclass(frozen=True)
class ProxyGeometry:
    """What a scene puts in the place of a depth that its source lacks: for edits to lie and stand on.

    `camera` is the recorded one, for whom the view's own may stand in. `depth` is that of a stage, metres, the same at
    all times, None where there can be none; `blank` tells of images that show nothing. `assumed` says in sentences
    what was assumed. `modelled`: the view's depth is a model's guess, which may be off by `spread` metres. `unknown`
    says why what was moved is no target, where that is so. Nothing is measured by it and nothing of it is written.
    """

    camera: Camera
    depth: Float32[np.ndarray, "h w"] | None
    assumed: tuple[str, ...] = ()
    blank: bool = False
    modelled: bool = False
    unknown: str = ""
    spread: float = 0.0


@dataclass(frozen=True)
class SensedDepth:
    """What was measured where a view's depth is a repaired one.

    `recorded` is the depth as the sensor gave it, which copies keep where nothing is edited; `noise` its deviation in
    metres. The shares of its pixels that were `missing` and that are `unknown` still; nine tenths of what was filled
    are off by less than `spread` metres.
    """

    recorded: Callable[[int], Float32[np.ndarray, "h w"]]
    noise: float
    spread: float
    missing: float
    unknown: float


@dataclass(frozen=True)
class CameraView:
    """A camera and its images, each loaded when asked for.

    `rgb(t)` is (h, w, 3) uint8; `depth(t)` (h, w) float32 metres, 0 where the sensor saw nothing;
    `ids(t)` (h, w) int32 instance ids, 0 for nothing. `depth` and `ids` are None where a source has none.
    Views that share an accessor share its images: a writer may then copy the recorded file. `inferred` instance ids
    were
    not recorded but found by motion or color: a scene may use them, and no dataset gets them. So it is with
    `stand_in`. `most_id` is the largest id that masks can hold where they are kept.
    `hands` are boxes (left, top, right, bottom; pixels) that annotators drew around hands, by frame.
    `radiance(t)`, (h, w, 3) float32, is what each pixel's light came to before white cut it off: above the color (0..1)
    where that happened, equal to it elsewhere. Simulators tell it; no other source has it.
    `sensed`: `depth` is a sensor's, repaired by a scene.
    """

    camera: Camera
    rgb: Callable[[int], UInt8[np.ndarray, "h w 3"]]
    depth: Callable[[int], Float32[np.ndarray, "h w"]] | None = None
    ids: Callable[[int], Int32[np.ndarray, "h w"]] | None = None
    inferred: bool = False
    proxy: ProxyGeometry | None = None
    hands: Mapping[int, tuple[tuple[float, float, float, float], ...]] = field(default_factory=dict)
    most_id: int = 2**31 - 1
    radiance: Callable[[int], Float32[np.ndarray, "h w 3"]] | None = None
    sensed: SensedDepth | None = None


@dataclass(frozen=True)
class Robot:
    """What the robot recorded. Never edited, written back as it came.

    Joints are (t, 0) and the gripper's pose and opening None where a source does not have them, or does not say
    which of its numbers they are; `extra` has all its numbers by their own names.
    """

    joint_positions: Float64[np.ndarray, "t j"]
    joint_velocities: Float64[np.ndarray, "t j"]
    gripper_to_world: Float64[np.ndarray, "t 4 4"] | None
    gripper_open: Float64[np.ndarray, "t"] | None
    extra: Mapping[str, Float64[np.ndarray, "t ..."]] = field(default_factory=dict)


@dataclass(frozen=True)
class Provenance:
    """Where an episode was read: the dataset, and the name of its layout."""

    dataset: Path
    layout: str


@dataclass(frozen=True)
class Embeddings:
    """What becomes of vectors that were made of words: `embed` makes those of sentences that changed anew, unit vectors
    (n, d), or else `drop` leaves them out of every episode. With neither an episode whose words change is refused."""

    embed: Callable[[Sequence[str]], Float32[np.ndarray, "n d"]] | None = None
    drop: bool = False

    @staticmethod
    def among(names: Iterable[str]) -> list[str]:
        """The names of features that hold such vectors: all datasets of Open X-Embodiment call them so."""
        return [name for name in names if "embedding" in name.rpartition("/")[2]]


@dataclass(frozen=True, eq=False)
class Episode:
    """One demonstration.

    `key` is its path inside the dataset, with forward slashes. `source` is the adapter's own: what it
    needs to write the episode back with every field it does not know about. `provenance` says where it was read by
    `rpaug.read`; `side` gives the files that belong beside a copy that `rpaug.augment` made, its report among them.
    `rate` is frames a second, None where the source does not say. `unread` says in sentences which of its data may be
    images that were not understood: they are written back as they came, whatever an edit does to the others.
    `embeddings` is what becomes of vectors in the source that were made of words which an edit changed.
    """

    key: str
    views: Mapping[str, CameraView]
    robot: Robot
    descriptions: tuple[str, ...]
    length: int
    source: Any = None
    provenance: Provenance | None = None
    side: Callable[..., Mapping[str, bytes]] | None = None
    rate: float | None = None
    unread: tuple[str, ...] = ()
    embeddings: Embeddings = Embeddings()

    @property
    def instruction(self) -> str:
        """The first description, or an empty string."""
        return self.descriptions[0] if self.descriptions else ""

    @classmethod
    def from_arrays(
        cls,
        rgb: Any,
        *,
        depth: Any = None,
        masks: Any = None,
        cameras: Any = None,
        instruction: str | Sequence[str] = "",
        joint_positions: Any = None,
        joint_velocities: Any = None,
        gripper_to_world: Any = None,
        gripper_open: Any = None,
        key: str = "episode0",
    ) -> "Episode":
        """An episode of arrays, each by the camera's name, or of one camera alone, which is then called `front`.

        `rgb` are (t, h, w, 3) uint8; `depth` (t, h, w) metres, 0 for nothing; `masks` (t, h, w) instance ids, 0 for
        nothing; `cameras` a `Camera` or a pair of K (3, 3) and cam_to_world, (4, 4) or (t, 4, 4), with OpenCV's axes
        and integer pixel centres. Depth needs its camera. `instruction` is one or several. The robot's states have one
        row a frame: joints (t, j) in radians, the gripper's pose (t, 4, 4) and opening (t,) in 0..1. Raises BadInput.
        """
        images = {
            name: arrays.colors(key, f"rgb[{name!r}]", one)
            for name, one in arrays.by_camera(rgb).items()
        }
        lengths = {len(stack) for stack in images.values()}
        if len(lengths) != 1:
            found = f"{sorted(lengths)} frames" if lengths else "no camera"
            raise BadInput(key, "rgb", found=found, expected="cameras with equally many frames")
        (length,) = lengths
        more = {"depth": arrays.by_camera(depth), "masks": arrays.by_camera(masks)}
        more["cameras"] = arrays.by_camera(cameras)
        for field_, given in more.items():
            for name in given:
                if name not in images:
                    expected = f"one of: {', '.join(images)}"
                    raise BadInput(key, field_, found=f"a camera {name!r}", expected=expected)
        for name in more["depth"]:
            if name not in more["cameras"]:
                expected = "K and cam_to_world of each camera with depth"
                raise BadInput(key, "cameras", found=f"none for {name!r}", expected=expected)
        views = {
            name: _view(key, name, stack, *(given.get(name) for given in more.values()))
            for name, stack in images.items()
        }
        joints = np.zeros((length, 0)) if joint_positions is None else joint_positions
        joints = arrays.numbers(key, "joint_positions", joints, (length, None))
        speeds = np.zeros((length, 0)) if joint_velocities is None else joint_velocities
        robot = Robot(
            joint_positions=joints,
            joint_velocities=arrays.numbers(key, "joint_velocities", speeds, (length, None)),
            gripper_to_world=None
            if gripper_to_world is None
            else arrays.poses(key, "gripper_to_world", gripper_to_world, length),
            gripper_open=None
            if gripper_open is None
            else arrays.numbers(key, "gripper_open", gripper_open, (length,)),
        )
        told = (instruction,) if isinstance(instruction, str) else tuple(instruction)
        return cls(key, views, robot, tuple(filter(None, told)), length)


def _view(
    key: str,
    name: str,
    rgb: UInt8[np.ndarray, "t h w 3"],
    depth: Any,
    masks: Any,
    camera: "Camera | tuple[Any, Any] | None",
) -> CameraView:
    """One camera of `Episode.from_arrays`. Raises BadInput."""
    length, height, width = rgb.shape[:3]
    field_ = f"cameras[{name!r}]"
    if camera is None:
        K, pose = arrays.assumed_intrinsics(width, height), np.eye(4)
    elif isinstance(camera, Camera):
        K, pose = camera.K, camera.cam_to_world
    elif isinstance(camera, Sequence) and len(camera) == 2:
        K, pose = camera
    else:
        expected = "a Camera, or K and cam_to_world"
        raise BadInput(key, field_, found=type(camera).__name__, expected=expected)
    stands = Camera(
        arrays.intrinsics(key, f"{field_} K", K),
        arrays.poses(key, f"{field_} cam_to_world", pose, length),
        width,
        height,
        assumed=camera is None or (isinstance(camera, Camera) and camera.assumed),
        unplaced=isinstance(camera, Camera) and camera.unplaced,
    )
    shape = rgb.shape[:3]
    return CameraView(
        stands,
        rgb.__getitem__,
        None if depth is None else arrays.depths(key, f"depth[{name!r}]", depth, shape).__getitem__,
        None if masks is None else arrays.masks(key, f"masks[{name!r}]", masks, shape).__getitem__,
    )


@dataclass(frozen=True, eq=False)
class Mesh:
    """A thing that was never recorded: triangles with an image laid on them, in metres of their own frame.

    `points` and unit `normals` belong together, and `uv` says where in `image` each lies: (0, 0) is its lower left,
    (1, 1) its upper right, and it repeats. `faces` run counter-clockwise seen from outside. The image holds albedos.
    """

    points: Float64[np.ndarray, "v 3"]
    normals: Float64[np.ndarray, "v 3"]
    uv: Float64[np.ndarray, "v 2"]
    faces: Int32[np.ndarray, "f 3"]
    image: UInt8[np.ndarray, "h w 3"]


@dataclass(frozen=True, eq=False)
class RobotPart:
    """A part of the robot as its file has it: where it is in the world over time, and the instance id that it shows."""

    instance_id: int
    mesh: Mesh
    to_world: Float64[np.ndarray, "t 4 4"]


@dataclass(frozen=True, eq=False)
class Body:
    """A rigid set of instances and where it is over time.

    `to_world[t]` carries a point from the body's own frame (world coordinates at the frame `reference`, so
    that `to_world[reference]` is the identity) to world at t. `motion` says which hypothesis explains the
    track; `residual` is its median point-to-plane distance in metres, and `ambiguous` is set where another
    hypothesis explains the pixels as well. `copy_of` is set for a duplicate: it maps
    each recorded instance id whose pixels show it to the instance id it has here. `scale` is the size of a resized
    body over
    its recorded one: a recorded point p of its frame is shown at scale * p. An inserted body has a `mesh` in its
    frame; where it also has `splats` there, those are shown and the mesh only says how far it reaches, unless it is
    `outlined`: then the mesh is its true surface, which gives depth and mask. A body that deforms is shown by `soft`:
    Gaussians in the world with a moment for every time.
    """

    instance_ids: frozenset[int]
    to_world: Float64[np.ndarray, "t 4 4"]
    motion: str  # "static" | "gripper" | "link" | "aligned" | "unknown" | "simulated"
    reference: int = 0
    residual: float = 0.0
    ambiguous: bool = False
    copy_of: Mapping[int, int] = field(default_factory=dict)
    scale: float = 1.0
    mesh: Mesh | None = None
    soft: "Gaussians | None" = None
    splats: "Gaussians | None" = None
    outlined: bool = False


class Surface(Protocol):
    """Where some colors lie, row by row; every part is worked out only when it is asked for.

    `points` are metres in the frame of the row's own body (`Body.to_world` at that time undone), `normals` unit
    vectors there, towards whoever looks; `facing` are the same normals in the world, `towards` the unit vectors there
    to the eye. `footprint` is the width in metres that one pixel covers on the surface. `ids` are instance ids. `lit`
    is the share of its light that a place has now, of that which it was recorded in at other times, 1 where nothing
    tells. `mirrored` is the part of a color that is a highlight, nan where nothing tells, None without any. Raises
    Unsupported where a source has no depth to tell it from.
    """

    @property
    def ids(self) -> Int32[np.ndarray, "n"]: ...
    @property
    def points(self) -> Float32[np.ndarray, "n 3"]: ...
    @property
    def normals(self) -> Float32[np.ndarray, "n 3"]: ...
    @property
    def facing(self) -> Float32[np.ndarray, "n 3"]: ...
    @property
    def towards(self) -> Float32[np.ndarray, "n 3"]: ...
    @property
    def footprint(self) -> Float32[np.ndarray, "n"]: ...
    @property
    def lit(self) -> Float32[np.ndarray, "n"]: ...
    @property
    def mirrored(self) -> Float32[np.ndarray, "n 3"] | None: ...


class Appearance(Protocol):
    """A function on surfaces: recorded color in, edited color out.

    `instance_ids` are the instances it applies to, None for all; of those, instance ids in `unlit`, if it has such an
    attribute, show no surface and are left as they are. It is called with colors in display sRGB 0..1 and
    with where they lie, and must treat every row alone, so that any carrier (pixels, surfels, Gaussians) can use it.
    What depends on `surface.points` and `surface.normals` alone is the same in all cameras and at all times.

    A class may have a static method `stacked(several, device)` that gives the same by torch for edits of many images
    at once (`Stacked`), within 1e-4: frames are then drawn on a GPU where one is asked for.
    """

    @property
    def instance_ids(self) -> frozenset[int] | None: ...

    def __call__(
        self, color: Float32[np.ndarray, "n 3"], surface: Surface
    ) -> Float32[np.ndarray, "n 3"]: ...


Stacked = Callable[[Any, Any, Any], Any]
"""Colors (n, 3), which of the edits each row belongs to (n,), and where the rows lie, all tensors: edited colors."""


class Sensor(Protocol):
    """What the camera itself does to a finished image, after everything in the scene is settled.

    All its randomness comes from `rng`, which is seeded by the draw's `seed`, the camera's name and the frame.
    """

    @property
    def seed(self) -> int: ...

    @property
    def cameras(self) -> tuple[str, ...] | None:
        """Those that it happens in, None for all."""

    def __call__(
        self, image: UInt8[np.ndarray, "h w 3"], rng: np.random.Generator
    ) -> UInt8[np.ndarray, "h w 3"]: ...


Everywhere = Callable[[UInt8[np.ndarray, "h w 3"], str, int], UInt8[np.ndarray, "h w 3"]]
"""What edits that need no place do to a recorded image of a camera at a time."""

Back = Callable[["Episode", Everywhere], "Episode"]


@dataclass(frozen=True)
class FrameResidual:
    """What some Gaussians differ by at one recorded time: the residual that no rigid body explains.

    `rows` name them, ascending. Each array is added to that of `Gaussians`; `means` come in multiples of the
    Gaussian's largest standard deviation and `scales` as differences of logarithms.
    """

    rows: Int32[np.ndarray, "m"]
    means: Float16[np.ndarray, "m 3"]
    quats: Float16[np.ndarray, "m 4"]
    scales: Float16[np.ndarray, "m 3"]
    opacities: Float16[np.ndarray, "m"]
    sh: Float16[np.ndarray, "m k 3"]


@dataclass(frozen=True)
class Gaussians:
    """3D Gaussians in their bodies' frames (Kerbl et al. 2023, arXiv 2308.04079).

    `quats` are (w, x, y, z), of any length but zero. `scales` are standard deviations in metres along the
    Gaussian's own axes. `opacities` are in 0..1. `sh` holds real spherical-harmonics coefficients in 3DGS
    order: color = 0.5 + 0.28209479 * sh[:, 0] for degree 0. `ids` are instance ids (0: none).
    `moments[t]` is how they differ at time t alone; `moments.at` applies it.
    """

    means: Float32[np.ndarray, "n 3"]
    quats: Float32[np.ndarray, "n 4"]
    scales: Float32[np.ndarray, "n 3"]
    opacities: Float32[np.ndarray, "n"]
    sh: Float32[np.ndarray, "n k 3"]
    ids: Int32[np.ndarray, "n"]
    frame_residuals: Mapping[int, FrameResidual] = field(default_factory=dict)

    ARRAYS: ClassVar = ("means", "quats", "scales", "opacities", "sh", "ids")

    def __len__(self) -> int:
        return len(self.means)


@dataclass(frozen=True)
class Gaussians4:
    """Gaussians in space and time (Yang et al. 2023, arXiv 2310.10642), for what no rigid motion explains.

    `means` are (x, y, z, t) in metres, space relative to `origin` in the world, time with `pace` metres to a frame.
    `left` and `right` are the quaternions (w, x, y, z) of the rotation v -> left * v * right, t being the real part,
    of any length but zero. `scales` are standard deviations in metres along the Gaussian's own four axes. The rest
    is as in `Gaussians` and does not depend on time.
    """

    means: Float32[np.ndarray, "n 4"]
    left: Float32[np.ndarray, "n 4"]
    right: Float32[np.ndarray, "n 4"]
    scales: Float32[np.ndarray, "n 4"]
    opacities: Float32[np.ndarray, "n"]
    sh: Float32[np.ndarray, "n k 3"]
    ids: Int32[np.ndarray, "n"]
    origin: Float64[np.ndarray, "3"]
    pace: float

    def __len__(self) -> int:
        return len(self.means)


@dataclass(frozen=True)
class Ambience:
    """The light that inserted things are shown in, and how dark and bright the recording gets.

    `light` are the nine terms of `rpaug.scene.lighting.irradiance`, 1 on a face that looks up, and `tint` its color.
    `lightness` is the darkest and the brightest recorded (CIELAB, 0..100), None to leave colors be.
    """

    light: tuple[float, ...]
    tint: tuple[float, float, float]
    lightness: tuple[float, float] | None = None


@dataclass(frozen=True)
class Rig:
    """Ambient light and lamps far away, such that level ground which all of them reach has light 1.

    `directions` are unit vectors in the world, from what is lit to the lamps.
    """

    ambient: float
    directions: tuple[tuple[float, float, float], ...]
    strengths: tuple[float, ...]

    def light(
        self,
        normals: Float32[np.ndarray, "n 3"],
        reached: Sequence[Float32[np.ndarray, "n"] | float],
    ) -> Float32[np.ndarray, "n"]:
        """Light on surfaces of these normals, where each lamp reaches so much of them."""
        out = np.full(len(normals), self.ambient, np.float32)
        for direction, strength, share in zip(
            self.directions, self.strengths, reached, strict=True
        ):
            towards = np.maximum(normals @ np.array(direction, np.float32), 0)
            out += np.float32(strength) * share * towards
        return out


@dataclass(frozen=True)
class Relit:
    """The lamps whose cast shadows were recorded, and those that the edited scene is shown under.

    A shadow takes away `depth` times as much light as it would; a lamp is a disc of the radius `softness`, in radians.
    Instance ids that are `unlit` show no surface and keep their color. `gains` are what each lamp's color is now over
    the recorded one, by channel; none for as recorded.
    """

    recorded: Rig
    now: Rig
    depth: float = 1.0
    softness: float = 0.0
    unlit: tuple[int, ...] = ()
    gains: tuple[tuple[float, float, float], ...] = ()


@dataclass(frozen=True)
class Belief:
    """What a role is taken to mean: its instance ids, how sure that is (0..1), and why, in sentences.

    A belief below a bound is kept for people to look at, and is no role of the scene.
    """

    instance_ids: frozenset[int]
    confidence: float
    reasons: tuple[str, ...] = ()


@dataclass(frozen=True)
class Scene:
    """An episode rebuilt: bodies with pose tracks, cameras, and how their surfaces look.

    Operators change a scene and nothing else. `episode` holds the recorded pixels, which are the scene's
    surfels; `gaussians` is there when the plan fitted some. `cameras` and `descriptions` start as recorded.
    `appearance` is applied in order to what is seen, `sensor` in order to the finished images.
    `flowing` are the Gaussians of instances that bend; `gaussians` then lacks those.
    `drift[camera][t]` put before a moving camera's recorded pose is where its image was truly taken from:
    recorders are off by millimetres. It is for rendering alike, and never written. `irradiance` is the light that
    Gaussians of moving bodies turn in, None for the same from everywhere.
    An operator that moves, copies or removes bodies keeps the recorded ones in `recorded_bodies`
    (`recorded_bodies=scene.tracked`): the recorded pixels are carried from there to where the bodies are now.
    `inpaint` names what paints the places that this uncovers and nobody ever saw (`rpaug.providers.inpaint`).
    `ambience` is the light that inserted bodies are shown in. `simulated` says, in plain values, what each simulation
    came to; `actions_valid` is false in it where the recorded actions would no longer do what they did.
    `back` brings what the scene shows back into the recording, where that is no set of pinhole images, and what edits
    do wherever they show into recorded images that the scene does not hold; None leaves it.
    `robot_parts` are the robot's shape by its file: moved cameras show them where nobody saw the robot.
    `roles` holds what is believed firmly enough, `beliefs` each role that was thought of with its reasons.
    `names` are the instance ids that models found by words, none for words that they found nothing by.
    `relit` casts the lamps' shadows anew; None leaves those that were recorded.
    """

    episode: Episode
    cameras: Mapping[str, Camera]
    bodies: tuple[Body, ...]
    roles: Mapping[str, frozenset[int]]
    antialiased: bool
    descriptions: tuple[str, ...]
    appearance: tuple[Appearance, ...] = ()
    sensor: tuple[Sensor, ...] = ()
    gaussians: Gaussians | None = None
    flowing: Gaussians4 | None = None
    pose_correction: Mapping[str, Float64[np.ndarray, "t 4 4"]] = field(default_factory=dict)
    irradiance: Float64[np.ndarray, "9"] | None = None
    recorded_bodies: tuple[Body, ...] | None = None
    inpaint: str = "fsr"
    ambience: Ambience | None = None
    simulated: tuple[Mapping[str, Any], ...] = ()
    back: Back | None = None
    beliefs: Mapping[str, Belief] = field(default_factory=dict)
    names: Mapping[str, frozenset[int]] = field(default_factory=dict)
    robot_parts: tuple[RobotPart, ...] = ()
    relit: Relit | None = None

    @property
    def actions_valid(self) -> bool:
        """Whether what the robot recorded would still do what it did."""
        return all(one["actions_valid"] for one in self.simulated)

    @property
    def tracked(self) -> tuple[Body, ...]:
        """The bodies as they were recorded, whatever was edited since."""
        return self.bodies if self.recorded_bodies is None else self.recorded_bodies

    @property
    def moving(self) -> frozenset[int]:
        """Instance ids of the robot and of all that did not stand still when recorded."""
        moved = [body.instance_ids for body in self.tracked if body.motion != "static"]
        return frozenset().union(self.roles.get("robot", ()), *moved)

    @property
    def instance_ids(self) -> frozenset[int]:
        """All instance ids the scene knows."""
        return frozenset().union(*(body.instance_ids for body in self.bodies))
