"""A wish as tokens: each word is of a value, a thing, a camera, a phrase that asks for something, or unknown."""
# ruff: noqa: E501  # patterns are easiest to read whole

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from typing import Any

from rpaug.language import things, values
from rpaug.language.lexicon import group, senses
from rpaug.language.messages import NotUnderstood
from rpaug.scene.targets import relations, shapes

SPELLED = (
    (r"[’`]", "'"), (r"[“”\"]|(?<!\w)'|'(?!\w)", " "), (r"[–—]", "-"), (r"→|=>|-+>|\bbecomes\b", " -> "),
    (r"≥|>=|(?<!-)>", " at least "), (r"≤|<=", " at most "), (r"≈|~", " about "), (r"°", " degrees "), (r"\bw/", "with "),
    (r"\+ ?/ ?-|\+-|plus[ /-]minus|plus or minus", "±"), (r"(?<=[a-z])'s\b(?<!it's)(?<!there's)(?<!that's)(?<!let's)(?<!what's)", ""),
    (r"\+(?=\d)", ""), (r"\+|&", " and "), (r"(?<=[a-z]) ?/ ?(?=[a-z])", " or "), (r"(?<=[a-z%]) ?/ ?(?=\d)", " and "), (r"(?<=[a-z,]) - (?=[a-z])", " , "), (r"(?<=[a-z])-ish\b", "ish"), (r"\btable ?cloth\b", "table"), (r"\bgrey", "gray"), (r"\bnon[- ](?=[a-z])", "not "), (r"colour", "color"),
    (r"\bboth (?=the [^,;]+ and )", ""), (r"\b(?:all )?(?:the )?(stuff|things|objects|items|everything|anything) (?:what|that|which) (?:is|are) (?=not needed)", r"\1 "),
    (r"\bu\b", "you"), (r"\ba few\b|\bseveral\b", "some"), (r"\bshd\b", "should"), (r"\b(?:diff|diffrent)\b", "different"), (r"\bsth\b", "something"),
    (r"(?<![\d.])([1-9])/([2-9]|10)(?![\d/.])(?! ?(?:inch|cm|m\b|stop))", lambda m: f"{100 * int(m[1]) / int(m[2]):.4g} % "),
    (r"(\d+)/(\d+)(?= ?(?:inch|cm|of|the|m\b))", lambda m: f"{int(m[1]) / int(m[2]):.4g}"), (r"[!?.]+(?= |$)|[!?\n]+", " ; "),
    (r" a?round(?= at random| by|$| ?[,;])", " "), (r"\bphoto[- ]?graph", "photo"), (r"\([^)\d]*\)", lambda m: f" , {m[0][1:-1]} , "),
)  # fmt: skip
PLAIN = "|".join(sorted(things.PLAIN))
PLAINLY = re.compile(rf"\b({PLAIN}) ?,(?= ?(?:{PLAIN})\b)")
"""A mark between two words that tell nothing: "plain, boring walls"."""
ATTRIBUTE = "|".join(
    map(re.escape, sorted({*values.TINTS, *relations.RANKS}, key=len, reverse=True))
)
BOTH = re.compile(rf"\b(the|of) ({ATTRIBUTE}) and (?:the )?({ATTRIBUTE}) ([a-z]+s)\b")
WORD = re.compile(
    r"->|(?<!\d )(?<!% )(?<![\w%])-\d+(?:\.\d+)?|\d+(?:\.\d+)?|\.\d+|#[0-9a-f]{6}|[a-z][a-z0-9_']*(?:-[a-z][a-z0-9_']*)*|\S"
)
CHANCE = frozenset(["probability", "prob", "chance", "p", "likelihood"])
COPIES = group("tokens_copies")
LEAD = group("tokens_lead")
ORDINALS = {"second": 2, "other": 2, "third": 3, "fourth": 4, "fifth": 5, "tenth": 10}
OFTEN = {"sometimes": 0.5, "occasionally": 0.25}
FILLING = frozenset(["of", "the", "all", "them", "is", "to", "as", "=", ":", "-"])
EACH = r"(?: each)?(?: (?:of|per|for) (?:each |every |an |the )?episode)?(?: please)?(?! of)"
SETTINGS = {
    "copies": rf"(?:(?:make|write|give me|create|produce|generate|with|in|as|i need|i want|for|now) )*(?:a total of )?(?P<n>NUM) (?:augmented )?(?:copies|versions|variants|variations){EACH}(?: with\b)?",
    "keep_originals": r"(?:(?:keep|keeping|write|with|include|retain|preserve)(?: all)?(?: of)?(?: the)? originals?(?: (?:episodes|recordings))?|(?:the )?originals?(?: should be| must be| are)? (?:kept|included|retained))(?: in| too| as well| also)?",
    "seed": r"(?:(?:with|use|using|set) )*(?:the |a )?(?:random )?seed(?: number)?(?: of| to| is| as)?(?: [=:])? (?P<n>\d+)",
    "select": r"(?:(?:only|in|for|on|of|from|using|do|take) )+(?:only |just )?(?:the )?first (?:(?P<n>NUM) )?(?:episodes?|recordings?|demonstrations?|demos?)(?: only)?",
}  # fmt: skip
NUMBERED = "|".join([r"\d+(?: \. \d+)?", *sorted(values.NUMBERS, key=len, reverse=True)])
SETTING = {
    name: re.compile(rf"{text.replace('NUM', f'(?:{NUMBERED})')}(?= |$)")
    for name, text in SETTINGS.items()
}
CAMERA = group("tokens_camera")
EVERY = group("tokens_every")
CARRIED = ("wrist", "hand", "gripper")
"""Parts of the names of cameras that move with the robot."""
STANDING = frozenset(["fixed", "static", "other"])
POSED = group("tokens_posed")
VERBS = group("tokens_verbs")
NEVER = ("never", "do not", "don't", "dont", "no")
JOINS = ("and", "filler", "stop")
WEAK = ("filler", "do", "to", "and", "further")
"""Kinds of tokens that any edit may leave out: they join what is said, and ask for nothing."""


