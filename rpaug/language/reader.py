"""What a clause asks for: the first way of changing a scene by whose words and values every token is accounted for."""

import contextlib
from collections.abc import Collection

from rpaug.core import color_space
from rpaug.core.errors import RpaugError
from rpaug.language import (
    gathering,
    lights,
    looks,
    placing,
    templates,
    tokens,
    values,
    viewing,
    weighed,
)
from rpaug.language.gathering import WishState
from rpaug.language.lexicon import group
from rpaug.language.messages import Entry, Meant, NotUnderstood, Wish
from rpaug.language.things import Named, Namer
from rpaug.language.tokens import Clause, Token, said

VERBS = group("reader_acts") | {"do", "warm", "cool"}
IT = weighed.IT
LOOKS = {"color", "texture", "darker", "brighter"}
"""Kinds of words that alone are said of what was named in an earlier wish: "no, green"."""
AFTERTHOUGHT = group("reader_afterthought")
"""Kinds of words that only go on with what the clause before asks for."""
WAYS = (
    placing.physics,
    lights.sensor,
    viewing.camera_pose,
    looks.replaced,
    looks.swapped,
    lights.light,
    placing.duplicate,
    placing.remove,
    placing.object_size,
    placing.spread,
    placing.distractors,
    placing.insert,
    placing.move,
    looks.shade,
    looks.painted,
)


def _read(parts: list[Token], wish: Wish, namer: Namer) -> Meant:
    """The edits of a clause that says all that it needs. Raises RpaugError."""
    for way in WAYS:
        clause = Clause(list(parts))
        try:
            if (found := way(clause, wish, namer)) is not None:
                clause.done()
                return found
        except NotUnderstood as error:
            raise NotUnderstood(f"{error}{_nearest(parts)}") from None
    unknown = next((one.text for one in parts if one.kind in ("unknown", "thing")), said(parts))
    why = f"{said(parts)!r}: it is not clear what to do with {unknown!r}"
    raise NotUnderstood(f"{why}{_nearest(parts)}")


def _nearest(parts: list[Token]) -> str:
    """What of a clause would be understood, said of its first thing."""
    named = (one.value.words for one in parts if one.kind == "thing" and not one.value.pronoun)
    return templates.nearest(said(parts), next((f"the {one}" for one in named), None))


def read(
    read: list[Token], state: WishState, nouns: Collection[str]
) -> tuple[Meant, float | None, list[Token]]:
    """What a clause asks for, the share of copies that it is meant for, and the clause without that.

    Raises RpaugError with what of it is not understood, and the nearest that would be.
    """
    if (lots := weighed.lots(read, lambda part: _portion(part, state, nouns))) is not None:
        return lots, None, read
    shares = [one.value for one in read if one.kind == "chance"]
    if len(shares) > 1:
        raise NotUnderstood(f"{said(read)!r}: one share of the copies at a time")
    if len(shares) == len([one for one in read if one.kind not in tokens.JOINS]):
        raise NotUnderstood(f"{said(read)!r}: what is to be changed in these copies?")
    bare = _bare([one for one in read if one.kind not in ("chance", "even")])
    recorded, bare = _recorded(bare)
    share = shares[0] if shares else None
    try:
        found = _meant(bare, state, nouns)
    except RpaugError as error:
        trailing = None if share is not None else _trailing(bare, state, nouns)
        if trailing is not None:
            found, share = trailing
        elif (
            other := _gone_on(bare, state)
            or _instead(bare, state, nouns)
            or _alternatives(bare, state)
            or _look(bare, state)
        ) is not None:
            found = other
        else:
            raise error
    if shares and state.fresh and any("other half" in one.text for one in read):
        before = gathering.settled(state.fresh[-1])
        if any(gathering.settled(edit) != before for edit in found.edits):
            raise NotUnderstood(
                f"{said(read)!r}: halves that exclude each other are of one edit each"
            )
    if recorded:
        found = _of_that_color(found, recorded, state)
    return found, share, bare


def _portion(part: list[Token], state: WishState, nouns: Collection[str]) -> Meant:
    """What a part of a clause means; "it" in the next part is what this one is about."""
    found = _meant(_bare(part), state, nouns)
    state.mention = found.mention or state.mention
    return found


def _bare(read: list[Token]) -> list[Token]:
    """Without marks at both ends, and none after another."""
    out: list[Token] = []
    for one in read:
        if not (
            one.kind in ("and", "stop") and (not out or out[-1].kind in ("and", "stop"))
        ) and not (not out and one.text in ("either", ":", "->")):
            out.append(one)
    while out and (out[-1].kind in ("and", "stop") or out[-1].text in ("in", "with", "at", ":")):
        out.pop()
    return out


def _recorded(read: list[Token]) -> tuple[str | None, list[Token]]:
    """The color that something has now, "from red to white", and the clause without it."""
    for k in range(len(read) - 2):
        if (
            read[k].text == "from"
            and read[k + 1].kind == "color"
            and read[k + 2].text in ("to", "into")
        ):
            return read[k + 1].text, [*read[:k], *read[k + 2 :]]
    return None, read


