"""What a clause says of things that come, go, move, are copied or change in size, and of what they are made of."""

import itertools
from collections.abc import Sequence
from copy import deepcopy
from typing import Any

from rpaug.assets import library
from rpaug.core import color_space
from rpaug.core.errors import MissingExtra, TargetError
from rpaug.language.lexicon import group
from rpaug.language.messages import Entry, Meant, Mention, NotUnderstood, Wish
from rpaug.language.things import PRONOUNS, Named, Namer, every
from rpaug.language.tokens import Clause, Token
from rpaug.language.values import Amount, tidy
from rpaug.physics import materials
from rpaug.providers.words import synonym
from rpaug.scene.targets import relations
from rpaug.scene.targets.relations import ANYTHING, singular

MOST = 30
COUNTS = 5  # different numbers of new things that one wish may draw from
# Ahead and to the left, as the robot sees it.
SIDES = {
    "left": (0, 1),
    "right": (0, -1),
    "ahead": (1, 0),
    "back": (-1, 0),
    "off": (1, 0),
    "close": (-1, 0),
}
NEW = Mention(kind="new")
LOOKED = ("vary", "paint", "lay", "texture", "move", "scale", "bigger", "smaller", "remove", "copy")
"""What says that something there is changed, not that a new thing stands somewhere."""
PUT = group("placing_put")
TABLE = frozenset({"table", "desk", "tabletop", "counter", "scene"})


def physics(clause: Clause, wish: Wish, namer: Namer) -> Meant | None:
    """A thing behaves as if it were of a material, and may fall from some height."""
    falls = clause.says("drop", "dropped", "fall", "falls", "falling")
    words = clause.text.split()
    material = next((one for one in materials.shipped() if one in words), None)
    turned = (
        clause.says("turn") and clause.says("into") and material and not clause.has("color", "lay")
    )
    if not (clause.has("physics") or turned or (falls and clause.has("length"))) or clause.has(
        "camera"
    ):
        return None
    if material is None:
        raise NotUnderstood(
            f"{clause.text!r}: what is it made of? `like` one of {', '.join(materials.shipped())}"
        )
    height = clause.single("length")
    clause.every("physics", "down", "from", "not")
    said = ("if", "it", "were", "height", "drop", "dropped", "fall", "falls", "falling", "made")
    clause.tokens = [
        one for one in clause.tokens if one.text not in said and material not in one.text.split()
    ]
    named = clause.things()
    fields: Entry = {"height": [height[0].low, height[0].high]} if height else {}
    return each(namer, named, {"op": "physics"}, {"material": material, **fields})


def duplicate(clause: Clause, wish: Wish, namer: Namer) -> Meant | None:
    """Further ones of a thing that is there."""
    if not clause.has("copy") or not clause.has("thing"):
        return None
    clause.every("copy", "add")
    numbers, twice = clause.single("number", "times"), clause.every("twice")
    count = 2 if twice else whole(numbers[0]) if numbers else 1
    fields = {"count": count} if count > 1 else {}
    return each(namer, clause.things(), {"op": "duplicate"}, fields, mention=NEW)


def remove(clause: Clause, wish: Wish, namer: Namer) -> Meant | None:
    """Things are gone: those that are named, what the task does not need, or all but what is named."""
    if not clause.has("remove", "clear"):
        return None
    if clause.says("only"):
        raise NotUnderstood(f"{clause.text!r}: only what is to be left? `leave only ...`")
    clearing = clause.every("clear") or (clause.has("on") and clause.has("all"))
    clause.every("on", "remove")
    if clause.has("not"):
        apart = clause.things("not")
        named, others = clause.things(), clause.every("not", "all", "strangers", "rest")
        if not apart or not (len(others) > 1 or anything(named)):
            raise NotUnderstood(f"{clause.text!r}: all but what? `remove everything except ...`")
        return Meant(edits=({"op": "remove", "target": namer.but(apart)},))
    if clearing or clause.has("strangers", "rest"):
        named = [] if clause.has("thing") and not clearing else clause.things()
        if not {one.words for one in named} <= TABLE:
            raise NotUnderstood(
                f"{clause.text!r}: clear what? `clear the table` takes away all that the task does not need"
            )
        some = bool(clause.every("vary")) or " of the " in f" {clause.text} "
        clause.every("strangers", "rest", "all")
        numbers, part = clause.amounts("number"), clause.amounts("times", "share")
        if part:
            there = len(namer.groups({"handle": sorted(namer.strangers())}))
            return _some(round(part[0].low * there), namer)
        if numbers and some:
            return _some(whole(numbers[0]), namer)
        if not (ids := namer.strangers()):
            raise NotUnderstood(f"{clause.text!r}: the task needs all that is there")
        gone: Entry = {"op": "remove", "target": {"handle": sorted(ids)}}
        more = (
            each(namer, clause.things(), {"op": "remove"}, {}).edits if clause.has("thing") else ()
        )
        return Meant(edits=(gone, *more))
    return each(namer, clause.things(), {"op": "remove"}, {}) if clause.has("thing") else None


