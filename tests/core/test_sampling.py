"""Frame numbers that stand for an episode, and frame numbers in words."""

from hypothesis import given
from hypothesis import strategies as st

from rpaug.core import sampling


@given(st.sets(st.integers(0, 60)))
def test_spans_name_each_number_and_no_other(numbers: set[int]) -> None:
    told = sampling.spans(sorted(numbers))
    found = set[int]()
    for part in told.split(", ") if told else ():
        first, _, last = part.partition(" to ")
        found |= set(range(int(first), int(last or first) + 1))
    assert found == numbers


def test_numbers_in_a_row_are_one_span() -> None:
    assert sampling.spans([3, 4, 5, 9]) == "3 to 5, 9"
