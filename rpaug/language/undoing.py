"""Earlier edits that a wish takes back."""

import re

from rpaug.language.calling import called
from rpaug.language.gathering import WishState, short
from rpaug.language.messages import NotUnderstood

UNDO = re.compile(
    r"(?:undo|forget about|forget|revert|cancel|take back|roll back)(?: (?P<what>[a-z0-9_ ]+))?"
)
UNDO_LAST = frozenset(
    f"{verb}{what}"
    for verb in ("undo", "revert", "cancel", "take back")
    for what in (
        "",
        " it",
        " that",
        " the last step",
        " the last edit",
        " the last change",
        " the last one",
        " last",
    )
)  # the whole round before, whatever it was
RESTART = re.compile(
    r"(?:start (?:over|again|afresh|from scratch)|forget everything|undo everything|clear the recipe)"
)


def undo(what: str | None, gathered: WishState) -> None:
    if not gathered.edits:
        raise NotUnderstood("there is nothing to undo")
    what = re.sub(r"^(?:the|that|my) ", "", what or "").strip()
    left = [edit for edit in gathered.edits if not called(what, edit)]
    if len(left) == len(gathered.edits):
        there = "; ".join(map(short, gathered.edits))
        raise NotUnderstood(f"nothing that was asked for is called {what!r}; there is: {there}")
    gathered.edits = left
    gathered.did, gathered.mention = True, None
