"""Rules for things that are there: taken out, copied, moved, resized, rearranged, simulated."""
# ruff: noqa: E501  # patterns are easiest to read whole

import re

from rpaug.core import registry
from rpaug.language import slots
from rpaug.language.grammar import NotThis, Said, done, refuse, rule
from rpaug.language.grounding import thing, things
from rpaug.language.messages import Entry, Meant, Mention

BIGGER, SMALLER = (1.1, 1.25), (0.75, 0.9)
LARGER = r"(?:bigger|larger|greater|taller and wider)"
SMALL = r"(?:smaller|tinier|less big|littler)"
GROW = r"(?:enlarge|grow|increase|expand|magnify|inflate|upscale|blow up|bump up|scale up|size up)"
SHRINK = r"(?:shrink|reduce|decrease|downscale|downsize|scale down|size down|minify|miniaturi[sz]e)"
SIZED = r"(?:(?:the )?(?:size|scale|dimensions) of {thing}|{thing}(?:(?:'s|') (?:size|scale|dimensions))?)"
ABOUT = r"(?: about (?:its|the) (?P<about>grasp|support|foot))?"
# Ahead of the robot and to its left, by the words for it.
WAYS = {
    **dict.fromkeys(("to the left", "left", "leftwards", "leftward", "to the robot's left", "to its left", "to the robot's own left"), (0, 1)),
    **dict.fromkeys(("to the right", "right", "rightwards", "rightward", "to the robot's right", "to its right", "to the robot's own right"), (0, -1)),
    **dict.fromkeys(("away", "away from the robot", "farther away", "further away", "ahead", "farther away from the robot", "further away from the robot",
                     "farther from the robot", "further from the robot", "away from the arm", "from the robot"), (1, 0)),
    **dict.fromkeys(("towards the robot", "toward the robot", "closer to the robot", "closer", "nearer", "nearer to the robot", "towards the arm",
                     "closer to the arm", "to the robot", "in the direction of the robot"), (-1, 0)),
}  # fmt: skip
WAY = slots.any_of(WAYS)
MATERIALS = ("rubber", "cloth", "foam", "sand", "jelly", "wood", "metal", "ceramic")
MATERIAL = rf"(?:a |an |some )?(?:piece of |block of |lump of )?(?P<material>{'|'.join(MATERIALS)})"
LIKE = r"(?:like|as|as if made of|made of|as if it were|as if it were made of|behaving like|as though made of)"
HERE = r"(?: (?:on|onto|to) (?:the )?(?:table|scene|desk|tabletop))?"
FROM_HERE = r"(?: (?:out of|from|off) (?:the )?(?:scene|table|picture|pictures|image|images|desk|view|tabletop|workspace|counter))?"
BESIDE = r"(?:(?:over |down |somewhere |right |to )*(?:near|next to|beside|close to|by|alongside|near to|closer to|nearer to|adjacent to))"
ANY_WAY = (
    r"(?: (?:in any direction|either way|any way|in a random direction|from where it (?:is|was)))?"
)


@rule(rf"<REMOVE> {{thing}}{FROM_HERE}",
      rf"(?:take|throw|toss|cut|edit|clear|strip|get|paint|chuck) {{thing}} (?:away|out){FROM_HERE}",
      rf"(?:take|clear|wipe|get|pull|edit|cut) {{thing}}{FROM_HERE.removesuffix('?')}",
      r"(?:make|let) {thing} (?:disappear|vanish|go away|invisible)")  # fmt: skip
def remove(stated: Said) -> Meant:
    return done(*({"op": "remove", "target": one} for one in things(stated)))


@rule(r"(?:duplicate|copy|clone|replicate|double|multiply) {thing}(?:,? (?P<times>once|twice|thrice|{number} times|{number}x))?",
      rf"(?:(?:<ADD>|make|give me|have|produce) )?{{number}} more of {{thing}}{HERE}", rf"(?:(?:<ADD>|make|give me|have|produce) )?{{number}} (?:more |extra |additional |further |exact |identical )?(?:copies|copy|duplicates|duplicate|clones|clone|replicas|replica|twins|twin) of {{thing}}{HERE}",
      rf"(?:<ADD>|make|have) another (?:one |copy )?of {{thing}}{HERE}")  # fmt: skip
