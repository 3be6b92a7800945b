"""Edits that draw from what failures were measured at: their usual range, made wide enough for that."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from rpaug.core import registry
from rpaug.diagnosis.messages import Factor

Edit = dict[str, Any]
Spans = Sequence[tuple[float, float]]

MARGIN = 1.1  # times what was measured
ALIKE = 0.3  # of a likeness to the target: failures that are all above met look-alikes


def widened(factor: Factor, edit: Edit, spans: Spans, focal: float | None) -> Edit:
    """The edit with its range widened to `spans`, as `messages.Cause` has them; as it is where they say nothing.

    `focal` is the recordings' focal length over the image's width, where it is known.
    """
    widen = WIDEN.get((factor, edit.get("op", "")))
    known = len(spans) > 0 and np.isfinite(spans).all()
    return {**edit, **widen(edit, spans, focal)} if widen and known else edit


def _given(edit: Edit, key: str) -> Any:
    """The edit's own value, or its operator's default."""
    return edit.get(key, getattr(registry.operator(edit["op"]), key))


def _camera(edit: Edit, spans: Spans, focal: float | None) -> Edit:
    """A turn that moves the picture as far as it was moved; what turned about its own axis counts as it is."""
    if focal is None:
        return {}
    right, down, _, turn = (max(-low, high) for low, high in spans)
    angle = MARGIN * max(np.arctan(right / focal), np.arctan(down / focal), turn)
    return {"turn": round(max(_given(edit, "turn"), float(angle)), 4)}


def _size(edit: Edit, spans: Spans, focal: float | None) -> Edit:
    low, high = np.exp(np.array(spans[0]) * MARGIN)
    least, most = _given(edit, "range")
    return {"range": [round(min(least, float(low)), 3), round(max(most, float(high)), 3)]}


def _light(edit: Edit, spans: Spans, focal: float | None) -> Edit:
    """Up to the light that there was; darkness is in the usual range."""
    least, most = np.array(_given(edit, "range"))
    gains = np.exp(MARGIN * np.array([high for _, high in spans[:3]]))
    brightest = np.clip(0.5 * gains, most, 1)
    return {"range": [least.tolist(), brightest.round(3).tolist()]}


def _distractor(edit: Edit, spans: Spans, focal: float | None) -> Edit:
    return {"like": "color"} if spans[1][0] > ALIKE else {}


WIDEN: Mapping[tuple[str, str], Callable[[Edit, Spans, float | None], Edit]] = {
    ("camera", "camera_pose"): _camera,
    ("object size", "object_size"): _size,
    ("lighting", "light_color"): _light,
    ("distractor", "distractors"): _distractor,
}
