"""What the extra `words` (all-MiniLM-L6-v2) makes of words that the grammar does not know.

    python tools/bench/synonyms.py

Each word has a known answer, written before it was asked: the verb or the kind of thing it means, or none. Words are
right, wrongly taken for another (of these with the opposite meaning), or left as not understood though meant.
"""

import argparse
import json
import sys
import time

from rpaug.assets import library
from rpaug.language.operation import OPPOSED, VERBS
from rpaug.providers.words import synonym

VERBS_MEANT = {
    "eliminate": "remove", "delete": "remove", "erase": "remove", "discard": "remove", "clone": "duplicate",
    "replicate": "duplicate", "relocate": "move", "shift": "move", "repaint": "paint", "colour": "paint",
    "tint": "paint", "insert": "add", "place": "add", "shuffle": "rearrange", "reorganise": "rearrange",
    "wobble": "jitter",
    "smudge": "blur", "wrap": "cover", "tip": "tilt", "darken": None, "grow": None, "elevate": None, "reduce": None,
    "illuminate": None, "wash": None, "cook": None, "sing": None, "ignore": None, "open": None,
    "eat": None, "print": None,
}  # fmt: skip
KINDS_MEANT = {
    "beaker": "cup", "tumbler": "cup", "teacup": "cup", "novel": "book", "notebook": "book", "tin": "can",
    "banana": "fruit", "pear": "fruit", "cube": "block", "dish": "plate", "pot": "jar", "carton": "box",
    "flask": "bottle", "sphere": "ball", "shoe": None, "unicorn": None, "hammer": None, "phone": None, "spoon": None,
    "policy": None, "dataset": None, "sandwich": None,
}  # fmt: skip


def main() -> None:
    """Print a table, or one JSON value."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    kinds = sorted({one.category for one in library.assets()})
    start, figures = time.process_time(), {}
    for name, meant, known in (("verbs", VERBS_MEANT, VERBS), ("kinds", KINDS_MEANT, kinds)):
        found = {word: synonym(word, known) for word in meant}
        raw = dict(found)
        found = {word: None if got in OPPOSED else got for word, got in found.items()}
        figures[name] = {
            "words": len(meant),
            "right": sum(found[word] == want for word, want in meant.items()),
            "taken": sum(got is not None for got in found.values()),
            "wrongly_taken": sorted(w for w, got in found.items() if got and got != meant[w]),
            "barred_as_opposed": sorted(w for w in meant if raw[w] != found[w]),
        }
    figures["processor_seconds"] = round(time.process_time() - start, 1)
    if options.json:
        sys.stdout.write(json.dumps(figures, indent=1) + "\n")
        return
    for name, value in figures.items():
        sys.stdout.write(f"{name}: {value}\n")


if __name__ == "__main__":
    main()