def _of_that_color(found: Meant, tint: str, state: WishState) -> Meant:
    """The edits, painting only what was recorded in a color, where several show. Raises NotUnderstood for others."""
    word = color_space.canonical(tint)
    plain = [one for edit in found.edits for one in edit.get("one_of", [edit])]
    if word is None or any(edit["op"] != "recolor" for edit in plain):
        raise NotUnderstood(f"'from {tint}': only a new color can be for what has that color now")
    namer = state.namer
    for edit in plain:
        ids = namer.ids(edit["target"]) if namer.recording else frozenset[int]()
        rows = [row for row in namer.rows if row["id"] in ids] if ids else []
        if all(word in row.get("shows", [row["color"]]) for row in rows):
            edit["only"] = word
        else:
            state.notes.append(
                f"'from {tint}' is taken to describe what is painted: not all of it is {tint}"
            )
    return found


def _meant(read: list[Token], state: WishState, nouns: Collection[str]) -> Meant:
    """The edits of a clause; with the verb or the things of the one before where it has none of its own."""
    wish = state.here()
    if (fits := templates.fitting(said(read), wish, state.namer, nouns)) is not None:
        return fits
    try:
        return _read(read, wish, state.namer)
    except RpaugError as error:
        why = error
    kinds = {one.kind for one in read}
    before = [state.verb] if state.verb and not kinds & {"remove", "add", "move", "copy"} else []
    if "thing" not in kinds:
        before += [state.about] if state.about else []
        known = state.mention is not None and state.mention.kind == "target"
        said_of_it = state.did or bool(state.edits and kinds & LOOKS)
        before += [[IT]] if known and said_of_it else []
    for more in before:
        with contextlib.suppress(RpaugError):
            return _read([*more, *read], wish, state.namer)
    raise why


def _look(read: list[Token], state: WishState) -> Meant | None:
    """A clause that is a color and a thing alone, "black dresser", as what that thing shall be: none of that kind has
    the color now, and no verb of the clause before goes on."""
    namer = state.namer
    if len(read) != 1 or read[0].kind != "thing" or namer.recording is None or state.verb:
        return None
    words = read[0].text.split()
    colored = values.color(words, 0)
    if colored is None or colored[0] == len(words) or namer.there(read[0].value):
        return None
    rest = Named(" ".join(words[colored[0] :]))
    if not namer.there(rest):
        return None
    color = Token("color", " ".join(words[: colored[0]]), colored[1])
    return _read([color, Token("thing", rest.words, rest)], state.here(), namer)


def _trailing(
    read: list[Token], state: WishState, nouns: Collection[str]
) -> tuple[Meant, float] | None:
    """What a clause means whose last words are a bare share, "the can red, 30%": that is the share of copies."""
    for k, mark in ((len(read) - 1, len(read) - 2), (0, 1)):
        if len(read) < 3 or read[k].kind != "share" or read[mark].text not in (",", "(", ")"):
            continue
        much = read[k].value
        if much.how == "exact" and 0 <= much.low <= 1 and not read[k].text.startswith("by"):
            with contextlib.suppress(RpaugError):
                return _meant(_bare([*read[:k], *read[k + 1 :]]), state, nouns), much.low
    return None


def _instead(read: list[Token], state: WishState, nouns: Collection[str]) -> Meant | None:
    """What a clause asks for whose end says how it is now: "a wooden table instead of the white one"."""
    at = next((k for k, one in enumerate(read) if one.text in ("instead of", "rather than")), 0)
    if not at or any(one.kind in ("not", "keep") for one in read[at + 1 :]):
        return None
    with contextlib.suppress(RpaugError):
        found = _meant(_bare(read[:at]), state, nouns)
        note = f"{said(read[at:])!r} is taken to say how it is now"
        return found.model_copy(update={"notes": (*found.notes, note)})
    return None


def _gone_on(read: list[Token], state: WishState) -> Meant | None:
    """What the clause before comes to with these words at its end, if that is the same edit with more said of it."""
    before, edits = state.last, state.latest
    if not before or not {one.kind for one in read} <= AFTERTHOUGHT:
        return None
    with contextlib.suppress(RpaugError):
        found = _read([*before, *read], state.here(), state.namer)
        if list(map(_about, found.edits)) == list(map(_about, edits)) and not found.replaces:
            state.edits = [one for one in state.edits if all(one is not old for old in edits)]
            state.fresh = [one for one in state.fresh if all(one is not old for old in edits)]
            return found
    return None


def _about(edit: Entry) -> object:
    """What an edit settles and of what, or else its operators."""
    return gathering.settled(edit) or {one["op"] for one in edit.get("one_of", [edit])}


def _alternatives(read: list[Token], state: WishState) -> Meant | None:
    """One of several edits, drawn for each copy; None for a clause without "or"."""
    at = [k for k, one in enumerate(read) if one.kind == "or"]
    if not at:
        return None
    parts = [read[a + 1 : b] for a, b in zip([-1, *at], [*at, len(read)], strict=True)]
    options: list[Entry] = []
    for part in parts:
        bare = _bare(part)
        if any(one.kind == "and" for one in bare) and bare[0].kind not in VERBS:
            return None  # "red or blue, and dim the light": what is joined goes on by itself
        found = _meant(bare, state, frozenset())
        if len(found.edits) != 1 or found.replaces:
            raise NotUnderstood(f"{said(part)!r} is no single edit, and `or` draws one of several")
        options += found.edits[0].get("one_of", found.edits)
        if found.mention and found.mention.kind == "target":
            state.mention = found.mention
        state.about = [one for one in bare if one.kind == "thing"] or state.about
    return Meant(edits=({"one_of": options},))
