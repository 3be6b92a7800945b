"""Spelling: unknown words become the known word of this scene that is nearest, and that is told."""

import re
from collections.abc import Collection, Sequence

from rpaug.scene.targets.relations import singular

SHORTEST = 4  # letters of a word that can be mended; of five to seven one may be wrong, of more two

KEYS = ("qwertyuiop", "asdfghjkl", "zxcvbnm", "qaz", "wsx", "edc", "rfv", "tgb", "yhn", "ujm")


def distance(first: str, second: str) -> int:
    """How many letters are put in, left out, changed, or exchanged with their neighbor (Damerau 1964, restricted)."""
    rows = [list(range(len(second) + 1))]
    for i, a in enumerate(first, 1):
        row = [i]
        for j, b in enumerate(second, 1):
            row.append(min(row[-1] + 1, rows[-1][j] + 1, rows[-1][j - 1] + (a != b)))
            if i > 1 and j > 1 and a == second[j - 2] and first[i - 2] == b:
                row[-1] = min(row[-1], rows[-2][j - 2] + 1)
        rows.append(row)
    return rows[-1][-1]


def slipped(word: str, other: str) -> bool:
    """May somebody mean one word and type another of its length: a key beside, another vowel, the wrong letter doubled?

    Else a word of one other letter is a word of its own: "plant" is no misspelt "plank".
    """
    at = [k for k in range(len(word)) if word[k] != other[k]]
    if len(at) != 1:
        return True
    typed, meant = word[at[0]], other[at[0]]
    beside = any(typed + meant in row or meant + typed in row for row in KEYS)
    doubled = typed in (word[at[0] - 1 : at[0]], word[at[0] + 1 : at[0] + 2])
    return beside or doubled or {typed, meant} <= set("aeiouy")


def nearest(word: str, known: Collection[str]) -> str | None:
    """The one known word of the same first letter that a word misspells; None for none, or several as near."""
    most = 1 if len(word) < 8 else 2
    near = [
        (distance(word, one), one)
        for one in known
        if one[0] == word[0] and abs(len(one) - len(word)) <= most and len(one) >= SHORTEST
    ]
    near = sorted(
        pair
        for pair in near
        if pair[0] <= most
        and (len(word) != len(pair[1]) or slipped(word, pair[1]))
        and (len(word) > SHORTEST or sorted(word) == sorted(pair[1]))
    )
    if (
        len(word) < SHORTEST
        or not near
        or len([pair for pair in near if pair[0] == near[0][0]]) > 1
    ):
        return None
    return near[0][1]


def repaired(words: Sequence[str], known: Collection[str]) -> tuple[list[str], list[str]]:
    """The words, the misspelt among them mended, and a note for each of these."""
    out, notes = list[str](), list[str]()
    for word in words:
        fine = not re.fullmatch("[a-z]+", word) or word in known or singular(word) in known
        other = None if fine else nearest(word, known)
        out.append(other or word)
        notes += [f"{word!r} is read as {other!r}"] if other else []
    return out, notes