def _some(count: int, namer: Namer) -> Meant:
    """So many of the things that the task does not need are gone, others in each copy."""
    chosen = list(
        itertools.combinations(namer.groups({"handle": sorted(namer.strangers())}), count)
    )
    if not 0 < len(chosen) <= MOST:
        raise NotUnderstood(
            f"{count} of them: there are {len(chosen)} ways, and at most {MOST} can be drawn from"
        )
    gone = [sorted(frozenset[int]().union(*group)) for group in chosen]
    return Meant(edits=(one_of([{"op": "remove", "target": {"handle": ids}} for ids in gone]),))


def object_size(clause: Clause, wish: Wish, namer: Namer) -> Meant | None:
    """A thing is larger or smaller than it was recorded."""
    if not clause.has("thing") or clause.has("add"):
        return None
    tall = clause.says("tall", "high", "wide", "long") and not clause.has(
        "texture", "lay", "move", "up"
    )
    if (tall or clause.has("bigger", "smaller", "scale", "size_of")) and clause.has("length"):
        raise NotUnderstood(
            "sizes are factors of the recorded one: say `20% larger`, or `half its size`"
        )
    if not clause.has("bigger", "smaller", "scale", "size_of"):
        return None
    down, up = _grown(clause)
    clause.every("size_of", "little", "to")
    shares = clause.amounts("share", "times", "number")
    if down and clause.has("twice"):
        raise NotUnderstood(f"{clause.text!r}: say `half its size`")
    shares += (
        [Amount(2, 2, "of")] if clause.every("twice") or clause.says("double the size of") else []
    )
    shares += (
        [Amount(0.5, 0.5, "of")]
        if clause.every("halve") or clause.says("halve the size of")
        else []
    )
    varied, notes = clause.every("vary", "any"), tuple[str, ...]()
    if down and up and len(shares) == 1 and clause.every("or"):
        shares, down, up = [Amount(shares[0].high, shares[0].high, "about")], False, False
    if len(shares) > 1 or (down and up):
        raise NotUnderstood(f"{clause.text!r}: one factor, please")
    fields: Entry = {}
    if shares:
        low, high = _factors(clause, shares[0], down, up)
        if not 0.1 <= low <= high <= 10:
            raise NotUnderstood(f"{low:g} to {high:g} times its size: factors are within 0.1..10")
        fields = {"range": [tidy(low), tidy(high)]}
    elif down or up:
        fields = {"range": [0.8, 0.9] if down else [1.1, 1.25]}
        low, high = fields["range"]
        notes = (f"between {low:g} and {high:g} times its size, since no factor was named",)
    elif not varied and not any(one.kind == "scale" for one in clause.taken):
        return None
    return each(namer, clause.things(), {"op": "object_size"}, fields, notes=notes)


def _grown(clause: Clause) -> tuple[bool, bool]:
    """Is it to be smaller, is it to be larger?"""
    verbs = {one.text for one in clause.every("scale")}
    up = clause.every("bigger", "more", "up") or verbs & {"enlarge", "grow", "magnify", "upscale"}
    down = clause.every("smaller", "less", "down") or verbs & {
        "shrink",
        "downsize",
        "halve the size of",
    }
    return bool(down), bool(up)


