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
    return "".join(
        char.encode("unicode_escape").decode()
        if unicodedata.category(char) in INVISIBLE and char not in "\n\t"
        else char
        for char in text
    )


def markdown(text: str) -> str:
    """The text as one line of Markdown that shows it as it is."""
    return MARKS.sub(r"\\\1", html.escape(" ".join(visible(text).split()), quote=False))
