"""Rules for things that are there: taken out, copied, moved, resized, rearranged, simulated."""
# ruff: noqa: E501  # patterns are easiest to read whole

import re

from rpaug import registry
from rpaug.agents import slots
from rpaug.agents.grammar import NotThis, Said, done, refuse, rule
from rpaug.agents.grounding import thing, things
from rpaug.agents.messages import Entry, Meant, Mention

REMOVE = r"(?:remove|delete|erase|get rid of|take away|take out|eliminate|hide|discard|clear away)"
BIGGER, SMALLER = (1.1, 1.25), (0.75, 0.9)
LARGER = r"(?:bigger|larger|greater)"
ABOUT = r"(?: about (?:its|the) (?P<about>grasp|support|foot))?"
# Ahead of the robot and to its left, by the words for it.
WAYS = {
    **dict.fromkeys(("to the left", "left", "leftwards", "to the robot's left"), (0, 1)),
    **dict.fromkeys(("to the right", "right", "rightwards", "to the robot's right"), (0, -1)),
    **dict.fromkeys(("away", "away from the robot", "farther away", "further away", "ahead"), (1, 0)),
    **dict.fromkeys(("towards the robot", "toward the robot", "closer to the robot", "closer", "nearer"), (-1, 0)),
}  # fmt: skip
WAY = slots.any_of(WAYS)
MATERIALS = ("rubber", "cloth", "foam", "sand", "jelly", "wood", "metal", "ceramic")
MATERIAL = rf"(?:a |an )?(?P<material>{'|'.join(MATERIALS)})"


@rule(rf"{REMOVE} {{thing}}(?: (?:out of|from|off) (?:the )?(?:scene|table|picture|image|images|desk))?",
      r"take {thing} (?:away|out|out of the scene|off the table|from the table|off the desk)",
      r"{thing} (?:should|must|shall) (?:disappear|vanish|go|be gone|be removed|go away)",
      r"make {thing} (?:disappear|vanish|go away)")  # fmt: skip
def remove(said: Said) -> Meant:
    return done(*({"op": "remove", "target": one} for one in things(said)))


@rule(r"(?:duplicate|copy|clone|replicate|double) {thing}(?: (?P<times>once|twice|{number} times))?",
      r"(?:make|add|create|put) {number} (?:copies|copy|duplicates|duplicate|clones|clone) of {thing}(?: on the table)?",
      r"(?:add|put|make|place) {number} more of {thing}(?: on the table)?")  # fmt: skip
def duplicate(said: Said) -> Meant:
    where = thing(said)
    times = {"once": 1, "twice": 2}.get(said.get("times") or "")
    if times is None:
        times = slots.count(said["number"]) if said.get("number") else 1
    if times > 20:
        raise refuse(f"{times} copies are too many: at most 20")
    count: Entry = {"count": times} if times > 1 else {}
    return done(
        {"op": "duplicate", "target": where, **count}, mention=Mention(kind="target", target=where)
    )


MOVE = r"(?:move|shift|push|pull|slide|put|place|set|bring|displace|relocate)"


@rule(rf"{MOVE} {{thing}} (?:by )?{{length}} (?:further |farther )?(?P<way>{WAY})",
      rf"{MOVE} {{thing}} (?:further |farther )?(?P<way>{WAY}) (?:by )?{{length}}")  # fmt: skip
def moved(said: Said) -> Meant:
    ahead, left = WAYS[said["way"]]
    far = slots.length(said["length"])
    return _move(said, {"by": [slots.rounded(ahead * far) or 0, slots.rounded(left * far) or 0]})


@rule(rf"{MOVE} {{thing}} (?:to|at) {{point}}",
      rf"{MOVE} {{thing}} (?:near|next to|beside|close to) {{other}}",
      rf"{MOVE} {{thing}} (?:within|to within) {{length}} of {{other}}")  # fmt: skip
