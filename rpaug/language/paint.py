"""Rules for colors, textures and styles."""
# ruff: noqa: E501  # patterns are easiest to read whole

import re

from rpaug.assets.textures import shipped
from rpaug.language import slots
from rpaug.language.grammar import NotThis, Said, done, refuse, rule
from rpaug.language.grounding import Target, thing, things
from rpaug.language.messages import Entry, Meant, Mention

TABLE = {"role": "table"}
ONE_OF = rf"(?P<one>{slots.ONE_COLOR})(?P<more>(?:, ?{slots.ONE_COLOR})*,? or (?:an? )?{slots.ONE_COLOR}(?:,? or (?:an? )?{slots.ONE_COLOR})*)"
DARKER, LIGHTER = 0.6, 0.4  # of a color's rgb; of its way to white
KINDS = {
    **dict.fromkeys(("wood", "wooden", "timber", "woody"), "wood"),
    **dict.fromkeys(("stone", "rock", "rocky", "stony"), "stone"),
    **dict.fromkeys(("fabric", "cloth", "textile"), "fabric"),
    **dict.fromkeys(("checker", "checkered", "chequered", "checked", "checkerboard"), "checker"),
    **dict.fromkeys(("noise", "noisy"), "noise"),
}
LAID = r"(?: (?:texture|pattern|surface|finish|look|skin|cover|covering|material))"
WIDE = r"(?:,? (?:(?:that|which) (?:is|are) )?(?:(?:at|with) (?:a )?(?:scale|width|size) of {length}|(?:at |of )?{length}(?: (?:wide|across|scale|in width|large|per tile|per repeat))|scaled to {length}))?"
WIDE_TOO = r"(?:{length}[ -](?:wide )?)?"
STYLE = r"(?:styli[sz]e|re-?style|re-?styli[sz]e|style)"
LAY = r"(?:put|lay|add|use|apply|place|wrap|project|map|slap|stick|throw|spread|print)"
COVER = r"(?:cover|wrap|texture|re-?texture|line|coat|clad|drape|dress|skin|plaster|upholster|paper|overlay|tile|pave|face|decorate|finish|carpet|panel)"
HUES = r"(?: (?:paint|colou?r|colou?ring|coat|coat of paint|tint|shade|hue|finish))?"


@rule(rf"<PAINT> {{thing}} (?:(?:to|to be|into|in|with|as) )?(?:(?:a )?(?:coat|shade|layer) of )?{{color}}{HUES}(?P<contrast>,? (?:and )?(?:not|rather than|instead of) {slots.ONE_COLOR})?",
      r"(?:<VARY>|set|turn|make|paint|switch) (?:the )?colou?r of {thing} (?:to|into|for|with|to be)? ?{color}",
      r"(?:<VARY>|set|turn|make|switch) {thing}(?:'s|')? colou?r (?:to|into|for|with|to be)? ?{color}",
      rf"give {{thing}} (?:a |an |the |some )?(?:(?:coat|shade|layer|colou?r) (?:of )?)?{{color}}{HUES}",
      rf"(?:use |have |choose |draw |pick )?(?:an? )?{{color}}{HUES} (?:for|on) {{thing}}", r"{thing} in {color}",
      r"{color} is (?:the colou?r )?(?:that )?(?:i want |i'd like |we want )?for {thing}", rf"(?:put|add|use|apply) (?:some |a )?(?:(?:coat|shade|layer) of )?{{color}}{HUES} (?:on|onto|to|for) {{thing}}",
      rf"(?:change|turn|switch) {{thing}} from {slots.ONE_COLOR} (?:to|into) {{color}}", rf"(?:change|turn|switch) (?:the )?colou?r of {{thing}} from {slots.ONE_COLOR} (?:to|into) {{color}}")  # fmt: skip
def recolor(stated: Said) -> Meant:
    tint = slots.color(stated["color"])
    where = things(stated)
    if tint == {"sample": "colosseum"} and where == [TABLE]:
        return done({"op": "table_color"}, mention=Mention(kind="target", target=TABLE))
    return _each(where, {"op": "recolor", "color": tint}, "target", ("color",))


