"""How people put an order, and how the rules put it: the same meaning in other words, never more or less of it."""
# ruff: noqa: E501  # patterns are easiest to read whole

import re
from collections.abc import Callable, Iterator
from functools import lru_cache

from rpaug.language import slots

DEEPEST = 3  # rewritings of one step, one after the other

NEAR = r"(?:somewhere )?(?:near|next to|beside|close to|by|at|within|alongside|on the table,? near)"
PLACED = (
    r"(?:added|put in|put|placed|inserted|set|introduced|included|dropped|thrown in|there|present)"
)
WISH = r"(?:i(?: (?:really|just))? (?:want|need|would like|wish for)|i'd (?:like|love|want)|we (?:want|need)|we'd like|let us have|give me|get me|how about|what about|there (?:should|must|has to) be|let there be)"
ONE_MORE = rf"(?:an?|another|some|more|{slots.NUMBER}) "
THIS = r"(?:(?:(?:all|every|each|both)(?: of)? )?(?:the|its?|that|this) (?!(?:the|all) )|(?:all|every|each|both|object|handle|whatever|what) |(?=it |them |everything ))[a-z0-9_#'-]+[^;:]*?"
OUGHT = r"(?:should(?: all)?|must|shall|ought to|has to|have to|needs? to|is to|are to)"
GONE = r"(?:gone|away|out|off|absent|out of (?:the )?(?:way|sight|view|picture|pictures|scene|image|images)|off the (?:table|desk|scene|picture))"
RANDOM = r"(?:randomly|at random|arbitrarily)"
CHANCY = r"(?:bump|wiggle|wobble|jiggle|randomi[sz]e|vary|change|jitter|perturb|shake|move|shift|nudge|displace|scatter|shuffle|spread|rearrange|reorder|mix|resize|rescale|scale|alter|modify|relocate|reposition)"

# A participle that does not end in "ed" after its verb.
IRREGULAR = {
    "lit": "light", "put": "put", "set": "set", "taken": "take", "thrown": "throw", "made": "make", "shaken": "shake",
    "brought": "bring", "hidden": "hide", "cut": "cut", "spread": "spread", "given": "give", "laid": "lay", "clad": "cover",
    "stood": "stand", "spun": "spin", "grown": "grow", "shrunk": "shrink", "shrunken": "shrink", "got": "get", "left": "leave",
    "hung": "hang", "undone": "undo", "dyed": "dye", "blown": "blow",
}  # fmt: skip


def _an_order(verb: str, what: str, rest: str) -> str:
    return " ".join(filter(None, (verb, what, rest.strip())))


def _from_passive(match: re.Match[str]) -> Iterator[str]:
    """The orders that "the cup moved 5 cm to the left" may come of, such as "move the cup 5 cm to the left"."""
    how = f"{match['how']} " if match["how"] else ""
    for verb in _verbs(match["done"]):
        yield _an_order(f"{how}{verb}", match["what"], match["rest"])


def _verbs(participle: str) -> list[str]:
    """What a participle may be of: "dimmed" of "dim" or "dimme", of which the rules know one."""
    if participle in IRREGULAR:
        return [IRREGULAR[participle]]
    if not participle.endswith("ed") or len(participle) < 5:
        return []
    stem = participle[:-2]
    bare = [stem[:-1]] if stem[-1] == stem[-2] else []
    return [stem, f"{stem}e", *bare, *([f"{stem[:-1]}y"] if stem.endswith("i") else [])]


def _template(text: str) -> Callable[[re.Match[str]], Iterator[str]]:
    def fill(match: re.Match[str]) -> Iterator[str]:
        stated = {name: (value or "").strip() for name, value in match.groupdict().items()}
        yield re.sub(r" +", " ", text.format(**stated)).strip()

    return fill


