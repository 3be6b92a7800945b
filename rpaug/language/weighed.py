"""Shares of the copies that exclude each other: "blue in 40 %, yellow in 40 %, the rest as recorded"."""

from collections.abc import Callable, Sequence

from rpaug.language import rest, values
from rpaug.language.messages import Entry, Meant, NotUnderstood
from rpaug.language.things import Named
from rpaug.language.tokens import Token, said

SUBJECT = ("thing", "light", "paint", "lay", "style", "size_of", "do", "vary")
"""Kinds of tokens of the first share that the others go without."""
AMOUNTS = ("bigger", "smaller", "less", "more", "scale", "noise", "jpeg")
"""Kinds of tokens that a share may be the amount of."""
IT = Token("thing", "it", Named("it", pronoun=True))
FULL = 1.02


def lots(read: Sequence[Token], meant: Callable[[list[Token]], Meant]) -> Meant | None:
    """One of several edits by their shares; None for a clause that says no such thing. Raises RpaugError."""
    parts = _parts(_named_once(read))
    if len(parts) < 2 or not all(_share(one) or _rest(one) for one in parts) or _compared(read):
        return None
    first, whole, options = None, 0.0, list[Entry]()
    subject = list[Token]()
    for part in parts:
        share = _share(part)
        weight = share.value if share else 1 - whole
        weight = weight if isinstance(weight, float | int) else weight.low
        whole += weight
        if weight <= 0 or whole > FULL:
            raise NotUnderstood(f"{said(read)!r}: the shares come to more than all copies")
        if _untouched(part):
            continue
        plain = [
            one
            for one in part
            if one is not share and one.kind != "rest" and one.text != "otherwise"
        ]
        own = any(one.kind in ("thing", "light", "camera") for one in plain)
        if own and first is not None and not _rest(part):
            return None
        found = meant([*(one for one in subject if not own or one.kind == "vary"), *plain])
        if first is None:
            first, subject = found, _subject(part, found)
        if len(found.edits) != 1 or found.replaces:
            raise NotUnderstood(
                f"{said(part)!r} is no single edit, and shares are drawn of single ones"
            )
        looks = found.edits[0].get("one_of", found.edits)
        options += [{**one, "weight": values.tidy(weight / len(looks))} for one in looks]
    if first is None or (len({one["op"] for one in options}) > 1 and not _rest(parts[-1])):
        return None
    drawn = values.tidy(sum(one["weight"] for one in options))
    chance = {"probability": drawn} if drawn < 2 - FULL else {}
    return Meant(edits=({"one_of": options, **chance},), mention=first.mention, notes=first.notes)


def _subject(part: Sequence[Token], found: Meant) -> list[Token]:
    """What the other parts go without: what the first is about, and its verb."""
    about = found.mention is not None and found.mention.kind == "target"
    words = [one for one in part if one.kind in SUBJECT and not (about and one.kind == "thing")]
    return [IT, *words] if about else words


def _compared(read: Sequence[Token]) -> bool:
    """Are the shares how much something changes: "20% smaller, the rest as it is"?"""
    told = any(one.kind == "chance" for one in read)
    return not told and (
        any(one.kind in AMOUNTS for one in read)
        or any(one.text.endswith("er") and one.kind != "thing" for one in read)
        or len([one for one in read if one.kind in ("share", "times")]) < 2
    )


def _parts(read: Sequence[Token]) -> list[list[Token]]:
    """A clause cut behind each share, at the next mark."""
    parts: list[list[Token]] = [[]]
    for one in read:
        if one.kind in ("and", "stop") and (_share(parts[-1]) or _rest(parts[-1])):
            parts.append([])
        else:
            parts[-1].append(one)
    return [part for part in parts if part]


def _named_once(read: Sequence[Token]) -> list[Token]:
    """Without a texture before the first share that every part says again, "marble table, half black, half white"."""
    at = next((k for k, one in enumerate(read) if _share([one])), 0)
    if not at or (read[at - 1].kind != "and" and read[at - 1].text != ":"):
        return list(read)
    head = [one for one in read[:at] if one.kind == "texture"]
    if len(head) != 1:
        return list(read)
    out = [one for one in read[:at] if one.kind != "texture"]
    for one in read[at:]:
        size, fits = (
            (0, []) if one.kind != "color" else values.texture(f"{one.text} {head[0].text}".split())
        )
        out.append(Token("texture", one.text, fits) if size else one)
    return out


def _share(part: Sequence[Token]) -> Token | None:
    """The share of the copies that a part is for."""
    fits = [one for one in part if one.kind == "chance"]
    fits += [
        one
        for one in part
        if one.kind in ("share", "times")
        and one.value.how == "exact"
        and one.value.high <= 1
        and one.text[0] != "b"
    ]
    return fits[0] if len(fits) == 1 else None


def _rest(part: Sequence[Token]) -> bool:
    """Is a part for all copies that are left?"""
    words = said(part)
    return (
        "other half" in words
        or words.startswith("the other ")
        or any(one.kind == "rest" or one.text == "otherwise" for one in part)
    )


def _untouched(part: Sequence[Token]) -> bool:
    """Is a part left as it was recorded?"""
    words = set(said(part).split())
    return any(one.kind == "keep" for one in part) or bool(words & rest.RECORDED)
