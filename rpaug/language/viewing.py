"""What a clause says of cameras: moved along a direction, turned by an angle, jittered, or aimed at a thing."""

from typing import Any

from rpaug.language.messages import Entry, Meant, Mention, NotUnderstood, Wish
from rpaug.language.things import Namer
from rpaug.language.tokens import CARRIED, Clause, Token
from rpaug.language.values import Amount, tidy

# A camera's axes: x right, y down, z into the scene; a turn about x looks up, about y right, about z clockwise.
WAYS = {
    "up": (0, -1, 0),
    "down": (0, 1, 0),
    "left": (-1, 0, 0),
    "right": (1, 0, 0),
    "ahead": (0, 0, 1),
    "back": (0, 0, -1),
}
TURNS = {"up": (1, 0, 0), "down": (-1, 0, 0), "left": (0, -1, 0), "right": (0, 1, 0)}
AWAY = ("away", "out", "it")
STEP, WRIST_STEP, TURN = 0.1, 0.02, 0.1745  # metres and radians, where no amount was named
MIDDLE = frozenset(["midpoint", "middle", "center", "halfway", "between", "of", "the"])


def camera_pose(clause: Clause, wish: Wish, namer: Namer) -> Meant | None:
    """Cameras at an exact motion, at one drawn along a direction or within bounds, or looking at something."""
    if (names := _named(clause, wish, namer)) is None:
        return None
    order = [one.kind for one in clause.tokens if one.kind in ("length", "angle")]
    lengths, angles = clause.amounts("length"), clause.amounts("angle")
    if any(one.how == "least" for one in (*lengths, *angles)):
        raise NotUnderstood(f"{clause.text!r}: at most how far?")
    edit: Entry = {"op": "camera_pose", "camera": names}
    if clause.every("aim"):
        clause.tokens = [one for one in clause.tokens if not set(one.text.split()) <= MIDDLE]
        edit["toward"] = namer.middle(clause.things())
    rolled = clause.one("roll", "unroll")
    tilts = bool(clause.every("tilt", "pan")) or clause.has("rotate") or clause.says("turn")
    axes, ways, notes = clause.every("axes"), clause.every(*WAYS), list[str]()
    if (
        len(order) == len(ways) and angles
    ):  # each amount goes with the way said with it; the angle's last
        ways.append(ways.pop(order.index("angle")))
    clause.every("move", "rotate", "pose", "from", "each")
    clause.tokens = [one for one in clause.tokens if one.text not in AWAY]
    if axes:
        if len(lengths) != 1 or lengths[0].how != "exact":
            raise NotUnderstood(f"{clause.text!r}: how far along each axis?")
        edit["by"] = [lengths[0].low, lengths[0].low, 0]
    elif rolled:
        if ways or lengths:
            raise NotUnderstood(f"{clause.text!r}: roll the camera, or move it")
        sign, angle = (
            -1 if rolled.kind == "unroll" else 1,
            angles[0] if angles else Amount(TURN, TURN),
        )
        if clause.every("vary", "any") and angle.how == "exact":
            angle = Amount(angle.high, angle.high, "about")
        edit |= {"by": [0, 0, 0]} | _motion("turned", [((0, 0, sign), angle)])
    elif ways:
        edit |= _posed(clause, names, ways, lengths, angles, tilts, notes)
    elif "toward" not in edit:
        edit |= _jittered(clause, lengths, angles, tilts, notes)
    mention = Mention(kind="camera", cameras=names)
    return Meant(edits=(edit,), mention=mention, notes=tuple(notes), stage="renderer")


def _named(clause: Clause, wish: Wish, namer: Namer) -> Any:
    """The cameras that a clause is about; None where it is about none."""
    apart = excepted(clause)
    told = [one for one in clause.tokens if one.kind == "camera"]
    for one in told if any(one.value for one in told) and len(told) > 1 else []:
        if "pose" in one.text and one.value in ([], "static"):  # "camera poses of the front camera"
            clause.take(one)
    token, mention = clause.one("camera"), wish.mention
    known = mention is not None and mention.kind == "camera"
    pronoun = any(one.kind == "thing" and one.value.pronoun for one in clause.tokens)
    if token is None and known and (pronoun or clause.has("aim")):
        token = Token("camera", "it", [])
        clause.tokens = [
            one for one in clause.tokens if not (one.kind == "thing" and one.value.pronoun)
        ]
    looking = clause.says("look", "view", "see", "film", "watch") and clause.has("from")
    looking &= not clause.has("light", "lit", "warm", "cool", "darker", "brighter")
    if token is None and looking and clause.has(*WAYS):
        clause.every("all", "image")
        return "static"
    if token is None:
        return None
    if apart:
        stand = [one for one in wish.setting.cameras if not any(part in one for part in CARRIED)]
        named = [one for one in token.value if token.value != "static"] or stand
        return [one for one in named if one not in apart]
    if token.value:
        return (
            token.value[0]
            if isinstance(token.value, list) and len(token.value) == 1
            else token.value
        )
    if mention is not None and known:
        return mention.cameras
    namer.notes.append(f"{token.text!r} is taken as all cameras that stand still")
    return "static"