UNIT = slots.any_of({**slots.METRES, **slots.RADIANS, "%": 1, "percent": 1, "per cent": 1, "pixels": 1, "pixel": 1, "px": 1, "stops": 1, "stop": 1, "ev": 1})  # fmt: skip
AMOUNT = rf"{slots.NUMBER} ?(?:{UNIT})(?![a-z])"
DONE = rf"(?:(?P<how>{RANDOM}|slightly|a bit|a little) )?(?P<done>[a-z]{{3,}}ed|{'|'.join(IRREGULAR)})(?P<rest>(?: .+)?)"
ROWS: tuple[tuple[str, Callable[[re.Match[str]], Iterator[str]]], ...] = (
    # Orders about a thing that is there.
    (rf"(?:{WISH}|have|get|let|make|see) (?P<what>{THIS}) (?:to (?:be )?|be )?{GONE}", _template("remove {what}")),
    (rf"(?P<what>{THIS}) (?:{OUGHT} (?:be )?|can |could )(?:go|disappear|vanish|{GONE})(?: away)?", _template("remove {what}")),
    (rf"(?:{WISH}|have|get|let|make|see) (?P<what>{THIS}) (?:to be |be )?{DONE}", _from_passive),
    (rf"(?P<what>{THIS}) {OUGHT} (?:be|get) {DONE}", _from_passive),
    (rf"(?:{WISH} )?(?P<what>{THIS}) (?:{OUGHT}|to) (?:be|become|turn|appear|come out|(?P<like>look(?: like)?))(?: in)? (?P<how>.+)", _template("make {what} {like} {how}")),
    (rf"(?:{WISH} )?(?P<what>{THIS}) (?:{OUGHT}|to) (?:get|have|receive|wear|show|carry) (?P<how>.+)", _template("give {what} {how}")),
    (rf"(?:{WISH} )?(?P<what>{THIS}) (?:{OUGHT}|to) (?P<how>(?:behave|act|fall|move|deform|bend|sit|stand|lie|come|go) .+)", _template("let {what} {how}")),
    (rf"(?:(?P<what>{THIS}) {OUGHT}|(?:let|have|make) (?P<thing>{THIS})) (?P<verb>vary|change|differ|shrink|grow|turn|rotate|move|shift)(?P<rest>(?: .+)?)", _template("{verb} {what}{thing} {rest}")),
    (rf"(?P<what>{THIS}) {OUGHT} (?:end up|go|come|move|stand|sit|lie|be)(?P<rest> (?:to |at |near |next |beside |close |within |up |down |back |forward |left |right |closer |higher |lower ).*)", _template("move {what} {rest}")),
    (rf"(?:{WISH}|have|get|let) (?P<what>{THIS}) (?P<rest>(?:at|near|next to|beside|close to|within) .*)", _template("move {what} {rest}")),
    (rf"(?P<what>{THIS}) (?:wants?|needs?|gets?|receives?) (?P<how>(?:an?|some|the) .+)", _template("give {what} {how}")),
    (rf"give (?P<how>(?:an?|some) .+?) to (?P<what>{THIS})", _template("give {what} {how}")),
    (r"(?P<what>[a-z_ ]+): (?P<verb>[a-z]+) (?P<rest>.+)", _template("{verb} {what} {rest}")),
    (r"(?P<what>[a-z_ ]+): (?P<rest>.+)", _template("{what} {rest}")),
    (rf"(?:{WISH}|have) (?P<what>{THIS} .+)", _template("make {what}")),
    (rf"(?:let|have|get|see) (?P<what>{THIS}) (?:be |become |turn |in )?(?P<how>.+)", _template("make {what} {how}")),
    (rf"let (?P<what>{THIS}) (?:have|get|wear) (?P<how>.+)", _template("give {what} {how}")),
    # New things.
    (rf"{WISH} (?P<new>{ONE_MORE}.+?|[a-z]+_[a-z_]+) (?:to be )?{PLACED}(?P<rest>(?: .+)?)", _template("add {new} {rest}")),
    (rf"(?P<where>{NEAR} [^,]+?|at {slots.POINT}),? (?P<order>(?:{WISH}|add|put|place|insert|set|there|throw|drop) .+)", _template("{order} {where}")),
    (rf"{WISH} (?:to see |to have |to add )?(?P<new>{ONE_MORE}.+)", _template("add {new}")),
    (rf"{WISH} (?:to see |to have |to add )?(?P<new>[a-z]+_[a-z_]+.*)", _template("add {new}")),
    (rf"{WISH} (?P<order>.+)", _template("{order}")),
    (rf"(?:throw|toss|drop|bring|mix|pop|sneak) in (?P<new>{ONE_MORE}.+)", _template("add {new}")),
    (rf"(?:throw|toss|bring|drop|mix|pop|sneak) (?P<new>{ONE_MORE}.+?) in(?P<rest>(?: .+)?)", _template("add {new} {rest}")),
    (rf"(?P<new>{ONE_MORE}.+?|[a-z]+_[a-z_]+) (?:should|must|shall|has to|have to|needs? to|is to|are to) (?:be {PLACED}|be(?= near| next| at| on| beside)|stand|appear|lie|sit)(?P<rest>(?: .+)?)", _template("add {new} {rest}")),
    # Chance is what these verbs are about.
    (rf"{RANDOM} (?P<order>{CHANCY} .+)", _template("{order}")),
    (rf"(?P<order>{CHANCY} .+?) {RANDOM}(?P<rest>(?: .+)?)", _template("{order} {rest}")),
    (rf"{RANDOM} (?:re-?)?(?:colou?r|paint) (?P<what>.+)|(?:(?:re-?)?(?:colou?r|paint)) (?P<other>.+?) {RANDOM}", _template("give {what}{other} a random color")),
    (rf"{RANDOM} (?:re-?)?texture (?P<what>.+)|(?:re-?)?texture (?P<other>.+?) {RANDOM}", _template("give {what}{other} a random texture")),
    # What it is about comes first.
    (r"(?:for|on|with) (?P<what>(?:the|all|every) [^,]+?)(?:, | (?=use|choose|pick|take|try))(?:use |choose |pick |take |try |have )?(?P<how>.+)", _template("give {what} {how}")),
    (r"(?:use|choose|pick|take|try) (?P<how>.+?) (?:for|as) (?P<what>(?:the|all|every) .+)", _template("give {what} {how}")),
    (rf"(?P<far>(?:by|from) (?:up to )?{AMOUNT}),? (?P<order>[a-z]+ .+)", _template("{order} {far}")),
    (r"(?P<verb>[a-z]{2,})ing (?P<rest>.+)", lambda match: iter([f"{verb} {match['rest']}" for verb in _verbs(f"{match['verb']}ed")])),
    # A slight change of what was said before.
    (rf"(?P<order>.+) (?:instead|rather)(?: of {slots.ONE_COLOR})?", _template("{order}")),
    (r"(?:instead|rather),? (?P<order>.+)", _template("{order}")),
)  # fmt: skip
COMPILED = tuple((re.compile(pattern), make) for pattern, make in ROWS)


