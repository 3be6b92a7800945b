"""A whole wish, offline: its tokens clause by clause, the longest beginning that is understood first."""

import contextlib
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from rpaug.assets import library
from rpaug.core import color_space, registry
from rpaug.core.errors import RpaugError
from rpaug.language import reader, repair, rest, templates, tokens, values
from rpaug.language.declared import own_role, targets
from rpaug.language.lexicon import group
from rpaug.language.messages import Answer, Entry, Meant, Mention, NotUnderstood, Trace, Wish
from rpaug.language.recording import Recording
from rpaug.language.things import Named, Namer
from rpaug.language.tokens import Token, said

QUESTION = frozenset(
    ["is", "are", "does", "did", "why", "who", "when", "where", "which", "what", "how"]
)
BREAKS = group("manager_breaks") | {","}
ACTS = group("manager_acts")
ORDERS = ("make", "turn", "set", "give", "put")
SIMILE = {"to", "filler", "thing", "unknown", "and", "on"}
JOINS = ("and", "filler", "stop")
AFTERTHOUGHT = group("manager_afterthought")
"""Kinds of words that only go on with what the clause before asks for."""
IT = Token("thing", "it", Named("it", pronoun=True))
MOST_CLAUSES, MOST_EDITS, MOST_UNDONE = 30, 120, 8
SETTLED = group("manager_settled")


@dataclass
class WishState:
    """What has been gathered of one wish so far."""

    wish: Wish
    namer: Namer
    edits: list[Entry]
    mention: Mention | None
    did: bool
    notes: list[str] = field(default_factory=list)
    fresh: list[Entry] = field(default_factory=list)  # edits of this wish
    kept: list[Token] = field(default_factory=list)  # what must stay as it is
    trace: list[Trace] = field(default_factory=list)
    verb: list[Token] = field(default_factory=list)  # of the clause before
    about: list[Token] = field(
        default_factory=list
    )  # the things that the clause before gave a look or a size
    last: tuple[list[Token], list[Entry]] = field(
        default_factory=lambda: ([], [])
    )  # that clause, and its edits

    def here(self) -> Wish:
        """The wish as the next clause sees it."""
        self.namer.mention = self.mention
        return self.wish.model_copy(update={"edits": tuple(self.edits), "mention": self.mention})