@dataclass(frozen=True)
class Token:
    """Some words, what kind they are of, and their value."""

    kind: str
    text: str
    value: Any = None


@dataclass
class Clause:
    """The tokens of a clause. What an edit takes is gone; what is left at the end was not understood."""

    tokens: list[Token]
    taken: list[Token] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.text = said(self.tokens)

    def has(self, *kinds: str) -> bool:
        return any(token.kind in kinds for token in self.tokens)

    def says(self, *words: str) -> bool:
        """Do some words stand in it, taken or not?"""
        return any(f" {one} " in f" {self.text} " for one in words)

    def absolute(self) -> bool:
        """Is an amount what is reached, "to 40 %", "60 % of now", rather than by how much it changes?"""
        led = any(
            one.kind == "to" and one.text in ("to", "as", "like")
            for one in (*self.tokens, *self.taken)
        )
        return led or self.says(
            "of the", "of now", "of what it is", "of its", "of before", "of that"
        )

    def one(self, *kinds: str) -> Token | None:
        """The first token of these kinds, taken."""
        token = next((one for one in self.tokens if one.kind in kinds), None)
        if token is not None:
            self.take(token)
        return token

    def every(self, *kinds: str) -> list[Token]:
        """All tokens of these kinds, taken."""
        found = [token for token in self.tokens if token.kind in kinds]
        for token in found:
            self.take(token)
        return found

    def after(self, kind: str, *kinds: str) -> Token | None:
        """The first token of these kinds behind one of `kind`, both taken."""
        start = next((k for k, one in enumerate(self.tokens) if one.kind == kind), len(self.tokens))
        token = next((one for one in self.tokens[start:] if one.kind in kinds), None)
        if token is not None:
            self.take(self.tokens[start])
            self.take(token)
        return token

    def amounts(self, *kinds: str) -> list[values.Amount]:
        """All amounts of these kinds, taken."""
        return [one.value for one in self.every(*kinds)]

    def single(self, *kinds: str) -> list[values.Amount]:
        """The amount of these kinds, taken, if there is one. Raises NotUnderstood for several."""
        found = self.amounts(*kinds)
        if len(found) > 1:
            raise NotUnderstood(f"{self.text!r}: one amount at a time, please")
        return found

    def take(self, token: Token) -> None:
        """That token is accounted for."""
        self.tokens = [one for one in self.tokens if one is not token]
        self.taken.append(token)

    def things(self, *after: str) -> list[things.Named]:
        """The things that stand side by side, the first of them behind a token of these kinds if any is given."""
        start = next((k for k, one in enumerate(self.tokens) if one.kind in after), -1) + 1
        found: list[things.Named] = []
        for token in self.tokens[start:]:
            if token.kind == "thing":
                found.append(token.value)
                self.take(token)
            elif after and found and token.kind == "or":  # "all but the cup or the stove"
                self.take(token)
            elif found and token.kind != "and" and token.text != "the":
                break
        return found

    def done(self) -> None:
        """See that nothing is left. Raises NotUnderstood with what is."""
        left = [token.text for token in self.tokens if token.kind not in WEAK]
        if left:
            raise NotUnderstood(
                f"{self.text!r}: {', '.join(map(repr, left))} is not understood here"
            )