def duplicate(stated: Said) -> Meant:
    where = thing(stated)
    times = {"once": 1, "twice": 2, "thrice": 3}.get(stated.get("times") or "")
    if times is None:
        times = slots.count(stated["number"]) if stated.get("number") else 1
    if times > 20:
        raise refuse(f"{times} copies are too many: at most 20")
    count: Entry = {"count": times} if times > 1 else {}
    return done(
        {"op": "duplicate", "target": where, **count}, mention=Mention(kind="target", target=where)
    )


@rule(rf"<PUT> {{thing}} (?:by )?{{length}} (?:further |farther |over )?(?P<way>{WAY})",
      rf"<PUT> {{thing}} (?:further |farther |over )?(?P<way>{WAY})(?: by|,)? {{length}}",
      rf"{{thing}} (?:goes |by )?{{length}} (?:further |farther )?(?P<way>{WAY})",
      rf"<PUT> {{thing}} (?:by )?{{length}} (?:further |farther )?(?P<way>{WAY}),? and (?:by )?{{least}} (?:further |farther )?(?P<then>{WAY})")  # fmt: skip
def moved(stated: Said) -> Meant:
    by = [0.0, 0.0]
    for way, far in (("way", "length"), ("then", "least")):
        if stated.get(way):
            metres = slots.length(stated[far])
            by = [was + metres * part for was, part in zip(by, WAYS[stated[way]], strict=True)]
    return _move(stated, {"by": [slots.rounded(value) or 0 for value in by]})


@rule(r"<PUT> {thing} (?:over )?(?:to|at|onto) (?:position |the position |point |the point |coordinates |the coordinates |location |the location |place )?{point}",
      r"<PUT> {thing} (?:within|to within|at most|no more than|no farther than|no further than) {length} (?:of|from|away from) {other}",
      rf"<PUT> {{thing}} {BESIDE} {{other}},? (?:within|at most|no more than|no farther than|no further than|up to) {{length}}(?: away| from it| of it)?",
      rf"<PUT> {{thing}} {BESIDE} {{other}}")  # fmt: skip
def placed(stated: Said) -> Meant:
    if stated.get("point"):
        return _move(stated, {"to": slots.numbers(stated["point"])})
    fields: Entry = {"near": thing(stated, "other")}
    if stated.get("length"):
        fields["within"] = slots.length(stated["length"])
    return _move(stated, fields)


@rule(rf"(?:<PUT>|<SHAKE>) {{thing}}(?:'s (?:position|place|location))?(?: around| about| anywhere| somewhere| in any direction)?,? (?:by )?<UP_TO> {{length}}{ANY_WAY}",
      r"(?:move|shift|displace|nudge|jiggle|jitter|relocate|reposition) {thing}(?: (?:around|about|a bit|a little|slightly|randomly|elsewhere|somewhere else|somewhere))?",
      r"<PUT> {thing} (?:somewhere else|elsewhere|anywhere|(?:in|to|at) (?:another|a random|a different|some other|a new) (?:place|position|spot|location)|somewhere random|somewhere different|randomly)",
      rf"<VARY> (?:the )?(?:position|place|location|placement|whereabouts) of {{thing}}(?:,? (?:by )?<UP_TO> {{length}}{ANY_WAY})?",
      rf"(?:<VARY> )?where {{thing}} (?:is|are|stands?|sits?|lies?|starts?)(?:,? (?:by )?<UP_TO> {{length}}{ANY_WAY})?",
      rf"<VARY> {{thing}}'s (?:position|place|location|placement)(?:,? (?:by )?<UP_TO> {{length}}{ANY_WAY})?",
      r"(?:a |use a )?(?:random|different|new|another) (?:place|position|location|spot) for {thing}",
      r"give {thing} (?:a )?(?:random|different|new|another) (?:place|position|location|spot)")  # fmt: skip
def anywhere(stated: Said) -> Meant:
    far = stated.get("length")
    return _move(stated, {"shift": slots.length(far)} if far else {})