def _factors(clause: Clause, one: Amount, down: bool, up: bool) -> tuple[float, float]:
    """Between which factors of its size a thing is drawn."""
    if one.how in ("about", "upto") and one.high < 1:
        upto = one.how == "upto"
        return (1.0 if up and upto else 1 - one.high), (1.0 if down and upto else 1 + one.high)
    absolute = (
        one.how == "of"
        or (one.high >= 0.5 and down)
        or clause.absolute()
        or clause.says("its size", "times")
    )
    if absolute or not (down or up):
        return one.low, one.high
    return (1 - one.high, 1 - one.low) if down else (1 + one.low, 1 + one.high)


def spread(clause: Clause, wish: Wish, namer: Namer) -> Meant | None:
    """Things on the table change places."""
    if not clause.has("spread"):
        return None
    clause.every("spread", "on", "vary")
    far, whole_table = clause.single("length"), clause.every("all", "strangers", "rest")
    named = clause.things()
    if not whole_table and not named:
        return None
    edit: Entry = {"op": "spread"}
    if named and not anything(named):
        edit["targets"] = [namer.target(one) for one in named]
    return Meant(edits=(edit | ({"shift": far[0].high} if far else {}),))


def distractors(clause: Clause, wish: Wish, namer: Namer) -> Meant | None:
    """Things at random that the task does not need stand about."""
    loose = [one for one in clause.tokens if one.kind == "thing" and anything([one.value])]
    puts = clause.has("add") or clause.says("throw", "put")
    if loose and puts and not clause.has("color", "texture", "paint"):
        clause.every("strangers")
        clause.tokens = [one for one in clause.tokens if not any(one is other for other in loose)]
    elif (
        not clause.has("strangers")
        or clause.has("spread", "texture", "lay", "paint", "bigger", "smaller", "move")
        or (clause.has("color") and not clause.has("add", "number"))
    ):
        return None
    numbers, sizes = clause.single("number"), clause.single("length")
    near = clause.every("near")
    named = clause.things()
    if named and not near and not {one.words for one in named} <= TABLE:
        raise NotUnderstood(f"{clause.text!r}: where is the clutter to be?")
    clause.every("strangers", "add", "on", "all", "vary", "little", "any")
    edit: Entry = {"op": "distractors"}
    if numbers and numbers[0].how in ("exact", "range"):
        low, high = int(numbers[0].low), int(numbers[0].high)
        if high - low >= COUNTS or low != numbers[0].low:
            raise NotUnderstood(f"{clause.text!r}: how many?")
        counts = [whole(Amount(n, n)) for n in range(low, high + 1)]
    elif numbers:
        raise NotUnderstood(f"{clause.text!r}: how many? say a number, or `between 1 and 3`")
    else:
        counts = []
    if tint := _tint(clause):
        edit["color"] = tint
    if near:
        target = namer.target(named[0]) if named else {"role": "manipulated"}
        known = target == {"role": "manipulated"} or namer.handled(target)
        if not known:
            raise NotUnderstood(
                f"{clause.text!r}: clutter stands near the target or the robot's path; "
                "`add a mug near ...` puts one thing"
            )
        edit["near"] = "target"
    edit |= {"size": [sizes[0].low, sizes[0].high]} if sizes else {}
    return Meant(
        edits=(one_of([{**edit, "count": count} for count in counts] or [edit]),), mention=NEW
    )