def said(tokens: Sequence[Token]) -> str:
    """The words of some tokens."""
    return " ".join(one.text for one in tokens)


def split(stated: str) -> list[str]:
    """A wish as words and marks: lower case, one spelling of marks and units."""
    text = stated.lower()
    for pattern, other in SPELLED:
        text = re.sub(pattern, other, text)
    text = PLAINLY.sub(r"\1", text)
    text = BOTH.sub(
        lambda m: f"{m[1]} {m[2]} {(noun := relations.singular(m[4]))} and the {m[3]} {noun}", text
    )
    return WORD.findall(text)


def tokens(words: Sequence[str], cameras: Sequence[str], nouns: Collection[str]) -> list[Token]:
    """The tokens of some words. Raises NotUnderstood for a camera that the recording lacks."""
    out: list[Token] = []
    at = 0
    while at < len(words):
        verb = next((one for one in reversed(out) if one.kind in VERBS), None)
        adds = verb is not None and verb.kind == "add" and verb.text != "lay"
        bare = _bare_camera(words, at, cameras, out[-1].kind if out else "stop")
        size, kind, value = bare or _next(words, at, cameras, nouns, adds)
        if kind == "color" and out and out[-1].text in NEVER:  # "never red" leaves a color out
            out[-1] = Token("not", out[-1].text)
        if kind == "strangers" and out and out[-1].text == "no":
            out[-1] = Token("remove", "no")
        if kind == "chance" and out and out[-1].kind == "each":  # of what was listed
            kind, value = "share", values.Amount(value, value)
        if words[at : at + size] == ["all", "but"]:
            out.append(Token("all", "all"))
        out.append(Token(kind, " ".join(words[at : at + size]), value))
        at += size
    if any(one.kind == "thing" for one in out):
        return out
    return [part for one in out for part in _of_light(one)]


def _of_light(token: Token) -> list[Token]:
    """A token, or where it is a brightness that no thing has, the light and its amount."""
    words = token.text.split()
    much = values.amount(words, 1) if token.kind == "color" and words[0] == "brightness" else None
    if much is None or much[0] != len(words) - 1:
        return [token]
    return [Token("light", words[0]), Token(much[1], " ".join(words[1:]), much[2])]


