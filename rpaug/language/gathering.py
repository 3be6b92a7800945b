"""What has been gathered of one wish so far: its edits, of which only one of a kind can hold for one thing."""

from dataclasses import dataclass, field
from typing import Any

from rpaug.core import registry
from rpaug.language import declared
from rpaug.language.messages import Entry, Meant, Mention, NotUnderstood, Trace, Wish


@dataclass
class WishState:
    """What has been gathered of one wish so far."""

    wish: Wish
    edits: list[Entry]
    settings: dict[str, Any]
    mention: Mention | None
    notes: list[str] = field(default_factory=list)
    fresh: list[Entry] = field(default_factory=list)  # edits of this wish
    barred: list[str] = field(default_factory=list)
    did: bool = False
    trace: list[Trace] = field(default_factory=list)

    def here(self) -> Wish:
        """The wish as the next step sees it."""
        return self.wish.model_copy(update={"edits": tuple(self.edits), "mention": self.mention})


def take(found: Meant, chance: float | None, gathered: WishState) -> None:
    """Add what a step means. A later look, size or light of the same thing takes the place of an earlier one's."""
    gathered.did = True
    gathered.mention = found.mention if found.mention else gathered.mention
    gathered.notes += found.notes
    for number in found.replaces:
        (edit,) = found.edits
        _forget_fresh(gathered, gathered.edits[number])
        gathered.edits[number] = edit
        gathered.fresh.append(edit)
        return
    taken = [key(edit) for edit in gathered.fresh]
    for edit in found.edits:
        group = key(edit)
        if group and group in taken:
            raise NotUnderstood(f"two edits of one wish give one thing a {group[0]}: {short(edit)}")
        taken.append(group)
    for edit in found.edits:
        edit = {**edit, "probability": chance} if chance is not None else edit
        group = key(edit)
        same = [k for k, other in enumerate(gathered.edits) if group and key(other) == group]
        if same:
            gathered.notes.append(f"takes the place of: {short(gathered.edits[same[0]])}")
            gathered.edits[same[0]] = edit
        else:
            gathered.edits.append(edit)
        gathered.fresh.append(edit)


def _forget_fresh(gathered: WishState, edit: Entry) -> None:
    gathered.fresh = [other for other in gathered.fresh if other is not edit]


def key(edit: Entry) -> tuple[str, str] | None:
    """What an edit settles, and of what."""
    group = registry.operator(edit["op"]).settles if "op" in edit else ""
    if not group:
        return None
    return group, repr(declared.targets(edit) or [{"role": declared.own_role(edit["op"])}])


def short(edit: Entry) -> str:
    return ", ".join(f"{name} {value}" for name, value in edit.items())
