"""What was drawn, in words: `manipulated: brown -> olive`, `front: moved 8.6 cm, turned 4.1 degrees`."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from rpaug.core import color_space

Edit = Mapping[str, Any]
Fields = Mapping[str, Any]
TINTED = 1.06  # red over blue of a light's gain, or green over both, from which it has another tint
NOTHING: Mapping[int, str] = {}
MOST = 3  # numbers of a list that are shown


def draws(
    given: Iterable[Mapping[str, Any]], recorded: Mapping[int, str] = NOTHING
) -> list[tuple[str, str]]:
    """The operator and what it came to, of every draw that was not skipped. `recorded` are color words by instance."""
    return [(one["op"], draw(one, recorded)) for one in given if one.get("op")]


def draw(one: Mapping[str, Any], recorded: Mapping[int, str] = NOTHING) -> str:
    """One draw of a report in words."""
    if one.get("left_out"):
        return f"left out: {one['left_out']}"
    fields, edit = one.get("fields") or {}, one.get("edit") or {}
    try:
        told = WORDS.get(one["op"], _plain)(fields, _named(edit, recorded))
    except (KeyError, IndexError, TypeError, ValueError):  # a report of another version
        told = _plain(fields, edit)
    notes = [*one.get("fell_short", ()), *one.get("painted_over", ()), *_shadows(edit)]
    return f"{told} ({'; '.join(notes)})" if notes else told


def _shadows(edit: Edit) -> tuple[str, ...]:
    """Where the shadows of what was edited are cast anew; nothing where they stayed."""
    lamps = edit.get("lamps")
    if isinstance(lamps, Mapping):
        return ("shadows cast anew",)
    return ("its shadow on the table goes along",) if lamps else ()


def target(given: Any) -> str:
    """A recipe's target as people say it."""
    if isinstance(given, str):
        return given
    if not isinstance(given, Mapping):
        return "target"
    if given.get("role") or given.get("text"):
        return str(given.get("role") or given.get("text"))
    return f"instance {given.get('handle')}"


def _paint(fields: Fields, edit: Edit) -> str:
    new = color_space.nearest(np.array(edit["color"]))
    return f"{target(fields.get('target', 'table'))}: {_old(edit)} → {new}"


def _texture(fields: Fields, edit: Edit) -> str:
    return f"{target(fields.get('target', 'surface'))}: {_old(edit)} → {_name(edit['texture'])}"


def _named(edit: Edit, recorded: Mapping[int, str]) -> Edit:
    """The edit whose `surfaces` have the words for their recorded colors; parts of one go by the part's own."""
    if "surfaces" not in edit:
        return edit
    words = [
        color_space.nearest(np.array(one["albedo"]))
        if "part" in one
        else recorded.get(one["handle"])
        for one in edit["surfaces"]
    ]
    return {**edit, "surfaces": [word for word in words if word]}


def _old(edit: Edit) -> str:
    return " and ".join(dict.fromkeys(edit.get("surfaces", ()))) or "as recorded"


def _light(fields: Fields, edit: Edit) -> str:
    level = 100 * (float(np.mean(edit["gain"])) - 1)
    which = (
        f"{len(edit['colored'])} of {len(edit['lamps']['now']['directions'])} "
        if "colored" in edit
        else ""
    )
    share = f"{abs(level):.0f} %"
    bright = "as bright" if share == "0 %" else f"{share} {'brighter' if level > 0 else 'dimmer'}"
    return f"{which}lamps {bright}, {_tint(edit, lamp=fields.get('temperature') is not None)}"


def _tint(edit: Edit, *, lamp: bool) -> str:
    """The tint of a light; a `lamp` of some temperature is warmer or cooler alone."""
    red, green, blue = np.maximum(edit["gain"], 1e-6)
    beside = [(red / blue, "warmer", "cooler")]
    beside += [] if lamp else [(green / np.sqrt(red * blue), "greener", "pinker")]
    words = [
        more if ratio > TINTED else less
        for ratio, more, less in beside
        if max(ratio, 1 / ratio) > TINTED
    ]
    return " and ".join(words) or "of the same tint"


def _lamp(_: Fields, edit: Edit) -> str:
    cosine = float(np.dot(edit["recorded"], edit["direction"]))
    return f"the lamp stands {np.degrees(np.arccos(np.clip(cosine, -1, 1))):.0f} degrees elsewhere"


def _cameras(_: Fields, edit: Edit) -> str:
    return "; ".join(
        f"{name}: moved {100 * np.linalg.norm(one['shift']):.1f} cm, "
        f"turned {np.degrees(np.linalg.norm(one['turn'])):.1f} degrees"
        for name, one in edit.items()
    )


def _added(_: Fields, edit: Edit) -> str:
    names = [_name(one["asset"]) for one in edit["things"]]
    return f"added: {', '.join(names) or 'nothing'}"


def _gone(fields: Fields, edit: Edit) -> str:
    return f"removed: {target(fields.get('target'))}"


def _moved(fields: Fields, edit: Edit) -> str:
    turn = np.array(edit["motion"])[:3, :3]
    angle = np.degrees(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1)))
    return f"{target(fields.get('target'))}: put elsewhere, turned by {angle:.0f} degrees"


def _spread(_: Fields, edit: Edit) -> str:
    return f"{len(edit['moves'])} things put elsewhere"


def _copies(fields: Fields, edit: Edit) -> str:
    return f"{target(fields.get('target'))}: {len(edit['copies'])} more of it"


def _size(fields: Fields, edit: Edit) -> str:
    return f"{target(fields.get('target'))}: {100 * edit['scale']:.0f} % of its size"


def _plain(_: Fields, edit: Edit) -> str:
    return ", ".join(f"{name} {short(value)}" for name, value in edit.items()) or "done"


def _name(word: str) -> str:
    return word.replace("_", " ")


def short(value: Any) -> str:
    """Numbers with three digits; of long lists the first few."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if value is None:
        return "none"
    if isinstance(value, float):
        return f"{value:.3g}"
    if isinstance(value, Mapping):
        return "; ".join(f"{name} {short(one)}" for name, one in value.items())
    if isinstance(value, Sequence) and not isinstance(value, str):
        more = f" and {len(value) - MOST} more" if len(value) > MOST else ""
        return " ".join(map(short, value[:MOST])) + more
    return str(value)


WORDS: Mapping[str, Callable[[Fields, Edit], str]] = {
    "recolor": _paint,
    "table_color": _paint,
    "retexture": _texture,
    "table_texture": lambda fields, edit: _texture({"target": "table", **fields}, edit),
    "background_texture": lambda fields, edit: _texture({"target": "background", **fields}, edit),
    "light_color": _light,
    "light_direction": _lamp,
    "camera_pose": _cameras,
    "insert": _added,
    "distractors": _added,
    "remove": _gone,
    "move": _moved,
    "spread": _spread,
    "duplicate": _copies,
    "object_size": _size,
}
