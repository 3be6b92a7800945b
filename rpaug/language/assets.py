"""Rules for new things: looked for in the library."""
# ruff: noqa: E501  # patterns are easiest to read whole

import re
from typing import Any

from rpaug.assets import library
from rpaug.core import color_space
from rpaug.core.errors import MissingExtra
from rpaug.language import slots
from rpaug.language.grammar import NotThis, Said, done, refuse, rule
from rpaug.language.grounding import target, thing
from rpaug.language.messages import Entry, Meant, Mention, NotUnderstood
from rpaug.providers.words import synonym

HERE = r"(?: (?:down )?(?:on|onto|to|in|into|all over|over|around|across) (?:the )?(?:table|scene|desk|counter|tabletop|workspace|picture|table top|worktop))?"
NEAR = r"(?:(?:somewhere |right |down )?(?:near|next to|beside|close to|by|nearby|alongside|adjacent to|near to|in the vicinity of))"
SIZES = r"(?:,? (?:each |all )?(?:(?:whose|with (?:a|its|the)) longest side (?:is |of )?|of (?:a )?size |sized |measuring |with (?:a )?sizes? )?(?:of )?between {length} and {least}(?: (?:large|big|long|in size|across|wide|each))?)?"
MANY = rf"(?:(?:a |the )?(?:few|couple of)|some|more|{slots.NUMBER})"
CLUTTER = r"(?:(?:new )?distractors?(?: objects?| items?| things?)?|(?:random|distracting|unrelated|irrelevant) (?:objects?|things?|items?|clutter))"
NEW = Mention(kind="new")
MOST = 30


@rule(rf"(?:(?:<ADD>|scatter|sprinkle|distribute|spread|use) )?(?:(?P<many>{MANY}) )?(?:more )?(?:(?P<tint>{slots.ONE_COLOR}) )?{CLUTTER}{HERE}{SIZES}",
      rf"(?:clutter|fill|litter|populate|mess up|distract) (?:up )?(?:the )?(?:table|scene|desk|workspace)(?: up)?(?: with (?:(?P<many>{MANY}) )?(?:(?P<tint>{slots.ONE_COLOR}) )?{CLUTTER})?{SIZES}",
      rf"(?:<ADD> )(?:some |more )?clutter{HERE}")  # fmt: skip
def distractors(stated: Said) -> Meant:
    edit: Entry = {"op": "distractors"}
    many = stated.get("many")
    if many not in (None, "some", "more", "a few", "few"):
        edit["count"] = 2 if "couple" in (many or "") else _count(many or "")
    if stated.get("tint"):
        edit["color"] = slots.color(stated["tint"])
    if stated.get("length"):
        edit["size"] = [slots.length(stated["length"]), slots.length(stated["least"])]
    return done(edit, mention=NEW)


@rule(rf"<ADD> {{asset}}{HERE},? (?:within|at most|no more than|no farther than|no further than|up to|not more than) {{length}} (?:of|from|away from) {{other}}",
      rf"<ADD> {{asset}}{HERE},? {NEAR} {{other}}(?:,? (?:within|at most|no more than|no farther than|up to) {{length}}(?: away| from it| of it)?)?",
      rf"{NEAR} {{other}},? <ADD> {{asset}}{HERE}",
      rf"<ADD> {{asset}}{HERE},? (?:at|to) (?:position |the position |point |the point |coordinates |the coordinates |location |place )?{{point}}",
      rf"<ADD> {{asset}}{HERE}{SIZES}",
      r"there should be {asset}" + HERE)  # fmt: skip
def insert(stated: Said) -> Meant:
    fields: Entry = {}
    if stated.get("other"):
        fields["near"] = thing(stated, "other")
    if stated.get("point"):
        fields["at"] = slots.numbers(stated["point"])
    edits: list[Entry] = []
    notes: list[str] = []
    for part in re.split(r",? and |, ", stated["asset"]):
        count, found, note = asset(part, stated.wish.setting.generates)
        notes += note
        if stated.get("length"):
            place = {"within": slots.length(stated["length"])} if "near" in fields else {}
            if not place:
                found["size"] = [slots.length(stated["length"]), slots.length(stated["least"])]
            found = {**found, **fields, **place}
        else:
            found = {**found, **fields}
        edits += [{"op": "insert", **found} for _ in range(count)]
    if fields.get("at") and len(edits) > 1:
        raise refuse("two things cannot stand at one place")
    return done(*edits, mention=NEW, notes=tuple(notes))


