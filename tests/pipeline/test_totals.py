"""What a run comes to in words: counts add up over copies, and each stands where its sentence has it."""

import re

from hypothesis import given
from hypothesis import strategies as st

from rpaug.operators.distractors import Distractors
from rpaug.pipeline.recipe import Option
from rpaug.pipeline.run import Summary
from rpaug.pipeline.totals import EditOutcomes

WORDS = "asked near the target stand elsewhere: no room there"
COPIES = st.lists(
    st.tuples(st.integers(0, 3), st.integers(0, 4)).map(lambda one: (one[0], sum(one))), min_size=1
)


def outcomes() -> EditOutcomes:
    return EditOutcomes(0, Option("distractors", {}, Distractors(count=2)))


@given(COPIES)
def test_things_that_could_not_be_had_are_counted_of_those_asked_for(
    copies: list[tuple[int, int]],
) -> None:
    found = outcomes()
    for number, (missed, asked) in enumerate(copies):
        found.add(f"episode{number}", None, {WORDS: [missed, asked]})
    summary = Summary(fell_short=list(found.fell_short()))
    missed, asked = (sum(one[k] for one in copies) for k in (0, 1))
    where = [f"episode{number}" for number, one in enumerate(copies) if one[0]]
    more = f" and {len(where) - 3} others" if where[3:] else ""
    sentence = f"distractors: {missed} of {asked} {WORDS} ({', '.join(where[:3])}{more})"
    assert summary.shortfalls == ([sentence] if missed else [])


def test_each_reason_is_said_with_its_number_of_episodes() -> None:
    found = outcomes()
    for number, why in enumerate(["no table", "no room; there is: 1", "no room; there is: 2"]):
        found.add(f"episode{number}", why, {})
    (line,) = Summary(left_out=list(found.left_out())).lacked
    assert line.endswith("3 of 3 episodes lacked it: in 2: no room; in 1: no table")


@given(st.lists(st.tuples(st.integers(0, 4), st.booleans()), min_size=1))
def test_episodes_that_lacked_an_edit_are_counted_of_those_that_drew_it(
    copies: list[tuple[int, bool]],
) -> None:
    found = outcomes()
    for number, left_out in copies:
        found.add(f"episode{number}", "no room" if left_out else None, {})
    lines = Summary(left_out=list(found.left_out())).lacked
    nowhere = all(left_out for _, left_out in copies)
    lacked, drew = {n for n, left_out in copies if left_out}, {n for n, _ in copies}
    assert len(lines) == bool(lacked)
    for line in lines:
        said = re.fullmatch(
            r"distractors[^:]*: (in no copy: )?(\d+) of (\d+) episodes lacked it: no room", line
        )
        assert said
        assert bool(said[1]) == nowhere
        assert (int(said[2]), int(said[3])) == (len(lacked), len(drew))
