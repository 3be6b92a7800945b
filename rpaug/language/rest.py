"""What a clause says beside edits: undoing, the same once more, what must stay as it is, and why somebody wants it."""

import re
from collections.abc import Sequence
from dataclasses import fields
from itertools import dropwhile
from typing import Any, cast

from rpaug.core import color_space, registry
from rpaug.language import templates, values
from rpaug.language.calling import called, short
from rpaug.language.declared import own_role, targets
from rpaug.language.lexicon import group
from rpaug.language.messages import Entry, Meant, Mention, NotUnderstood
from rpaug.language.things import FLOOR, WALL, Named, Namer, Target
from rpaug.language.tokens import CARRIED, WEAK, Token, said

ADDED = ("insert", "distractors", "duplicate")
KEPT = ("thing", "camera", "light", "lit", "image")
NEGATED = ("do not", "don't", "dont", "never", "may not")
DONE = group("rest_done")
MODAL = group("rest_modal")
STATES = group("rest_states")
HAVING = frozenset({"has", "have", "blend", "blends", "always", "often", "usually"})
"""Of these none is said of what is wished for, unless it is a duty: "should have"."""
RECORDED = group("rest_recorded")
REWORDED = frozenset(
    {"paraphrase", "paraphrased", "rephrase", "rephrased", "reword", "reworded", "wordings"}
)
TEXTS, AGREES = group("rest_texts"), group("rest_agrees")
VALUES = ("color", "texture", "share", "length", "angle", "number", "remove")
SPEAKERS = frozenset({"i", "we", "this", "our", "my", "it", "that", "there"})
LISTED = ("vary", "remove")
STOP = Token("stop", ";")
HARD: Entry = {"op": "light_color", "brightness": [0.4, 0.8]}


def undoes(read: Sequence[Token]) -> bool:
    """Does a clause take something back that was asked for?"""
    return any(one.kind == "undo" for one in read)


def unnamed(read: Sequence[Token]) -> bool:
    """Does it not say what: "undo", "undo it", "undo the last step"?"""
    return all(
        one.kind in ("undo", "filler", "stop", "and") or one.text in ("it", "this", "that", "last", "step", "edit")
        or (one.kind == "thing" and (one.value.pronoun or one.value.words.startswith("last")))
        for one in read
    )  # fmt: skip


def _what(read: Sequence[Token], kinds: Sequence[str]) -> str:
    """What is taken back, in words without article."""
    words = said([one for one in read if one.kind not in (*kinds, "filler", "and", "stop")])
    return words.removeprefix("the ").removeprefix("that ").removeprefix("my ")


def left(read: Sequence[Token], edits: Sequence[Entry]) -> list[Entry]:
    """The edits without those that a clause undoes. Raises NotUnderstood where none is called so."""
    if unnamed(read):
        return list(edits[:-1])
    what = _what(read, ["undo"])
    kept = [edit for edit in edits if not called(what, edit)]
    if len(kept) == len(edits):
        there = "; ".join(map(short, edits))
        raise NotUnderstood(f"nothing that was asked for is called {what!r}; there is: {there}")
    return kept


def taken_back(read: Sequence[Token], edits: Sequence[Entry]) -> list[Entry] | None:
    """The edits without what was put in and is to be removed again; None where a clause says no such thing."""
    if not edits or not any(one.kind == "remove" for one in read):
        return None
    what = _what(read, ["remove"])
    gone = [edit for edit in edits if called(what, edit)]
    if not gone or any(edit.get("op") not in ADDED for edit in gone):
        return None
    return [edit for edit in edits if edit not in gone]