@rule(r"<ADD> {asset} (?:in|into|inside|on|onto|on top of|under|behind|in front of|above|below"
      r"|(?:to |on )?the (?:left|right) of|left of|right of|between) .+")  # fmt: skip
def elsewhere(stated: Said) -> Meant:
    asset(stated["asset"], stated.wish.setting.generates)
    raise refuse(
        "new things stand on the table: `near` something, `within` a length of it, or `at` (x, y)"
    )


def asset(words: str, generates: bool = False) -> tuple[int, dict[str, Any], list[str]]:
    """How many, which fields of `insert` find it in the library, and what was taken for granted.

    With a generator, fields may name a kind that the library lacks: `making` sees to it. Raises NotThis if the words
    name a thing of the scene, NotUnderstood if there is nothing of the kind and nobody to make it.
    """
    words = words.strip()
    if re.match(r"(?:the|its?|them|that|this|these|those|all|every)\b", words):
        raise NotThis
    many = re.match(rf"(?:{slots.NUMBER}|another|some|a few|several)(?: more| other)? ", words)
    number = 1
    if many:
        stated = re.sub(r" (?:more|other) $", "", many.group()).strip()
        if stated in ("some", "a few", "several"):
            raise refuse(f"{words!r}: how many?")
        number = 1 if stated == "another" else _count(stated)
        words = words[many.end() :]
    words = re.sub(r"^(?:new|extra|additional|further) ", "", words)
    named = _named(words)
    if named:
        return number, {"asset": named}, []
    first, _, rest = words.partition(" ")
    tint = color_space.canonical(first) if rest else None
    kind = _singular(rest if tint else words)
    categories = sorted({one.category for one in library.assets()})
    notes: list[str] = []
    if kind not in categories:
        if not re.fullmatch(r"[a-z_]+(?: [a-z_]+){0,2}", kind):
            raise NotThis
        alike = None if generates and _thing(kind) else _alike(kind, categories)
        if alike is None and not (generates and _thing(kind)):
            names = ", ".join(one.name for one in library.assets())
            raise refuse(f"the library has no {kind!r}; kinds are: {', '.join(categories)}; names are: {names}. "
                         "`rpaug assets add` adds one, and --generator has one made")  # fmt: skip
        if alike is not None:
            notes.append(f"{kind!r} is taken to mean {alike!r}")
            kind = alike
    if tint:
        if not generates:
            library.find(kind, tint)
        return number, {"category": kind, "color": tint}, notes
    return number, {"category": kind}, notes


def _thing(kind: str) -> bool:
    """Is it a phrase that a thing can go by? "a pinch of salt" and "the recipe" are none."""
    try:
        target(kind)
    except (NotThis, NotUnderstood):
        return False
    return True


def _named(words: str) -> str | None:
    """The name of the one thing in the library that is called so: in any order of its words, and in the plural."""
    parts = sorted(_singular(words).replace(" ", "_").split("_"))
    kinds = {one.category for one in library.assets()}
    known = [one.name for one in library.assets() if sorted(one.name.split("_")) == parts]
    if not known or (
        known[0] != words and set(parts) & kinds and len(parts) == 2 and _tinted(parts)
    ):
        return known[0] if known and known[0] == words else None
    return known[0]


def _tinted(parts: list[str]) -> bool:
    """Is one of the words a color? Then kind and color are asked for rather than one name."""
    return any(color_space.canonical(part) for part in parts)


def _singular(words: str) -> str:
    for plural, one in (
        ("boxes", "box"),
        ("dishes", "dish"),
        ("brushes", "brush"),
        ("dice", "die"),
    ):
        words = re.sub(rf"\b{plural}$", one, words)
    return words[:-1] if words.endswith("s") and not words.endswith("ss") else words


def _count(words: str) -> int:
    number = slots.count(words)
    if number > MOST:
        raise refuse(f"{number} things are too many: at most {MOST} at once")
    return number


def _alike(kind: str, categories: list[str]) -> str | None:
    try:
        return synonym(kind, categories)
    except MissingExtra:
        return None
