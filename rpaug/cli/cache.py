"""`rpaug cache`: what was worked out or fetched once and is kept, and taking some of it out."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rpaug.cli.console import AsJson, counted, print_json, say
from rpaug.core.errors import RpaugError

if TYPE_CHECKING:
    from rpaug.core.cache import Entry

Names = Annotated[
    list[str] | None,
    typer.Argument(
        help="Kinds (kernels, videos, weights), or names or their beginnings.", show_default=False
    ),
]


def ls(names: Names = None, as_json: AsJson = False) -> int:
    """List what the cache holds: kind, name, megabytes, days since it was used.

    Its folder is RPAUG_CACHE, its size limit RPAUG_CACHE_GB (20). Example: [bold]rpaug cache ls videos[/]
    """
    from rpaug.core import cache

    found = _chosen(cache.entries(), names or []) if names else cache.entries()
    total = sum(entry.bytes for entry in found)
    if as_json:
        described: dict[str, Any] = {"folder": str(cache.root()), "limit_bytes": cache.limit()}
        print_json(described | {"bytes": total, "entries": [*map(_described, found)]})
        return 0
    for entry in found:
        say(_line(entry))
    many = counted(len(found), "thing")
    say(f"{many}, {total / 1e6:.1f} of {cache.limit() / 1e6:.0f} MB in {cache.root()}")
    return 0


def rm(
    names: Names = None,
    older_than: Annotated[
        float | None, typer.Option(min=0, help="Only what was not used for so many days.")
    ] = None,
    all_: Annotated[
        bool, typer.Option("--all", help="Everything, weights that were fetched too.")
    ] = False,
    as_json: AsJson = False,
) -> int:
    """Take things out of the cache; they are worked out anew when they are needed.

    Weights, which were fetched on request, go only by their name or kind, or with --all. Nothing is removed if one name
    is wrong. Exit code 1 if some could not be removed. Example: [bold]rpaug cache rm videos --older-than 30[/]
    """
    from rpaug.core import cache

    if not names and not all_ and older_than is None:
        raise RpaugError("nothing named: give kinds or names, --older-than DAYS, or --all")
    found = cache.entries()
    if names:
        found = _chosen(found, names)
    elif not all_:
        found = [entry for entry in found if entry.kind not in cache.FETCHED]
    if older_than is not None:
        found = [entry for entry in found if entry.days > older_than]
    removed, kept = [], dict[str, str]()
    for entry in found:
        try:
            cache.remove(entry)
            removed.append(entry)
        except OSError as error:
            kept[f"{entry.kind}/{entry.name}"] = error.strerror or str(error)
    if as_json:
        print_json({"removed": [*map(_described, removed)], "kept": kept})
    else:
        for entry in removed:
            say(f"removed {_line(entry)}")
        for name, why in kept.items():
            say(f"kept {name}: {why}")
        size = sum(entry.bytes for entry in removed)
        say(f"{counted(len(removed), 'thing')}, {size / 1e6:.1f} MB removed")
    return 1 if kept else 0


def _chosen(found: Sequence["Entry"], names: Sequence[str]) -> list["Entry"]:
    """Those of a kind, or whose name begins so. Raises RpaugError for words that fit none."""
    for word in names:
        if not any(_fits(entry, word) for entry in found):
            kinds = ", ".join(sorted({entry.kind for entry in found})) or "none: it is empty"
            raise RpaugError(f"nothing in the cache is called {word!r}; kinds: {kinds}")
    return [entry for entry in found if any(_fits(entry, word) for word in names)]


def _fits(entry: "Entry", word: str) -> bool:
    return bool(word) and (entry.kind == word or entry.name.startswith(word))


def _described(entry: "Entry") -> dict[str, Any]:
    return {
        "kind": entry.kind,
        "name": entry.name,
        "path": str(entry.path),
        "bytes": entry.bytes,
        "days": round(entry.days, 2),
    }


def _line(entry: "Entry") -> str:
    return f"{entry.kind:8} {entry.name:40} {entry.bytes / 1e6:9.1f} MB  {entry.days:6.1f} days"