def answer(wish: Wish, recording: Recording | None = None) -> Answer:
    """What a wish comes to, offline. Raises NotUnderstood, and then nothing of the wish holds."""
    words, nouns = tokens.split(wish.stated), _nouns(wish)
    mended, notes = repair.repaired(words, tokens.known(wish.setting.cameras) | nouns)
    try:
        return _answer(wish, mended, nouns, notes, recording)
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
    state = WishState(
        wish,
        Namer(recording, wish.mention),
        list(wish.edits),
        wish.mention,
        bool(found),
        list(notes),
    )
    apart = {word for one in read if one.kind == "thing" for word in one.value.words.split()}
    state.namer.apart = bool(apart & {"arm"}) and bool(apart & {"gripper", "hand"})
    _run(read, state, nouns)
    if state.kept and any(
        one.kind in ("all", "rest") for one in read
    ):  # everything, but what is kept
        namer = Namer(recording, wish.mention)
        namer.kept = [one.value for one in state.kept if one.kind == "thing"]
        state = WishState(wish, namer, list(wish.edits), wish.mention, bool(found), list(notes))
        _run(read, state, nouns)
    rest.respected(state.kept, state.fresh, state.namer, state.notes)
    if not state.did or not (state.edits or wish.edits):
        raise NotUnderstood(f"{wish.stated!r}: that asks for no change, so there is nothing to do")
    whole = Trace(
        stage="manager",
        by="words",
        input=wish.stated,
        output={"read": " ".join(words), "settings": found},
    )
    return Answer(
        edits=tuple(_drawn(state.edits)),
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
        read = read[size:]
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
    whole = next((k for k, one in enumerate(read) if one.kind == "stop"), len(read))
    yield whole
    for k in range(whole - 1, 0, -1):
        if read[k].text in BREAKS or (
            read[k].kind == "keep" and read[k].text.startswith("without")
        ):
            yield k


def _clause(read: list[Token], state: WishState, nouns: frozenset[str]) -> None:
    """One clause. Raises RpaugError and then changes nothing."""
    whole = read
    bare = {one.kind for one in read} <= {
        "not",
        "thing",
        "color",
        "texture",
        "or",
        "and",
        "filler",
        "to",
    }
    while read and (
        read[0].kind in JOINS or read[0].text in ("or", "while", *([] if bare else ["but"]))
    ):
        read = read[1:]
    while read and read[-1].kind in ("and", "stop"):
        read = read[:-1]
    kinds = {one.kind for one in read}
    if kinds <= {"filler", "and"}:
        return
    if "restart" in kinds and kinds <= {"restart", *tokens.WEAK}:
        state.edits, state.fresh, state.mention, state.did = [], [], None, True
    elif rest.undoes(read) and state.edits:
        _undo(read, state)
    elif (left := rest.taken_back(read, state.edits)) is not None:
        state.edits, state.did = left, True
    elif (back := rest.put_back(read, state.edits, state.namer)) is not None:
        state.edits, state.did = back, True
    elif state.edits and not state.fresh and (again := rest.again(read, state.edits, state.namer)):
        _take(again, None, state, read)
    elif state.fresh and (even := rest.evenly(read, state.fresh[-1])) is not None:
        state.fresh[-1] |= even
    elif (both := rest.halves(read, state.edits, state.mention)) is not None:
        state.edits, state.did = both, True
    elif harder := rest.harder(read, state.here(), state.namer):
        _take(harder, None, state, read)
    elif (alone := rest.only(whole)) is not None:
        if any(one.get("op") == "remove" for one in state.fresh):
            state.kept += alone
        else:
            _edit(
                [
                    Token("remove", "remove"),
                    Token("all", "everything"),
                    Token("not", "except"),
                    *alone,
                ],
                state,
                nouns,
            )
    elif (kept := rest.kept(read)) is not None:
        state.kept += kept
        state.namer.kept += [one.value for one in kept if one.kind == "thing"]
    elif (
        read[0].text == "so" and len(read) > 1 and (read[1].kind in ACTS or read[1].text in ORDERS)
    ):
        _edit(read[1:], state, nouns)
    elif why := rest.reason(whole, state.fresh, state.namer):
        state.mention = why.mention or state.mention
        state.notes += why.notes
    elif (
        read[0].text == "like"
        and kinds <= SIMILE
        and {one.kind for one in state.last[0]} & {"color", "texture", "light", "warm", "darker"}
    ):
        state.notes.append(f"{said(read)!r} is taken as a reason, not as an edit")
    elif state.fresh and kinds <= {"filler", "all", "little", "thing", "and"} and "little" in kinds:
        state.notes.append(f"{said(read)!r} is taken as said of amounts that were not named")
    else:
        try:
            _edit(read, state, nouns)
        except RpaugError:
            if (why := rest.reason(whole, state.fresh, state.namer, sure=False)) is None:
                raise
            state.mention = why.mention or state.mention
            state.notes += why.notes


def _undo(read: list[Token], state: WishState) -> None:
    """Take earlier edits back. Raises NotUnderstood where none is called so."""
    state.edits, state.did, state.mention = rest.left(read, state.edits), True, None


def _edit(read: list[Token], state: WishState, nouns: frozenset[str]) -> None:
    """What a clause asks for, with the share of copies that it is meant for."""
    shares = [one.value for one in read if one.kind == "chance"]
    if len(shares) > 1:
        raise NotUnderstood(f"{said(read)!r}: one share of the copies at a time")
    if len(shares) == len([one for one in read if one.kind not in JOINS]):
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
        elif (other := _gone_on(bare, state) or _alternatives(bare, state)) is not None:
            found = other
        else:
            raise error
    if recorded:
        found = _of_that_color(found, recorded, state)
    _take(found, share, state, bare)


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


def _meant(read: list[Token], state: WishState, nouns: frozenset[str]) -> Meant:
    """The edits of a clause; with the verb or the things of the one before where it has none of its own."""
    wish = state.here()
    if (fits := templates.fitting(said(read), wish, state.namer, nouns)) is not None:
        return fits
    try:
        return reader.read(read, wish, state.namer)
    except RpaugError as error:
        why = error
    kinds = {one.kind for one in read}
    before = [state.verb] if state.verb and not kinds & {"remove", "add", "move", "copy"} else []
    if "thing" not in kinds:
        before += [state.about] if state.about else []
        before += [[IT]] if state.did and state.mention and state.mention.kind == "target" else []
    for more in before:
        with contextlib.suppress(RpaugError):
            return reader.read([*more, *read], wish, state.namer)
    raise why


def _trailing(
    read: list[Token], state: WishState, nouns: frozenset[str]
) -> tuple[Meant, float] | None:
    """What a clause means whose last words are a bare share, "the can red, 30%": that is the share of copies."""
    for k in (len(read) - 1, 0):
        if (
            not read
            or read[k].kind != "share"
            or read[k].value.how != "exact"
            or not 0 <= read[k].value.low <= 1
        ):
            continue
        with contextlib.suppress(RpaugError):
            return _meant(_bare([*read[:k], *read[k + 1 :]]), state, nouns), read[k].value.low
    return None


def _gone_on(read: list[Token], state: WishState) -> Meant | None:
    """What the clause before comes to with these words at its end, if that is the same edit with more said of it."""
    before, edits = state.last
    if not before or not {one.kind for one in read} <= AFTERTHOUGHT:
        return None
    with contextlib.suppress(RpaugError):
        found = reader.read([*before, *read], state.here(), state.namer)
        if [_ops(one) for one in found.edits] == [
            _ops(one) for one in edits
        ] and not found.replaces:
            state.edits = [one for one in state.edits if all(one is not old for old in edits)]
            state.fresh = [one for one in state.fresh if all(one is not old for old in edits)]
            return found
    return None


def _ops(edit: Entry) -> set[str]:
    return {one["op"] for one in edit.get("one_of", [edit])}


def _alternatives(read: list[Token], state: WishState) -> Meant | None:
    """One of several edits, drawn for each copy; None for a clause without "or"."""
    at = [k for k, one in enumerate(read) if one.kind == "or"]
    if not at:
        return None
    parts = [read[a + 1 : b] for a, b in zip([-1, *at], [*at, len(read)], strict=True)]
    options: list[Entry] = []
    for part in parts:
        bare = _bare(part)
        found = _meant(bare, state, frozenset())
        if len(found.edits) != 1 or found.replaces:
            raise NotUnderstood(f"{said(part)!r} is no single edit, and `or` draws one of several")
        options += found.edits[0].get("one_of", found.edits)
        if found.mention and found.mention.kind == "target":
            state.mention = found.mention
        state.about = [one for one in bare if one.kind == "thing"] or state.about
    return Meant(edits=({"one_of": options},))


def _take(found: Meant, share: float | None, state: WishState, read: list[Token]) -> None:
    """Add what a clause means. A later look, size or light of the same thing takes the place of an earlier one's."""
    state.did = True
    state.mention = found.mention or state.mention
    named = [one for one in read if one.kind == "thing"]
    if all(one["op"] in SETTLED for edit in found.edits for one in edit.get("one_of", [edit])):
        state.about = named if named and len(named) == len(found.edits) else state.about
        if len(named) == 1 and found.mention and isinstance(found.mention.target, str):
            state.about = [Token("thing", found.mention.target, Named(found.mention.target))]
    else:
        state.about = []
    state.verb = [one for one in read[:3] if one.kind in ("remove", "add", "move", "copy", "vary")][
        :1
    ] or state.verb
    state.notes += found.notes
    kept = len(state.fresh)
    for k in found.replaces:
        state.fresh = [one for one in state.fresh if one is not state.edits[k]]
        state.edits[k] = found.edits[0]
    for edit in () if found.replaces else found.edits:
        edit = {**edit, "probability": share} if share is not None else edit
        if not _merged(edit, state):
            _add(edit, state)
    state.last = (read, state.fresh[kept:] if share is None and not found.replaces else [])
    if len(state.edits) > MOST_EDITS:
        raise NotUnderstood("too many edits: say them in several wishes")
    output = {"edits": list(found.edits), "notes": list(found.notes)}
    state.trace.append(Trace(stage=found.stage, by="words", input=said(read), output=output))


def _add(edit: Entry, state: WishState) -> None:
    """Add an edit, or let it take an earlier one's place. Raises NotUnderstood where both are of one wish."""
    group = _key(edit)
    same = next((k for k, other in enumerate(state.edits) if group and _key(other) == group), None)
    if same is not None and any(state.edits[same] is one for one in state.fresh):
        before = state.edits[same]
        if before == edit:  # said twice
            return
        if rest.unsaid(before):
            state.fresh = [one for one in state.fresh if one is not before]
        elif edit.get("probability") is None or before.get("probability") is None:
            what = group[0] if group else ""
            raise NotUnderstood(
                f"two edits of one wish give one thing a {what}: {rest.short(edit)}"
            )
        else:
            same = None
    if same is not None:
        state.notes.append(f"takes the place of: {rest.short(state.edits[same])}")
        state.edits[same] = edit
    else:
        state.edits.append(edit)
    state.fresh.append(edit)


def _merged(edit: Entry, state: WishState) -> bool:
    """Does an edit go on with the one before, of the same camera: where it looks then, how far it turns as well?"""
    if edit.get("op") != "camera_pose" or not state.fresh or "probability" in edit:
        return False
    before = state.fresh[-1].get("one_of", [state.fresh[-1]])
    if any(one["op"] != "camera_pose" or one["camera"] != edit["camera"] for one in before):
        return False
    exact = {"by", "turned", "toward"}
    if "toward" in edit and not exact & edit.keys() - {"toward"}:
        more = {"toward": edit["toward"]}
    elif (
        exact & {*edit, *(key for one in before for key in one)}
        or "turn" not in edit
        or edit.get("shift")
    ):
        return False
    else:
        more = {"turn": edit["turn"]}
    for one in before:
        one.update(more)
    return True


def _drawn(edits: list[Entry]) -> Iterator[Entry]:
    """Edits that give one thing one of several looks, each to a share of the copies, as one draw."""
    for edit in edits:
        alike = [
            one
            for one in edits
            if "probability" in one and "op" in one and _key(one) and _key(one) == _key(edit)
        ]
        if len(alike) < 2 or "probability" not in edit:
            yield edit
        elif edit is alike[0]:
            whole = values.tidy(sum(one["probability"] for one in alike))
            if whole > 1:
                raise NotUnderstood(f"shares of {whole:g} in all: {rest.short(edit)}")
            options = [
                {
                    **{n: v for n, v in one.items() if n != "probability"},
                    "weight": one["probability"],
                }
                for one in alike
            ]
            yield {"one_of": options, **({"probability": whole} if whole < 1 else {})}


def _key(edit: Entry) -> tuple[str, str] | None:
    """What an edit settles, and of what."""
    if "one_of" in edit:
        keys = {_key(one) for one in edit["one_of"]}
        return keys.pop() if len(keys) == 1 else None
    operator, role = registry.operator(edit["op"]), own_role(edit["op"])
    if not operator.settles or (operator.needs.targets and not role and not targets(edit)):
        return None  # without a target one is drawn
    return operator.settles, repr(targets(edit) or [{"role": role}])
