"""What is believed of a video's table, in words: which surfaces, in which frames, how sure; and what else is level."""

from collections.abc import Sequence

from rpaug.core.types import Belief
from rpaug.scene.video.instances import InstanceMap, Support

DISPUTED = 0.1  # of a surface's pixels: more is told
LISTED = 4  # other level surfaces
Span = tuple[int, int]


def table(
    found: InstanceMap, spans: Sequence[Span], eye: float
) -> tuple[Belief | None, tuple[str, ...]]:
    """The belief, None where nothing is level, and sentences about what an edit of the table does not reach, or reaches
    wrongly. `spans` are the recorded frames of each piece, `eye` is the camera's height above its support."""
    supports = [
        (piece, one) for piece, one in enumerate(found.supports) if one and one.instance_ids
    ]
    told = [*_parted(found, spans), *(_disputed(one, spans[piece]) for piece, one in supports)]
    told += [_levels(found, piece, eye) for piece, _ in supports]
    if not supports:
        return None, tuple(filter(None, told))
    ids = frozenset[int]().union(*(one.instance_ids for _, one in supports))
    sure = min(_sure(one) for _, one in supports)
    reasons = tuple(_reason(one, spans[piece], len(spans)) for piece, one in supports)
    return Belief(ids, sure, reasons), tuple(filter(None, told))


def _sure(one: Support) -> float:
    """How sure a support is: what is measured in its plane, and not disputed."""
    return one.measured * (1 - one.disputed)


def _reason(one: Support, span: Span, pieces: int) -> str:
    where = f" in frames {span[0]} to {span[1]}" if pieces > 1 else ""
    return (
        f"instance {_numbers(one)}{where}: the largest level surface below the camera; {one.measured:.0%} of"
        f" {one.sightings} measured points lie in its plane, and {one.disputed:.0%} of its pixels are something else"
        " in another frame"
    )


def _parted(found: InstanceMap, spans: Sequence[Span]) -> list[str]:
    """That the pieces of a video do not hang together, and which have no support."""
    if len(spans) < 2:
        return []
    frames = "; ".join(f"{first} to {last}" for first, last in spans)
    without = [span for k, span in enumerate(spans) if not any(found.supports[k : k + 1])]
    none = [f"frames {first} to {last} show no table" for first, last in without]
    return [
        f"the camera is known in {len(spans)} pieces (frames {frames}) that share too few points to be set beside each"
        " other: each has a table of its own, and what is put on one is not on the others",
        *none,
    ]


def _disputed(one: Support, span: Span) -> str:
    if one.disputed <= DISPUTED:
        return ""
    return (
        f"table: {one.disputed:.0%} of instance {_numbers(one)} (frames {span[0]} to {span[1]}) is something else in"
        " another frame, and may be painted wrongly there"
    )


def _levels(found: InstanceMap, piece: int, eye: float) -> str:
    """The other level surfaces of a piece, the largest first."""
    others = [one for one in found.levels if one.piece == piece][:LISTED]
    if not others:
        return ""
    heights = (
        f"{one.instance_id} ({100 * abs(one.height) * eye:.0f} cm {'above' if one.height > 0 else 'below'} it)"
        for one in others
    )
    table = found.supports[piece]
    assert table is not None
    return f"level as well, and not the table {_numbers(table)}: {', '.join(heights)}; {{handle: ID}} names one"


def _numbers(one: Support) -> str:
    return ", ".join(map(str, sorted(one.instance_ids)))