@rule(
    rf"<PUT> {{thing}} (?:(?:by )?{{length}} )?(?:forward|forwards|back|backwards|up|down)(?: (?:by )?{slots.LENGTH})?"
)
def which_way(stated: Said) -> Meant:
    thing(stated)
    raise refuse(
        "say `away from the robot`, `towards the robot`, `to the left` or `to the right`; things stay on the table"
    )


@rule(rf"<PUT> {{thing}} (?P<way>{WAY})")
def how_far(stated: Said) -> Meant:
    thing(stated)
    raise refuse("how far? say a length, such as 5 cm")


@rule(r"(?:rotate|turn|spin) {thing}(?: (?:by )?(?:<UP_TO> )?{angle})?")
def rotated(stated: Said) -> Meant:
    thing(stated)
    raise refuse("things turn only as they are moved: `move` it, which turns it by up to 0.5 rad")


OTHERS = (
    r"(?:everything(?: else)?|the (?:loose )?(?:objects|things|clutter|items)|all (?:the )?(?:objects|things)|"
    r"the other (?:objects|things|items)|other objects|other things|what lies around|what is loose|whatever is loose|all loose (?:objects|things)|loose (?:objects|things)|objects|things|the scene|the layout|the arrangement)"
    r"(?: (?:that is |that are |lying |standing )?(?:on|around|across|over) the (?:table|desk|tabletop|counter))?"
)
SPREAD = r"(?:rearrange|re-arrange|shuffle|reshuffle|scatter|spread(?: out)?|mix up|reorder|re-order|jumble|jumble up|disarrange|redistribute|mess up|shake up|permute|randomi[sz]e (?:the )?(?:layout|arrangement|positions|places|placement) of|move around)"
AROUND = r"(?: (?:around|about|up|out|anew|apart|again|over the table|across the table|on the table|around the table|about the table))?"


@rule(
    rf"{SPREAD} {OTHERS}{AROUND}(?:,? (?:by )?<UP_TO> {{length}}{ANY_WAY})?",
    rf"(?:move|shift|mix|push|shake|jumble|spread|scatter) {OTHERS} (?:around|about|up|out|apart)(?:,? (?:by )?<UP_TO> {{length}}{ANY_WAY})?",
    r"<VARY> the (?:layout|arrangement)(?: of (?:the )?(?:table|scene|objects|things|everything))?",
    rf"{SPREAD} {{thing}}{AROUND}(?:,? (?:by )?<UP_TO> {{length}}{ANY_WAY})?",
)
def spread(stated: Said) -> Meant:
    edit: Entry = {"op": "spread"}
    if stated.get("thing"):
        edit["targets"] = things(stated)
    if stated.get("length"):
        edit["shift"] = slots.length(stated["length"])
    return done(edit)


@rule(rf"(?:make|render|turn|get) {{thing}} (?:(?:a bit|a little|a little bit|slightly|much|somewhat) )?(?:{LARGER}|(?P<less>{SMALL})){ABOUT}",
      rf"(?:enlarge|grow|magnify|inflate|upscale|blow up|scale up|(?P<less>shrink|downscale|downsize|scale down|miniaturi[sz]e)) {{thing}}(?: (?:a bit|a little|slightly|somewhat))?{ABOUT}",
      rf"(?:scale|size|blow) {{thing}} (?:up|(?P<less>down)){ABOUT}",
      rf"(?:increase|(?P<less>reduce|decrease)) (?:the )?(?:size|scale|dimensions) of {{thing}}{ABOUT}",
      rf"(?:increase|(?P<less>reduce|decrease)) {{thing}}'s (?:size|scale|dimensions){ABOUT}")  # fmt: skip
def resized(stated: Said) -> Meant:
    low, high = SMALLER if stated.get("less") else BIGGER
    return _scale(
        stated,
        low,
        high,
        (f"between {low:g} and {high:g} times its size, since no factor was named",),
    )