def put_back(read: Sequence[Token], edits: Sequence[Entry], namer: Namer) -> list[Entry] | None:
    """The edits, where things that were removed stay after all; None where a clause says no such thing."""
    removals = [edit for edit in edits if edit.get("op") == "remove"]
    backs = any(one.kind == "back" for one in read) or (
        any(one.kind == "keep" for one in read)
        and any(one.text in ("though", "after all") for one in read)
    )
    named = [one.value for one in read if one.kind == "thing"]
    kinds = {one.kind for one in read} - {*WEAK, "thing", "keep", "back", "add"}
    if not removals or not backs or len(named) != 1 or kinds:
        return None
    where, out = (
        namer.target(named[0]) if " one" not in f" {named[0].words}" else None,
        list[Entry](),
    )
    for edit in edits:
        if edit in removals and edit["target"] == where:
            continue
        if edit in removals and namer.recording:
            ids = namer.among(named[0], namer.ids(edit["target"]))
            edit = {**edit, "target": namer.without(edit["target"], ids)} if ids else edit
        out.append(edit)
    if out == list(edits):
        raise NotUnderstood(f"{named[0].words!r} was not removed")
    return out


def again(read: Sequence[Token], edits: Sequence[Entry], namer: Namer, fresh: bool) -> Meant | None:
    """The last edit once more, for another thing: "the same for the cabinet", "the cabinet too"."""
    named = [one.value for one in read if one.kind == "thing"]
    also = any(one.text in ("too", "also", "as well", "likewise") for one in read)
    same = any(one.kind == "same" or one.text == "do" for one in read)
    kinds = {one.kind for one in read} - {*WEAK, "thing", "same"}
    if not (also or (same and not fresh)):
        return None
    seen = [one.value for one in read if one.kind == "camera" and isinstance(one.value, list)]
    if kinds == {"camera"} and len(seen) == 1 and not named and "camera" in edits[-1]:
        names = seen[0][0] if len(seen[0]) == 1 else seen[0]
        mention = Mention(kind="camera", cameras=names)
        return Meant(edits=({**edits[-1], "camera": names},), mention=mention)
    if len(named) != 1 or named[0].pronoun or kinds:
        return None
    where = namer.target(named[0])
    options = [_about(where, one, named[0]) for one in edits[-1].get("one_of", [edits[-1]])]
    more = {**edits[-1], "one_of": options} if "one_of" in edits[-1] else options[0]
    return Meant(edits=(more,), mention=Mention(kind="target", target=where))


def _about(where: Target, edit: Entry, named: Named) -> Entry:
    """An edit, of another thing. Raises NotUnderstood for one of nothing."""
    place = next((n for n in registry.operator(edit["op"]).needs.targets if n in edit), None)
    if place is None:
        raise NotUnderstood(
            f"the same for {named.words!r}: the edit before has no thing that it is about"
        )
    return {name: value for name, value in edit.items() if name != "only"} | {place: where}


def follows(read: Sequence[Token]) -> Meant | None:
    """That the instruction is to tell the new colors: it does in any case. None where a clause says no such thing."""
    words = set(said(read).split())
    if words & TEXTS and words & REWORDED:
        raise NotUnderstood(
            f"{said(read)!r}: other wordings take a model: --llm, or `instructions: {{paraphrases: 3}}` in the recipe"
        )
    other = any(one.kind in VALUES for one in read) or any(
        one.kind == "thing" and not TEXTS & set(one.value.words.split()) for one in read
    )
    if other or not words & TEXTS or not words & AGREES:
        return None
    return Meant(
        edits=(), notes=(f"{said(read)!r}: the instruction follows the edits in every copy",)
    )


def headed(read: Sequence[Token]) -> tuple[int, Token | None]:
    """How many tokens are a heading, "make it harder:" or "white plate:" before "make it ...", and what that names."""
    at = next((k for k, one in enumerate(read) if one.text == ":"), 0)
    kinds = {one.kind for one in read[:at]}
    named = [one for one in read[:at] if one.kind == "thing"]
    if "harder" in kinds and kinds <= {"harder", "thing", "all", *WEAK}:
        return at + 1, None
    if at < 4 and kinds and kinds <= {"unknown", "filler"}:
        return at + 1, None
    parts = [one.value.words for one in read[at + 1 :] if one.kind == "thing"]
    if [one.value.words for one in named] == ["background"] and {*parts} & {*FLOOR, *WALL}:
        return at + 1, None
    pronoun = any(one.kind == "thing" and one.value.pronoun for one in read[at:])
    return (
        (at + 1, named[0])
        if len(named) == 1 and pronoun and kinds <= {"thing", "filler"}
        else (0, None)
    )