def insert(clause: Clause, wish: Wish, namer: Namer) -> Meant | None:
    """New things from the library, near something or at a place."""
    named = [one.value for one in clause.tokens if one.kind == "thing"]
    fresh = any(one.fresh for one in named) or clause.has("number")
    lying = all(one.fresh for one in named) and any(parted(one.words)[2] in TABLE for one in named)
    stands = (clause.has("on", "near") or lying) and not clause.has(*LOOKED)
    putting = any(one.text in PUT for one in clause.tokens) or stands
    by_name = any("_" in one.words.split()[0] and one.words.split()[0] in _names() for one in named)
    if (
        not named
        or not (clause.has("add") or by_name or (putting and fresh))
        or clause.has("physics", "scale")
    ):
        return None
    clause.every("add", "on")
    ones = _one_each(clause)
    numbers, at, far = clause.single("number"), clause.one("point"), clause.single("length")
    near = clause.every("near") or (clause.says("within") and far)
    tints, banned = _tints(clause)
    named = clause.things()
    beside = clause.things() or named[-1:] if near else []
    named = named[: len(named) - (beside == named[-1:])] if near else named
    if any(parted(one.words)[1] for one in named[:-1]):
        raise NotUnderstood(f"{clause.text!r}: one place at a time, please")
    first, relation, anchor = parted(named[-1].words) if named else ("", "", "")
    if relation:
        if relation != "closest to" and anchor not in TABLE:
            raise NotUnderstood(
                "new things stand on the table: `near` something, `within` a length of it, or `at` (x, y)"
            )
        named = [*named[:-1], Named(first, named[-1].several, named[-1].fresh)]
        beside = beside or ([_anchor(anchor)] if relation == "closest to" else [])
    place: Entry = {"near": namer.target(beside[0])} if beside else {}
    place |= {"at": at.value} if at else {}
    if far:
        place |= {"within": far[0].high} if beside else {"size": [far[0].low, far[0].high]}
    if not named:
        raise NotUnderstood(f"{clause.text!r}: add what?")
    count = whole(numbers[0]) if numbers else 1
    if count * len(named) > MOST or (at and count * len(named) > 1):
        raise NotUnderstood(f"{clause.text!r}: at most {MOST} things at once, and one at a place")
    if ones and (count != len(ones) or len(named) > 1 or tints):
        raise NotUnderstood(f"{clause.text!r}: how many of each color?")
    colors, told = (tints, list[str]()) if banned is None else _free(named[0].words, banned)
    found = _inserted(named, ones or colors, bool(ones), place, count, bool(numbers), wish)
    return found.model_copy(update={"notes": (*found.notes, *told)})


def _one_each(clause: Clause) -> list[str]:
    """The colors of new things that are told one by one: "two mugs, one blue and one green"."""
    tokens, out = clause.tokens, list[str]()
    for number, color in itertools.pairwise(tokens):
        if number.text == "one" and color.kind == "color" and isinstance(color.value[0], str):
            clause.take(number)
            clause.take(color)
            out.append(color.value[0])
    return out


def _tints(clause: Clause) -> tuple[list[str], list[str] | None]:
    """The colors of which a new thing has one, or those that it must not have; None where nothing is said of these.

    Raises NotUnderstood for one that the library is not searched by.
    """
    at = next((k for k, one in enumerate(clause.tokens) if one.kind == "not"), len(clause.tokens))
    banned = [tint for one in clause.tokens[at:] if one.kind == "color" for tint in one.value]
    for one in [one for one in clause.tokens[at:] if one.kind in ("color", "or", "not")]:
        clause.take(one)
    told = clause.every("color")
    told += _led_by_color(clause) if told else []
    tints = [tint for one in told for tint in one.value]
    if any(not isinstance(tint, str) for tint in (*tints, *banned)):
        raise NotUnderstood(
            f"{clause.text!r}: new things are found by plain color words, such as red"
        )
    free = not told and (banned or clause.has("paint", "any")) and clause.every("vary", "any")
    if tints or free:
        clause.every("paint", "or")
    return tints, banned if free else None


def _led_by_color(clause: Clause) -> list[Token]:
    """The color that stands behind an "or" before the noun, "a red or blue mug", taken out of that."""
    for k, one in enumerate(clause.tokens[1:], 1):
        first, *rest = one.value.words.split() if one.kind == "thing" else [""]
        if clause.tokens[k - 1].kind == "or" and rest and color_space.canonical(first):
            clause.tokens[k - 1 : k + 1] = [
                Token("thing", one.text, Named(" ".join(rest), fresh=True))
            ]
            return [Token("color", first, [first])]
    return []


