"""What is wrong with a recipe: all of it at once, each fault with its line and key."""

from typing import Any

from rpaug.core.errors import BadRecipe
from rpaug.core.validation import Invalid, dotted, validated
from rpaug.pipeline.recipe_yaml import Path_


class Faults:
    """Collects what is wrong, so that one run tells all of it."""

    def __init__(self, name: str, lines: dict[Path_, int]) -> None:
        self.name, self.lines, self.found = name, lines, []  # type: ignore[var-annotated]

    def add(self, path: Path_, message: str) -> None:
        """One fault, at the line of its key, or of the nearest key above it that has one."""
        line = next(
            (self.lines[path[:n]] for n in range(len(path), -1, -1) if path[:n] in self.lines), None
        )
        place = f"{self.name}:{line}" if line else self.name
        self.found.append(f"{place}: {dotted(path)}: {message}" if path else f"{place}: {message}")

    def check(self, path: Path_, kind: type, data: Any) -> Any:
        """The data as a value of that type, or None after its faults were added."""
        try:
            return validated(kind, data)
        except Invalid as error:
            for place, message in error.faults:
                self.add((*path, *place), message)
            return None

    def raise_any(self) -> None:
        """Raises BadRecipe if there are faults."""
        if self.found:
            raise BadRecipe("\n".join(self.found))
