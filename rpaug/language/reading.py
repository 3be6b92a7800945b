"""One clause of a wish into tokens, every one of which an edit must account for."""
# ruff: noqa: E501  # patterns and word lists are easiest to read whole

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from typing import Any

from rpaug.core import color_space
from rpaug.language import naming, words
from rpaug.language.lexicon import CLASSES
from rpaug.language.messages import NotUnderstood
from rpaug.language.words import Token

LONGEST = max(len(phrase.split()) for phrase in CLASSES)
CAMERA = ("camera", "cam", "cameras", "cams", "view", "viewpoint", "views")
POSE = re.compile(
    r"(?:'s)? (?:pose|position|viewpoint|placement|location|orientation|extrinsics|angle|mount)s?\b"
)
EVERY = re.compile(r"(?:(?:all|every|each|both|the)(?: of)? )*(?:the )?(?:two |three |four |five |static |fixed )*(?:cameras|cams|camera poses|viewpoints)\b|(?:every|each|all) (?:static |fixed )?(?:camera|cam)\b|camera(?: pose)?(?= (?:jitter|shake|perturbation|noise on))")  # fmt: skip
WEAK = ("filler", "do", "to", "and", "further")
"""Kinds of tokens that any edit may leave out: they join what is said, and ask for nothing."""


@dataclass
class Clause:
    """The tokens of a clause. What an edit takes is gone; what is left at the end was not understood."""

    text: str
    tokens: list[Token]
    taken: list[Token] = field(default_factory=list)

    def has(self, *kinds: str) -> bool:
        return any(token.kind in kinds for token in self.tokens)

    def one(self, *kinds: str) -> Token | None:
        """The first token of these kinds, taken."""
        for token in self.tokens:
            if token.kind in kinds:
                self._take(token)
                return token
        return None

    def every(self, *kinds: str) -> list[Token]:
        """All tokens of these kinds, taken."""
        found = [token for token in self.tokens if token.kind in kinds]
        for token in found:
            self._take(token)
        return found

    def _take(self, token: Token) -> None:
        self.tokens = [one for one in self.tokens if one is not token]
        self.taken.append(token)

    def things(self, *after: str) -> list[naming.Named]:
        """The things that stand side by side, the first of them behind a token of these kinds if any is given."""
        start = next((k for k, one in enumerate(self.tokens) if one.kind in after), -1) + 1
        found: list[naming.Named] = []
        for token in self.tokens[start:]:
            if token.kind == "thing":
                found.append(token.value)
                self._take(token)
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


def clause(text: str, cameras: Sequence[str], nouns: Collection[str] = ()) -> Clause:
    """A clause's tokens. Raises NotUnderstood for a camera that the recording lacks."""
    return Clause(text, list(_tokens(text, cameras, nouns)))


def _tokens(text: str, cameras: Sequence[str], nouns: Collection[str]) -> list[Token]:
    out: list[Token] = []
    rest = text.strip()
    while rest:
        adds = any(one.kind == "add" and one.text != "lay" for one in out)
        token = _next(rest, cameras, nouns, adds)
        out.append(token)
        rest = rest[len(token.text) :].lstrip()
    return out


def _next(rest: str, cameras: Sequence[str], nouns: Collection[str], adds: bool) -> Token:
    spoken = rest.replace(",", " , ").split()
    if rest[0] == ",":
        return Token("and", ",")
    if found := _camera(rest, cameras):
        return found
    if (point := words.POINT.match(rest)) and not re.match(r"[\d.-]+ ?,", rest):
        return Token(
            "point",
            point.group(),
            [words.tidy(float(v)) for v in re.findall(words.DIGITS, point.group())],
        )
    if (found_amount := words.QUANTITY.match(rest)) and (amount := words.quantity(found_amount)):
        return amount
    named = naming.begins(spoken, nouns)
    colored = words.COLORS.match(rest)
    size, fits = (0, []) if adds and named else words.texture(_bare(spoken))
    skipped = len(spoken) - len(_bare(spoken))
    if size and not (named and _known(named[1].words)):
        said = _said(rest, skipped + size)
        return Token("texture", said, fits)
    if colored and not (named and named[0] > len(colored.group().replace(",", " , ").split())):
        return Token("color", colored.group(), words.colors(colored.group()))
    phrase = next(
        (
            p
            for n in range(LONGEST, 0, -1)
            if (p := " ".join(spoken[:n])) in CLASSES and len(spoken) >= n
        ),
        "",
    )
    if (
        named
        and (len(phrase.split()) <= 1 or named[0] > len(phrase.split()))
        and not _function(phrase, named)
    ):
        return Token("thing", _said(rest, named[0]), named[1])
    if phrase:
        return Token(CLASSES[phrase], _said(rest, len(phrase.split())))
    return Token("unknown", _said(rest, 1))


