"""A recipe's YAML as plain data, with the line of every key, and keys set from outside."""

import re
from collections.abc import Iterator
from typing import Any

import yaml

from rpaug.core import safe_yaml as plain_yaml
from rpaug.core.color_space import HEX
from rpaug.core.errors import BadRecipe
from rpaug.core.validation import kind_of

MOST = 20_000  # values, aliases written out

BARE = re.compile(rb"[:,\[]\s*#[0-9a-fA-F]{3,6}\b")  # a color that YAML takes for a comment

Path_ = tuple[str | int, ...]


def parse(data: bytes, name: str) -> tuple[Any, dict[Path_, int]]:
    """Plain data and the line of every key. Raises BadRecipe, naming file and line."""
    try:
        tree, node = plain_yaml.load(data, MOST)
    except plain_yaml.NotPlain as error:
        hint = "; a color like '#ff0000' wants quotes" if BARE.search(data) else ""
        raise BadRecipe(f"{name}:{error.line or '?'}: {error}{hint}") from None
    return tree, dict(_lines(node)) if node is not None else {(): 1}


def _lines(root: yaml.Node) -> Iterator[tuple[Path_, int]]:
    waiting: list[tuple[yaml.Node, Path_]] = [(root, ())]
    while waiting:
        node, path = waiting.pop()
        yield path, node.start_mark.line + 1
        if isinstance(node, yaml.MappingNode):
            waiting += [(value, (*path, str(key.value))) for key, value in node.value]
        elif isinstance(node, yaml.SequenceNode):
            waiting += [(value, (*path, i)) for i, value in enumerate(node.value)]


def override(tree: Any, given: str) -> None:
    """Apply `edits.0.color=red` to plain data. Raises BadRecipe."""
    dotted_path, equals, text = given.partition("=")
    if not equals or not dotted_path:
        raise BadRecipe(f"--set {given}: expected key.path=value")
    *parents, last = dotted_path.split(".")
    here = tree
    try:
        for part in parents:
            here = here[int(part)] if isinstance(here, list) else here.setdefault(part, {})
        # A shell has taken the quotes without which a color is a comment.
        value = text if HEX.fullmatch(text) else plain_yaml.load(text.encode(), MOST)[0]
        if isinstance(here, list):
            here[int(last)] = value
        elif isinstance(here, dict):
            here[last] = value
        else:
            raise BadRecipe(
                f"--set {given}: {'.'.join(parents)} holds {kind_of(here)}, not a mapping or list"
            )
    except (ValueError, IndexError, AttributeError):
        raise BadRecipe(f"--set {given}: no such place in the recipe, or not a value") from None