def _next(
    words: Sequence[str], at: int, cameras: Sequence[str], nouns: Collection[str], adds: bool
) -> tuple[int, str, Any]:
    """How many words the next token takes, its kind and value."""
    phrase = values.longest(words, at, senses())
    kind = senses().get(phrase, "unknown")
    if kind in ("even", "filler") and len(phrase.split()) > 2:
        return len(phrase.split()), kind, None
    if found := _setting(words, at):
        return found[0], "setting", found[1]
    if shared := chance(words, at):
        return shared[0], "chance", shared[1]
    if seen := camera(words, at, cameras):
        return seen[0], "camera", seen[1]
    if there := values.point(words, at):
        return there[0], "point", there[1]
    if much := values.amount(words, at):
        return much
    rest = list(words[at : at + 20])
    shares = (k for k, word in enumerate(rest) if k and word == "in" and chance(words, at + k))
    rest = rest[: next(shares, len(rest))]
    named = things.begins(rest, nouns)
    skipped = next((k for k, one in enumerate(rest) if one not in things.UNSAID), 0)
    size, fits = (0, []) if adds and named else values.texture(rest[skipped:])
    definite = words[at] in ("the", "this", "that", "both")
    if size and not (named and _solid(named[1].words, definite)):
        return skipped + size, "texture", fits
    colored = values.color(words, at)
    if colored and not (named and named[0] > colored[0]) and colored[0] >= len(phrase.split()):
        return colored[0], "color", colored[1]
    longer = named and (len(phrase.split()) <= 1 or named[0] > len(phrase.split()))
    if named and longer and (phrase != named[1].words or kind == "filler"):
        return named[0], "thing", named[1]
    return (len(phrase.split()), kind, None) if phrase else (1, "unknown", None)


def _solid(name: str, definite: bool) -> bool:
    """Is the head of a noun phrase a known thing rather than a texture: "the wooden box"?"""
    head = relations.singular(name.split()[-1])
    known = head in shapes.WORDS and (definite or head not in ("brick", "marble", "tile"))
    return known or head in things.ROLES or head in relations.PARTS


def _setting(words: Sequence[str], at: int) -> tuple[int, dict[str, Any]] | None:
    """What is said of the whole recipe from a word on. Raises NotUnderstood for no number of copies."""
    rest = " ".join(words[at : at + 14])
    for name, pattern in SETTING.items():
        if found := pattern.match(rest):
            stated = found.groupdict().get("n")
            number = values.number(stated.split(), 0)[1] if stated else 1
            if number != int(number) or (number < 1 and name == "copies"):
                raise NotUnderstood(f"{stated!r} is no number of copies")
            value: Any = {"keep_originals": True, "select": {"limit": int(number)}}.get(
                name, int(number)
            )
            return len(found.group().split()), {name: value}
    return None


def chance(words: Sequence[str], at: int) -> tuple[int, float] | None:
    """The share of copies that is said from a word on. Raises NotUnderstood for no share."""
    k = at
    while words[k : k + 1] and words[k] in LEAD and not values.longest(words, k, values.PARTS):
        k += 1
    led = " ".join(words[at:k])
    if words[k : k + 1] and words[k] in OFTEN:
        return k + 1 - at, OFTEN[words[k]]
    if words[k : k + 2] == ["other", "half"]:
        end = _copies(words, k + 2)
        return (end or k + 2) - at, 0.5
    ordinal = next(
        (
            ORDINALS.get(one) or int(one)
            for one in words[k : k + 1]
            if one in ORDINALS or one.isdecimal()
        ),
        0,
    )
    if {"every", "each"} & set(led.split()) and ordinal:
        end = _copies(words, k + 1 + (words[k + 1 : k + 2] in (["rd"], ["th"], ["nd"])))
        if end:
            return end + 2 * (words[end : end + 2] == ["or", "so"]) - at, values.tidy(1 / ordinal)
    if words[k : k + 1] and words[k] in CHANCE:
        k += 1
        while words[k : k + 1] and words[k] in FILLING:
            k += 1
        found = values.amount(words, k)
        return (
            (k + found[0] - at, _share(found[2].low))
            if found and found[1] in ("share", "number")
            else None
        )
    return _counted(words, at, k)