def _function(phrase: str, named: tuple[int, naming.Named]) -> bool:
    """Is a one-word phrase more likely what it does in a wish than a thing, as "cover" or "light"?"""
    return phrase == named[1].words and CLASSES.get(phrase) not in (None, "filler")


def _known(name: str) -> bool:
    """Is the head of a noun phrase a known thing rather than a texture: "the wooden box"?"""
    head = naming.singular(name.split()[-1])
    return (
        (head in naming.shapes.WORDS and head not in ("brick", "marble"))
        or head in naming.ROLES
        or head in naming.relations.PARTS
    )


def _bare(spoken: list[str]) -> list[str]:
    k = 0
    while k < len(spoken) and spoken[k] in words.UNSAID:
        k += 1
    return spoken[k:]


def _said(rest: str, count: int) -> str:
    """The first so many words, commas counted, as they stand in the text."""
    found = re.match(rf"(?:\s*(?:,|[^\s,]+)){{{count}}}", rest)
    return found.group() if found else rest


def _camera(rest: str, cameras: Sequence[str]) -> Token | None:
    if every := EVERY.match(rest):
        return _posed(rest, every.group(), "static")
    found = re.match(
        r"((?:the |both |all )?)((?:[a-z0-9_-]+(?:,? and (?:the )?|, (?:the )?| )){0,6}?)(cameras?|cams?|viewpoint|view)\b",
        rest,
    )
    if found is None:
        return None
    parts = [part for part in re.split(r",? and (?:the )?|, (?:the )?", found[2].strip()) if part]
    if not parts:
        known = list(cameras) if len(cameras) == 1 else None
        if found[3] in ("view", "viewpoint") or (known is None and found[3].endswith("s")):
            return None
        return _posed(rest, found.group(), known or [])
    chosen: list[str] = []
    for part in parts:
        fits = [name for name in cameras if re.sub("[ -]", "_", part) in _spelled(name)]
        if not fits and found[3].endswith("s"):
            fits = [name for name in cameras if set(part.split()) <= set(name.lower().split("_"))]
        if not fits:
            if (
                len(part.split()) > 2
                or set(part.split()) & set(CLASSES) - {"front", "left", "right"}
                or found[3] == "view"
            ):
                return None
            raise NotUnderstood(f"no camera is called {part!r}; there are: {', '.join(cameras)}")
        chosen += fits
    return _posed(rest, found.group(), chosen)


def _spelled(name: str) -> tuple[str, ...]:
    plain = name.lower().replace("-", "_")
    return plain, plain.removesuffix("_camera"), plain.removesuffix("_rgb")


def _posed(rest: str, said: str, value: Any) -> Token:
    """A camera with what may follow it: "the front camera's pose"."""
    more = POSE.match(rest[len(said) :])
    return Token("camera", said + (more.group() if more else ""), value)


def known(cameras: Sequence[str]) -> frozenset[str]:
    """All words that a wish is made of, beside the things of its scene."""
    parts = [
        *CLASSES,
        *words.WORDS,
        *words.UNITS,
        *words.TINTS,
        *color_space.NAMES,
        *cameras,
        *CAMERA,
        *words.HOW,
    ]
    parts += [
        *words.KINDS,
        *words.shipped.NAMES,
        *naming.shapes.WORDS,
        *naming.relations.PARTS,
        *naming.relations.GRIPS,
        *naming.ROLES,
        *naming.PRONOUNS,
        *naming.relations.RANKS,
        *words.SHADES,
        *naming.PLAIN,
        *naming.roles.NAMES,
        naming.HANDLED.pattern,
    ]
    return frozenset(word for part in parts for word in re.findall(r"[a-z]+", part))
