"""Spoilt JSON and YAML: a node of the tree becomes something else, or the text itself is cut and bent."""

import copy
import json
from typing import Any

import numpy as np
import yaml

WEIRD: tuple[Any, ...] = (
    None, True, -1, 0, 1, 2**31, 2**63, 10**40, -(10**40), 0.5, 1e308, float("nan"), float("inf"),
    "", "x", "\0", "../../etc/passwd", "-1", "999999999999", "é" * 300, "{chunk_index:999999999d}",
    "{x.__class__}", [], [None], [[[[[]]]]], [1e9] * 50, {}, {"a": {}}, ["-1"], ["99999999999"],
)  # fmt: skip


TAGS = ("!!int", "!!float", "!!bool", "!!null", "!!timestamp", "!!binary", "!!set", "!!omap", "!!pairs", "!!seq",
        "!!map", "!!str", "!", "!x", "&x", "*x", "!!python/name:os.system", "|", ">-", "? ")  # fmt: skip


def places(tree: Any) -> list[tuple[Any, Any]]:
    """Every (container, key) in a tree."""
    found, waiting = [], [tree]
    while waiting:
        node = waiting.pop()
        keys = (
            list(node)
            if isinstance(node, dict)
            else range(len(node))
            if isinstance(node, list)
            else ()
        )
        for key in keys:
            found.append((node, key))
            waiting.append(node[key])
    return found


def bent(tree: Any, rng: np.random.Generator) -> Any:
    """A copy of a tree with one to three of its nodes changed."""
    tree = copy.deepcopy(tree)
    for _ in range(rng.integers(1, 4)):
        known = places(tree)
        if not known:
            return tree
        node, key = known[rng.integers(len(known))]
        match rng.integers(6):
            case 0:
                del node[key]
            case 1 | 2 | 3:
                node[key] = copy.deepcopy(WEIRD[rng.integers(len(WEIRD))])
            case 4:
                other, name = known[rng.integers(len(known))]
                node[key] = copy.deepcopy(other[name])
            case _ if isinstance(node, dict):
                node[str(WEIRD[rng.integers(10, len(WEIRD))])] = node.pop(key)
            case _:
                node.insert(key, copy.deepcopy(node[key]))
    return tree


def bytes_bent(data: bytes, rng: np.random.Generator) -> bytes:
    """Bytes flipped, cut off, doubled, or replaced by extremes."""
    raw = bytearray(data)
    for _ in range(rng.integers(1, 5)):
        if not raw:
            break
        at = int(rng.integers(len(raw)))
        span = int(rng.integers(1, 9))
        match rng.integers(5):
            case 0:
                raw[at] ^= 1 << int(rng.integers(8))
            case 1:
                raw[at : at + span] = bytes([int(rng.choice([0, 1, 0x7F, 0x80, 0xFF]))]) * span
            case 2:
                raw[at : at + span] = rng.bytes(span)
            case 3:
                del raw[at : at + span]
            case _:
                raw[at:at] = raw[at : at + span]
    if rng.random() < 0.1:
        del raw[int(rng.integers(len(raw) + 1)) :]
    return bytes(raw)


def spoilt_json(data: bytes, rng: np.random.Generator) -> bytes:
    """A JSON file, bent as a tree or as text."""
    match rng.integers(10):
        case 0:
            return b"[" * int(rng.integers(1, 200_000))
        case 1 | 2:
            return bytes_bent(data, rng)
        case _:
            return json.dumps(bent(json.loads(data), rng)).encode(errors="surrogatepass")


def spoilt_lines(data: bytes, rng: np.random.Generator) -> bytes:
    """One line of JSON spoilt, among others."""
    lines = data.splitlines(keepends=True)
    at = int(rng.integers(len(lines)))
    lines[at] = spoilt_json(lines[at], rng) + b"\n"
    return b"".join(lines)


def spoilt_yaml(data: bytes, rng: np.random.Generator) -> bytes:
    """A YAML file, bent as a tree or as text; some grow from a few anchors, some name objects of Python."""
    match rng.integers(18):
        case 0:
            lines = ["version: 1", "a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
            lines += [
                f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]"
                for i in range(1, int(rng.integers(2, 12)))
            ]
            last = len(lines) - 2
            return "\n".join(
                [*lines, f"views: *a{last}", f"cameras: {{x: {{K: *a{last}}}}}"]
            ).encode()
        case 1:
            return b"cameras: !!python/object/apply:os.system ['true']\n" + data
        case 2:
            return b"cameras: &a {x: *a}\n"
        case 3:
            sign = [b"[", b"- ", b"{", b"? ", b"&a ["][int(rng.integers(5))]
            return sign * int(rng.integers(1, 100_000))
        case 4 | 5:
            return bytes_bent(data, rng)
        case 6:  # a value of a type that it is not, or of one that JSON has not
            text, tag = data.decode(), TAGS[int(rng.integers(len(TAGS)))]
            ends = [at for at in range(len(text) - 1) if text[at : at + 2] in (": ", "- ")]
            at = ends[int(rng.integers(len(ends)))] + 2
            return (text[:at] + tag + " " + text[at:]).encode()
        case 7:  # merges, each of ten of the one before
            lines = ["a0: &a0 {x: 1, y: 2}"]
            lines += [
                f"a{i}: &a{i} {{<<: [{', '.join([f'*a{i - 1}'] * 10)}]}}"
                for i in range(1, int(rng.integers(2, 12)))
            ]
            return "\n".join([*lines, data.decode()]).encode()
        case 8:  # a number to the base of sixty
            return b"version: 1" + b":59" * int(rng.integers(1, 300_000)) + b"\n" + data
        case _:
            return yaml.safe_dump(bent(yaml.safe_load(data), rng)).encode()
