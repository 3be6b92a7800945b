"""Which recorded pixels show a moved camera its view: its own, other cameras', and other times'.

A view at time t draws, in this order (an earlier source keeps a pixel that a later one confirms):

1. the camera's own recorded image at t;
2. what the other cameras recorded at t;
3. *plates*: what a fixed camera saw of static bodies where something moving hides them at t;
4. *history*: what a moving camera saw of static bodies at other times;
5. *parts*: what any camera saw of moving bodies at other times, carried along by their poses;
6. *the robot's shape* by its file, where nobody saw the robot;
7. *patches*: what nobody ever saw behind edited bodies, painted.

What moves and is cut off by the border of the camera's own image goes on beyond it, but for what its file shows.

All but the first are carved by the first: a surfel where the own camera saw farther is not there. And all but the
first take on the first's light, thing by thing.

Bodies that were edited are cut out of all of these and drawn once more from the same recordings, carried from where
they were recorded to where they are now. They come before all others, to keep their pixels where they touch what they
stand on.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial

import cv2
import numpy as np
from jaxtyping import Bool, Int32

from rpaug.core.errors import SourceLacks, TargetError
from rpaug.core.image_cache import held
from rpaug.core.jit import kernel
from rpaug.core.pixels import grown
from rpaug.core.types import Camera, CameraView, Episode, Scene
from rpaug.render import denoise, holes, unmix, window, zbuffer
from rpaug.render.gains import matched
from rpaug.render.pinhole import NEAR, intrinsics, map_pixel, relative
from rpaug.render.window import Window
from rpaug.render.zbuffer import Rendered, Source
from rpaug.scene.recorded import edges, parts, robot, unseen
from rpaug.scene.recorded.carry import carried
from rpaug.scene.recorded.parts import PartRecording
from rpaug.scene.recorded.plates import Plate, among, plate, source_at, spread
from rpaug.scene.recorded.robot import PartColors

HISTORY_FRAMES = 6  # frames of a moving camera kept for what they show of static bodies
SAME_PLACE = 0.01  # metres: what another camera saw this close to what the own one shows of a body is the same
BLURRED = 0.006  # of the width of photographs: so far a thing shows beside its outline
SHADED = 3  # times that: so far other images may show its contact shadow
BORDER = 0.25  # of an image's longer side: so far what it cuts off is continued
LIFTED_BYTES = 64 << 20  # of images with footprints, kept for all cameras of one time
NOISES = 3.0  # standard deviations of depth noise within which two depths are one surface


@dataclass(frozen=True)
class Surfels:
    """What is kept of an episode between views.

    `static` are the instance ids that never move; `noise` is the standard deviation of recorded depth as a share of it.
    `patches` stand for what nobody saw; `shape` are the robot's parts by its file; `edges` are those of resting things.
    """

    static: frozenset[int]
    plates: Mapping[str, Plate]
    history: Mapping[str, tuple[Source, ...]]
    parts: tuple[PartRecording, ...] = ()
    noise: float = 0.0
    patches: tuple[Source, ...] = ()
    shape: tuple[PartColors, ...] = ()
    edges: holes.Edges = holes.NO_EDGES
    images: "LiftedImages | None" = None

    @property
    def tolerance(self) -> float:
        """The share of depth within which two recordings show one surface."""
        return tolerance(self.noise)


@dataclass(frozen=True)
class LiftedImages:
    """The images of an episode as other cameras are shown them, by camera and time."""

    episode: Episode
    of: Callable[[str, int], Source]


def tolerance(noise: float) -> float:
    """The share of depth within which two recordings of that much noise show one surface."""
    return max(zbuffer.SAME_SURFACE, NOISES * noise)


def build(scene: Scene, kept: Surfels | None = None) -> Surfels:
    """What `recorded` says of the scene (`kept`, if it was asked before), and patches behind what was edited in it."""
    kept = kept or recorded(scene)
    images = LiftedImages(scene.episode, held(partial(_image, kept, scene), LIFTED_BYTES))
    return replace(kept, patches=_patches(kept, scene), images=images)


def recorded(scene: Scene) -> Surfels:
    """Plates of the fixed cameras, history of the moving ones, and what was seen of moving bodies whose track holds.

    Edits do not change it: all copies of an episode share it. Keeps a few images in memory. Raises SourceLacks if a
    source has no depth.
    """
    static, plates, noise = plates_of(scene)
    views, length = scene.episode.views, scene.episode.length
    near, mixed = tolerance(noise), scene.antialiased
    fixed = {name: view for name, view in views.items() if static and view.camera.fixed}
    moving = {name: view for name, view in views.items() if static and not view.camera.fixed}
    history = {
        name: tuple(_history(view, length, static, noise, near, mixed))
        for name, view in moving.items()
    }
    moved = parts.recorded(scene, noise, near, _rim(scene))
    ends = edges.straight([edges.farthest(view, length) for view in fixed.values()], static)
    return Surfels(static, plates, history, moved, noise, shape=robot.recorded(scene), edges=ends)


def plates_of(scene: Scene) -> tuple[frozenset[int], dict[str, Plate], float]:
    """Instance ids of what rests, the plates of the fixed cameras, and the depth's noise. Raises SourceLacks if a
    source has no depth."""
    static = frozenset().union(
        *(body.instance_ids for body in scene.tracked if body.motion == "static")
    )
    views, length = scene.episode.views, scene.episode.length
    for name, view in views.items():
        if view.depth is None:
            raise SourceLacks(
                f"{name}: moving a camera needs recorded depth, and this source has none"
            )
    noise = _noise(scene)
    near, mixed = tolerance(noise), scene.antialiased
    fixed = {name: view for name, view in views.items() if static and view.camera.fixed}
    found = {name: plate(view, length, static, noise, near, mixed) for name, view in fixed.items()}
    return static, found, noise


def _patches(surfels: Surfels, scene: Scene) -> tuple[Source, ...]:
    """Painted surfels behind the static bodies that were edited, be it only later."""
    edited = standing_edited(surfels, scene)
    if not edited:
        return ()
    plates, past = _still(surfels, scene, edited)
    return unseen.patches(plates, past, edited, scene.inpaint, surfels.tolerance)


def standing_edited(surfels: Surfels, scene: Scene) -> frozenset[int]:
    """Handles of bodies that stood still when recorded and are not there as they were, be it only later."""
    edits = (*carried(scene, 0), *carried(scene, scene.episode.length - 1))
    return (
        frozenset(instance_id for edit in edits for instance_id in edit.instance_ids)
        & surfels.static
    )


def backgrounds(surfels: Surfels, scene: Scene) -> dict[str, unseen.Background]:
    """What each fixed camera would see of static things alone, without the edited ones; paint counts as a hole."""
    edited = standing_edited(surfels, scene)
    plates, past = _still(surfels, scene, edited)
    return {
        name: unseen.background(
            camera,
            kept,
            plates,
            (*past, *surfels.patches),
            edited,
            surfels.tolerance,
            len(surfels.patches),
        )
        for name, (camera, kept) in plates.items()
    }


def _still(
    surfels: Surfels, scene: Scene, edited: frozenset[int]
) -> tuple[dict[str, tuple[Camera, Plate]], list[Source]]:
    """The fixed cameras' plates, and what moving cameras recorded of static things, without the edited ones."""
    cameras = {name: scene.episode.views[name].camera for name in surfels.plates}
    plates = {name: (cameras[name], kept) for name, kept in surfels.plates.items()}
    rim = _rim(scene)
    past = [_without(source, edited, rim) for kept in surfels.history.values() for source in kept]
    return plates, past


