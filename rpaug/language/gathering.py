"""The edits of a wish as they are gathered: a later one joins an earlier, takes its place, or cannot hold beside it."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import count

from rpaug.core import registry
from rpaug.language import values
from rpaug.language.calling import short
from rpaug.language.declared import own_role, targets
from rpaug.language.lexicon import group
from rpaug.language.messages import Entry, Meant, Mention, NotUnderstood, Trace, Wish
from rpaug.language.things import Named, Namer
from rpaug.language.tokens import Token, said

MOST_EDITS = 120
SETTLED = group("gathering_settled")


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
    about: list[Token] = field(default_factory=list)  # what that gave a look or a size
    last: list[Token] = field(default_factory=list)  # that clause
    latest: list[Entry] = field(default_factory=list)  # its edits

    def here(self) -> Wish:
        """The wish as the next clause sees it."""
        self.namer.mention = self.mention
        return self.wish.model_copy(update={"edits": tuple(self.edits), "mention": self.mention})


def take(found: Meant, share: float | None, state: WishState, read: list[Token]) -> None:
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
    chance: Entry = {} if share is None else {"probability": share}
    for k in found.replaces:
        state.fresh = [one for one in state.fresh if one is not state.edits[k]]
        state.edits[k] = {**found.edits[0], **chance}
    if share is not None and len(found.edits) > 1:
        if any("one_of" in edit for edit in found.edits):
            state.notes.append(
                f"{said(read)!r}: each is drawn by itself, so copies have one, both or none"
            )
        else:
            used = {edit.get("together") for edit in state.edits}
            chance["together"] = next(f"wish {n}" for n in count(1) if f"wish {n}" not in used)
    for edit in () if found.replaces else found.edits:
        edit = {**edit, **chance}
        if not _merged(edit, state):
            _add(edit, state)
    state.last, state.latest = (
        read,
        [] if share is not None or found.replaces else state.fresh[kept:],
    )
    if len(state.edits) > MOST_EDITS:
        raise NotUnderstood("too many edits: say them in several wishes")
    output = {"edits": list(found.edits), "notes": list(found.notes)}
    state.trace.append(Trace(stage=found.stage, by="words", input=said(read), output=output))


def _add(edit: Entry, state: WishState) -> None:
    """Add an edit, or let it take an earlier one's place. Raises NotUnderstood where both are of one wish."""
    group = settled(edit)
    same = next(
        (k for k, other in enumerate(state.edits) if group and settled(other) == group), None
    )
    if edit.get("op") == "camera_pose" and state.fresh and _shaken(state.fresh[-1], edit):
        state.edits.pop()  # "camera shake! up to 1 cm": the heading of what follows
        state.fresh.pop()
    if same is not None and any(state.edits[same] is one for one in state.fresh):
        before = state.edits[same]
        if before == edit:  # said twice
            return
        if _unsaid(before) and not _unsaid(edit):
            state.fresh = [one for one in state.fresh if one is not before]
        elif edit.get("probability") is None or before.get("probability") is None:
            what = group[0] if group else ""
            raise NotUnderstood(f"two edits of one wish give one thing a {what}: {short(edit)}")
        else:
            same = None
    if same is not None:
        state.notes.append(f"takes the place of: {short(state.edits[same])}")
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


def drawn(edits: list[Entry]) -> Iterator[Entry]:
    """Edits that give one thing one of several looks, each to a share of the copies, as one draw."""
    for edit in edits:
        alike = [
            one
            for one in edits
            if "probability" in one
            and "op" in one
            and settled(one)
            and settled(one) == settled(edit)
        ]
        if len(alike) < 2 or "probability" not in edit:
            yield edit
        elif edit is alike[0]:
            if any("together" in one for one in alike):
                why = (
                    "it is of the same copies as another, and cannot have a second share of its own"
                )
                raise NotUnderstood(f"{short(edit)}: {why}; say it in two wishes")
            whole = values.tidy(sum(one["probability"] for one in alike))
            if whole > 1:
                raise NotUnderstood(f"shares of {whole:g} in all: {short(edit)}")
            options = [
                {
                    **{n: v for n, v in one.items() if n != "probability"},
                    "weight": one["probability"],
                }
                for one in alike
            ]
            yield {"one_of": options, **({"probability": whole} if whole < 1 else {})}


def settled(edit: Entry) -> tuple[str, str] | None:
    """What an edit settles, and of what."""
    if "one_of" in edit:
        keys = {settled(one) for one in edit["one_of"]}
        return keys.pop() if len(keys) == 1 else None
    operator, role = registry.operator(edit["op"]), own_role(edit["op"])
    if not operator.settles or (operator.needs.targets and not role and not targets(edit)):
        return None  # without a target one is drawn
    return operator.settles, repr(targets(edit) or [{"role": role}])


def _shaken(before: Entry, edit: Entry) -> bool:
    """Does an edit say of many cameras how far they are moved, where the one before only said that all are?"""
    bare = before == {"op": "camera_pose", "camera": "static"}
    return bare and not isinstance(edit["camera"], str) and {"shift", "turn"} & edit.keys() != set()


def _unsaid(edit: Entry) -> bool:
    """Does an edit give a look without saying which?"""
    bare = "texture" not in edit and edit.get("op", "").endswith("texture")
    return bare or edit.get("color") == {"sample": "colosseum"} or edit == {"op": "table_color"}
