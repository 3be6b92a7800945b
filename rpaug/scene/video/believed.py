"""What is believed of a video's table, in words: which surfaces, in which frames, how sure; and what else is level."""

from collections.abc import Sequence

from rpaug.core.types import Belief
from rpaug.scene.video import instances
from rpaug.scene.video.instances import InstanceMap, Support

DISPUTED = 0.1  # of a surface's pixels: more is told
LISTED = 4  # other level surfaces
BEHIND = "the background of a video is all that is no instance of its own: arms and things may be painted with it"
NONE = "nothing large and level was found below the camera: there is no table; `{handle: ID}` names a surface"
# Below the bound of roles: nothing measures it.
BACKGROUND = Belief(frozenset([instances.BACKGROUND]), 0.2, (BEHIND,))
Span = tuple[int, int]


def table(found: InstanceMap, spans: Sequence[Span]) -> Belief | None:
    """The belief, None where nothing is level. `spans` are the first and last recorded frame of each piece."""
    known = _supports(found)
    if not known:
        return None
    ids = frozenset[int]().union(*(one.instance_ids for _, one in known))
    sure = min(one.measured * (1 - one.disputed) for _, one in known)
    return Belief(ids, sure, tuple(_reason(one, spans[k], len(spans)) for k, one in known))


def doubts(found: InstanceMap, spans: Sequence[Span]) -> tuple[str, ...]:
    """Where edits of the table leave out frames, or may paint what is none, in sentences."""
    known = dict(_supports(found))
    none = [
        f"frames {first} to {last} show no table that is known: edits of the table leave them out"
        for k, (first, last) in enumerate(spans)
        if known and k not in known
    ]
    wrong = [
        f"{one.disputed:.0%} of the table {_numbers(one)} (frames {spans[k][0]} to {spans[k][1]}) is something else in"
        " other frames: it may be painted wrongly there"
        for k, one in known.items()
        if one.disputed > DISPUTED
    ]
    glass = [
        f"instance {thing.instance_id} has the color of the table {_numbers(one)} on which {thing.outlined} of"
        f" {thing.shown} frames outline it: a glass, or a mark that shines; it is left as it is, its rim may not be"
        for one in known.values()
        for thing in one.clear
    ]
    return (*none, *wrong, *glass)


def apart(spans: Sequence[Span]) -> tuple[str, ...]:
    """In which frames what is put in does not show, in a sentence; none where a video is one piece."""
    if len(spans) < 2:
        return ()
    return (
        f"what is put into one piece of the video (frames {_frames(spans)}) does not show in the others; `near:"
        " {handle: ID}` puts it beside something of a piece",
    )


def told(found: InstanceMap, spans: Sequence[Span], eye: float) -> tuple[str, ...]:
    """What `rpaug inspect` says of the table beside the belief, or of there being none: pieces, doubts, other level
    surfaces. `eye` is the camera's height above its support."""
    parted = [
        f"the camera is known in {len(spans)} pieces (frames {_frames(spans)}) that share too few points to be set"
        " beside each other: each has a table of its own, and what is put on one is not on the others"
    ] * (len(spans) > 1)
    levels = [_levels(found, k, one, eye) for k, one in _supports(found)]
    none = [NONE] * (not _supports(found))
    return (*parted, *none, *doubts(found, spans), *filter(None, levels))


def _frames(spans: Sequence[Span]) -> str:
    return "; ".join(f"{first} to {last}" for first, last in spans)


def _supports(found: InstanceMap) -> list[tuple[int, Support]]:
    return [(piece, one) for piece, one in enumerate(found.supports) if one]


def _reason(one: Support, span: Span, pieces: int) -> str:
    where = f" in frames {span[0]} to {span[1]}" if pieces > 1 else ""
    return (
        f"instance {_numbers(one)}{where}: the largest level surface below the camera; {one.measured:.0%} of"
        f" {one.sightings} measured points lie in its plane, and {one.disputed:.0%} of its pixels are something else"
        " in another frame"
    )


def _levels(found: InstanceMap, piece: int, table: Support, eye: float) -> str:
    """The other level surfaces of a piece, the largest first."""
    others = [one for one in found.levels if one.piece == piece][:LISTED]
    if not others:
        return ""
    heights = (
        f"{one.instance_id} ({100 * abs(one.height) * eye:.0f} cm {'above' if one.height > 0 else 'below'} it)"
        for one in others
    )
    return f"level as well, and not the table {_numbers(table)}: {', '.join(heights)}; {{handle: ID}} names one"


def _numbers(one: Support) -> str:
    return ", ".join(map(str, sorted(one.instance_ids)))
