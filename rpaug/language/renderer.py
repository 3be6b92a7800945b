"""Viewpoint words into a camera's motion, in the frame it was recorded in: x right, y down, z into the scene."""
# ruff: noqa: E501  # patterns are easiest to read whole

import re
from typing import Any

from rpaug.language import slots
from rpaug.language.grammar import NotThis, Said, done, refuse, rule
from rpaug.language.messages import Meant, Mention

DIRECTIONS = {
    **dict.fromkeys(("up", "upwards", "upward", "higher", "above"), (0, -1, 0)),
    **dict.fromkeys(("down", "downwards", "downward", "lower", "below"), (0, 1, 0)),
    **dict.fromkeys(("left", "leftwards", "the left"), (-1, 0, 0)),
    **dict.fromkeys(("right", "rightwards", "the right"), (1, 0, 0)),
    **dict.fromkeys(("forward", "forwards", "closer", "nearer", "in", "close", "near"), (0, 0, 1)),
    **dict.fromkeys(("back", "backward", "backwards", "farther", "further", "away", "further away", "farther away",
                     "farther back", "further back", "out"), (0, 0, -1)),
}  # fmt: skip
# A positive turn about x looks up, about y looks right, and about z rolls the camera clockwise.
TURNS = {"up": (1, 0, 0), "down": (-1, 0, 0), "right": (0, 1, 0), "left": (0, -1, 0), "clockwise": (0, 0, 1),
         "counterclockwise": (0, 0, -1), "anticlockwise": (0, 0, -1)}  # fmt: skip
STEP, WRIST_STEP, TURN = 0.1, 0.02, 10 * slots.RADIANS["degree"]  # where no amount was named
AMOUNTS = {
    "a bit": 0.5,
    "slightly": 0.5,
    "a little": 0.5,
    "a little bit": 0.5,
    "much": 2.0,
    "a lot": 2.0,
    "far": 2.0,
}

DIRECTION = slots.any_of(DIRECTIONS)
AMOUNT = slots.any_of(AMOUNTS)
TERM = (
    rf"(?:(?:to )?(?:{DIRECTION})(?: by|,)? {slots.LENGTH}|(?:by )?{slots.LENGTH} (?:to |further |farther )?(?:{DIRECTION})"
    rf"|(?:{AMOUNT} )?(?:to )?(?:further |farther )?(?:{DIRECTION})(?: {AMOUNT})?)"
)
TERMS = rf"(?P<terms>{TERM}(?:(?:,? and |, ){TERM})*)"
MOVE = r"(?:move|shift|bring|slide|push|pull|put|set|take|place|translate|nudge|drag|relocate|dolly|truck|reposition|displace)"
TOWARDS = r"(?: (?:to|towards?|from) (?:the )?(?:scene|table|workspace|desk|objects|action))?"
TURN_VERB = r"(?:tilt|pitch|turn|rotate|pan|yaw|point|aim|swivel|angle|swing)"
SIDE = r"(?P<way>up|down|left|right)(?:wards?)?"
ROLLED = r"(?P<way>clockwise|counter-?clockwise|anti-?clockwise)"
POSE = r"(?:poses?|positions?|viewpoints?|placements?|locations?|orientations?|extrinsics|angles?|mounts?|viewing angles?)"
AT_MOST = r"(?:,? (?:by )?<UP_TO> {length}(?:(?: and|,) (?:<UP_TO> )?{angle})?)?"


@rule(
    rf"(?P<way>raise|lift|elevate|hoist|heighten|lower|drop|sink) {{camera}}(?: up| down)?(?: (?:by )?{{length}})?(?: (?P<amount>{AMOUNT}))?"
)
def height(stated: Said) -> Meant:
    sign = -1 if stated["way"] not in ("lower", "drop", "sink") else 1
    return _shifted(stated, [((0, sign, 0), stated.get("length"), stated.get("amount"))])


@rule(rf"(?:(?:{MOVE}|make|get) )?{{camera}} {TERMS}{TOWARDS}")
def shifted(stated: Said) -> Meant:
    return _shifted(stated, _terms(stated["terms"]))


@rule(rf"(?:look|view|see|film|watch)(?: at)?(?: (?:it|the scene|the table|everything|this))? from {TERMS}",
      rf"(?:look|view|see|film|watch)(?: at)?(?: (?:it|the scene|the table|everything|this))? from {TERMS} (?:in|with|through) {{camera}}",
      rf"(?:with|in|for|through) {{camera}},? (?:look|view|see|film|watch)(?: at)?(?: (?:it|the scene|the table|everything|this))? from {TERMS}",
      rf"(?:view|show) (?:it|the scene) {TERMS}")  # fmt: skip
def looked(stated: Said) -> Meant:
    return _shifted(stated, _terms(stated["terms"]))


@rule(rf"{TURN_VERB} {{camera}} {SIDE}(?: (?:by )?{{angle}})?",
      rf"{TURN_VERB} {{camera}} (?:by )?{{angle}} (?:to the )?{SIDE}",
      rf"{TURN_VERB} {{camera}} (?:to |towards? )?(?:the )?{SIDE}(?: (?:by )?{{angle}})?",
      rf"(?:roll|rotate|turn|twist|spin) {{camera}} {ROLLED}(?: (?:by )?{{angle}})?",
      rf"(?:roll|rotate|turn|twist|spin) {{camera}} (?:by )?{{angle}} {ROLLED}")  # fmt: skip
def turned(stated: Said) -> Meant:
    names, mention = cameras(stated)
    amount = slots.angle(stated["angle"]) if stated.get("angle") else slots.rounded(TURN)
    turn = [slots.rounded(amount * part) for part in TURNS[stated["way"].replace("-", "")]]
    notes = () if stated.get("angle") else ("10 degrees, since no angle was named",)
    edit = {"op": "camera_pose", "camera": names, "by": [0, 0, 0], "turned": turn}
    return done(edit, mention=mention, notes=notes)


