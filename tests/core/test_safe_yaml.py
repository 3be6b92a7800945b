"""YAML of strangers: plain values, or a refusal that names the line, before anything large is built."""

import time

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from rpaug.core import safe_yaml as plain_yaml

MOST = 1000
BOMB = "a0: &a0 [x, x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]\n" for i in range(1, 12)
)
MERGES = "a0: &a0 {x: 1, y: 2}\n" + "".join(
    f"a{i}: &a{i} {{<<: [{', '.join([f'*a{i - 1}'] * 10)}]}}\n" for i in range(1, 12)
)
CHAIN = "a0: &a0 [x]\n" + "".join(f"a{i}: &a{i} [*a{i - 1}]\n" for i in range(1, 60))

words = st.text(st.characters(min_codepoint=32, max_codepoint=126), max_size=8)
values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | words,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(words, inner, max_size=4),
    max_leaves=10,
)  # fmt: skip


@settings(deadline=None, max_examples=50, suppress_health_check=[HealthCheck.too_slow])
@given(values)
def test_plain_values_come_back(value: object) -> None:
    data = yaml.safe_dump(value, allow_unicode=True).encode()
    assert plain_yaml.load(data, MOST)[0] == value


def test_merges_and_aliases_that_stay_small_are_understood() -> None:
    tree, _ = plain_yaml.load(b"a: &a {x: 1}\nb: {<<: *a, y: 2}\nc: [*a, *a]\n", MOST)
    assert tree == {"a": {"x": 1}, "b": {"x": 1, "y": 2}, "c": [{"x": 1}, {"x": 1}]}
    assert plain_yaml.load(b"", MOST) == (None, None)


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        (BOMB, 3, "values"),
        (MERGES, 4, "values"),
        (CHAIN, 48, "levels"),
        ("a: &a {x: *a}", 1, "an alias of what it lies in"),
        ("[" * 100_000, 1, "levels"),
        ("- " * 100_000, 1, "levels"),
        ("a:\n  - " + "1" + ":59" * 300_000, 2, "a number that does not end"),
        ("a: 1\nb: 2\na: 3", 3, "a given twice"),
        ("a: 1\n? [x, y]\n: 3", 2, "a key that is no word"),
        ("a: 1\nb: 2001-01-01", 2, "a timestamp"),
        ("a: !!set {x}", 1, "!!set"),
        ("a: 1\nb: !!bool soup", 2, "'soup'"),
        ("a: 1\nb: !!int x", 2, "'x'"),
        ("a: 1\nb: !!int 0.05", 2, "'0.05'"),
        ("a: !!python/object/apply:os.system ['true']", 1, "!!python"),
        ("a: 1\nb: \x01", 2, "control characters"),
        ("a: 1\nb: [", 3, "did not find expected"),
    ],
)
def test_what_is_refused(text: str, line: int, words: str) -> None:
    begun = time.process_time()
    with pytest.raises(plain_yaml.NotPlain, match=r"found .*; expected ") as caught:
        plain_yaml.load(text.encode(), MOST)
    assert words in str(caught.value)
    assert caught.value.line == line
    assert time.process_time() - begun < 30  # not hours, as the worst of these would take


def test_bytes_that_are_no_text() -> None:
    with pytest.raises(plain_yaml.NotPlain, match="byte 5, not UTF-8") as caught:
        plain_yaml.load(b"a: 1\n\xff", MOST)
    assert caught.value.line == 2
