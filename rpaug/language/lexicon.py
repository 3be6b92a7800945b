"""What words ask for, beside values and things: those of every operator's `asked_as`, and ours in lexicon.txt.

There "kind: phrase, phrase" says what phrases ask for; "@name: word, word" is a list of words that a module goes by.
"""

import re
from collections.abc import Iterator, Mapping
from functools import cache
from importlib.resources import files

from rpaug.core import registry

MARKS: Mapping[str, str] = {";": "stop", ",": "and", "(": "and", ")": "and"}


@cache
def senses() -> Mapping[str, str]:
    """What each phrase asks for: operators' own, and over them ours."""
    operators = [registry.operator(name).asked_as for name in registry.operator_names()]
    ours = {kind: text for kind, text in _blocks().items() if kind[0] != "@"}
    every = ((kind, text) for block in (*operators, ours) for kind, text in block.items())
    return {**{phrase: kind for kind, text in every for phrase in _phrases(text)}, **MARKS}


@cache
def group(name: str) -> frozenset[str]:
    """A list of words that a module goes by."""
    return frozenset(_phrases(_blocks()[f"@{name}"]))


@cache
def _blocks() -> Mapping[str, str]:
    text = (files("rpaug.language") / "lexicon.txt").read_text(encoding="utf-8")
    parts = re.split(r"^(@?\w+):", text, flags=re.MULTILINE)[1:]
    return dict(zip(parts[::2], parts[1::2], strict=True))


def _phrases(text: str) -> Iterator[str]:
    """The phrases of a text, parted by commas."""
    return (" ".join(one.split()) for one in text.split(",") if one.strip())