@rule(rf"<SHAKE> (?:the )?{POSE} of {{camera}}{AT_MOST}",
      rf"<SHAKE> {{camera}}(?:(?:'s|')? {POSE})?(?: around| about| a bit| slightly)?{AT_MOST}",
      rf"<SHAKE> {{camera}}(?:(?:'s|')? {POSE})?,? (?:by )?<UP_TO> {{angle}}",
      rf"<SHAKE> (?:the )?{POSE} of {{camera}},? (?:by )?<UP_TO> {{angle}}",
      rf"(?:a |use a |some )?(?:random|different|varying|varied) {POSE} (?:for|of) {{camera}}{AT_MOST}",
      rf"(?:add|apply|use) (?:some |a bit of |random |a random )?(?:pose |position )?(?:jitter|shake|perturbation|noise|motion|wobble) (?:to|on) {{camera}}(?:(?:'s|')? {POSE})?{AT_MOST}",
      rf"{MOVE} {{camera}} (?:randomly|around|about|a bit|slightly|somewhere else|elsewhere){AT_MOST}",
      rf"{MOVE} {{camera}},? (?:by )?<UP_TO> {{length}}(?:(?: and|,) (?:<UP_TO> )?{{angle}})?(?: in any direction| either way)?",
      r"move {camera}")  # fmt: skip
def jittered(stated: Said) -> Meant:
    names, mention = cameras(stated)
    edit: dict[str, Any] = {"op": "camera_pose", "camera": names}
    if stated.get("length"):
        edit["shift"] = slots.length(stated["length"])
    if stated.get("angle"):
        edit["turn"] = slots.angle(stated["angle"])
        if not stated.get("length"):
            edit["shift"] = 0
    return done(edit, mention=mention)


@rule(r"zoom .+", r".+ zoom")
def zoomed(stated: Said) -> Meant:
    raise refuse("a lens cannot be changed: move the camera closer or back instead")


def cameras(stated: Said) -> tuple[str | list[str], Mention]:
    """The cameras that a slot names. Raises NotUnderstood for one that the recording does not have."""
    words = stated.get("camera")
    known = stated.wish.setting.cameras
    if words is None or words in ("the cameras", "cameras", "all cameras", "all the cameras", "every camera",
                                  "all static cameras", "the static cameras", "static cameras"):  # fmt: skip
        return "static", Mention(kind="camera", cameras="static")
    if words in ("it", "them"):
        mention = stated.wish.mention
        if mention is None or mention.kind != "camera":
            raise NotThis
        return mention.cameras, mention
    if words in ("the camera", "camera"):
        if len(known) != 1:
            raise refuse(f"which camera? there are: {', '.join(known)}")
        return known[0], Mention(kind="camera", cameras=known[0])
    bare = re.sub(r"^(?:both |all )?(?:the )?| ?cam(?:era)?s?$", "", words)
    names: list[str] = []
    for part in re.split(r",? and |, ", bare):
        part = re.sub(r" ?cam(?:era)?s?$", "", part.removeprefix("the "))
        found = [name for name in known if _same(part, name)]
        several = words.startswith(("both", "all")) or words.endswith("s")
        if not found and several:
            found = [name for name in known if set(part.split()) <= set(name.lower().split("_"))]
        if not found:
            raise refuse(f"no camera is called {part!r}; there are: {', '.join(known)}")
        names += found
    chosen = names[0] if len(names) == 1 else names
    return chosen, Mention(kind="camera", cameras=chosen)


def _same(words: str, name: str) -> bool:
    plain = name.lower().replace("-", "_")
    return re.sub("[ -]", "_", words) in (
        plain,
        plain.removesuffix("_camera"),
        plain.removesuffix("_rgb"),
    )


Term = tuple[tuple[int, int, int], str | None, str | None]
"""A direction along the camera's axes, and the words for how far."""


def _terms(text: str) -> list[Term]:
    """Direction, length and amount of each part of a motion."""
    out = []
    for part in re.findall(TERM, text):
        far = re.search(slots.LENGTH, part)
        amount = re.search(rf"\b{AMOUNT}\b", part)
        words = part.replace(far.group(), " ") if far else part
        found = [
            d for d in sorted(DIRECTIONS, key=len, reverse=True) if re.search(rf"\b{d}\b", words)
        ]
        # "further left" is to the left; "further" alone is back.
        way = next((d for d in found if d not in ("further", "farther")), found[0])
        out.append(
            (DIRECTIONS[way], far.group() if far else None, amount.group() if amount else None)
        )
    return out


def _shifted(stated: Said, terms: list[Term]) -> Meant:
    names, mention = cameras(stated)
    by, notes = [0.0, 0.0, 0.0], []
    for direction, far, amount in terms:
        metres = slots.length(far) if far else _usual(names) * AMOUNTS.get(amount or "", 1.0)
        if not far:
            notes.append(f"{100 * metres:g} cm, since no length was named")
        by = [slots.rounded(was + metres * part) for was, part in zip(by, direction, strict=True)]
    edit = {"op": "camera_pose", "camera": names, "by": [value or 0 for value in by]}
    return done(edit, mention=mention, notes=tuple(notes))


def _usual(names: str | list[str]) -> float:
    """Metres that a camera is moved where none were named: little for one that is carried close to things."""
    every = [names] if isinstance(names, str) else names
    carried = any(word in name.lower() for name in every for word in ("wrist", "hand", "gripper"))
    return WRIST_STEP if carried else STEP
