"""What gates made of a copy, kept: judging renders every image of it, which is needed only once.

With a folder a file for each episode and recipe, `<hash>.verdicts.json`, is shared by all processes; without one each
process keeps its own. An entry that another process writes at the same time may get lost, and is then found again.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rpaug.core.files import write_atomic

ENDING = ".verdicts.json"


@dataclass(frozen=True)
class CopyVerdict:
    """The number of the draw that a copy came to, and why it is rejected, if it is."""

    attempt: int
    faults: tuple[str, ...]


class Verdicts:
    """Verdicts by the name of an episode under a recipe, and by the number of the copy."""

    def __init__(self, folder: Path | None) -> None:
        self._folder = folder
        self._held: dict[str, dict[int, CopyVerdict]] = {}

    def get(self, name: str, copy: int) -> CopyVerdict | None:
        """The verdict on a copy, None if it was not judged."""
        held = self._held.setdefault(name, {})
        if copy not in held:
            held |= self._read(name)
        return held.get(copy)

    def keep(self, name: str, copy: int, verdict: CopyVerdict) -> None:
        """Remember a verdict, for other processes too if there is a folder."""
        held = self._held.setdefault(name, {})
        held |= self._read(name) | {copy: verdict}
        if self._folder is not None:
            plain = {str(number): [one.attempt, list(one.faults)] for number, one in held.items()}
            write_atomic(self._folder / f"{name}{ENDING}", json.dumps(plain).encode())

    def _read(self, name: str) -> dict[int, CopyVerdict]:
        """What the folder holds; a damaged file holds nothing."""
        if self._folder is None:
            return {}
        try:
            given: Any = json.loads((self._folder / f"{name}{ENDING}").read_bytes())
            return {
                int(number): CopyVerdict(int(attempt), tuple(map(str, faults)))
                for number, (attempt, faults) in given.items()
            }
        except (OSError, ValueError, TypeError, AttributeError):
            return {}
