"""The last answer is kept for the very same question, and for no other."""

from rpaug.scene.remembered import once


def test_the_same_question_is_answered_once():
    asked = []

    @once
    def find(thing: object, some: frozenset[int]) -> int:
        asked.append(thing)
        return len(asked)

    one, other = [1], [1]
    assert find(one, frozenset({1})) == find(one, frozenset([1])) == 1
    assert find(other, frozenset({1})) == 2
    assert find(one, frozenset({2})) == 3
    assert len(asked) == 3
