"""A whole wish, offline: its tokens clause by clause, the longest beginning that is understood first."""

import contextlib
import re
from collections.abc import Iterator
from itertools import takewhile
from typing import Any

from rpaug.assets import library
from rpaug.core.errors import RpaugError
from rpaug.language import gathering, reader, repair, rest, tokens
from rpaug.language.gathering import WishState
from rpaug.language.lexicon import group
from rpaug.language.messages import Answer, Meant, Mention, NotUnderstood, Trace, Wish
from rpaug.language.recording import Recording
from rpaug.language.things import Namer
from rpaug.language.tokens import JOINS, Token, said

QUESTION = frozenset(
    ["is", "are", "does", "did", "why", "who", "when", "where", "which", "what", "how"]
)
NO = ("no", "nope", "nah")
BREAKS = group("manager_breaks") | {","}
PLAIN, SIMILE = group("manager_plain"), group("manager_simile")
ADJUNCT = frozenset({"chance", "filler", "to", "camera", "point", "and", "from", "even", "not"})
ORDERS = group("manager_orders")
SUBJECT = frozenset({"thing", "light", "lit", "image", "camera", "and", "each", "all", "filler"})
MODAL = frozenset({"should", "must", "shall", "ought", "want", "is", "are"})
ACTS = frozenset(
    {"lay", "paint", "style"}
)  # that nouns are as well: "the color of", "color the box"
APART = re.compile(
    r"\b(?:never|not|no) (?:both|together|in the same cop\w+|at (?:once|the same time))\b"
)
"""Edits that are to exclude each other, which one draw of several does and two draws do not."""
MOST_CLAUSES, MOST_UNDONE = 30, 8


def answer(wish: Wish, recording: Recording | None = None) -> Answer:
    """What a wish comes to, offline. Raises NotUnderstood, and then nothing of the wish holds."""
    words, nouns = tokens.split(wish.stated), _nouns(wish)
    mended, notes = repair.repaired(words, tokens.known(wish.setting.cameras) | nouns)
    try:
        return _answer(wish, _grounds(mended, notes), nouns, notes, recording)
    except RpaugError:
        if mended == words:
            raise
        with contextlib.suppress(RpaugError):
            return _answer(wish, words, nouns, [], recording)
        raise


def _nouns(wish: Wish) -> frozenset[str]:
    """The words of the instructions, of the library, and of what was asked for before."""
    stated = [
        *wish.setting.instructions,
        *(str(one) for edit in wish.edits for one in edit.values()),
    ]
    stated += [f"{one.name} {one.category}" for one in library.assets()]
    return frozenset(re.findall(r"[a-z]+", " ".join(stated).lower())) | {
        one.name for one in library.assets()
    }


def _grounds(words: list[str], notes: list[str]) -> list[str]:
    """The words without grounds of an order, "it is dark in the evening, so dim the lamps", which are told."""
    for at, word in enumerate(words[:-1]):
        start = max((k + 1 for k in range(at) if words[k] == ";"), default=0)
        led = [one for one in words[start:at] if one not in (",", "and")]
        if word == "so" and words[at + 1] in ORDERS and led and led[0] not in ORDERS:
            notes.append(f"{' '.join(words[start:at])!r} is taken as a reason, not as an edit")
            return _grounds([*words[:start], *words[at + 1 :]], notes)
    return words


def _answer(
    wish: Wish,
    words: list[str],
    nouns: frozenset[str],
    notes: list[str],
    recording: Recording | None,
) -> Answer:
    read = tokens.tokens(words, wish.setting.cameras, nouns)
    if words and words[0] in QUESTION and read[0].kind != "thing":
        raise NotUnderstood(f"{wish.stated!r}: a question; say what is to be changed")
    found: dict[str, Any] = {}
    for one in read:
        found |= one.value if one.kind == "setting" else {}
    read = [Token("stop", one.text) if one.kind == "setting" else one for one in read]
    while wish.edits and read and read[0].kind == "unknown" and read[0].text in NO:
        read = read[1:]
    state = _state(wish, read, recording, bool(found), notes)
    _run(read, state, nouns)
    if state.kept and any(one.kind in ("all", "rest") for one in read):
        kept = [one.value for one in state.kept if one.kind == "thing"]
        state = _state(wish, read, recording, bool(found), notes)
        state.namer.kept = kept  # everything, but what is kept
        _run(read, state, nouns)
    if (apart := APART.search(" ".join(words))) and not any("one_of" in one for one in state.edits):
        raise NotUnderstood(
            f"{apart[0]!r}: edits that exclude each other are said as one choice, for one: 'the cup either red or blue'"
        )
    rest.respected(state.kept, state.fresh, state.namer, wish.setting.cameras, state.notes)
    if state.kept and not state.fresh:
        state.edits, state.did = rest.spared(state.kept, state.edits, state.namer, state.notes)
    if not state.did or not (state.edits or wish.edits):
        raise NotUnderstood(f"{wish.stated!r}: that asks for no change, so there is nothing to do")
    whole = Trace(
        stage="manager",
        by="words",
        input=wish.stated,
        output={"read": " ".join(words), "settings": found},
    )
    return Answer(
        edits=tuple(gathering.drawn(state.edits)),
        settings=dict(wish.settings) | found,
        mention=state.mention,
        notes=tuple(dict.fromkeys([*state.notes, *state.namer.notes])),
        trace=(whole, *state.trace),
    )


