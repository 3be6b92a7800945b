"""Names that others gave (of episodes, files, instructions) shown so that they are nothing but text.

A terminal obeys control characters, Markdown and HTML obey marks; and who reads a name obeys what turns its direction.
"""

import html
import re
import unicodedata

INVISIBLE = {"Cc", "Cf", "Cs", "Zl", "Zp"}  # controls, formats, halves of characters, separators
MARKS = re.compile(r"([\\`*_\[\]|#~])")


def visible(text: str) -> str:
    """The text with what cannot be seen spelled out, as `\\x1b`; line breaks and tabs stay."""
    unseen = (char for char in {*text} - {*"\n\t"} if unicodedata.category(char) in INVISIBLE)
    spelled = {ord(char): char.encode("unicode_escape").decode() for char in unseen}
    return text.translate(spelled) if spelled else text


def quoted(instruction: str) -> str:
    """An instruction in quotation marks, or that there is none."""
    return f"“{instruction}”" if instruction.strip() else "no instruction"


def markdown(text: str) -> str:
    """The text as one line of Markdown that shows it as it is."""
    return MARKS.sub(r"\\\1", html.escape(" ".join(visible(text).split()), quote=False))