def distributed(read: list[Token]) -> list[Token]:
    """A list behind a verb, "mix: table, wall, small camera moves", as a clause of that verb for each thing in it."""
    at = next((k for k, one in enumerate(read) if one.text == ":"), 0)
    verb = [one for one in read[:at] if one.kind in LISTED]
    end = next((k for k in range(at, len(read)) if read[k].kind == "stop"), len(read))
    items: list[list[Token]] = [[]]
    for one in read[at + 1 : end]:
        items = [*items, []] if one.kind == "and" else [*items[:-1], [*items[-1], one]]
    items = [one for one in items if {t.kind for t in one} - {"filler"}]
    own = any(one.kind in {*LISTED, "color", "texture", "to"} for item in items for one in item)
    if (
        not verb
        or own
        or len(items) < 2
        or {one.kind for one in read[:at]} - {*LISTED, "filler", "all"}
    ):
        return read
    return [*(one for item in items for one in (*verb[:1], *item, STOP)), *read[end:]]


def only(read: Sequence[Token]) -> list[Token] | None:
    """The things that alone are to be left; None where a clause says no such thing."""
    words = said(read)
    named = [
        one for one in read if one.kind == "thing" and one.value.words not in ("table", "scene")
    ]
    keeps = any(one.kind == "keep" for one in read)
    alone = re.match(
        r"(?:[,;] )*(?:(?:and|but|leave|keep) )*(?:only|just|nothing but|nothing except) ", words
    )
    kinds = {one.kind for one in read} - {*WEAK, "thing", "keep", "on", "not", "left"}
    return named if alone and keeps and named and not kinds - {"unknown"} else None


def halves(
    read: Sequence[Token], edits: Sequence[Entry], mention: Mention | None
) -> list[Entry] | None:
    """The edits, where what was painted is of another color in half of the copies: "make it 50/50 with orange"."""
    tints = [one for one in read if one.kind == "color"]
    kinds = {one.kind for one in read} - {*WEAK, "thing", "color", "even"}
    if len(tints) != 1 or kinds or not any(one.kind == "even" for one in read) or mention is None:
        return None
    out = list(edits)
    for k, edit in enumerate(out):
        if edit.get("op") == "recolor" and edit["target"] == mention.target:
            out[k] = {"one_of": [edit, {**edit, "color": tints[0].value[0]}]}
            return out
    return None


def evenly(read: Sequence[Token], edit: Entry) -> Entry | None:
    """What is added to a draw that each look gets its share of; None where a clause says no such thing."""
    share = next((one.value.low for one in read if one.kind in ("share", "times")), None)
    kinds = {one.kind for one in read} - {"filler", "and", "each", "to"}
    if (
        "one_of" not in edit
        or not kinds
        or not kinds <= {"even", "share", "times"}
        or not ({"even"} & kinds or len(read) > 1)
    ):
        return None
    if share is None:
        return {}
    whole = values.tidy(share * sum(one.get("weight", 1) for one in edit["one_of"]))
    if whole > 1.02:
        raise NotUnderstood(f"{share:g} each: {len(edit['one_of'])} looks are more than all copies")
    return {"probability": whole} if whole < 0.98 else {}


def harder(read: Sequence[Token], namer: Namer) -> Meant | None:
    """Dimmer light, where something is to be harder to see; None where a clause says no such thing."""
    kinds = {one.kind for one in read} - {*WEAK, "harder", "thing", "all", "little", "much"}
    words = said(read)
    if not any(one.kind == "harder" for one in read) or (
        kinds and words not in ("the task", "task")
    ):
        return None
    for one in read:
        if (
            one.kind == "thing"
            and not one.value.pronoun
            and one.value.words not in ("task", "policy")
            and namer.recording
        ):
            namer.ids(namer.target(one.value))
    note = f"{words!r} is taken as dimmer light, 0.4 to 0.8 times as bright; say what else: clutter, colors, cameras"
    return Meant(edits=(dict(HARD),), mention=Mention(kind="light"), notes=(note,))


