"""A handle names one thing where masks are recorded; elsewhere one in each episode."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from rpaug.core.errors import BadInput, Unsupported
from rpaug.pipeline.inputs import see_handles_hold
from rpaug.pipeline.recipe import Recipe

BY_HANDLE = {"op": "recolor", "target": {"handle": 6}, "color": "red"}
BY_WORDS = {"op": "recolor", "target": {"text": "the cup"}, "color": "red"}


class OneCamera:
    """An adapter of episodes whose only camera has masks, or none."""

    def __init__(self, ids: Any) -> None:
        self.ids = ids

    def read(self, root: Path, key: str) -> Any:
        if self.ids == "spoilt":
            raise BadInput(root, "file", found="nothing", expected="a file")
        return SimpleNamespace(views={"front": SimpleNamespace(ids=self.ids)})


def see(edits: list, ids: Any, *keys: str, **given: Any) -> None:
    recipe = Recipe.from_dict({"version": 1, "edits": edits, **given})
    see_handles_hold(recipe, OneCamera(ids), Path("videos"), keys)  # type: ignore[arg-type]


def test_a_handle_in_several_episodes_without_masks_is_refused() -> None:
    words = (
        r"found a handle, and 2 episodes .* expected a role or words.*select: \{episodes: \[a\]\}"
    )
    nested = {"one_of": [BY_WORDS, BY_HANDLE]}
    for edits in ([BY_HANDLE], [nested]):
        with pytest.raises(Unsupported, match=words):
            see(edits, None, "a", "b")


def test_so_is_a_role_that_is_settled_by_one() -> None:
    with pytest.raises(Unsupported, match="roles: found a handle, and 3 episodes"):
        see([BY_WORDS], None, "a", "b", "c", roles={"table": {"handle": [2, 3]}})
    see([BY_WORDS], None, "a", "b", roles={"table": {"color": "brown"}})


def test_it_is_taken_where_it_names_one_thing() -> None:
    see([BY_HANDLE], None, "a")  # one episode
    see([BY_WORDS], None, "a", "b")
    see([BY_HANDLE], lambda t: None, "a", "b")  # recorded masks
    see([BY_HANDLE], "spoilt", "a", "b")  # said when it is read
