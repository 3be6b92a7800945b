"""YAML that a stranger wrote, as plain values: nothing so deep that it fills a stack, no aliases that fill the memory.

Everything is weighed before anything is built: nesting as the file is parsed, what aliases and merges come to in the
graph of nodes, numbers by their length. Types beyond JSON's, keys that are no words and keys given twice are refused.

`rpaug.safe_yaml` to whoever writes an adapter, who may rely on the names in `__all__`.
"""

from typing import Any

import yaml

__all__ = [
    "NotPlain",
    "load",
]

DEEPEST = 50  # levels, through aliases too: a loader recurses, the one in C until its stack is full
LONGEST = 400  # characters of a number; `1:59:59:...` is one in YAML, and long ones take hours
YAML = "tag:yaml.org,2002:"
PLAIN = {YAML + kind for kind in ("str", "int", "float", "bool", "null", "map", "seq", "merge")}
LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class NotPlain(ValueError):
    """What is wrong with a file, and in which line, counted from 1; None where that cannot be told."""

    def __init__(self, line: int | None, found: str, expected: str) -> None:
        self.line, self.found, self.expected = line, found, expected
        super().__init__(f"found {found}; expected {expected}")


def load(data: bytes, most: int) -> tuple[Any, yaml.Node | None]:
    """The values in a file of at most so many, and the nodes they were made of. Raises NotPlain."""
    try:
        data.decode()
        _shallow(data)
        loader = LOADER(data)
        try:
            node = loader.get_single_node()
            if node is None:
                return None, None
            _weigh(loader, node, 1, {}, most)
            return loader.construct_document(node), node
        finally:
            loader.dispose()
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        raise NotPlain(line, f"byte {error.start}, not UTF-8", "text") from None
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        at = mark.line + 1 if mark else None
        # libyaml's scanner reads ahead, and has a limit of its own: 1000 levels.
        if "nesting depth" in str(error.problem):
            raise NotPlain(at, f"more than {DEEPEST} levels", "a flatter file") from None
        raise NotPlain(at, str(error.problem)[:120], "YAML") from None
    except yaml.reader.ReaderError as error:
        line = data[: error.position].count(b"\n") + 1
        raise NotPlain(line, str(error).split("\n")[0][:120], "text") from None


def _shallow(data: bytes) -> None:
    depth = 0
    for event in yaml.parse(data, LOADER):
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1
        if depth > DEEPEST:
            found = f"more than {DEEPEST} levels"
            raise NotPlain(_line(event), found, "a flatter file")


def _line(part: Any) -> int:
    return int(part.start_mark.line) + 1


def _weigh(
    loader: Any, node: yaml.Node, depth: int, weighed: dict[int, tuple[int, int]], most: int
) -> tuple[int, int]:
    """Values that a node comes to with its aliases written out, and its levels."""
    line = _line(node)
    if id(node) not in weighed:
        if isinstance(node, yaml.ScalarNode):
            weighed[id(node)] = _scalar(loader, node), 1
        else:
            if node.tag not in PLAIN:
                raise NotPlain(
                    line, f"the type {node.tag.replace(YAML, '!!')}"[:80], "a plain map or list"
                )
            weighed[id(node)] = 0, 0  # not yet known
            held = [_weigh(loader, one, depth + 1, weighed, most) for one in _inner(loader, node)]
            weighed[id(node)] = (
                1 + sum(n for n, _ in held),
                1 + max((d for _, d in held), default=0),
            )
    count, levels = weighed[id(node)]
    if not count:
        raise NotPlain(line, "an alias of what it lies in", "a tree")
    if count > most:
        raise NotPlain(line, f"{count:.3g} values", f"at most {most}")
    if depth + levels - 1 > DEEPEST:
        raise NotPlain(line, f"more than {DEEPEST} levels", "a flatter file")
    return count, levels


def _inner(loader: Any, node: yaml.Node) -> list[yaml.Node]:
    """What lies in a list or map, whose keys must be words that are given once."""
    if not isinstance(node, yaml.MappingNode):
        return list(node.value)
    known: set[str] = set()
    for key, _ in node.value:
        line = _line(key)
        if not isinstance(key, yaml.ScalarNode):
            raise NotPlain(line, "a key that is no word", "a word")
        _scalar(loader, key)
        if key.value in known:
            raise NotPlain(line, f"{key.value[:80]} given twice", "each key once")
        known.add(key.value)
    return [value for _, value in node.value]


def _scalar(loader: Any, node: yaml.ScalarNode) -> int:
    """See that a value is what it is tagged as. One value it is."""
    line, kind = _line(node), node.tag.removeprefix(YAML)
    if node.tag not in PLAIN:
        found = f"{node.value[:40]!r}, a {kind[:40]}"
        raise NotPlain(line, found, "a plain value; quotes make it text")
    if kind not in ("str", "merge"):
        if len(node.value) > LONGEST:
            raise NotPlain(line, "a number that does not end", f"at most {LONGEST} characters")
        try:
            loader.construct_object(node)
        except (ValueError, LookupError) as error:
            found = f"{node.value[:40]!r}: {error}"[:120]
            raise NotPlain(line, found, f"a value of type {kind}; quotes make it text") from None
    return 1