def _noise(scene: Scene) -> float:
    """The noise of the least noisy camera's first and last depth image: noise is the sensor's, clutter is not."""
    found = []
    for view in scene.episode.views.values():
        for t in (0, scene.episode.length - 1):
            now = source_at(view, t)
            found.append(denoise.noise(now.depth, now.ids))
    return min(found, default=0.0)


def view(surfels: Surfels, scene: Scene, camera_name: str, t: int) -> Rendered:
    """What `scene.cameras[camera_name]` sees at time t, drawn from recorded pixels, holes filled.

    Colors are as recorded: appearance edits are functions of color and id, and are applied to the result. Where
    the camera stands as recorded, what no edited body hides or uncovers is the recorded image bit for bit. Raises
    TargetError.
    """
    if camera_name not in scene.cameras or camera_name not in scene.episode.views:
        known = ", ".join(scene.episode.views)
        raise TargetError(f"no camera is called {camera_name!r}; there are: {known}")
    camera, recorded = scene.cameras[camera_name], scene.episode.views[camera_name]
    stands = _stands(camera, recorded.camera, t) and recorded.depth is not None
    edits = carried(scene, t)
    if stands and recorded.ids and edits and not any(edit.shows for edit in edits):
        instance_ids = frozenset().union(*(edit.instance_ids for edit in edits))
        gone = grown(among(recorded.ids(t), instance_ids), _rim(scene))
        piece = window.around(gone, camera.K, camera.cam_to_world[t])
        return (
            _as_recorded(recorded, t)
            if piece is None
            else _behind(surfels, scene, camera_name, t, piece)
        )
    drawn, filled = _drawn(surfels, scene, camera_name, t, None)
    if stands and recorded.depth is not None:
        # Smoothing, and surfaces without depth, would change what was recorded.
        return replace(filled, depth=np.where(drawn.source == 0, recorded.depth(t), filled.depth))
    return filled