@rule(r"(?:<VARY>|re-?colou?r|re-?paint) (?:the )?(?:colou?rs?|hue|paint) of {thing}",
      r"<VARY> (?:the )?{thing}(?:'s|')? (?:colou?rs?|hue|paint)",
      r"(?:<VARY>|choose|pick|draw) (?:what |which |the )?colou?r (?:the )?{thing} (?:is|are|has|have)",
      r"(?:re-?colou?r|re-?paint) {thing}",
      r"(?:a |use a |some )?(?:random|new|different|another|other) colou?rs? (?:for|on) {thing}")  # fmt: skip
def any_color(stated: Said) -> Meant:
    return recolor(Said({**stated.slots, "color": "a random color"}, stated.wish))


@rule(rf"<PAINT> {{thing}} (?:to |into |in |with |an? )?(?:either |one of )?{ONE_OF}(?: colou?r)?",
      rf"(?:<VARY>|set|make) (?:the )?colou?r of {{thing}} (?:to |into )?(?:either |one of )?{ONE_OF}", rf"(?:<VARY>|set|make) {{thing}}(?:'s|')? colou?r (?:to |into )?(?:either |one of )?{ONE_OF}",
      rf"(?:use |choose )?(?:either )?{ONE_OF} (?:for|on) {{thing}}")  # fmt: skip
def one_of_colors(stated: Said) -> Meant:
    where = thing(stated)
    tints = [stated["one"], *re.split(r",? or (?:an? )?|, ?", stated["more"])[1:]]
    options = [{"op": "recolor", "target": where, "color": slots.color(tint)} for tint in tints]
    return done({"one_of": options}, mention=Mention(kind="target", target=where))


@rule(
    r"(?:make|paint|turn) {thing} (?:(?:a bit|a little|slightly|much|even) )?(?P<way>darker|lighter|brighter)(?: still)?"
)
def shade(stated: Said) -> Meant:
    where, notes = _shaded(stated)
    for number, edit in reversed(list(enumerate(stated.wish.edits))):
        if edit.get("op") == "recolor" and edit["target"] == where:
            dark = stated["way"] == "darker"
            tint = edit["color"]
            values = slots.darker(tint, DARKER) if dark else slots.lighter(tint, LIGHTER)
            return done(
                {**edit, "color": {"rgb": values}},
                mention=Mention(kind="target", target=where),
                notes=notes,
                replaces=(number,),
            )
    raise refuse(
        f"{stated['way']} than what? Only a colour that was asked for before has a {stated['way']} one: name a colour"
    )


def _shaded(stated: Said) -> tuple[Target, tuple[str, ...]]:
    """What is to be darker or lighter. "it" may be the one thing that was painted, if it was not named last."""
    mention, painted = (
        stated.wish.mention,
        [e["target"] for e in stated.wish.edits if e.get("op") == "recolor"],
    )
    unclear = stated["thing"] == "it" and (mention is None or mention.kind in ("camera", "new"))
    if unclear and len(painted) == 1:
        return painted[0], (f"'it' is taken to mean what was painted: {painted[0]}",)
    return thing(stated), ()


@rule(rf"(?:give|gave) {{thing}} (?:a |an |some )(?:random |new )?{{texture}}{LAID}{WIDE}", rf"(?:give|gave) {{thing}} (?:the )?{{texture}}{LAID}{WIDE}",
      rf"{COVER} {{thing}} (?:over |up |out )?(?:with|in|as|by|using) (?:a |an |the |some )?{{texture}}(?:{LAID})?{WIDE}",
      rf"{LAY} (?:a |an |the |some )?{{texture}}{LAID} (?:on|onto|to|over|around|across|upon|for) {{thing}}{WIDE}",
      rf"(?P<perhaps>{LAY}) (?:a |an |the |some )?{WIDE_TOO}{{texture}}(?:{LAID})? (?:on|onto|to|over|around|across|upon) {{thing}}",
      rf"(?:a |an )?{{texture}}{LAID} (?:for|on) {{thing}}{WIDE}",
      rf"(?P<perhaps>(?:use )?){{texture}} (?:for|on) {{thing}}{WIDE}",
      rf"(?P<perhaps>{LAY}) {{texture}} (?:on|onto|over|to|around|across|upon) {{thing}}{WIDE}",
      rf"make {{thing}} (?:look |appear )?(?:like|as if made (?:out )?of|made (?:out )?of|of|out of|in|as) (?:a |an |some )?{{texture}}(?:{LAID})?{WIDE}",
      r"(?:make|turn) {thing} (?:look |appear )?(?P<kind>wooden|checkered|chequered|rocky|checked|stony|woody)",
      rf"(?:<VARY>|replace|set|switch|exchange) (?:the )?(?:texture|pattern|surface|material) of {{thing}} (?:to|with|by|for|into) (?:a |an |the |some )?{{texture}}(?:{LAID})?{WIDE}",
      rf"(?:<VARY>|replace|set|switch|exchange) (?:the )?{{thing}}(?:'s|')? (?:texture|pattern|surface) (?:to|with|by|for|into) (?:a |an |the |some )?{{texture}}(?:{LAID})?{WIDE}",
      r"(?:<VARY>|replace|exchange) (?:the )?(?:textures?|patterns?|surfaces?) (?:of|on) {thing}",
      r"(?:<VARY>|replace|exchange) (?:the )?{thing}(?:'s|')? (?:textures?|patterns?|surfaces?)",
      r"(?:a |use a )?(?:random|different|new|another) texture (?:for|on) {thing}",
      r"(?:re-?texture|texture) {thing}")  # fmt: skip
