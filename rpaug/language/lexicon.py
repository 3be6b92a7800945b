"""What words ask for in a wish, beside values and things: those of every operator's `asked_as`, and ours (lexicon.txt)."""

import re
from collections.abc import Mapping
from functools import cache
from importlib.resources import files

from rpaug.core import registry

MARKS: Mapping[str, str] = {";": "stop", ",": "and", "(": "and", ")": "and"}


@cache
def senses() -> Mapping[str, str]:
    """What each phrase asks for: operators' own, and over them ours."""
    found: dict[str, str] = {}
    for name in registry.operator_names():
        found |= _spread(registry.operator(name).asked_as)
    text = (files("rpaug.language") / "lexicon.txt").read_text(encoding="utf-8")
    parts = re.split(r"^(\w+):", text, flags=re.MULTILINE)[1:]
    return {**found, **_spread(dict(zip(parts[::2], parts[1::2], strict=True))), **MARKS}


def _spread(blocks: Mapping[str, str]) -> dict[str, str]:
    """What each phrase of the blocks is: the block's name. Phrases are parted by commas."""
    parted = ((kind, phrase) for kind, text in blocks.items() for phrase in text.split(","))
    return {" ".join(phrase.split()): kind for kind, phrase in parted if phrase.strip()}