def _free(words: str, banned: list[str]) -> tuple[list[str | None], list[str]]:
    """The colors in which the library has a kind of thing, but some, and a note. Raises NotUnderstood for none."""
    kind = "block" if words == "cube" else singular(words)
    there = {one.color for one in library.assets() if one.category == kind}
    left = sorted(c for c in there if not any(color_space.akin(c, other) for other in banned))
    if there and not left:
        raise NotUnderstood(f"the library has a {words!r} in {', '.join(sorted(there))} alone")
    note = [f"{words!r} in the colors that the library has: {', '.join(left)}"] if left else []
    return ([None] if len(left) == len(there) else [*left]), note


def _inserted(
    named: list[Named],
    tints: Sequence[str | None],
    apart: bool,
    place: Entry,
    count: int,
    counted: bool,
    wish: Wish,
) -> Meant:
    """An edit for each new thing, `count` times for the first, in one of some colors, or in each if they are apart."""
    edits, notes = list[Entry](), list[str]()
    for one in named:
        if not (one.fresh or counted or one.words in _names()) and one.words == singular(one.words):
            raise NotUnderstood(
                f"{one.words!r}: is it there already, or a new one? say `a {one.words}`, or `move` it"
            )
        options = list[Entry]()
        for tint in tints or [None]:
            fields, note = asset(one.words, tint, wish.setting.generates)
            options.append({"op": "insert", **fields, **place})
            notes += note
        whole = [one_of(options)] * (count if one is named[0] else 1)
        edits += options if apart else whole
    return Meant(edits=tuple(map(deepcopy, edits)), mention=NEW, notes=tuple(dict.fromkeys(notes)))


def _tint(clause: Clause) -> str | None:
    """The color that new things are of. Raises NotUnderstood for one that the library cannot be searched by."""
    color = clause.one("color")
    if color is not None and not isinstance(color.value[0], str):
        raise NotUnderstood(
            f"{color.text!r}: new things are found by plain color words, such as red"
        )
    return color.value[0] if color is not None else None


def _anchor(words: str) -> Named:
    return Named(words, pronoun=words in PRONOUNS)


def _names() -> frozenset[str]:
    """What the library's assets are called."""
    return frozenset(one.name for one in library.assets())


def _alike(kind: str, categories: list[str]) -> str | None:
    """The category that means about the same; none without the extra `words`."""
    try:
        return synonym(kind, categories)
    except MissingExtra:
        return None


def asset(text: str, tint: Any, generates: bool) -> tuple[Entry, list[str]]:
    """The fields of `insert` that find a thing in the library. Raises NotUnderstood if nobody has or makes it."""
    parts = [singular(word) for word in text.split()]
    known = library.assets()
    categories = sorted({one.category for one in known})
    tints = [one for word in parts if (one := color_space.canonical(word))]
    plain = [word for word in parts if not color_space.canonical(word) or len(parts) == 1]
    plain = [word for word in plain if word not in ("small", "big", "coffee", "new")]
    kind, tint = " ".join(plain), (tints[0] if tints else tint)
    exact = [
        one.name
        for one in known
        if sorted(one.name.split("_")) == sorted(parts) or one.name == text.replace(" ", "_")
    ]
    if exact and not (tints and kind in categories):
        return {"asset": exact[0]}, []
    kind = "block" if kind == "cube" else kind
    notes, said = list[str](), kind
    if kind not in categories and not generates:
        last = plain[-1] if len(plain) == 2 and plain[-1] in categories else None
        if other := last or _alike(kind, categories):
            notes.append(f"{kind!r} is taken to mean {'a ' + other if last else repr(other)}")
            kind = other
    if kind not in categories and not generates:
        names = ", ".join(one.name for one in known)
        raise NotUnderstood(
            f"the library has no {kind!r}; kinds are: {', '.join(categories)}; names are: {names}. "
            "`rpaug assets add` adds one, and --generator has one made"
        )
    if tint and not generates:
        try:
            library.find(kind, tint)
        except TargetError as error:
            why = f"the library has no {said!r}: " if said != kind else ""
            raise NotUnderstood(
                f"{why}{error}. `rpaug assets add` adds one, and --generator has one made"
            ) from None
    return {"category": kind, **({"color": tint} if tint else {})}, notes


