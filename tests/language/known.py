"""The commands with known answers, split by a seeded hash: one half is worked with, the other is set aside.

Only how many of the half set aside are right is ever read, and only at the end (tools/bench/ask.py --aside). `OTHERS`
are in others' English: written by people who knew the docs and the half that is worked with, and worked with since. The
`FRESH` ones were written so too; of them only figures are read.
"""

import hashlib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

FOLDER = Path(__file__).parent / "commands"
OTHERS, FRESH = Path(__file__).parent / "others", Path(__file__).parent / "fresh"
SALT = "rpaug ask 0"
CAMERAS = ["front", "left_shoulder", "right_shoulder", "overhead", "wrist"]
INSTRUCTIONS = ["put the red block in the bowl"]
SETTINGS = ("copies", "keep_originals", "seed", "select")


@dataclass(frozen=True)
class Known:
    """One command: what is `say`d after what, about which recording, and the recipe that it must come to."""

    kind: str
    say: str
    answer: dict[str, Any] | None  # None: it must be refused
    after: tuple[str, ...] = ()
    needs: str | None = None  # an operator without which it must be refused
    missed: bool = False  # known to be refused though meant
    cameras: tuple[str, ...] = field(default=tuple(CAMERAS))
    instructions: tuple[str, ...] = field(default=tuple(INSTRUCTIONS))

    @property
    def aside(self) -> bool:
        """Is it in the half set aside?"""
        stated = "\n".join([SALT, self.kind, *self.after, self.say, *self.instructions])
        return bool(hashlib.blake2b(stated.encode(), digest_size=1).digest()[0] % 2)


def every(folder: Path = FOLDER) -> list[Known]:
    """All commands, in the order of their files."""
    out = []
    for path in sorted(folder.glob("*.yaml")):
        for case in yaml.safe_load(path.read_text()):
            answer = None
            if not case.get("refuse"):
                answer = {name: case[name] for name in (*SETTINGS, "edits") if name in case}
            out.append(
                Known(
                    path.stem,
                    case["say"],
                    answer,
                    tuple(case.get("after", ())),
                    case.get("needs"),
                    case.get("missed", False),
                    tuple(case.get("cameras", CAMERAS)),
                    tuple(case.get("instructions", INSTRUCTIONS)),
                )
            )
    return out