@rule(rf"(?:(?:make|render|scale|turn|get) )?{{thing}} (?:by )?{{share}} (?:{LARGER}|up|(?P<less>{SMALL}|down)){ABOUT}",
      rf"(?:make|render|scale|turn|get) {{thing}} (?:{LARGER}|up|(?P<less>{SMALL}|down)) (?:by )?{{share}}{ABOUT}",
      rf"(?:{GROW}|(?P<less>{SHRINK})) {SIZED}(?: in size)? by {{share}}{ABOUT}",
      rf"(?:{GROW}|(?P<less>{SHRINK})) {{thing}} {{share}}{ABOUT}")  # fmt: skip
def resized_by(stated: Said) -> Meant:
    part = slots.share(stated["share"])
    factor = slots.rounded(1 - part if stated.get("less") else 1 + part)
    return _scale(stated, factor, factor)


@rule(rf"(?:(?:make|scale|render|resize) )?{{thing}} (?:to )?(?P<times>twice|half|{{number}} times) (?:as (?:large|big)|(?:of )?(?:its|their) (?:own |current |original |recorded )?(?:size|scale)|the (?:original |recorded |current )?(?:size|scale)|larger|bigger){ABOUT}",
      rf"(?:scale|resize|enlarge|multiply|grow|upscale|magnify|scale up|shrink|downscale|scale down) {SIZED}(?: up| down)? (?:by|to|with) (?:a )?(?:factor (?:of )?)?(?P<low>{slots.NUMBER})(?: ?(?:times|x|×))?(?: its size)?{ABOUT}",
      rf"(?:scale|resize) {{thing}} (?:up |down )?(?P<low>{slots.NUMBER}) ?(?:times|x|×){ABOUT}",
      rf"(?:scale|resize|shrink|enlarge|grow|reduce|bring) {SIZED} to {{share}}(?: (?:of )?(?:its|the) (?:own |original |recorded |current )?size)?{ABOUT}",
      rf"(?P<times>double|halve|triple) {SIZED} in size{ABOUT}", rf"(?P<times>double|halve|triple) (?:the )?(?:size|scale|dimensions) of {{thing}}{ABOUT}", rf"(?P<times>double|halve|triple) {{thing}}'s (?:size|scale|dimensions){ABOUT}",
      rf"(?:scale|resize|rescale|<VARY>) {SIZED} (?:by |by a factor |by a factor of |to )?(?:anywhere |anything |somewhere )?(?:between|from) {{low}}(?: times)? (?:and|to) {{high}}(?: times| x)?(?: (?:of )?(?:its|the) (?:own |original |recorded )?size)?{ABOUT}",
      rf"(?:make|scale|render) {{thing}} (?:between|from) {{low}} (?:and|to) {{high}} times (?:as (?:large|big)|its (?:own |original |recorded )?size|the size){ABOUT}")  # fmt: skip
def scaled(stated: Said) -> Meant:
    if stated.get("low"):
        low, high = slots.number(stated["low"]), slots.number(stated.get("high") or stated["low"])
        return _scale(stated, low, high)
    if stated.get("share"):
        return _scale(stated, slots.share(stated["share"]), slots.share(stated["share"]))
    fixed = {"twice": 2, "half": 0.5, "double": 2, "halve": 0.5, "triple": 3}
    factor = fixed.get(stated["times"]) or slots.number(stated["number"])
    return _scale(stated, factor, factor)


@rule(rf"(?:<VARY>|resize|rescale) (?:the )?(?:size|scale|dimensions) of {{thing}}(?: (?:a bit|a little|slightly))?{ABOUT}",
      rf"<VARY> {{thing}}'s (?:size|scale|dimensions)(?: (?:a bit|a little|slightly))?{ABOUT}", rf"(?:vary|randomi[sz]e|change|alter) how (?:big|large) {{thing}} (?:is|are){ABOUT}",
      rf"(?:resize|rescale) {{thing}}(?: (?:a bit|a little|slightly))?{ABOUT}", rf"(?:a |use a )?(?:random|different|new|another) size for {{thing}}{ABOUT}",
      rf"give {{thing}} (?:a )?(?:random|different|new|another) size{ABOUT}")  # fmt: skip
def any_size(stated: Said) -> Meant:
    return _scale(stated, None, None)


@rule(rf"make {{thing}} {slots.LENGTH} (?:tall|high|wide|long|large|big|deep)")
def absolute(stated: Said) -> Meant:
    thing(stated)
    raise refuse("sizes are factors of the recorded one: say `20% larger`, or `half its size`")