def move(clause: Clause, wish: Wish, namer: Namer) -> Meant | None:
    """A thing stands elsewhere: by so much, at a place, near something, or anywhere within bounds."""
    put = any(one.text in PUT for one in (*clause.tokens, *clause.taken))
    if (
        not (clause.has("move") or put)
        or not clause.has("thing")
        or clause.has("lay", "texture", "color", "paint")
    ):
        return None
    shifts = bool(clause.every("move"))
    clause.every("add")
    near = clause.every("near") or (clause.says("within") and clause.has("length"))
    named = clause.things()
    far, at = clause.amounts("length"), clause.one("point")
    ways = [one for one in clause.every(*SIDES, "up", "down") if not put or one.text != "down"]
    beside = clause.things() if near else []
    if len(beside) > 1 or (beside and ways):
        raise NotUnderstood(f"{clause.text!r}: near one thing, or by a length along a direction")
    first, relation, anchor = parted(named[-1].words) if named else ("", "", "")
    if relation == "closest to" and not ways and not at:
        named, beside = [*named[:-1], Named(first)], [_anchor(anchor)]
    clause.every("vary", "from", "on")
    fields: Entry = {}
    if beside:
        fields = {"near": namer.target(beside[0])} | ({"within": far[0].high} if far else {})
    elif at:
        fields["to"] = at.value[:2]
    elif ways:
        if len(far) != len(ways) or any(one.how != "exact" for one in far):
            raise NotUnderstood(f"{clause.text!r}: how far? say a length, such as 5 cm")
        if any(one.kind not in SIDES for one in ways):
            raise NotUnderstood("things move ahead, back, left and right, as the robot sees it")
        steps = [
            (f.low * SIDES[w.kind][0], f.low * SIDES[w.kind][1])
            for f, w in zip(far, ways, strict=True)
        ]
        fields["by"] = [tidy(sum(step[k] for step in steps)) or 0 for k in (0, 1)]
    elif far:
        if far[0].how == "exact":
            raise NotUnderstood(f"{clause.text!r}: which way? or say `by up to`")
        fields["shift"] = far[0].high
    elif not shifts and not any(
        one.text in ("somewhere else", "elsewhere") for one in clause.taken
    ):
        return None
    return each(namer, named, {"op": "move"}, fields)


def each(
    namer: Namer,
    named: list[Named],
    head: Entry,
    fields: Entry,
    mention: Mention | None = None,
    notes: tuple[str, ...] = (),
) -> Meant:
    """The edit for each thing. Raises NotUnderstood if there is none."""
    if not named:
        raise NotUnderstood("which thing is meant?")
    targets = [every(namer.counted(one)) if one.several else namer.target(one) for one in named]
    last = Mention(kind="target", target=targets[0]) if len(targets) == 1 else None
    edits = tuple({**head, "target": one, **fields} for one in targets)
    return Meant(edits=edits, mention=mention or last, notes=notes)


def parted(text: str) -> tuple[str, str, str]:
    """A phrase up to its first relation, the relation and what it is to."""
    spoken = text.split()
    for k in range(1, len(spoken)):
        name, size = relations.relation_at(spoken, k)
        if size:
            return " ".join(spoken[:k]), name, " ".join(spoken[k + size :]).removeprefix("the ")
    return text, "", ""


def anything(named: list[Named]) -> bool:
    """Are no things in particular meant: "all objects"?"""
    return bool(named) and all(one.words in ANYTHING for one in named)


def one_of(options: list[Entry]) -> Entry:
    """One of several edits, drawn for each copy."""
    return options[0] if len(options) == 1 else {"one_of": options}


def whole(amount: Amount) -> int:
    """How many things an amount says. Raises NotUnderstood for none or too many."""
    if amount.low != int(amount.low) or amount.low < 1 or amount.low != amount.high:
        raise NotUnderstood(f"{amount.low:g} to {amount.high:g} things: say one whole number")
    if amount.low > MOST:
        raise NotUnderstood(f"{amount.low:g} things are too many: at most {MOST} at once")
    return int(amount.low)
