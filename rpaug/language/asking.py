"""One wish through all stages: understood, grounded in a recorded scene, checked as a recipe, and logged."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import yaml

from rpaug.core.errors import BadRecipe, RpaugError
from rpaug.core.types import Episode, Scene
from rpaug.language import rounds
from rpaug.language.messages import Answer, NotUnderstood, Trace, WishContext
from rpaug.language.rounds import History

if TYPE_CHECKING:
    from rpaug.language.making import Maker
    from rpaug.language.recording import Recording


class Understanding(Protocol):
    """What turns a wish after some rounds into edits: the grammar, or a language model, which looks at the recording.

    Raises NotUnderstood.
    """

    def __call__(
        self,
        history: History,
        stated: str,
        setting: WishContext,
        recording: "Recording | None" = None,
    ) -> Answer: ...


@dataclass(frozen=True)
class AskResult:
    """What came of a wish: a valid recipe, notes on what was taken for granted, the log, and the talk so far."""

    recipe: dict[str, Any]
    notes: tuple[str, ...]
    trace: tuple[Trace, ...]
    history: History

    @property
    def yaml(self) -> str:
        """The recipe as a file, with the wishes and the notes on top."""
        lines = [f"# asked: {_line(one.said)}" for one in self.history.rounds]
        lines += [f"# read: {_line(one)}" for one in self.read]
        lines += [f"# note: {_line(note)}" for note in self.notes]
        return (
            "\n".join(lines)
            + "\n"
            + yaml.dump(self.recipe, Dumper=_Dumper, sort_keys=False, width=110)
        )

    @property
    def read(self) -> tuple[str, ...]:
        """What each part of the wish was understood as, where the grammar read it."""
        parts = [
            one
            for one in self.trace
            if one.by == "words" and one.stage in ("operation", "renderer")
        ]
        return tuple(
            f"{one.input!r} as {'; '.join(map(_told, one.output['edits']))}" for one in parts
        )

    @property
    def log(self) -> str:
        """Every stage, one JSON value a line."""
        return "".join(
            json.dumps(one.model_dump(), ensure_ascii=False) + "\n" for one in self.trace
        )


class _Dumper(yaml.SafeDumper):
    """An edit on lines of its own, and lists of numbers in one."""

    def represent_sequence(self, tag: str, sequence: Any, flow_style: bool | None = None) -> Any:
        flat = all(not isinstance(value, dict) for value in sequence)
        return super().represent_sequence(tag, sequence, flow_style=flat)

    def ignore_aliases(self, data: Any) -> bool:
        return True


def setting_of(episode: Episode) -> WishContext:
    """What a recording offers to a wish."""
    return WishContext(cameras=tuple(episode.views), instructions=episode.descriptions)


def ask(
    stated: str,
    setting: WishContext,
    scene: Callable[[], Scene] | None = None,
    *,
    history: History | None = None,
    understanding: Understanding = rounds.next_round,
    tier: int = 0,
    maker: "Maker | None" = None,
) -> AskResult:
    """The recipe for a wish. `scene` builds a recorded scene in which every target must be found.

    `maker` makes what is to be put in and the library lacks. Raises NotUnderstood for a wish that has no meaning here,
    TargetError or Unsupported for one that the scene has nothing for, NotMade where making fails. Nothing is written
    but what was made.
    """
    from rpaug.language import making, refiner  # only here: they bring the library of things
    from rpaug.language.recording import Recording  # only here: it brings numba and the pipeline

    history = history or History()
    setting = setting.model_copy(update={"generates": maker is not None})
    recording = Recording(scene) if scene is not None else None
    answer = understanding(history, stated, setting, recording)
    _built(answer)
    trace = list(answer.trace)
    if recording and answer.edits:
        trace += recording.ground(answer)
    found = list(making.provided(answer.edits, maker))
    trace += [done for _, done in found if done is not None]
    edits = tuple(edit for edit, _ in found)
    settings, output = refiner.refined(edits, answer.settings, tier)
    trace.append(Trace(stage="refiner", by="plan", input=list(edits), output=output))
    answer = answer.model_copy(update={"edits": edits, "settings": settings})
    _built(answer)
    if recording and answer.edits:
        recording.check(answer)
    return AskResult(answer.recipe(), answer.notes, tuple(trace), history.after(stated, answer))


def _built(answer: Answer) -> None:
    """See that an answer comes to a valid recipe. Raises NotUnderstood."""
    from rpaug.pipeline import recipe as recipes  # only here: it brings every operator

    try:
        recipes.build(answer.recipe(), name="the wish")
    except BadRecipe as error:
        raise NotUnderstood(f"the wish comes to a recipe that is not valid: {error}") from None


def _told(edit: Mapping[str, Any]) -> str:
    """An edit in few words; the looks of which one is drawn by their number."""
    if "one_of" in edit:
        return f"one of {len(edit['one_of'])}: {_told(edit['one_of'][0])}, ..."
    return " ".join(
        [edit["op"], *(f"{name} {value}" for name, value in edit.items() if name != "op")]
    )


def _line(text: str) -> str:
    return " ".join(text.split())


def reason(error: RpaugError) -> str:
    """What was not understood, in one line."""
    return _line(str(error))
