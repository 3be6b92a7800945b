"""Records taken apart and put together: nothing is lost, and nothing but an Example is taken for one."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rpaug_adapters.rlds.example import Example, example

from rpaug import BadInput

NAMES = st.text(min_size=1, max_size=12)
VALUES = st.one_of(
    st.lists(st.binary(max_size=300), max_size=5),
    st.lists(st.floats(width=32, allow_nan=False), max_size=9).map(lambda v: np.array(v, np.float32)),
    st.lists(st.integers(-(2**63), 2**63 - 1), max_size=9).map(lambda v: np.array(v, np.int64)),
)  # fmt: skip
FEATURES = st.dictionaries(NAMES, VALUES, max_size=5)


def held(parsed: Example, name: str, like: object) -> object:
    if isinstance(like, list):
        return parsed.blobs(name)
    return parsed.numbers(name) if parsed.features[name].kind else np.zeros(0)


@given(FEATURES)
def test_what_is_encoded_is_what_is_parsed(features: dict) -> None:
    parsed = Example("here", example(features))
    assert list(parsed.features) == list(features)
    for name, values in features.items():
        assert np.array_equal(held(parsed, name, values), values)


@given(FEATURES, st.data())
def test_only_the_replaced_feature_changes(features: dict, data: st.DataObject) -> None:
    if not features:
        return
    name = data.draw(st.sampled_from(sorted(features)))
    blobs = data.draw(st.lists(st.binary(max_size=200), max_size=3))
    parsed = Example("here", example(features))
    assert parsed.replaced({name: blobs}) == example({**features, name: blobs})
    assert parsed.replaced({}) == parsed.data


def test_unknown_fields_and_unpacked_numbers_survive() -> None:
    # Example { 1: map { "a": floats 1.0, 2.0 one by one }, 7: 5 }, lengths by hand.
    floats = b"\x0d" + np.float32(1).tobytes() + b"\x0d" + np.float32(2).tobytes()
    feature = b"\x12" + bytes([len(floats)]) + floats
    entry = b"\x0a\x01a\x12" + bytes([len(feature)]) + feature
    table = b"\x0a" + bytes([len(entry)]) + entry
    data = b"\x0a" + bytes([len(table)]) + table + b"\x38\x05"
    parsed = Example("here", data)
    assert parsed.floats("a").tolist() == [1.0, 2.0]
    changed = parsed.replaced({"a": [b"new"]})
    assert changed.endswith(b"\x38\x05")
    assert Example("here", changed).blobs("a") == [b"new"]


@settings(max_examples=500)
@given(FEATURES, st.data())
def test_damage_is_an_error_in_words_or_harmless(features: dict, data: st.DataObject) -> None:
    whole = bytearray(example(features))
    for _ in range(data.draw(st.integers(1, 4))):
        if whole:
            whole[data.draw(st.integers(0, len(whole) - 1))] = data.draw(st.integers(0, 255))
    cut = data.draw(st.integers(0, len(whole)))
    given = None
    try:
        parsed = Example("here", bytes(whole[:cut]))
        for name, feature in parsed.features.items():
            if feature.kind == "bytes":
                parsed.blobs(name)
            elif feature.kind:
                parsed.numbers(name)
    except BadInput as error:
        given = str(error)
    assert given is None or given.startswith("here: ")


def test_a_length_beyond_the_record_is_not_allocated() -> None:
    with pytest.raises(BadInput, match="are left"):
        Example("here", b"\x0a\xff\xff\xff\xff\xff\xff\xff\x7f")