def excepted(clause: Clause) -> list[str]:
    """The cameras that a clause names as those that are not meant."""
    at = next((k for k, one in enumerate(clause.tokens) if one.kind == "not"), len(clause.tokens))
    apart = [
        one for one in clause.tokens[at:] if one.kind == "camera" and isinstance(one.value, list)
    ]
    for one in [*clause.tokens[at : at + 1], *apart] if apart else []:
        clause.take(one)
    return [name for one in apart for name in one.value]


def _jittered(
    clause: Clause, lengths: list[Amount], angles: list[Amount], tilts: bool, notes: list[str]
) -> Entry:
    """A motion of any direction within bounds."""
    moved = any(one.kind in ("move", "rotate") for one in clause.taken) or clause.says("move")
    vague = not clause.every("vary", "little", "any") and not lengths
    if vague and not (moved or tilts) and (not angles or len(clause.taken) < 2):
        raise NotUnderstood(f"{clause.text!r}: what about the camera?")
    if vague and not angles:
        raise NotUnderstood(f"{clause.text!r}: which way, and how far?")
    if vague and angles[0].how == "exact":
        notes.append("which way it turns was not said: it turns about any axis, up to that angle")
    elif any(one.how == "exact" for one in lengths) and moved:
        raise NotUnderstood(f"{clause.text!r}: which way, and how far?")
    if not (lengths or angles):
        return {}
    return {"shift": lengths[0].high if lengths else 0, "turn": angles[0].high if angles else 0}


def _posed(
    clause: Clause,
    names: Any,
    ways: list[Token],
    lengths: list[Amount],
    angles: list[Amount],
    tilts: bool,
    notes: list[str],
) -> Entry:
    """A motion along directions: those that lengths go with, and the one that an angle goes with."""
    little = 0.5 if clause.every("little") else 2.0 if clause.every("much") else 1.0
    clause.every("vary")
    turning = bool(angles) or (tilts and not lengths)
    turns, moves = (ways[-1:], ways[:-1]) if turning else ([], ways)
    if len(lengths) not in (0, len(moves)) or len(angles) > 1:
        raise NotUnderstood(f"{clause.text!r}: which way, and how far?")
    if len([one for one in (*lengths, *angles) if one.how != "exact"]) > 1:
        raise NotUnderstood(f"{clause.text!r}: one range at a time along a direction")
    carried = any(part in str(names).lower() for part in CARRIED)
    usual = (WRIST_STEP if carried else STEP) * little
    if moves and not lengths:
        notes.append(f"{100 * usual:g} cm, since no length was named")
        lengths = [Amount(usual, usual)] * len(moves)
    if any(way.kind in ("up", "down") for way in moves):
        notes.append("up is where the upper edge of the camera's image is, not up in the room")
    edit = _motion("by", [(WAYS[way.kind], far) for way, far in zip(moves, lengths, strict=True)])
    if turns:
        if turns[0].kind not in TURNS:
            raise NotUnderstood(f"{clause.text!r}: a camera turns up, down, left or right")
        if not angles:
            notes.append("10 degrees, since no angle was named")
        edit |= _motion(
            "turned", [(TURNS[turns[0].kind], angles[0] if angles else Amount(TURN, TURN))]
        )
    return edit


def _motion(name: str, parts: list[tuple[Any, Amount]]) -> Entry:
    """A camera's motion or turn: the sum of parts along axes, or the low and high of what is drawn."""
    ends = [
        [sum(axis[k] * one.ends[end] for axis, one in parts) for k in range(3)] for end in (0, 1)
    ]
    low, high = ([tidy(pick(pair)) or 0 for pair in zip(*ends, strict=True)] for pick in (min, max))
    return {name: low if low == high else [low, high]}