def kept(read: Sequence[Token]) -> list[Token] | None:
    """What must stay as it is; None where a clause says no such thing. Raises NotUnderstood where that is unclear."""
    at = next((k for k, one in enumerate(read) if one.kind == "keep"), None)
    if {one.kind for one in read} <= {"not", "and", "filler", *KEPT} and read[0].kind == "not":
        return [one for one in read if one.kind in KEPT]  # "..., but not the cameras"
    if at is None:
        return None
    if any(one.kind in ("because", "clear_of") for one in read):
        return None
    if any(one.text in ("but", "while", ":") or one.kind == "color" for one in read[:at]):
        raise NotUnderstood(f"{said(read)!r}: one thing after the other, please")
    counted = {"number", "strangers"} <= {
        one.kind for one in read[at + 1 :]
    }  # "..., 4 distractors"
    joined = dropwhile(lambda one: one.kind != "and", read[at + 1 :])
    if (
        counted
        or any(one.text in ("should", "must", "shall") for one in read[at + 1 :])
        or any(one.kind == "color" for one in joined)  # "leave the mug alone, the arm in gold"
    ):
        raise NotUnderstood(f"{said(read)!r}: one thing after the other, please")
    named = [one for one in read if one.kind in KEPT]
    negated = any(one.text in NEGATED for one in read)
    allowed = {*KEPT, *group("rest_beside")}
    allowed |= {*DONE, "do", "from"} if negated else set()
    if any(one.kind in ("rest", "chance", "share") or one.text == "other" for one in read):
        allowed |= {"chance", "share", "to"}
        named = [] if read[0].kind in ("rest", "chance", "share") else named
        named = [one for one in named if not (one.kind == "thing" and one.value.pronoun)]
    if wrong := [one for one in read if one.kind not in allowed and one.text not in RECORDED]:
        raise NotUnderstood(
            f"{said(read)!r}: it is not clear what must stay as it is: {wrong[0].text!r}"
        )
    return named


def reason(
    read: Sequence[Token], fresh: Sequence[Entry], namer: Namer, sure: bool = True
) -> Meant | None:
    """Why somebody wants it, or how things are: it asks for nothing, and that is told. None for anything else.

    `sure`: only what cannot be a wish; else also what was read as none.
    """
    words = said(read)
    if "shadow" in words and not templates.fits(words):
        raise NotUnderstood(
            f"{words!r}: of cast shadows it can be asked: 'vary the depth of the shadows', "
            "'move the shadows by up to 30 degrees'"
        )
    denied = any(one.kind == "not" for one in read) and any(one.kind == "color" for one in read)
    if denied or any(one.text == "," for one in read):
        return None
    added = any(option["op"] in ADDED for edit in fresh for option in edit.get("one_of", [edit]))
    if added and any(one.kind == "clear_of" for one in read):
        return Meant(
            edits=(),
            notes=(
                f"{words!r}: what is put in stands clear of other things and of all that moves",
            ),
        )
    first, spoken = (
        next(one for one in read if one.kind not in ("filler", "and", "stop")),
        set(words.split()),
    )
    simile = next((k for k, one in enumerate(read) if one.text == "like"), len(read))
    stated = (
        first.kind in ("thing", "camera")
        and not spoken & MODAL
        and {one.text for one in read[:simile]} & (HAVING if sure else STATES)
    )
    told = (
        words.split()[0] in SPEAKERS
        and (spoken & STATES or any(one.kind == "because" for one in read))
        and not sure
    )
    until = [one.kind for one in read if one.kind not in ("filler", "keep", "and", "stop", "do")]
    because = until[:1] == ["because"]
    if not (because or stated or told or _fact(read, namer)):
        return None
    mention = None
    if first.kind == "thing" and not first.value.fresh and not first.value.pronoun:
        mention = Mention(kind="target", target=namer.target(first.value))
    if first.kind == "camera" and first.value:
        names = (
            first.value[0]
            if isinstance(first.value, list) and len(first.value) == 1
            else first.value
        )
        mention = Mention(kind="camera", cameras=names)
    return Meant(
        edits=(), mention=mention, notes=(f"{words!r} is taken as a reason, not as an edit",)
    )