def _counted(words: Sequence[str], at: int, k: int) -> tuple[int, float] | None:
    """A share of copies that begins with its amount: "30 % of copies", "one in ten", "a 40 % chance"."""
    size, first, _ = values.number(words, k)
    k += size
    between = next(
        (
            n
            for n in (2, 1)
            if " ".join(words[k : k + n]) in ("in", "of", "out of", "of every", "in every")
        ),
        0,
    )
    more, second, kind = values.number(words, k + between) if size and between else (0, 0.0, "")
    if more and second > first and kind == "number" and (end := _copies(words, k + between + more)):
        return end - at, values.tidy(first / second)
    found = values.amount(words, k - size)
    if (
        found is None
        or found[1] not in ("share", "times")
        or found[2].how not in ("exact", "about")
    ):
        return None
    if found[1] == "times" and words[k : k + 1] in (["x"], ["times"]):
        return None
    k += found[0] - size
    if words[k : k + 1] and words[k] in CHANCE:
        return k + 1 - at, _share(found[2].low)
    led = set(words[at:k])
    ends = (
        "in" in led
        and not led & {"each", "every"}
        and words[k : k + 1] in ([], [","], [";"], ["and"])
    )
    end = _copies(words, k) or ends * k
    return (end - at, _share(found[2].low)) if end else None


def _copies(words: Sequence[str], k: int) -> int:
    """Where words for the copies end that stand from the k-th word on; 0 if there are none."""
    while words[k : k + 1] and words[k] in FILLING:
        k += 1
    if not (words[k : k + 1] and words[k] in COPIES):
        return 0
    return k + 1 + (words[k + 1 : k + 2] == ["only"])


def _share(value: float) -> float:
    if not 0 <= value <= 1:
        raise NotUnderstood(f"{value:g} is no probability")
    return value


def camera(words: Sequence[str], at: int, cameras: Sequence[str]) -> tuple[int, Any] | None:
    """The cameras that are named from a word on: their names, "static" for all, [] for one without a name.

    Raises NotUnderstood for a name that no camera has.
    """
    k = at
    while words[k : k + 1] and words[k] in EVERY:
        k += 1
    if words[k : k + 1] in (["cameras"], ["cams"], ["viewpoints"]) or (
        words[k : k + 1] in (["camera"], ["cam"]) and {"all", "every", "each"} & set(words[at:k])
    ):
        return _posed(words, k + 1) - at, _every(words[at:k], cameras)
    chosen, k, last = list[str](), at, at
    while words[k : k + 1] and (words[k] in ("the", "both", "all") and k - last < 3):
        k += 1
        if named := _name(words, k, cameras):
            k, chosen, last = k + named[0], [*chosen, *named[1]], k + named[0]
    if not chosen and k < len(words) and (named := _name(words, k, cameras)):
        k, chosen = k + named[0], named[1]
        while words[k : k + 1] and words[k] in (",", "and", "the"):
            more = next(
                (
                    n
                    for n in (k + 1, k + 2)
                    if (words[n - 1 : n] != ["the"] or n > k + 1) and _name(words, n, cameras)
                ),
                0,
            )
            found = _name(words, more, cameras) if more else None
            if found is None:
                break
            k, chosen = more + found[0], [*chosen, *found[1]]
    if chosen and words[k : k + 1] and words[k] in CAMERA:
        return _posed(words, k + 1) - at, list(dict.fromkeys(chosen))
    return _unnamed(words, at, cameras)


def _every(led: Sequence[str], cameras: Sequence[str]) -> Any:
    """All cameras by their names where one of them is carried and all are meant, else "static" for those that stand."""
    whole = {"all", "every", "each", "five", "four", "three", "two"} & set(led)
    carried = any(part in name.lower() for name in cameras for part in CARRIED)
    return list(cameras) if whole and carried and not STANDING & set(led) else "static"