@lru_cache(256)  # each step is asked for what it takes back, and then for what it means
def orders(step: str) -> tuple[str, ...]:
    """The step as it was said, and then every other way to put it, the nearest first."""
    seen, level, out = {step}, [step], [step]
    for _ in range(DEEPEST):
        found: list[str] = []
        for stated in level:
            for pattern, make in COMPILED:
                match = pattern.fullmatch(stated)
                found += [other for other in (make(match) if match else ()) if other not in seen]
                seen.update(found)
        level = list(dict.fromkeys(found))
        out += level
    return tuple(out)


PLAIN: tuple[tuple[str, str], ...] = (
    (r"[–—−]", "-"),
    (r"\bcolour by", "color by"),
    (r"\bhalf a dozen\b", "six"),
    (r"\b(?:1/2|½) ?", "half a "),
    (r"\banywhere (?=between|from)", ""),
    (r"\b(?P<way>from|to|towards?) robot\b", r"\g<way> the robot"),
    (rf"\b(?:about|roughly|approximately|around|circa|some) (?={slots.NUMBER} ?(?:{UNIT})(?![a-z]))", ""),
    (rf"\b(?:exactly|precisely|a total of) (?={slots.NUMBER}\b)", ""),
    (rf"\b(?:no more|not more|never more) than (?={slots.NUMBER})", "at most "),
    (rf"(?:\b(?:by|of|within) )?(?P<far>{AMOUNT})(?: at (?:the )?(?:most|maximum)| max(?:imum)?| tops| or less)(?![a-z])", r"by up to \g<far>"),
    (rf"(?:\+/-|±|plus or minus|plus/minus) ?(?={slots.NUMBER})", "up to "),
    (rf"\bbetween (?P<low>{slots.NUMBER}) and (?P<high>{slots.NUMBER}) ?(?P<unit>{UNIT})(?![a-z])", r"between \g<low> \g<unit> and \g<high> \g<unit>"),
    (rf"\b(?:from )?(?P<low>{slots.NUMBER}) (?:to|up to) (?P<high>{slots.NUMBER}) ?(?P<unit>{UNIT})(?![a-z])", r"between \g<low> \g<unit> and \g<high> \g<unit>"),
    (rf"\b(?:from )?(?P<low>{slots.DIGITS}) ?- ?(?P<high>{slots.DIGITS}) ?(?P<unit>{UNIT})(?![a-z])", r"between \g<low> \g<unit> and \g<high> \g<unit>"),
    (rf"\b(?:from )?(?P<low>{AMOUNT}) (?:to|up to) (?P<high>{AMOUNT})", r"between \g<low> and \g<high>"),
)  # fmt: skip
CLEAR = tuple((re.compile(pattern), instead) for pattern, instead in PLAIN)


def plain(text: str) -> str:
    """A text with its quantities put in one way: "2 to 4 inches" as "between 2 inches and 4 inches"."""
    for pattern, instead in CLEAR:
        text = pattern.sub(instead, text)
    return text
