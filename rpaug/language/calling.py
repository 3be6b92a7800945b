"""What people call the edits that they want undone, or left out."""
# ruff: noqa: E501  # patterns are easiest to read whole

import re

from rpaug.language.gathering import OWN_TARGET
from rpaug.language.messages import Entry

CALLED = {
    **dict.fromkeys(("light", "lights", "lighting", "lamp", "lamps", "illumination"), ("light_color", "light_direction")),
    **dict.fromkeys(("camera", "cameras", "viewpoint", "view", "camera pose"), ("camera_pose",)),
    **dict.fromkeys(("noise",), ("sensor_noise",)), **dict.fromkeys(("blur",), ("sensor_blur",)),
    **dict.fromkeys(("jpeg", "compression"), ("sensor_jpeg",)), **dict.fromkeys(("exposure",), ("sensor_exposure",)),
    **dict.fromkeys(("distractor", "distractors", "clutter"), ("distractors",)),
    **dict.fromkeys(("background", "walls", "floor"), ("background_texture",)),
    **dict.fromkeys(("table", "table color", "table colour"), ("table_color", "table_texture")),
    **dict.fromkeys(("texture", "textures"), ("retexture", "table_texture", "background_texture", "stylize")),
    **dict.fromkeys(("color", "colour", "colors", "colours", "paint"), ("recolor", "table_color")),
    **dict.fromkeys(("size", "resizing"), ("object_size",)), **dict.fromkeys(("spread", "shuffle"), ("spread",)),
}  # fmt: skip


def called(what: str, edit: Entry) -> bool:
    """Do the words mean that edit: its kind, what it is about, or its operator's name?"""
    if "one_of" in edit:
        return any(called(what, option) for option in edit["one_of"])
    if edit["op"] in CALLED.get(what, ()) or what.replace(" ", "_") == edit["op"]:
        return True
    words = {_plain(word) for word in what.split()} - {"new", "extra", "added"}
    about = " ".join(
        str(value)
        for name in (
            "target",
            "targets",
            "category",
            "asset",
            "color",
            "near",
            "camera",
            "texture",
            "style",
            "material",
        )
        if name != "near" and (value := edit.get(name)) is not None
    )
    return bool(words) and words <= {
        _plain(word) for word in re.findall(r"[a-z0-9]+", about.lower())
    }


def _plain(word: str) -> str:
    return word[:-1] if word.endswith("s") and not word.endswith("ss") else word


def about(edit: Entry) -> str:
    """The target of an edit in words, or what its operator is called."""
    target = edit.get("target")
    if isinstance(target, str):
        return target
    if isinstance(target, dict):
        return str(target.get("role") or target.get("text") or target.get("handle"))
    return str(OWN_TARGET.get(edit["op"], edit["op"]))