def _drawn(
    surfels: Surfels, scene: Scene, name: str, t: int, piece: Window | None
) -> tuple[Rendered, Rendered]:
    """What the recordings show of a camera's view, or of a piece of it, and the same with its holes filled."""
    camera = scene.cameras[name]
    K, size = (
        (camera.K, (camera.width, camera.height)) if piece is None else (piece.own, piece.size)
    )
    known = list(_known(surfels, scene, name, t, piece))
    shape = list(_shape(surfels, scene, name, t)) if piece is None else []
    drawn = zbuffer.render(
        K, camera.cam_to_world[t], size, [*known, *shape, *_painted(surfels, known[0], piece)],
        witness=known[0], tolerance=surfels.tolerance,
    )  # fmt: skip
    moved = frozenset(one for edit in carried(scene, t) for one in edit.instance_ids)
    painted = np.zeros_like(drawn.hole)
    if moved and _rim(scene):
        support = scene.roles.get("table", frozenset())
        drawn, painted = unseen.closed(drawn, known[0].ids, support)
    witness = holes.Witness(known[0], K, camera.cam_to_world[t], surfels.edges.without(moved))
    continued = np.zeros_like(drawn.hole)
    if not _stands(camera, scene.episode.views[name].camera, t):
        if scene.antialiased:
            drawn = unmix.unmixed(drawn, witness)
        drawn, continued = _continued(drawn, known, surfels.tolerance, scene, name, t)
    filled = holes.fill(drawn, witness)
    # Patches, stretched surfels and what goes on beyond a border are invented as much as what single views are filled
    # with. The robot's shape is not: it was held against the recording.
    invented = drawn.rough | continued | painted | (drawn.source >= len(known) + len(shape))
    return drawn, replace(filled, hole=drawn.hole | invented)


def _continued(
    drawn: Rendered, known: list[Source], near: float, scene: Scene, name: str, t: int
) -> tuple[Rendered, Bool[np.ndarray, "h w"]]:
    """What is drawn of a moved camera's view, with what moves continued where the border of its own image cuts it off,
    and the pixels that this gives.

    The border's pixels are repeated beyond it, at their depth, where no other camera sees through them. They hide what
    is farther, but nothing that moves: that was recorded.
    """
    own, *others = known[: len(scene.episode.views)]
    modelled = frozenset(part.instance_id for part in scene.robot_parts)
    margin = round(BORDER * max(own.ids.shape))

    def widened(image: np.ndarray) -> np.ndarray:
        return cv2.copyMakeBorder(image, margin, margin, margin, margin, cv2.BORDER_REPLICATE)

    shown = among(own.ids, scene.moving - modelled) & (own.use is None or own.use)
    use = widened(shown.view(np.uint8)).view(np.bool_)
    use[margin:-margin, margin:-margin] = False
    if not use.any():
        return drawn, np.zeros_like(drawn.hole)
    camera, K = scene.cameras[name], own.K.copy()
    K[:2, 2] += margin
    rgb, depth, ids = (widened(image) for image in (own.rgb, own.depth, own.ids))
    whole = Source(K, own.cam_to_world, rgb, depth, ids, use)
    beyond = zbuffer.lift(window.trimmed(whole), near)
    pose = camera.cam_to_world[t]
    shot = zbuffer.render(camera.K, pose, (camera.width, camera.height), [beyond], tolerance=near)
    farther = (drawn.depth == 0) | (shot.depth < drawn.depth)
    found = ~shot.hole & (drawn.hole | (farther & ~among(drawn.ids, scene.moving)))
    zbuffer.carve(found, shot.depth, camera.K, pose, others, near)
    return replace(
        drawn,
        rgb=np.where(found[..., None], shot.rgb, drawn.rgb),
        depth=np.where(found, shot.depth, drawn.depth),
        ids=np.where(found, shot.ids, drawn.ids),
        hole=drawn.hole & ~found,
    ), found


