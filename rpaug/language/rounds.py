"""Several rounds of one talk: what was said, and the recipe after each, kept in a history file."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import ValidationError

from rpaug.core.errors import BadInput
from rpaug.language.messages import (
    Answer,
    Entry,
    Mention,
    Message,
    NotUnderstood,
    Wish,
    WishContext,
)

if TYPE_CHECKING:
    from rpaug.language.recording import Recording

MOST = 200  # rounds kept
LONGEST = 1000  # characters of a wish: what is longer is no wish, and takes long to tell so


class TalkRound(Message):
    """One wish and what holds after it."""

    said: str
    edits: tuple[Entry, ...]
    settings: dict[str, Any] = {}
    mention: Mention | None = None


class History(Message):
    """All rounds so far, the latest last."""

    version: int = 1
    rounds: tuple[TalkRound, ...] = ()

    def wish(self, stated: str, setting: WishContext) -> Wish:
        """The next wish, said after these rounds."""
        if not self.rounds:
            return Wish(stated=stated, setting=setting)
        last = self.rounds[-1]
        return Wish(
            stated=stated,
            setting=setting,
            edits=last.edits,
            settings=last.settings,
            mention=last.mention,
        )

    def after(self, stated: str, answer: Answer) -> "History":
        """The history with one more round."""
        made = TalkRound(
            said=stated, edits=answer.edits, settings=answer.settings, mention=answer.mention
        )
        return History(rounds=(*self.rounds, made)[-MOST:])

    def before(self) -> Answer:
        """What held before the last round."""
        if len(self.rounds) < 2:
            return Answer(edits=())
        last = self.rounds[-2]
        return Answer(edits=last.edits, settings=last.settings, mention=last.mention)


def load(path: Path) -> History:
    """The history in a file; none yet if there is no such file. Raises BadInput."""
    from rpaug.core.files import read_bytes  # only here: it brings OpenCV

    if not path.exists():
        return History()
    try:
        return History.model_validate(json.loads(read_bytes(path)))
    except (ValueError, ValidationError) as error:
        reason = str(error).splitlines()[0][:200]
        raise BadInput(
            path, "history", found=reason, expected="a file that `rpaug ask --history` wrote"
        ) from None


def said_after(stated: str, before: Sequence[str], setting: WishContext) -> Answer:
    """What a wish comes to after others, offline. Raises NotUnderstood."""
    history = History()
    for one in before:
        history = history.after(one, next_round(history, one, setting))
    return next_round(history, stated, setting)


def next_round(
    history: History, stated: str, setting: WishContext, recording: "Recording | None" = None
) -> Answer:
    """What a wish comes to after these rounds, offline. Raises NotUnderstood."""
    from rpaug.language import manager  # only here: it brings the library of things and numba

    if len(stated) > LONGEST:
        raise NotUnderstood(
            f"a wish of {len(stated)} characters; at most {LONGEST}: say it in several"
        )
    if manager.undone(stated) and history.rounds:
        return history.before()
    return manager.answer(history.wish(stated, setting), recording)
