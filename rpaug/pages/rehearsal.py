"""What is done while nobody asks for anything: ordinary edits are tried, so that the first of each is drawn as fast as
the next. What they look at in an episode is found and kept, textures are made, kernels are loaded."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

from rpaug.core.errors import RpaugError
from rpaug.pages.session import Session
from rpaug.pipeline import recipe as recipes
from rpaug.pipeline.recipe import Recipe

ORDINARY: tuple[dict[str, Any], ...] = (
    {"op": "recolor", "target": {"role": "manipulated"}, "color": "blue"},
    {"op": "table_texture"},
    {"op": "distractors", "count": 1},
    {"op": "light_color"},
    {"op": "camera_pose", "camera": "static"},
)
NEXT = (2, 3, 4)  # copies that are looked at after the first
PATIENCE = 0.5  # seconds
PAUSE = 0.05  # seconds between two looks whether somebody waits


class GivenUp(Exception):
    """Somebody waits for something else."""


class Rehearsal:
    """Draws by turns: who asks goes first, what is only likely to be asked waits until nobody does."""

    def __init__(self) -> None:
        self._turn, self._counting = threading.RLock(), threading.Lock()
        self._waiting = 0
        self._changed, self._ended = threading.Event(), False
        self._next: tuple[Session, Recipe] | None = None
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    @contextmanager
    def asked(self) -> Iterator[None]:
        """Somebody waits for what is drawn meanwhile."""
        with self._counting:
            self._waiting += 1
        try:
            with self._turn:
                yield
        finally:
            with self._counting:
                self._waiting -= 1

    @contextmanager
    def spare(self) -> Iterator[Callable[[], None]]:
        """The same for what may be given up: what is given raises `GivenUp` where somebody else waits."""

        def see() -> None:
            if self._ended or self._waiting > 1:
                raise GivenUp

        with self.asked():
            see()
            yield see

    def follow(self, session: Session, recipe: Recipe) -> None:
        """Try ordinary edits on this episode beside those of the recipe, and nothing on another any more."""
        self._next = session, recipe
        self._changed.set()

    def end(self) -> None:
        """Stop, without waiting long for what is being drawn: it ends with the process."""
        self._ended = True
        self._changed.set()
        self._thread.join(PATIENCE)

    def _run(self) -> None:
        while not self._ended:
            self._changed.wait()
            self._changed.clear()
            if self._next is None:
                continue
            for piece in pieces(*self._next):
                while self._waiting and not self._stale():
                    self._changed.wait(PAUSE)
                if self._stale():
                    break
                with self._turn, suppress(RpaugError):  # it is told when somebody asks for it
                    piece()

    def _stale(self) -> bool:
        return self._ended or self._changed.is_set()


def pieces(session: Session, recipe: Recipe) -> Iterator[Callable[[], object]]:
    """Work that later requests need: what is in the episode, the recipe's first copy, each ordinary edit beside those
    of the recipe, the next copies, and the first again: its answers are the latest that are kept."""

    def drawn(asked: Recipe, copy: int = 1) -> Callable[[], object]:
        return lambda: session.drawn(asked, copy, [0], judged=False)

    yield lambda: session.found
    yield drawn(recipe)
    for edit in ORDINARY:
        with suppress(RpaugError):  # the recipe names what only this episode has
            yield drawn(
                recipes.build({**recipe.source, "edits": [*recipe.source.get("edits", ()), edit]})
            )
    for copy in NEXT:
        yield drawn(recipe, copy)
    yield drawn(recipe)
