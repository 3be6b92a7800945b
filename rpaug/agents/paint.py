"""Rules for colours, textures and styles."""
# ruff: noqa: E501  # patterns are easiest to read whole

import re

from rpaug.agents import slots
from rpaug.agents.grammar import NotThis, Said, done, refuse, rule
from rpaug.agents.grounding import Target, thing, things
from rpaug.agents.messages import Entry, Meant, Mention
from rpaug.textures import shipped

TABLE, BACKGROUND = {"role": "table"}, {"role": "background"}
DARKER, LIGHTER = 0.6, 0.4  # of a colour's rgb; of its way to white
KINDS = {
    **dict.fromkeys(("wood", "wooden", "timber"), "wood"),
    **dict.fromkeys(("stone", "rock", "rocky"), "stone"),
    **dict.fromkeys(("fabric", "cloth", "textile"), "fabric"),
    **dict.fromkeys(("checker", "checkered", "chequered", "checked", "checkerboard"), "checker"),
    **dict.fromkeys(("noise", "noisy"), "noise"),
}
PAINT = r"(?:make|paint|re-?colou?r|colou?r|turn|dye|tint|render|change|set)"
LAY = r"(?:put|lay|add|use|apply)"


@rule(rf"{PAINT} {{thing}} (?:(?:to|to be|into|in|with) )?{{colour}}(?P<contrast>,? (?:and )?not {slots.ONE_COLOUR})?",
      r"(?:change|set|turn|vary|randomi[sz]e) the colou?r of {thing} (?:to|into) {colour}",
      r"(?:change|set|turn) {thing}(?:'s)? colou?r (?:to|into) {colour}",
      r"give {thing} (?:a |an )?{colour}",
      r"{thing} (?:should|must|shall) (?:be|become|turn) {colour}",
      rf"{PAINT} {{thing}} {{colour}} instead(?: of {slots.ONE_COLOUR})?")  # fmt: skip
def recolour(said: Said) -> Meant:
    tint = slots.colour(said["colour"])
    where = things(said)
    if tint == {"sample": "colosseum"} and where == [TABLE]:
        return done({"op": "table_color"}, mention=Mention(kind="target", target=TABLE))
    return _each(where, {"op": "recolor", "color": tint}, "target", ("color",))


@rule(r"(?:vary|randomi[sz]e|change|jitter) the colou?r of {thing}",
      r"(?:vary|randomi[sz]e|change|jitter) {thing}(?:'s)? colou?r",
      r"(?:vary|randomi[sz]e|change|jitter) the {thing}(?:'s)? colou?r",
      r"(?:a )?(?:random|new|different|another) colou?r (?:for|on) {thing}")  # fmt: skip
def any_colour(said: Said) -> Meant:
    return recolour(Said({**said.slots, "colour": "a random color"}, said.wish))


@rule(rf"{PAINT} {{thing}} (?P<one>{slots.ONE_COLOUR})(?P<more>(?:,? or {slots.ONE_COLOUR})+)")
def one_of_colours(said: Said) -> Meant:
    where = thing(said)
    tints = [said["one"], *re.split(r",? or ", said["more"])[1:]]
    options = [{"op": "recolor", "target": where, "color": slots.colour(tint)} for tint in tints]
    return done({"one_of": options}, mention=Mention(kind="target", target=where))


@rule(
    r"(?:make|paint|turn) {thing} (?:(?:a bit|a little|slightly|much|even) )?(?P<way>darker|lighter|brighter)(?: still)?"
)
def shade(said: Said) -> Meant:
    where, notes = _shaded(said)
    for number, edit in reversed(list(enumerate(said.wish.edits))):
        if edit.get("op") == "recolor" and edit["target"] == where:
            dark = said["way"] == "darker"
            tint = edit["color"]
            values = slots.darker(tint, DARKER) if dark else slots.lighter(tint, LIGHTER)
            return done(
                {**edit, "color": {"rgb": values}},
                mention=Mention(kind="target", target=where),
                notes=notes,
                replaces=(number,),
            )
    raise refuse(
        f"{said['way']} than what? Only a colour that was asked for before has a {said['way']} one: name a colour"
    )


def _shaded(said: Said) -> tuple[Target, tuple[str, ...]]:
    """What is to be darker or lighter. "it" may be the one thing that was painted, if it was not named last."""
    mention, painted = (
        said.wish.mention,
        [e["target"] for e in said.wish.edits if e.get("op") == "recolor"],
    )
    unclear = said["thing"] == "it" and (mention is None or mention.kind in ("camera", "new"))
    if unclear and len(painted) == 1:
        return painted[0], (f"'it' is taken to mean what was painted: {painted[0]}",)
    return thing(said), ()