def placed(said: Said) -> Meant:
    if said.get("point"):
        return _move(said, {"to": slots.numbers(said["point"])})
    fields: Entry = {"near": thing(said, "other")}
    if said.get("length"):
        fields["within"] = slots.length(said["length"])
    return _move(said, fields)


@rule(rf"{MOVE} {{thing}} (?:by )?<UP_TO> {{length}}",
      r"move {thing}(?: (?:around|a bit|randomly|elsewhere|somewhere else|somewhere))?",
      rf"{MOVE} {{thing}} (?:somewhere else|elsewhere|in another place|to another place|somewhere random)",
      r"(?:vary|randomi[sz]e|change|jitter) the (?:position|place|location) of {thing}(?: by <UP_TO> {length})?",
      r"relocate {thing}")  # fmt: skip
def anywhere(said: Said) -> Meant:
    far = said.get("length")
    return _move(said, {"shift": slots.length(far)} if far else {})


@rule(
    rf"{MOVE} {{thing}} (?:(?:by )?{{length}} )?(?:forward|forwards|back|backwards|up|down)(?: (?:by )?{slots.LENGTH})?"
)
def which_way(said: Said) -> Meant:
    thing(said)
    raise refuse(
        "say `away from the robot`, `towards the robot`, `to the left` or `to the right`; things stay on the table"
    )


@rule(rf"{MOVE} {{thing}} (?P<way>{WAY})")
def how_far(said: Said) -> Meant:
    thing(said)
    raise refuse("how far? say a length, such as 5 cm")


@rule(r"(?:rotate|turn|spin) {thing}(?: (?:by )?(?:<UP_TO> )?{angle})?")
def rotated(said: Said) -> Meant:
    thing(said)
    raise refuse("things turn only as they are moved: `move` it, which turns it by up to 0.5 rad")


OTHERS = (
    r"(?:everything(?: else)?|the (?:loose )?(?:objects|things|clutter|items)|all (?:the )?(?:objects|things)|"
    r"the other (?:objects|things)|what lies around|objects|things)(?: (?:on|around) the (?:table|desk))?"
)
SPREAD = r"(?:rearrange|shuffle|scatter|spread(?: out)?|mix up|reorder)"


@rule(
    rf"{SPREAD} {OTHERS}(?: (?:by )?<UP_TO> {{length}})?",
    rf"{SPREAD} {{thing}}(?: (?:by )?<UP_TO> {{length}})?",
)
def spread(said: Said) -> Meant:
    edit: Entry = {"op": "spread"}
    if said.get("thing"):
        edit["targets"] = things(said)
    if said.get("length"):
        edit["shift"] = slots.length(said["length"])
    return done(edit)


@rule(rf"(?:make|render) {{thing}} (?:(?:a bit|a little|slightly|much) )?(?P<way>{LARGER}|smaller){ABOUT}",
      rf"(?P<way>enlarge|grow|shrink) {{thing}}{ABOUT}")  # fmt: skip
def resized(said: Said) -> Meant:
    low, high = SMALLER if said["way"] in ("smaller", "shrink") else BIGGER
    return _scale(
        said,
        low,
        high,
        (f"between {low:g} and {high:g} times its size, since no factor was named",),
    )


@rule(rf"(?:make|render) {{thing}} (?:by )?{{share}} (?P<way>{LARGER}|smaller){ABOUT}",
      rf"(?:make|render) {{thing}} (?P<way>{LARGER}|smaller) by {{share}}{ABOUT}",
      rf"(?P<way>enlarge|grow|shrink|increase|reduce) (?:the size of )?{{thing}}(?:'s size)? by {{share}}{ABOUT}")  # fmt: skip
def resized_by(said: Said) -> Meant:
    part = slots.share(said["share"])
    factor = slots.rounded(1 - part if said["way"] in ("smaller", "shrink", "reduce") else 1 + part)
    return _scale(said, factor, factor)


