"""What people call the edits that they want undone, or left out."""

import re

from rpaug.core import registry
from rpaug.language import declared
from rpaug.language.messages import Entry

# Fields beside targets that say what an edit is about.
TELLING = ("category", "asset", "color", "camera", "texture", "style", "material")


def called(what: str, edit: Entry) -> bool:
    """Do the words mean that edit: its kind, what it is about, or its operator's name?"""
    if "one_of" in edit:
        return any(called(what, option) for option in edit["one_of"])
    if what in registry.operator(edit["op"]).undone_as or what.replace(" ", "_") == edit["op"]:
        return True
    words = {_plain(word) for word in what.split()} - {"new", "extra", "added"}
    telling = [edit[name] for name in TELLING if edit.get(name) is not None]
    about = " ".join(map(str, [*declared.targets(edit), *telling]))
    return bool(words) and words <= {
        _plain(word) for word in re.findall(r"[a-z0-9]+", about.lower())
    }


def _plain(word: str) -> str:
    return word[:-1] if word.endswith("s") and not word.endswith("ss") else word


def about(edit: Entry) -> str:
    """The target of an edit in words, or what its operator is called."""
    target = next(iter(declared.targets(edit)), None)
    if isinstance(target, dict):
        return str(target.get("role") or target.get("text") or target.get("handle"))
    return str(target or declared.own_role(edit["op"]) or edit["op"])


def short(edit: Entry) -> str:
    """An edit in one line."""
    return ", ".join(f"{name} {value}" for name, value in edit.items())