@rule(r"(?:give|gave) {thing} (?:a |an |the )?(?:random |new )?{texture}(?: texture| pattern| surface| finish| look)",
      r"(?:cover|wrap|texture|retexture|line|coat) {thing} (?:with|in|as) (?:a |an |the )?{texture}(?: texture| pattern| surface)?"
      r"(?:,? {length} wide)?",
      rf"{LAY} (?:a |an |the )?{{texture}}(?: texture| pattern| surface) (?:on|onto|to|over) {{thing}}(?:,? {{length}} wide)?",
      r"(?:a |an )?{texture}(?: texture| pattern) (?:for|on) {thing}(?:,? {length} wide)?",
      r"lay {texture} (?:on|onto|over) {thing}(?:,? {length} wide)?",
      r"make {thing} (?:look like|of|out of) {texture}",
      r"make {thing} (?P<kind>wooden|checkered|chequered|rocky)",
      r"(?:change|vary|randomi[sz]e|replace) the texture of {thing}",
      r"(?:change|vary|randomi[sz]e|replace) (?:the )?{thing}(?:'s)? texture",
      r"(?:retexture|texture) {thing}")  # fmt: skip
def texture(said: Said) -> Meant:
    where = things(said)
    words = said.get("texture") or said.get("kind")
    fields: Entry = {} if words is None else _picture("texture", words)
    if said.get("length"):
        fields["scale"] = slots.length(said["length"])
    named = {"table": "table_texture", "background": "background_texture"}
    if len(where) == 1 and isinstance(where[0], dict) and where[0].get("role") in named:
        op = named[where[0]["role"]]
        return done({"op": op, **fields}, mention=Mention(kind="target", target=where[0]))
    return _each(where, {"op": "retexture", **fields}, "target", tuple(fields))


@rule(r"styli[sz]e {thing} (?:like|as|with|in the style of) (?:a |an |the )?{texture}",
      r"styli[sz]e {thing} in (?:a |an |the )?{texture} style",
      r"give {thing} (?:the |a )?(?:style|look) of (?:a |an |the )?{texture}",
      r"(?:redo|render) {thing} in the style of (?:a |an |the )?{texture}",
      r"styli[sz]e {thing}")  # fmt: skip
def style(said: Said) -> Meant:
    words = said.get("texture")
    fields = {} if words is None else _picture("style", words)
    return _each(things(said), {"op": "stylize", **fields}, "target", tuple(fields))


def _each(where: list[Target], edit: Entry, name: str, last: tuple[str, ...]) -> Meant:
    """The edit for each target, with the target as its first field."""
    head = {key: value for key, value in edit.items() if key not in last}
    tail = {key: edit[key] for key in last}
    mention = Mention(kind="target", target=where[0]) if len(where) == 1 else None
    return done(*({**head, name: one, **tail} for one in where), mention=mention)


def _picture(name: str, words: str) -> Entry:
    """The field for a texture in words. Raises NotThis, or NotUnderstood for one that does not ship."""
    words = re.sub(
        r"^(?:a |an |the )?(?:random |other |another |different |new )+", "", words + " "
    ).strip()
    words = re.sub(r" ?(?:texture|style)$", "", words)
    if words in ("", "any", "another", "random", "new"):
        return {}
    if words in KINDS:
        return {name: {"sample": KINDS[words]}}
    parts = sorted(words.replace(" ", "_").split("_"))
    same = [known for known in shipped.NAMES if sorted(known.split("_")) == parts]
    singular = sorted(part.removesuffix("s") for part in parts)
    same = same or [
        known
        for known in shipped.NAMES
        if sorted(p.removesuffix("s") for p in known.split("_")) == singular
    ]
    if same:
        return {name: same[0]}
    alike = [known for known in shipped.NAMES if set(parts) <= set(known.split("_"))]
    if len(alike) == 1:
        return {name: alike[0]}
    if alike:
        raise refuse(f"{words!r} could be {', '.join(alike)}; say which")
    if len(parts) > 3:
        raise NotThis
    kinds = ", ".join(shipped.KINDS)
    raise refuse(
        f"no texture is called {words!r}; kinds are: {kinds}; names are: {', '.join(shipped.NAMES)}"
    )
