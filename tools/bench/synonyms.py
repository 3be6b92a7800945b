"""What the extra `words` (all-MiniLM-L6-v2) makes of kinds of things that the library lacks.

    python tools/bench/synonyms.py

Each word has a known answer, written before it was asked: the kind of thing it means, or none. Words are right,
wrongly taken for another, or left as not understood though meant.
"""

import argparse
import json
import sys
import time

from rpaug.assets import library
from rpaug.providers.words import synonym

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
    start, figures = time.process_time(), dict[str, object]()
    found = {word: synonym(word, kinds) for word in KINDS_MEANT}
    figures["kinds"] = {
        "words": len(found),
        "right": sum(found[word] == want for word, want in KINDS_MEANT.items()),
        "taken": sum(got is not None for got in found.values()),
        "wrongly_taken": sorted(w for w, got in found.items() if got and got != KINDS_MEANT[w]),
    }
    figures["processor_seconds"] = round(time.process_time() - start, 1)
    if options.json:
        sys.stdout.write(json.dumps(figures, indent=1) + "\n")
        return
    for name, value in figures.items():
        sys.stdout.write(f"{name}: {value}\n")


if __name__ == "__main__":
    main()
