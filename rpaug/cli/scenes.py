"""`rpaug scenes`: what a store of fitted scenes holds, taking some out of it, and export for viewers."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rpaug.cli.console import AsJson, print_json, say
from rpaug.cli.progress import progress_bar
from rpaug.core.errors import BadInput, RpaugError

if TYPE_CHECKING:
    from rpaug.core.types import Gaussians

Store = Annotated[
    Path, typer.Argument(help="Folder of a store: `rpaug fit --out`.", show_default=False)
]
Key = Annotated[str, typer.Argument(help="Key of a scene, or its beginning.", show_default=False)]


def ls(
    store: Store,
    check: Annotated[bool, typer.Option(help="Read every array and compare checksums.")] = False,
    as_json: AsJson = False,
) -> int:
    """List the scenes of a store: key, Gaussians, bodies, decibels, megabytes.

    Exit code 1 if some are damaged. Example: [bold]rpaug scenes ls scenes --check[/]
    """
    from rpaug.gaussians import store as stored

    names = stored.names(store)
    rows: list[dict[str, Any]] = []
    with progress_bar("reading", as_json) as progress:
        for name in names:
            progress(len(rows), len(names))
            rows.append(_facts(store, name, check))
    if as_json:
        print_json(rows)
    else:
        for row in rows:
            say(_line(row))
        say(f"{len(rows)} scenes in {store}")
    return 1 if any("damaged" in row for row in rows) else 0


def _facts(store: Path, name: str, check: bool) -> dict[str, Any]:
    from rpaug.gaussians import store as stored

    try:
        facts = stored.described(store, name)
        if check:
            stored.load(store, name)
    except BadInput as error:
        return {"key": name, "damaged": str(error)}
    report = facts["report"]
    return {
        "key": name,
        "gaussians": facts["gaussians"],
        "bodies": len(facts["bodies"]),
        "decibels": report.get("held_out_db") or report.get("train_db"),
        "megabytes": round(facts["bytes"] / 1e6, 2),
        "lender": facts.get("borrowed", {}).get("lender"),
    }


def _line(row: dict[str, Any]) -> str:
    if "damaged" in row:
        return f"{row['key']}  damaged: {row['damaged']}"
    level = "" if row["decibels"] is None else f"{row['decibels']:6.2f} dB"
    counts = f"{row['gaussians']:>8} Gaussians {row['bodies']:>4} bodies"
    donated = f"  borrows from {row['lender'][:8]}" if row["lender"] else ""
    return f"{row['key']}  {counts}  {level:9}  {row['megabytes']:8.2f} MB{donated}"


def rm(
    store: Store,
    keys: Annotated[
        list[str], typer.Argument(help="Keys of scenes, or their beginnings.", show_default=False)
    ],
    as_json: AsJson = False,
) -> int:
    """Take scenes out of a store, damaged ones too. Nothing is removed if one key is wrong.

    Nor if a scene that stays borrows from one of them.

    Example: [bold]rpaug scenes rm scenes 3fa2[/]
    """
    from rpaug.gaussians import store as stored

    names = list(dict.fromkeys(stored.named(store, key) for key in keys))
    for name in names:
        left = sorted(set(stored.borrowers(store, name)) - set(names))
        if left:
            few = ", ".join(left[:4])
            raise RpaugError(f"{name} lends Gaussians to {few}: remove those too")
    for name in names:
        stored.remove(store, name)
    if as_json:
        print_json({"removed": names})
    else:
        for name in names:
            say(f"removed {name}")
    return 0


def export(
    store: Store,
    key: Key,
    out: Annotated[Path, typer.Argument(help="New .ply or .spz file.", show_default=False)],
    frame: Annotated[
        int, typer.Option(min=0, help="Moving bodies stand where they are at this frame.")
    ] = 0,
    instance_id: Annotated[
        list[int] | None,
        typer.Option("--handle", help="Only this instance; may be given several times."),
    ] = None,
    as_json: AsJson = False,
) -> int:
    """Write a scene as a .ply in 3DGS layout or as an .spz, which SuperSplat and other viewers open.

    Example: [bold]rpaug scenes export scenes 3fa2 drawer.ply --frame 40[/]
    """
    from rpaug.gaussians import gaussian_files

    with progress_bar("exporting", as_json) as progress:
        progress(0, 2)  # reading, then writing
        placed = _placed(store, key, frame, instance_id or ())
        progress(1, 2)
        gaussian_files.write(out, placed)
        progress(2, 2)
    described = {"file": str(out), "gaussians": len(placed), "frame": frame}
    if as_json:
        print_json(described)
    else:
        say(f"{len(placed)} Gaussians in {out}")
    return 0


def _placed(store: Path, key: str, frame: int, instance_ids: Sequence[int]) -> "Gaussians":
    """The Gaussians of a stored scene at a frame, of these instances alone where some are named. Raises RpaugError."""
    import numpy as np

    from rpaug.gaussians import gaussians
    from rpaug.gaussians import store as stored

    found = stored.load(store, stored.named(store, key))
    assert found is not None
    length = len(found.bodies[0].to_world) if found.bodies else 1
    if frame >= length:
        raise RpaugError(f"--frame {frame}: this scene has frames 0 to {length - 1}")
    placed = gaussians.standing_at(found.gaussians, found.bodies, frame, found.irradiance)
    if not instance_ids:
        return placed
    missing = set(instance_ids) - set(np.unique(placed.ids).tolist())
    if missing:
        known = ", ".join(map(str, np.unique(placed.ids).tolist()))
        raise RpaugError(f"no Gaussian has instance id {sorted(missing)}; there are: {known}")
    return gaussians.chosen(placed, np.isin(placed.ids, list(instance_ids)))