@rule(rf"(?:make|let|have) {{thing}} (?:(?:physically )?(?:behave|act|move|fall|deform|bend|respond|react|bounce|wobble|collapse)) (?:(?:just )?like|as|as if (?:it were |it was )?(?:made )?(?:out )?(?:of )?) ?(?:if )?(?:it (?:were|was) )?(?:made )?(?:of )?{MATERIAL}",
      rf"(?:turn|change|convert) {{thing}} (?:in)?to {MATERIAL}", rf"(?:simulate|treat|model) {{thing}}(?:'s physics)? (?:as|like|as if made of|as being|with) {MATERIAL}(?: physics)?",
      r"make {thing} (?:(?:be )?(?:made )?(?:out )?of )?(?P<material>rubber|foam|sand|jelly|cloth)",
      rf"give {{thing}} (?:the )?(?:physics|behaviou?r|mechanics|material) of {MATERIAL}", rf"give {{thing}} {MATERIAL} (?:physics|behaviou?r|mechanics)",
      rf"(?:drop|let) {{thing}} (?:fall |drop )?(?:down )?(?:from )?(?:a height of |anywhere |a height )?between {{length}} and {{least}}(?: up| high| above the table)?,? {LIKE} {MATERIAL}",
      rf"(?:drop|let) {{thing}} (?:fall |drop )?{LIKE} {MATERIAL},? (?:down )?(?:from )?(?:a height of |anywhere |a height )?between {{length}} and {{least}}(?: up| high| above the table)?",
      rf"(?:drop|let) {{thing}} (?:fall |drop )?(?:down )?(?:from )?(?:a height of )?{{length}}(?: up| high| above the table)?,? {LIKE} {MATERIAL}",
      rf"(?:drop|let) {{thing}} (?:fall )?{LIKE} {MATERIAL},? (?:down )?from (?:a height of )?{{length}}(?: up| high| above the table)?")  # fmt: skip
def physics(stated: Said) -> Meant:
    if "physics" not in registry.operator_names():
        raise refuse("this installation has no operator `physics`")
    where = things(stated)
    for one in where:
        if isinstance(one, dict) and one.get("role") in ("table", "background", "robot"):
            raise refuse(f"the {one['role']} is not simulated, only things that stand on the table")
    fields: Entry = {"material": stated["material"]}
    if stated.get("length"):
        low = slots.length(stated["length"])
        fields["height"] = [low, slots.length(stated["least"]) if stated.get("least") else low]
    return done(*({"op": "physics", "target": one, **fields} for one in where))


@rule(
    r"(?:drop|let) {thing} (?:fall )?from {length}",
    r"(?:drop|let) {thing} fall",
    r"simulate {thing}",
)
def of_what(stated: Said) -> Meant:
    thing(stated)
    raise refuse(f"what is it made of? add `like` one of {', '.join(MATERIALS)}")


def _scale(
    stated: Said, low: float | None, high: float | None, notes: tuple[str, ...] = ()
) -> Meant:
    edit: Entry = {"op": "object_size"}
    if low is not None and high is not None:
        if not 0.1 <= low <= high <= 10:
            raise refuse(f"{low:g} to {high:g} times its size: factors are within 0.1..10")
        edit["range"] = [low, high]
    if stated.get("about"):
        edit["about"] = re.sub("foot", "support", stated["about"])
    where = things(stated)
    head, tail = {"op": edit.pop("op")}, edit
    mention = Mention(kind="target", target=where[0]) if len(where) == 1 else None
    return done(*({**head, "target": one, **tail} for one in where), mention=mention, notes=notes)


def _move(stated: Said, fields: Entry) -> Meant:
    if re.match(r"(?:an?|another|some) ", stated["thing"]):
        raise NotThis  # "put a mug next to the plate" is about a new one
    where = things(stated)
    if len(where) > 1 and fields.keys() & {"to"}:
        raise refuse("two things cannot stand at one place")
    mention = Mention(kind="target", target=where[0]) if len(where) == 1 else None
    return done(*({"op": "move", "target": one, **fields} for one in where), mention=mention)