@rule(rf"make {{thing}} (?P<times>twice|half|{{number}} times) (?:as (?:large|big)|its (?:own )?size|the size|larger|bigger){ABOUT}",
      rf"(?:scale|resize|enlarge|multiply) {{thing}} by (?:a factor of )?{{low}}(?: times)?{ABOUT}",
      rf"(?P<times>double|halve) the size of {{thing}}{ABOUT}",
      rf"(?:scale|resize|vary the size of) {{thing}} (?:by |by a factor )?(?:between|from) {{low}} (?:and|to) {{high}}(?: times)?{ABOUT}")  # fmt: skip
def scaled(said: Said) -> Meant:
    if said.get("low"):
        low = slots.numbers(said["low"])[0]
        return _scale(said, low, slots.numbers(said.get("high") or said["low"])[0])
    fixed = {"twice": 2, "half": 0.5, "double": 2, "halve": 0.5}
    factor = fixed.get(said["times"]) or slots.number(said["number"])
    return _scale(said, factor, factor)


@rule(rf"(?:vary|randomi[sz]e|change|jitter) the size of {{thing}}{ABOUT}",
      rf"(?:resize|rescale) {{thing}}{ABOUT}", rf"(?:a )?(?:random|different) size for {{thing}}{ABOUT}")  # fmt: skip
def any_size(said: Said) -> Meant:
    return _scale(said, None, None)


@rule(rf"make {{thing}} {slots.LENGTH} (?:tall|high|wide|long|large|big|deep)")
def absolute(said: Said) -> Meant:
    thing(said)
    raise refuse("sizes are factors of the recorded one: say `20% larger`, or `half its size`")


@rule(rf"(?:make|let) {{thing}} (?:behave|act|move|fall|deform|bend) (?:like|as) {MATERIAL}",
      rf"turn {{thing}} into {MATERIAL}", rf"(?:simulate|treat) {{thing}} as {MATERIAL}",
      r"make {thing} (?:out )?of (?P<material>rubber|foam|sand|jelly|cloth)",
      rf"(?:drop|let) {{thing}} (?:fall )?from {{length}} (?:like|as|made of) {MATERIAL}")  # fmt: skip
def physics(said: Said) -> Meant:
    if "physics" not in registry.operator_names():
        raise refuse("this installation has no operator `physics`")
    fields: Entry = {"material": said["material"]}
    if said.get("length"):
        fields["height"] = [slots.length(said["length"])] * 2
    return done(*({"op": "physics", "target": one, **fields} for one in things(said)))


@rule(
    r"(?:drop|let) {thing} (?:fall )?from {length}",
    r"(?:drop|let) {thing} fall",
    r"simulate {thing}",
)
def of_what(said: Said) -> Meant:
    thing(said)
    raise refuse(f"what is it made of? add `like` one of {', '.join(MATERIALS)}")


def _scale(said: Said, low: float | None, high: float | None, notes: tuple[str, ...] = ()) -> Meant:
    edit: Entry = {"op": "object_size"}
    if low is not None and high is not None:
        if not 0.1 <= low <= high <= 10:
            raise refuse(f"{low:g} to {high:g} times its size: factors are within 0.1..10")
        edit["range"] = [low, high]
    if said.get("about"):
        edit["about"] = re.sub("foot", "support", said["about"])
    where = things(said)
    head, tail = {"op": edit.pop("op")}, edit
    mention = Mention(kind="target", target=where[0]) if len(where) == 1 else None
    return done(*({**head, "target": one, **tail} for one in where), mention=mention, notes=notes)


def _move(said: Said, fields: Entry) -> Meant:
    if re.match(r"(?:an?|another|some) ", said["thing"]):
        raise NotThis  # "put a mug next to the plate" is about a new one
    where = things(said)
    if len(where) > 1 and fields.keys() & {"to"}:
        raise refuse("two things cannot stand at one place")
    mention = Mention(kind="target", target=where[0]) if len(where) == 1 else None
    return done(*({"op": "move", "target": one, **fields} for one in where), mention=mention)