def _fact(read: Sequence[Token], namer: Namer) -> bool:
    """Does it say of a thing that it is of the color that it has?"""
    tints = [one for one in read if one.kind == "color"]
    named = [one for one in read if one.kind == "thing"]
    if len(tints) != 1 or len(named) != 1 or not any(one.text in ("is", "are") for one in read):
        return False
    if {one.kind for one in read} - {*WEAK, "thing", "color"}:
        return False
    if any(one.text in ("here", "now", "already") for one in read):
        return True
    if namer.recording is None:
        return False
    ids, tint = namer.ids(namer.target(named[0].value)), tints[0].value[0]
    seen = [row["color"] for row in namer.rows if row["id"] in ids]
    return isinstance(tint, str) and any(color_space.means(tint, one) for one in seen)


def respected(
    kept: Sequence[Token],
    fresh: Sequence[Entry],
    namer: Namer,
    cameras: Sequence[str],
    notes: list[str],
) -> None:
    """Take what must stay as it is out of the edits of this wish. Raises NotUnderstood where that is not possible."""
    for token in kept:
        for edit in fresh:
            for option in edit.get("one_of", [edit]):
                if _unseen(token, option, cameras):
                    notes.append(f"{token.text!r} is left out of {short(edit)}")
                elif _touched(token, option, namer):
                    _spare(token, option, namer)
                    notes.append(f"{token.text!r} is left out of {short(edit)}")


def _unseen(token: Token, option: Entry, cameras: Sequence[str]) -> bool:
    """Take named cameras out of an edit that names some, or means all; False where it is not of these alone.

    Raises NotUnderstood if none is left.
    """
    place = next((name for name in ("camera", "cameras") if _has(option["op"], name)), None)
    if place is None or token.kind != "camera" or not isinstance(token.value, list):
        return False
    given = option.get(place)
    seen = [given] if isinstance(given, str) else given
    if seen == ["static"]:
        seen = [one for one in cameras if not any(part in one for part in CARRIED)]
    left = [one for one in (cameras if seen is None else seen) if one not in token.value]
    if not left:
        raise NotUnderstood(
            f"{token.text!r} must not change, and the same wish asks for: {short(option)}"
        )
    if len(left) == len(cameras if seen is None else seen):
        return False
    option[place] = left[0] if len(left) == 1 and place == "camera" else left
    return True


def _has(op: str, name: str) -> bool:
    return name in {one.name for one in fields(cast(Any, registry.operator(op)))}


def spared(
    kept: Sequence[Token], edits: Sequence[Entry], namer: Namer, notes: list[str]
) -> tuple[list[Entry], bool]:
    """The earlier edits but those of what must stay as it is after all, and whether there were any."""
    left = [
        edit
        for edit in edits
        if not any(
            _touched(one, option, namer) for one in kept for option in edit.get("one_of", [edit])
        )
    ]
    notes += [f"left out again: {short(edit)}" for edit in edits if edit not in left]
    return left, len(left) < len(edits)


def _touched(token: Token, edit: Entry, namer: Namer) -> bool:
    what = token.value.words if token.kind == "thing" else token.text.removeprefix("the ")
    if called(what, edit):
        return True
    role = own_role(edit["op"])
    about = targets(edit) or ([{"role": role}] if role else [])
    if not about or token.kind != "thing":
        return False
    where = namer.target(token.value)
    if namer.recording is None:
        return where in about
    ids = namer.ids(where)
    return any(ids & namer.ids(one) for one in about)


def _spare(token: Token, option: Entry, namer: Namer) -> None:
    named = registry.operator(option["op"]).needs.targets
    place = next((name for name in named if option.get(name) is not None), None)
    if (
        namer.recording is None
        or token.kind != "thing"
        or place is None
        or isinstance(option[place], list)
    ):
        raise NotUnderstood(
            f"{token.text!r} must not change, and the same wish asks for: {short(option)}"
        )
    option[place] = namer.without(option[place], namer.ids(namer.target(token.value)))