def undone(stated: str) -> bool:
    """Does the wish ask for nothing but the round before to be undone?"""
    words = tokens.split(stated)
    if len(words) > MOST_UNDONE:
        return False
    with contextlib.suppress(NotUnderstood):
        read = tokens.tokens(words, (), ())
        return rest.undoes(read) and rest.unnamed(read)
    return False


def _run(read: list[Token], state: WishState, nouns: frozenset[str]) -> None:
    """Take the longest beginning that is one clause, then go on with the rest. Raises RpaugError."""
    for _ in range(MOST_CLAUSES):
        while read and read[0].kind in JOINS:
            read = read[1:]
        if not read:
            return
        size, about = rest.headed(read)
        if any(one.kind == "unknown" for one in read[:size]):
            state.notes.append(f"{said(read[:size])!r} is taken as a title")
        read = rest.distributed(read[size:])
        if about is not None:
            state.mention = Mention(kind="target", target=state.namer.target(about.value))
        reason: RpaugError | None = None
        for end in _ends(read):
            notes = len(state.namer.notes)
            try:
                _clause(read[:end], state, nouns)
            except RpaugError as error:
                reason = error  # that of the shortest beginning tells most
                del state.namer.notes[notes:]
                continue
            read = read[end:]
            break
        else:
            assert reason is not None
            raise reason
    raise NotUnderstood(f"more than {MOST_CLAUSES} clauses: say them in several wishes")


def _ends(read: list[Token]) -> Iterator[int]:
    """Where the first clause may end: with the sentence, or before a word that joins clauses, the last first."""
    whole = next((k for k in range(1, len(read)) if _over(read, k)), len(read))
    yield whole
    for k in range(whole - 1, 0, -1):
        if read[k].text in BREAKS or (
            read[k].kind == "keep" and read[k].text.startswith("without")
        ):
            yield k


def _state(
    wish: Wish, read: list[Token], recording: Recording | None, did: bool, notes: list[str]
) -> WishState:
    """Where a wish begins."""
    namer = Namer(recording, wish.mention)
    named = {word for one in read if one.kind == "thing" for word in one.value.words.split()}
    namer.apart = bool(named & {"arm", "robot"}) and bool(named & {"gripper", "hand"})
    return WishState(wish, namer, list(wish.edits), wish.mention, did, list(notes))


def _over(read: list[Token], k: int) -> bool:
    """Does another clause begin for certain: after a mark, or where "and" leads to an order or to its share of copies?

    Raises NotUnderstood for a share that may be of what is before it, or of what comes after.
    """
    if read[k].kind == "stop" or read[k].text not in ("and", ",", "but"):
        return read[k].kind == "stop"
    if all(one.kind in ADJUNCT for one in read[:k]):
        return False
    after = [one for one in read[k + 1 :] if one.kind != "filler" and one.text != "and"]
    if after[:1] and after[0].text == "with" and after[1:2] and after[1].kind == "camera":
        after = after[1:]  # "..., with the wrist camera, look ..."
    if len(after) > 2 and after[0].kind in ("chance", "camera", "point") and after[1].text == ",":
        if read[k].text == "," and after[2].text not in ("but", "and"):
            raise NotUnderstood(
                f"{after[0].text!r}: is it of what is before it, or of what comes after?"
            )
        return read[k].text != ","
    mark = next((one.text for one in after if one.text in (":", ",", "and", "but", ";")), "")
    if (mark == ":" and read[k].text == ",") or _has_a_verb_of_its_own(read, k):
        return True
    return bool(after) and after[0].text.split()[0] in ORDERS and after[0].kind != "thing"


