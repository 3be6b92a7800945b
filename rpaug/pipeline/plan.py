"""Which carrier shows each part of each camera: the lowest tier that is good enough, and what is known about that.

A region is one body, or the background, in one camera. Its tier rises above the lowest that can show it at all only
where the recipe states an accuracy, an error measured on the episode misses it, and the next tier should meet it.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from rpaug.core.errors import SourceLacks, TargetError
from rpaug.core.interfaces import Operator
from rpaug.core.types import Effect, Episode, Scene
from rpaug.pipeline.recipe import Accuracy
from rpaug.pipeline.residuals import Residual
from rpaug.scene.placement.free_space import MARGIN
from rpaug.scene.targets.targets import BY_WORDS, Target, find

TIERS = {0: "recorded pixels", 1: "surfels", 3: "Gaussians", 4: "Gaussians in space and time"}
GEOMETRY = Effect.CAMERA | Effect.DEPTH | Effect.MASK | Effect.BODIES
EVERYTHING = "everything"
FIT = (
    "steps", "train_db", "held_out_db", "per_camera_db", "depth_error_mm", "founder", "borrowed",
    "four",
)  # fmt: skip
FEWEST = 200  # pixels: the residual of a smaller region says little

# Rough figures of a 2-core machine, for --dry-run (tools/bench/dry_run.py), in processor seconds. A worker starts, and
# loads what tells instances apart, what renders, and what each edit beside the first needs; an episode is read, its
# instances are told apart and tracked, and lamps and free space are sought for each edit that puts something down.
SECONDS_START, SECONDS_START_BODIES, SECONDS_START_RENDERED = 2.57, 1.03, 0.39
SECONDS_FURTHER = 0.83
SECONDS_EPISODE, SECONDS_TRACKED, SECONDS_PUT = 0.0035, 0.0047, 2.07
SECONDS_COPY = 0.0061
# The same by a million pixels: of an episode, and of each copy; of a moved camera with the draws that gates reject.
SECONDS_READ, SECONDS_BODIES = 0.059, 0.2
SECONDS_WRITTEN, SECONDS_COPY_PUT, SECONDS_COPY_FURTHER = 0.074, 0.064, 0.082
SECONDS_RENDERED = {0: 0.0, 1: 1.44, 3: 2.0, 4: 2.3}
SECONDS_OUTLINED, SECONDS_GUESSED = (
    0.01,
    1.5,
)  # an image and a million pixels of color alone: once, and each copy
SECONDS_FIT = 90.0
SECONDS_FOUR = 60.0  # more, where something bends
GROWN = 0.15  # of the recorded bytes, more, where cameras move
LOSSY = 2.0  # times the recorded bytes of color alone, which mostly is JPEG: it is written at the best quality
BYTES_A_COPY = 2000.0  # more: its report


@dataclass(frozen=True)
class Work:
    """What the edits of a plan come to: how many they are, how many put something down or move it, and the cameras that
    they move."""

    edits: int = 0
    put: int = 0
    moved: frozenset[str] = frozenset()


@dataclass(frozen=True)
class Error:
    """What is known of a region's error: PSNR in dB, median depth error in mm, and where that is from.

    `known` is "exact" (recorded pixels stay), "measured" (on this episode), "fit" (on its recorded views, after the
    fit) or "table" (docs/tiers.md: measured on other episodes).
    """

    psnr: float | None
    depth_mm: float | None
    known: str

    def meets(self, accuracy: Accuracy) -> bool:
        """True if nothing asked for is missed."""
        if self.known == "exact":
            return True
        bright = accuracy.psnr is None or (self.psnr is not None and self.psnr >= accuracy.psnr)
        near = accuracy.depth_mm is None or (
            self.depth_mm is not None and self.depth_mm <= accuracy.depth_mm
        )
        return bright and near

    def __str__(self) -> str:
        if self.known == "exact":
            return "exact"
        parts = [f"{self.psnr:.1f} dB"] if self.psnr is not None else []
        parts += [f"{self.depth_mm:.2f} mm"] if self.depth_mm is not None else []
        return f"{', '.join(parts)} ({self.known})"


EXACT = Error(None, None, "exact")
TABLE = {0: EXACT, 1: Error(27.6, 0.0, "table"), 3: Error(25.8, 2.8, "table")}
TABLE[4] = TABLE[3]  # of what is rigid; what bends is measured by the fit itself


@dataclass(frozen=True)
class Region:
    """One part of one camera's view, the tier that shows it, and its error there.

    `lower` is the measured error at the tier below, where that made the tier rise. `met` is None without an accuracy.
    """

    camera: str
    name: str
    tier: int
    error: Error
    instance_ids: frozenset[int] = frozenset()  # of no use for `everything`
    lower: Error | None = None
    met: bool | None = None

    def describe(self) -> dict[str, Any]:
        """Plain values."""
        facts: dict[str, Any] = {"camera": self.camera, "region": self.name, "tier": self.tier}
        facts |= {"error": vars(self.error)}
        if self.lower is not None:
            facts["risen_from"] = vars(self.lower)
        return facts if self.met is None else facts | {"met": self.met}

    def __str__(self) -> str:
        given = f"{self.camera}, {self.name}: tier {self.tier}, {TIERS[self.tier]}: {self.error}"
        if self.lower is not None:
            given += f", since the tier below gives {self.lower}"
        return given if self.met is not False else f"{given}; misses the accuracy asked for"


@dataclass(frozen=True)
class Plan:
    """`tier` is the least tier wanted, `carriers` the tier that draws each camera, `bodies` whether instances must
    be told apart and tracked. Of a camera that surfels draw, single regions may be at tier 3. `fit` is what a fit of
    Gaussians said of itself, `warnings` what is wrong with the recording, `parts` the targets of which a part finer
    than the masks is meant. `modelled`: an edit works on Gaussians, whatever shows what comes of it.
    `assumed` is what the source does not say and edits go by, in sentences. `film` is what structure from motion said
    of a video. `refine` is how many steps the edited Gaussians are tuned together, `refined` what came of it.
    `device` is what fits Gaussians and edits appearance; else frames are drawn on the CPU whatever it is. `lamps`:
    instances must be told apart and tracked if the recording shows moving shadows."""

    tier: int
    representations: dict[str, int]
    bodies: bool
    regions: tuple[Region, ...] = ()
    fit: Mapping[str, Any] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    parts: tuple[Target, ...] = ()
    modelled: bool = False
    assumed: tuple[str, ...] = ()
    video: Mapping[str, Any] = field(default_factory=dict)
    refine: int = 0
    device: str = "cpu"
    refined: Mapping[str, Any] = field(default_factory=dict)
    lamps: bool = False
    work: Work = Work()

    @property
    def gaussians(self) -> bool:
        """Whether anything is shown by Gaussians, or made with them."""
        tiers = [*self.representations.values(), *(region.tier for region in self.regions)]
        return self.modelled or any(tier >= 3 for tier in tiers)

    @property
    def blended(self) -> dict[str, frozenset[int]]:
        """Handles that Gaussians show, by camera that surfels draw."""
        shown: dict[str, frozenset[int]] = {}
        for region in self.regions:
            if region.tier == 3 and self.representations[region.camera] == 1:
                shown[region.camera] = shown.get(region.camera, frozenset()) | region.instance_ids
        return shown

    def describe(self) -> dict[str, Any]:
        """Plain values for the report and for people."""
        representations = {
            name: f"tier {tier}, {TIERS[tier]}" for name, tier in self.representations.items()
        }
        regions = [region.describe() for region in self.regions]
        facts: dict[str, Any] = {
            "tier": self.tier,
            "carriers": representations,
            "bodies": self.bodies,
            "regions": regions,
        }
        facts |= {"fit": dict(self.fit)} if self.fit else {}
        facts |= {"assumed": list(self.assumed)} if self.assumed else {}
        facts |= {"film": dict(self.video)} if self.video else {}
        facts |= {"refined": dict(self.refined)} if self.refined else {}
        if self.device != "cpu":
            facts["device"] = {"fits": self.device, "appearance": self.device, "frames": "cpu"}
        return facts | ({"warnings": list(self.warnings)} if self.warnings else {})

    @property
    def start(self) -> float:
        """Estimated seconds until a worker runs and has loaded what these edits need."""
        rendered = self.work.put > 0 or max(self.representations.values(), default=0) > 0
        seconds = SECONDS_START + SECONDS_START_BODIES * self.bodies
        further = SECONDS_FURTHER * max(0, self.work.edits - 1)
        return seconds + SECONDS_START_RENDERED * rendered + further

    def cost(self, episode: Episode, copies: int, stored: float = 0.0) -> dict[str, float]:
        """Estimated seconds and megabytes of `copies` of an episode of which `stored` megabytes are recorded, by a
        worker that runs already."""
        work = self.work
        seconds = SECONDS_EPISODE + SECONDS_COPY * copies + SECONDS_PUT * work.put
        seconds += SECONDS_TRACKED * self.bodies + SECONDS_FIT * self.gaussians
        seconds += SECONDS_FOUR * (4 in self.representations.values())
        each = SECONDS_WRITTEN + SECONDS_COPY_PUT * work.put
        each += SECONDS_COPY_FURTHER * max(0, work.edits - 1)
        for name, view in episode.views.items():
            megapixels = view.camera.width * view.camera.height * episode.length / 1e6
            anew = name in work.moved or self.tier > 0
            rate = each + SECONDS_RENDERED[self.representations[name] if anew else 0]
            rate += SECONDS_RENDERED[3] * (name in self.blended)
            seconds += megapixels * (SECONDS_READ + SECONDS_BODIES * self.bodies + copies * rate)
            if view.depth is None or view.inferred:
                told = SECONDS_OUTLINED * episode.length + SECONDS_GUESSED * megapixels
                seconds += told * self.bodies * (1 + copies)
        colored = all(view.depth is None for view in episode.views.values())
        grown = (LOSSY if colored else 1) * (1 + GROWN * bool(work.moved))
        size = copies * (stored * grown + BYTES_A_COPY / 1e6)
        return {"seconds": seconds, "megabytes": size}


def make(operators: Sequence[Operator], episode: Episode, tier: int = 0) -> Plan:
    """The plan for all these operators together, before anything is drawn.

    Appearance edits stay in cameras where they were recorded: tier 0. A moved camera sees surfaces that its own
    recording may lack: tier 1. Assets (tier 2) are shown by the surfels' z-buffer. `tier` is the least one wanted.
    """
    geometry = any(operator.effect & GEOMETRY for operator in operators)
    edited = [target for operator in operators for target in targets(operator)]
    parts = tuple(target for target in edited if target.part is not None)
    representation = _representation(geometry, tier)
    representations = dict.fromkeys(episode.views, representation)
    modelled = any(operator.needs.gaussians for operator in operators)
    wanted = any(operator.needs.bodies for operator in operators)
    bodies = bool(edited) or wanted or modelled or representation > 0
    parts = tuple(dict.fromkeys(parts))
    lamps = any(map(_asks_for_lamps, operators))
    moved = frozenset().union(*(_moved(operator, episode) for operator in operators))
    put = sum(bool(operator.effect & Effect.BODIES) for operator in operators)
    work = Work(len(operators), put, moved)
    return Plan(
        tier, representations, bodies, _whole(representations), parts=parts, modelled=modelled, lamps=lamps, work=work
    )  # fmt: skip


def _moved(operator: Operator, episode: Episode) -> frozenset[str]:
    """The cameras that an operator moves: all, where it does not say in a field `camera` which."""
    if not operator.effect & Effect.CAMERA:
        return frozenset()
    named = getattr(operator, "camera", None)
    if named == "static":
        return frozenset(name for name, view in episode.views.items() if view.camera.fixed)
    names = episode.views if named is None else [named] if isinstance(named, str) else named
    return frozenset(episode.views).intersection(names)


def check(operator: Operator, scene: Scene) -> None:
    """See that the recording has what an operator declares, sure enough. Raises SourceLacks, with all that is lacking:
    targets that are not found too."""
    if lacking := _lacking(operator, scene):
        raise SourceLacks("; ".join([lacking, *_not_found(operator, scene)]))


def _lacking(operator: Operator, scene: Scene) -> str:
    """What a recording lacks of what an operator declares; empty for nothing."""
    if operator.needs.depth and all(view.depth is None for view in scene.episode.views.values()):
        return "it needs recorded depth, and this source has none"
    if not (operator.needs.depth or operator.effect & GEOMETRY):
        return ""
    for name, view in scene.episode.views.items():
        whose, spread = "", 0.0
        if view.sensed is not None:
            whose, spread = "what was filled of the sensor's depth", view.sensed.spread
        elif view.proxy is not None and view.proxy.modelled:
            whose, spread = "the model's depth", view.proxy.spread
        if spread > MARGIN:
            how = (
                f"nothing tells how far off {whose} is"
                if spread == float("inf")
                else f"{whose} may be off by {1000 * spread:.0f} mm"
            )
            return (
                f"{name}: {how}, and things are kept {1000 * MARGIN:.0f} mm apart: this edit needs depth that "
                "tells them apart, recorded or by a better model"
            )
    return ""


def _not_found(operator: Operator, scene: Scene) -> Iterator[str]:
    """Why targets of an operator are not found."""
    for target in targets(operator):
        try:
            find(scene, target)
        except TargetError as error:
            yield str(error)


def flat(scene: Scene) -> list[str]:
    """The cameras without depth."""
    return [name for name, view in scene.episode.views.items() if view.depth is None]


def check_shown(operator: Operator, scene: Scene, edited: Scene) -> None:
    """See that every camera can show what an edit made of the scene. Raises SourceLacks."""
    lacking = flat(scene)
    if not lacking or not operator.effect & GEOMETRY:
        return
    representations = settle(make([operator], scene.episode), edited).representations
    for name in lacking:
        if representations[name] > 0:
            raise SourceLacks(
                f"{name} would show what its images hide, and that takes depth, which this source lacks"
            )


def check_steady(scene: Scene, edited: Scene) -> None:
    """See that what an edit paints does not come and go from frame to frame of a video. Raises TargetError."""
    unsteady: Callable[[frozenset[int]], str] = getattr(scene.back, "unsteady", lambda ids: "")
    for one in edited.appearance[len(scene.appearance) :]:
        if one.instance_ids and (why := unsteady(one.instance_ids)):
            raise TargetError(f"{why}; {BY_WORDS}")


def targets(operator: Operator) -> Iterator[Target]:
    """The things that an operator edits, as its fields name them."""
    for name in operator.needs.targets:
        value = getattr(operator, name)
        yield from (value,) if isinstance(value, Target) else value or ()


def _asks_for_lamps(operator: Operator) -> bool:
    wanted = operator.needs.lamps
    return getattr(operator, wanted) is not None if isinstance(wanted, str) else wanted


def weigh(
    plan: Plan,
    regions: Mapping[str, frozenset[int]],
    measured: Sequence[Residual],
    accuracy: Accuracy,
) -> Plan:
    """The plan with each region at the lowest tier that meets `accuracy`, by what was measured of tier 1.

    Where no tier is known to meet it, the lowest stays and the region says so. Cameras of which nothing was measured
    keep their tier.
    """
    found = []
    for name, representation in plan.representations.items():
        here = [one for one in measured if one.camera == name]
        if representation != 1 or not here:
            error = TABLE[representation]
            met = error.meets(accuracy)
            found.append(Region(name, EVERYTHING, representation, error, met=met))
        found += [
            _weighed(one, regions[one.region], accuracy) for one in here if representation == 1
        ]
    return replace(
        plan, representations=_representations(plan.representations, found), regions=tuple(found)
    )


def fitted(plan: Plan, facts: Mapping[str, Any], measured: Sequence[Residual]) -> Plan:
    """The plan with what a fit came to, and what was measured of its Gaussians in the recorded views.

    A region that rose goes back where Gaussians show even what they were fitted to no better than surfels would.
    """
    errors = {(one.camera, one.region): _error(one) for one in measured}

    def known(region: Region) -> Region:
        if region.tier < 3:
            return region
        if region.name == EVERYTHING:
            psnr = facts["per_camera_db"].get(region.camera)
            return replace(region, error=Error(psnr, facts["depth_error_mm"], "fit"))
        error = errors[region.camera, region.name]
        assert region.lower is not None
        if (error.psnr or 0.0) > (region.lower.psnr or 0.0):
            return replace(region, error=replace(error, known="fit"))
        return replace(region, tier=1, error=region.lower, lower=None, met=False)

    regions = tuple(known(region) for region in plan.regions)
    given = {name: facts[name] for name in FIT if name in facts}
    return replace(
        plan,
        representations=_representations(plan.representations, regions),
        regions=regions,
        fit=given,
    )


def settle(plan: Plan, scene: Scene) -> Plan:
    """The plan of one edited scene: rendered anew is only what shows a move, of its camera or of bodies."""
    edited = scene.recorded_bodies is not None
    representations = {}
    for name, view in scene.episode.views.items():
        moved = edited or scene.cameras[name] is not view.camera
        representations[name] = max(
            _representation(moved, plan.tier), plan.representations[name] if moved else 0
        )
    kept = [
        region
        for region in plan.regions
        if representations[region.camera] == plan.representations[region.camera]
    ]
    others = {
        name: tier for name, tier in representations.items() if tier != plan.representations[name]
    }
    return replace(plan, representations=representations, regions=(*kept, *_whole(others)))


def _whole(representations: Mapping[str, int]) -> tuple[Region, ...]:
    return tuple(
        Region(name, EVERYTHING, tier, TABLE[tier]) for name, tier in representations.items()
    )


def _representations(before: Mapping[str, int], regions: Sequence[Region]) -> dict[str, int]:
    """What draws each camera: Gaussians where they show all of it, surfels where they show some."""
    representations = {}
    for name in before:
        tiers = {region.tier for region in regions if region.camera == name}
        representations[name] = tiers.pop() if len(tiers) == 1 else 1
    return representations


def _error(one: Residual) -> Error:
    return Error(round(one.psnr, 2), round(one.depth_mm, 3), "measured")


def _weighed(one: Residual, instance_ids: frozenset[int], accuracy: Accuracy) -> Region:
    error = TABLE[1] if one.pixels < FEWEST else _error(one)
    met = error.meets(accuracy)
    if met or error.known != "measured" or not TABLE[3].meets(accuracy):
        return Region(one.camera, one.region, 1, error, instance_ids, met=met)
    return Region(one.camera, one.region, 3, TABLE[3], instance_ids, lower=error, met=True)


def _representation(moved: bool, tier: int) -> int:
    if tier >= 3:
        return tier
    return 1 if moved or tier >= 1 else 0
