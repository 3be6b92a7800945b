"""What others named is shown and never obeyed."""

from hypothesis import given
from hypothesis import strategies as st

from rpaug.core.visible import markdown, quoted, visible


def test_controls_and_turns_of_direction_are_spelled_out() -> None:
    assert visible("a\x1b[31mb\x9b1mc\u202ed\x7f") == r"a\x1b[31mb\x9b1mc\u202ed\x7f"
    assert visible("drawer, Schublade, 抽屉\n\tnext") == "drawer, Schublade, 抽屉\n\tnext"


@given(st.text())
def test_what_is_visible_stays_as_it_is_and_nothing_else_is_left(text: str) -> None:
    shown = visible(text)
    assert visible(shown) == shown
    assert not {"\x1b", "\x9b", "\u202e", "\x00", "\r"} & set(shown)


def test_markdown_shows_marks_and_tags_as_text() -> None:
    name = "ds<b>x\x1b[31m|`q`\n# _title_"
    assert markdown(name) == r"ds&lt;b&gt;x\\x1b\[31m\|\`q\` \# \_title\_"
    assert markdown("open_drawer (MIT, 2.0)") == r"open\_drawer (MIT, 2.0)"


def test_a_missing_instruction_is_said_to_be_missing() -> None:
    assert quoted("open the drawer") == "“open the drawer”"
    assert quoted("") == quoted(" ") == "no instruction"