def texture(stated: Said) -> Meant:
    where = things(stated)
    words = stated.get("texture") or stated.get("kind")
    fields: Entry = (
        {} if words is None else _picture("texture", words, sure="perhaps" not in stated.slots)
    )
    if stated.get("length"):
        fields["scale"] = slots.length(stated["length"])
    named = {"table": "table_texture", "background": "background_texture"}
    if len(where) == 1 and isinstance(where[0], dict) and where[0].get("role") in named:
        op = named[where[0]["role"]]
        return done({"op": op, **fields}, mention=Mention(kind="target", target=where[0]))
    return _each(where, {"op": "retexture", **fields}, "target", tuple(fields))


@rule(rf"{STYLE} {{thing}} (?:(?:to look |so that it looks )?like|as|as if made of|with|after|in the style of|using|by) (?:a |an |the |some )?{{texture}}(?: style)?",
      rf"{STYLE} {{thing}} (?:in|with|to) (?:a |an |the )?{{texture}} style",
      r"give {thing} (?:the |a |some )?(?:style|look|appearance) of (?:a |an |the )?{texture}", r"give {thing} (?:the |an? )?{texture} style",
      r"(?:apply|use|transfer|put) (?:a |an |the )?(?:{texture} style|style of (?:a |an |the )?(?P<kind>[a-z_ ]+?)) (?:to|on|onto|for) {thing}",
      r"(?:redo|render|make|paint) {thing} in (?:the style of (?:a |an |the )?{texture}|(?:a |an |the )?(?P<kind>[a-z_ ]+?) style)",
      rf"{STYLE} {{thing}}(?: randomly)?", r"(?:<VARY>) (?:the )?style of {thing}", r"(?:<VARY>) {thing}'s style", r"(?:a |use a )?(?:random|different|new|another) style for {thing}", r"give {thing} (?:a )?(?:random|different|new|another) style")  # fmt: skip
def style(stated: Said) -> Meant:
    words = stated.get("texture") or stated.get("kind")
    fields = {} if words is None else _picture("style", words)
    return _each(things(stated), {"op": "stylize", **fields}, "target", tuple(fields))


def _each(where: list[Target], edit: Entry, name: str, last: tuple[str, ...]) -> Meant:
    """The edit for each target, with the target as its first field."""
    head = {key: value for key, value in edit.items() if key not in last}
    tail = {key: edit[key] for key in last}
    mention = Mention(kind="target", target=where[0]) if len(where) == 1 else None
    return done(*({**head, name: one, **tail} for one in where), mention=mention)


def _picture(name: str, words: str, sure: bool = True) -> Entry:
    """The field for a texture in words. Raises NotThis, or if `sure` NotUnderstood for one that does not ship."""
    words = re.sub(
        r"^(?:a |an |the )?(?:random |other |another |different |new )+", "", words + " "
    ).strip()
    words = re.sub(r" ?(?:texture|style)$", "", words)
    if words in ("", "any", "another", "random", "new", "one", "ones"):
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
    if len(parts) > 3 or not sure:
        raise NotThis
    kinds = ", ".join(shipped.KINDS)
    raise refuse(
        f"no texture is called {words!r}; kinds are: {kinds}; names are: {', '.join(shipped.NAMES)}"
    )
