"""What the stages hand to each other."""

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from rpaug.core.errors import RpaugError

Entry = dict[str, Any]
"""One entry of a recipe's `edits`."""


class NotUnderstood(RpaugError):
    """A wish, or a part of it, has no meaning here; the message says which part and why."""


class Message(BaseModel):
    """A frozen value with no other keys than its own."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class WishContext(Message):
    """What a wish is about: names out of the recording, never obeyed, only looked up.

    `generates`: what the library lacks can be made.
    """

    cameras: tuple[str, ...] = ()
    instructions: tuple[str, ...] = ()
    generates: bool = False


class Mention(Message):
    """What "it" stands for after a step."""

    kind: Literal["target", "camera", "light", "new"]
    target: Any = None
    cameras: Any = None


class Wish(Message):
    """What was said, what was asked for before, and where."""

    stated: str = Field(max_length=4000)
    setting: WishContext = WishContext()
    edits: tuple[Entry, ...] = ()
    settings: dict[str, Any] = {}
    mention: Mention | None = None


class Meant(Message):
    """What one step means. `notes` are what was taken for granted, to be told to whoever asked."""

    edits: tuple[Entry, ...]
    mention: Mention | None = None
    notes: tuple[str, ...] = ()
    replaces: tuple[int, ...] = ()  # earlier edits that this one takes the place of
    stage: str = "operation"  # whose rule it was
    order: str = ""  # the step in the words that fitted the rule


class Trace(Message):
    """What one stage was given, what it was asked in words if a model was, and what it gave back."""

    stage: str
    by: str  # "grammar", "scene", or a model's name
    input: Any
    output: Any
    prompt: Any = None


class Answer(Message):
    """What a whole wish comes to: the edits and settings of the recipe after it."""

    edits: tuple[Entry, ...]
    settings: dict[str, Any] = {}
    mention: Mention | None = None
    notes: tuple[str, ...] = ()
    trace: tuple[Trace, ...] = ()

    def recipe(self) -> dict[str, Any]:
        """The recipe as plain data."""
        return {"version": 1, "seed": 0, "copies": 1, **self.settings, "edits": list(self.edits)}