def _as_recorded(view: CameraView, t: int) -> Rendered:
    assert view.depth is not None
    assert view.ids is not None
    rgb, ids = view.rgb(t), view.ids(t)
    nowhere = np.zeros(ids.shape, bool)
    return Rendered(
        rgb.astype(np.float32) / 255,
        view.depth(t),
        ids,
        nowhere.astype(np.int16),
        nowhere,
        nowhere.copy(),
    )


def _behind(surfels: Surfels, scene: Scene, name: str, t: int, piece: Window) -> Rendered:
    """The recorded image, with what the recordings show in a piece of it where its own surfels are cut out."""
    drawn, filled = _drawn(surfels, scene, name, t, piece)
    whole, at = _as_recorded(scene.episode.views[name], t), np.s_[piece.rows, piece.columns]
    new = drawn.source != 0
    depth, ids, hole, source = whole.depth.copy(), whole.ids.copy(), whole.hole, whole.source
    whole.rgb[at][new], depth[at][new], ids[at][new] = (
        filled.rgb[new],
        filled.depth[new],
        filled.ids[new],
    )
    hole[at][new], source[at][new] = filled.hole[new], filled.source[new]
    return replace(whole, depth=depth, ids=ids)


def _stands(camera: Camera, recorded: Camera, t: int) -> bool:
    same = np.array_equal(camera.cam_to_world[t], recorded.cam_to_world[t])
    return same and np.array_equal(camera.K, recorded.K)


def sources(
    surfels: Surfels, scene: Scene, own: str, t: int, piece: Window | None = None
) -> Iterator[Source]:
    """The recorded images that show camera `own` its view at time t, the most trusted first, itself before all, and
    what was painted last; or their parts that show a piece of the view."""
    shown = list(_known(surfels, scene, own, t, piece))
    yield from shown
    yield from _painted(surfels, shown[0], piece)


def _known(
    surfels: Surfels, scene: Scene, own: str, t: int, piece: Window | None
) -> Iterator[Source]:
    """What was recorded, edited bodies carried to where they are now."""
    edits = carried(scene, t)
    edited = frozenset(instance_id for edit in edits for instance_id in edit.instance_ids)
    whole = list(_recordings(surfels, scene, own, t, edited, piece))
    rim = _rim(scene)
    others = SHADED * rim if _outlined(scene) else rim
    rims = [rim, *[others] * (len(whole) - 1)]
    yield from map(_without, whole, [edited] * len(whole), rims) if edits else whole
    for edit in edits:
        for source in whole if edit.shows else ():
            use = among(source.ids, frozenset(edit.shows))
            use = use if source.use is None else use & source.use
            if source is not whole[0] and use.any():
                use = use & ~_shown(whole[0], source, use)
            if use.any():
                yield edit.carry(window.trimmed(replace(source, use=use, before=True)))


def _shape(surfels: Surfels, scene: Scene, name: str, t: int) -> Iterator[Source]:
    """The robot by its file, as a moved camera sees it: what was recorded of it comes first."""
    camera = scene.cameras[name]
    if surfels.shape and not _stands(camera, scene.episode.views[name].camera, t):
        yield robot.source(surfels.shape, camera, camera.cam_to_world[t], t)


def _painted(surfels: Surfels, recorded: Source, piece: Window | None) -> Iterator[Source]:
    """What stands for what nobody saw, in the light of what the camera recorded."""
    for patch in surfels.patches:
        part = patch if piece is None else piece.part(patch)
        if part is not None:
            lit = matched(replace(part, use=None), recorded, surfels.tolerance)
            yield replace(lit, use=part.use)