def _bare_camera(
    words: Sequence[str], at: int, cameras: Sequence[str], before: str
) -> tuple[int, str, Any] | None:
    """A camera's name alone: "except wrist", and before a colon "overhead: ..."."""
    k = at + (words[at] == "the")
    named = _name(words, k, cameras) if k < len(words) else None
    if named is None or len(named[1]) > 1:
        return None
    end = k + named[0]
    follows = words[end : end + 1]
    alone = before in ("not", "keep") and follows in ([], [","], [";"], [")"], ["and"], ["alone"])
    headed = before in ("stop", "and") and follows == [":"]
    return (end - at, "camera", named[1]) if alone or headed else None


def _unnamed(words: Sequence[str], at: int, cameras: Sequence[str]) -> tuple[int, Any] | None:
    """A camera without a name. Raises NotUnderstood for a name that none has."""
    k = at + (words[at : at + 1] in (["the"], ["a"]))
    if (
        words[k : k + 1] in (["camera"], ["cam"])
        and k + 1 < len(words)
        and (named := _name(words, k + 1, cameras))
    ):
        return k + 1 + named[0] - at, named[1]
    if words[k : k + 1] in (["camera"], ["cam"]):
        every = words[k + 1 : k + 2] in (["jitter"], ["shake"], ["perturbation"])
        return _posed(words, k + 1) - at, "static" if every else list(cameras) if len(
            cameras
        ) == 1 else []
    if (
        words[k + 1 : k + 2] in (["camera"], ["cam"])
        and re.fullmatch("[a-z_-]+", words[k])
        and words[k] not in senses()
    ):
        raise NotUnderstood(f"no camera is called {words[k]!r}; there are: {', '.join(cameras)}")
    return None


def _name(words: Sequence[str], at: int, cameras: Sequence[str]) -> tuple[int, list[str]] | None:
    """The cameras of the longest name from a word on; of a part of their names if they are several."""
    for size in (4, 3, 2, 1):
        spoken = re.sub("[ -]", "_", " ".join(words[at : at + size]))
        fits = [one for one in cameras if spoken in _spelled(one)]
        if fits and len(words) >= at + size:
            return size, fits
    part = words[at : at + 1]
    several = words[at + 1 : at + 2] in (["cameras"], ["cams"])
    fits = [one for one in cameras if part and several and part[0] in one.lower().split("_")]
    return (1, fits) if fits else None


def _spelled(name: str) -> tuple[str, ...]:
    plain = name.lower().replace("-", "_")
    return plain, plain.removesuffix("_camera"), plain.removesuffix("_rgb")


def _posed(words: Sequence[str], k: int) -> int:
    """Where a camera ends with what may follow it: "the front camera's pose"."""
    return k + (words[k : k + 1] != [] and words[k] in POSED)


def known(cameras: Sequence[str]) -> frozenset[str]:
    """All words that a wish is made of, beside the things of its scene."""
    looks = (
        values.TINTS,
        values.KINDS,
        values.LIKE,
        values.shipped.NAMES,
        values.SHADES,
        values.MANNERS,
        values.HUED,
    )
    amounts = (
        values.NUMBERS,
        values.PARTS,
        values.UNITS,
        values.HOW,
        values.CHANNELS,
        CHANCE,
        COPIES,
        OFTEN,
    )
    named = (
        shapes.WORDS,
        relations.PARTS,
        relations.GRIPS,
        relations.RANKS,
        relations.RELATIONS,
        relations.ORDINALS,
    )
    roles = (
        things.ROLES,
        things.roles.NAMES,
        things.PRONOUNS,
        things.PLAIN,
        things.PATTERNED,
        things.FURNITURE,
    )
    others = (
        things.ROBOTS,
        things.FINGERS,
        [things.HANDLED.pattern],
        SETTINGS.values(),
        cameras,
        CAMERA,
        senses(),
    )
    every = (part for table in (*looks, *amounts, *named, *roles, *others) for part in table)
    return frozenset(word for part in every for word in re.findall(r"[a-z]+", part))
