"""How many of the commands with known answers the offline grammar gets exactly right.

    python tools/bench/ask.py            the half that is worked with, with what went wrong
    python tools/bench/ask.py --others   those in others' English that are worked with, with what went wrong
    python tools/bench/ask.py --aside    the half set aside: the figures alone
    python tools/bench/ask.py --fresh    those in others' English that nobody learned from: the figures alone

A silent wrong edit is a recipe where a refusal was due; those on nonsense and injection are counted apart.
Seconds are processor time.
"""

import argparse
import json
import sys
import time
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "tests/language"))

import known
from test_grammar import rounded, understood

from rpaug.core import registry


def main() -> None:
    """Print a table, or one JSON value."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    sets = parser.add_mutually_exclusive_group()
    sets.add_argument("--aside", action="store_true", help="the half set aside, figures alone")
    sets.add_argument("--others", action="store_true", help="in others' English, worked with")
    sets.add_argument("--fresh", action="store_true", help="in others' English, figures alone")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    cases = [one for one in known.every() if one.aside == options.aside]
    if options.others or options.fresh:
        cases = known.every(known.OTHERS if options.others else known.FRESH)
    quiet = options.aside or options.fresh
    count: Counter[str] = Counter()
    silent, obeyed, refused, start = 0, 0, 0, time.process_time()
    for one in cases:
        there = one.needs is None or one.needs in registry.operator_names()
        want, got = (rounded(one.answer) if there else None), understood(one)
        count[f"{one.kind} right"] += got == want
        count[f"{one.kind} all"] += 1
        silent += want is None and got is not None
        obeyed += one.kind == "nonsense" and got is not None and got != want
        refused += want is not None and got is None
        if got != want and not quiet:
            sys.stderr.write(f"{one.kind}: {one.say!r}: {got}; expected {want}\n")
    right = sum(value for name, value in count.items() if name.endswith("right"))
    figures = {
        "set": next(
            (name for name in ("aside", "others", "fresh") if getattr(options, name)), "ours"
        ),
        "commands": len(cases),
        "exact": right,
        "share": round(right / len(cases), 4),
        "silent_wrong_edits": silent,
        "of_them_nonsense": obeyed,
        "refused_though_meant": refused,
        "milliseconds_each": round(1e3 * (time.process_time() - start) / len(cases), 2),
    }
    if options.json:
        sys.stdout.write(json.dumps(figures | {"by_kind": dict(count)}, indent=1) + "\n")
        return
    for name, value in figures.items():
        sys.stdout.write(f"{name:24}{value}\n")
    if not quiet:
        for kind in sorted({one.kind for one in cases}):
            sys.stdout.write(f"{kind:24}{count[f'{kind} right']} of {count[f'{kind} all']}\n")


if __name__ == "__main__":
    main()