def _has_a_verb_of_its_own(read: list[Token], k: int) -> bool:
    """After a clause that names more than things: does a subject with "should" follow, "the mug and the can should", or
    an order such as "color the box"?

    Raises NotUnderstood where its first things may be of what is before.
    """
    subject = list(
        takewhile(lambda one: one.kind in SUBJECT and one.text not in MODAL, read[k + 1 :])
    )
    verb = read[k + 1 + len(subject) :][:1]
    if {one.kind for one in read[:k]} <= SUBJECT:
        return False
    if [
        one.kind in kinds
        for one, kinds in zip(read[k + 1 : k + 3], (ACTS, {"thing"}), strict=False)
    ] == [True, True]:
        return True
    if not (verb and verb[0].text in MODAL):
        return False
    if read[k - 1].kind == "thing" and any(one.kind == "and" for one in subject):
        raise NotUnderstood(
            f"{said(subject)!r}: is all of it of what is before it, or of what comes after?"
        )
    return True


def _clause(read: list[Token], state: WishState, nouns: frozenset[str]) -> None:
    """One clause. Raises RpaugError and then changes nothing."""
    whole, plain = read, {one.kind for one in read} <= PLAIN
    while read and (read[0].kind in JOINS or read[0].text in ("or", "while")):
        read = read[1:]
    if read and read[0].text == "but" and not plain:
        return _clause(read[1:], state, nouns)
    while read and read[-1].kind in ("and", "stop"):
        read = read[:-1]
    if {one.kind for one in read} <= {"filler", "and"} or _earlier(read, state):
        return None
    if (alone := rest.only(whole)) is not None:
        if any(one.get("op") == "remove" for one in state.fresh):
            state.kept += alone
            return None
        read = [
            Token("remove", "remove"),
            Token("all", "everything"),
            Token("not", "except"),
            *alone,
        ]
    elif (kept := _kept(read, whole, state)) is not None:
        state.kept += kept
        state.namer.kept += [one.value for one in kept if one.kind == "thing"]
        return None
    if read[0].text == "so" and len(read) > 1 and read[1].text.split()[0] in ORDERS:
        read = read[1:]
    elif (
        why := rest.follows(read)
        or rest.reason(whole, state.fresh, state.namer)
        or _aside(read, state)
    ):
        return _told(why, state)
    try:
        found, share, bare = reader.read(read, state, nouns)
    except RpaugError:
        if (why := rest.reason(whole, state.fresh, state.namer, sure=False)) is None:
            raise
        return _told(why, state)
    return gathering.take(found, share, state, bare)


def _kept(read: list[Token], whole: list[Token], state: WishState) -> list[Token] | None:
    """What must stay as it is; nothing in a reason, "it looks way too clean in there". Raises NotUnderstood."""
    try:
        return rest.kept(read)
    except NotUnderstood:
        if (why := rest.reason(whole, state.fresh, state.namer, sure=False)) is None:
            raise
        _told(why, state)
        return []


def _earlier(read: list[Token], state: WishState) -> bool:
    """Does a clause change what was asked for before? Then that is done."""
    edits: list[Any] | None = None
    if any(one.kind == "restart" for one in read) and {one.kind for one in read} <= {
        "restart",
        *tokens.WEAK,
    }:
        state.fresh, state.mention, edits = [], None, []
    elif rest.undoes(read) and state.edits:
        edits, state.mention = rest.left(read, state.edits), None
    else:
        edits = rest.taken_back(read, state.edits)
        edits = rest.put_back(read, state.edits, state.namer) if edits is None else edits
        edits = rest.halves(read, state.edits, state.mention) if edits is None else edits
    if edits is not None:
        state.edits, state.did = edits, True
        return True
    fresh = bool(state.fresh)
    again = rest.again(read, state.edits, state.namer, fresh) if state.edits else None
    found = again or rest.harder(read, state.namer)
    if found:
        gathering.take(found, None, state, read)
    elif state.fresh and (even := rest.evenly(read, state.fresh[-1])) is not None:
        state.fresh[-1] |= even
        return True
    return found is not None


def _aside(read: list[Token], state: WishState) -> Meant | None:
    """A simile after an edit, or "all of it mild" after several edits: it asks for nothing, and that is told."""
    kinds = {one.kind for one in read if one.text != "one"}
    if read[0].text == "like" and kinds <= SIMILE and state.last:
        return Meant(edits=(), notes=(f"{said(read)!r} is taken as a reason, not as an edit",))
    if state.fresh and "little" in kinds and kinds <= {"filler", "all", "little", "thing", "and"}:
        return Meant(
            edits=(), notes=(f"{said(read)!r} is taken as said of amounts that were not named",)
        )
    return None


def _told(why: Meant, state: WishState) -> None:
    state.mention = why.mention or state.mention
    state.notes += why.notes