def _recordings(
    surfels: Surfels, scene: Scene, own: str, t: int, edited: frozenset[int], piece: Window | None
) -> Iterator[Source]:
    """All recordings that show what was there at time t, where it was then, or their parts that show the piece."""
    views, near = scene.episode.views, surfels.tolerance
    made = surfels.images
    lifted = made.of if made and made.episode is scene.episode else partial(_image, surfels, scene)
    recorded = _own(surfels, scene, own, t, piece, lifted)
    yield recorded

    def like(source: Source) -> Iterator[Source]:
        part = source if piece is None else piece.part(source)
        if part is not None:
            yield matched(part if part.lifted else zbuffer.lift(part, near), recorded, near)

    def names(view: CameraView) -> Int32[np.ndarray, "h w"]:
        size = view.camera.height, view.camera.width
        return view.ids(t) if view.ids else np.zeros(size, np.int32)

    now = {name: names(view) for name, view in views.items()}
    rim = _rim(scene) if edited else 0
    for name in views:
        if name != own:
            yield from like(lifted(name, t) if piece is None else _there(surfels, scene, name, t))
    for name, kept in surfels.plates.items():
        hidden = ~among(now[name], surfels.static - edited)
        if rim:
            hidden |= grown(among(now[name], edited), rim)
        hidden &= kept.known
        if hidden.any():
            yield from like(replace(kept.source, use=hidden))
    for past in surfels.history.values():
        for source in past:
            yield from like(source)
    poses = {body.instance_ids: body.to_world[t] for body in scene.tracked}
    for part in surfels.parts:
        yield from like(part.at(poses[part.instance_ids]))


def _own(
    surfels: Surfels,
    scene: Scene,
    name: str,
    t: int,
    piece: Window | None,
    lifted: Callable[[str, int], Source],
) -> Source:
    """What the camera itself recorded, or a piece of it; `lifted` gives what others are shown of it."""
    view, near = scene.episode.views[name], surfels.tolerance
    assert view.depth is not None
    depth = view.depth(t)
    if piece is None and not scene.antialiased and ((depth > 0) & np.isfinite(depth)).all():
        return replace(lifted(name, t), distant=True, carved=False)
    recorded = source_at(view, t, surfels.noise, distant=True)
    return zbuffer.lift(recorded if piece is None else piece.of(recorded), near)


def _there(surfels: Surfels, scene: Scene, name: str, t: int) -> Source:
    """What another camera is shown of a camera's image."""
    view = scene.episode.views[name]
    return source_at(view, t, surfels.noise, carved=True, mixed=scene.antialiased)


def _image(surfels: Surfels, scene: Scene, name: str, t: int) -> Source:
    """The same, lifted."""
    return zbuffer.lift(_there(surfels, scene, name, t), surfels.tolerance)


def _shown(own: Source, other: Source, use: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """Which pixels of another recording show a place that one's own shows as well, or sees through."""
    pose = relative(other.cam_to_world, own.cam_to_world)
    shown = np.zeros_like(use)
    _spare(
        use, other.depth, other.ids, intrinsics(other.K), pose, own.depth, own.ids, intrinsics(own.K), shown
    )  # fmt: skip
    return shown


@kernel
def _spare(use, depth, ids, lens, pose, own_depth, own_ids, own_lens, shown):
    height, width = own_ids.shape
    for row in range(use.shape[0]):
        for column in range(use.shape[1]):
            if not use[row, column] or not depth[row, column] > 0.0:
                continue
            z = float(depth[row, column])
            x, y, ahead = map_pixel(column, row, 1.0 / z, lens, pose, own_lens)
            if not (ahead > NEAR and -0.5 <= x < width - 0.5 and -0.5 <= y < height - 0.5):
                continue
            i, j = int(np.floor(y + 0.5)), int(np.floor(x + 0.5))
            beyond = own_depth[i, j] - ahead * z
            same = own_ids[i, j] == ids[row, column] and abs(beyond) < SAME_PLACE
            shown[row, column] = same or beyond > SAME_PLACE


def _without(source: Source, instance_ids: frozenset[int], rim: int) -> Source:
    """What a recording shows besides some things and the pixels around them that their blur reaches."""
    rest = ~grown(among(source.ids, instance_ids), rim)
    return replace(source, use=rest if source.use is None else rest & source.use)


def _rim(scene: Scene) -> int:
    """Pixels by which a thing shows beside its outline: where images are anti-aliased those that it meets, and in
    photographs as far as an outline that was worked out is blurred."""
    if not _outlined(scene):
        return int(scene.antialiased)
    return round(BLURRED * max(view.camera.width for view in scene.episode.views.values()))


def _outlined(scene: Scene) -> bool:
    """Whether outlines were worked out from photographs."""
    return scene.antialiased and all(view.inferred for view in scene.episode.views.values())


def _history(
    view: CameraView, length: int, static: frozenset[int], noise: float, near: float, mixed: bool
) -> Iterator[Source]:
    for t in sorted(spread(length)[:HISTORY_FRAMES]):
        past = source_at(view, t, noise, carved=True, mixed=mixed)
        use = among(past.ids, static) & (True if past.use is None else past.use)
        if use.any():
            yield zbuffer.lift(replace(past, use=use), near)
