"""`rpaug assets`: the library of things that `insert` and `distractors` put into scenes."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from rpaug.cli.console import AsJson, console, print_json, say


def ls(
    category: Annotated[str | None, typer.Option(help="Only of this category.")] = None,
    color: Annotated[str | None, typer.Option(help="Only of this color word.")] = None,
    smallest: Annotated[float, typer.Option(min=0, help="Longest side in metres, at least.")] = 0.0,
    largest: Annotated[float, typer.Option(min=0, help="Longest side in metres, at most.")] = 10.0,
    as_json: AsJson = False,
) -> int:
    """List the things that fit.

    Example: [bold]rpaug assets ls --category mug --color red[/]
    """
    from rpaug.assets import library

    found = library.find(category, color, (smallest, largest))
    if as_json:
        print_json([asdict(asset) for asset in found])
        return 0
    for asset in found:
        say(_line(asset))
    return 0


def add(
    file: Annotated[
        Path, typer.Argument(help="A glb, gltf, obj, stl or ply mesh, or a .ply of Gaussians.")
    ],
    name: Annotated[str | None, typer.Option(help="Its name; the file's if not given.")] = None,
    category: Annotated[str, typer.Option(help="What kind of thing it is.")] = "thing",
    scale: Annotated[float, typer.Option(min=1e-6, help="Metres to one unit of the file.")] = 1.0,
    up: Annotated[str, typer.Option(help="The file's upward axis: y or z.")] = "z",
    gaussians: Annotated[
        int, typer.Option(min=0, help="Show a mesh by so many Gaussians; 0 keeps its triangles.")
    ] = 0,
    as_json: AsJson = False,
) -> int:
    """Add a mesh, or Gaussians, to your library.

    Example: [bold]rpaug assets add teapot.glb --category teapot --scale 0.01 --up y[/]
    """
    from rpaug.assets import library, reading, sampled
    from rpaug.core.errors import RpaugError

    _check_up(up)
    thing, splats = reading.read(file, scale, up)
    outlined = gaussians > 0
    if outlined and splats is not None:
        raise RpaugError(
            f"--gaussians: {file} holds {len(splats)} Gaussians of its own; the option is for meshes"
        )
    if outlined:
        splats = sampled.gaussians(thing, gaussians)
    name = name or file.stem.replace("-", "_")
    added = library.add(name, category, thing, file.name, splats, outlined=outlined)
    return _added(added, as_json)


def generate(
    name: Annotated[str, typer.Argument(help="What to call it.")],
    text: Annotated[str, typer.Option(help="Words that say what to make.")] = "",
    image: Annotated[Path | None, typer.Option(help="A PNG or JPEG of what to make.")] = None,
    command: Annotated[
        str | None,
        typer.Option(help="Program that makes it: {text}, {image} and {out} are put in."),
    ] = None,
    endpoint: Annotated[str | None, typer.Option(help="HTTP address that makes it.")] = None,
    category: Annotated[str, typer.Option(help="What kind of thing it is.")] = "thing",
    scale: Annotated[float, typer.Option(min=1e-6, help="Metres to one unit of the file.")] = 1.0,
    up: Annotated[str, typer.Option(help="The file's upward axis: y or z.")] = "z",
    timeout: Annotated[float, typer.Option(min=0.1, help="Seconds to wait.")] = 600.0,
    most_megabytes: Annotated[int, typer.Option(min=1, help="Largest answer taken.")] = 512,
    as_json: AsJson = False,
) -> int:
    """Have a model of yours make Gaussians of words or a picture, and add them to your library.

    Example: [bold]rpaug assets generate mug_blue --text "a blue mug" --command "python lgm.py {text} {out}"[/]
    """
    from rpaug.assets import generate as generating
    from rpaug.assets import library
    from rpaug.core.errors import RpaugError

    if (command is None) == (endpoint is None):
        raise RpaugError("generate: name who makes it, with --command or --endpoint, not both")
    _check_up(up)
    library.check_name(name)
    wish = generating.GenerationRequest(text, image)
    wish.check()
    limits = generating.Limits(timeout, most_megabytes << 20)
    with console.status(f"waiting for {name} (at most {timeout:g} s)"):
        if command is not None:
            by, data = command, generating.by_command(command, wish, limits)
        else:
            assert endpoint is not None
            by, data = endpoint, generating.by_endpoint(endpoint, wish, limits)
    return _added(generating.keep(data, name, wish, by, category, scale, up), as_json)


def show(
    name: Annotated[str, typer.Argument(help="The thing's name.")],
    out: Annotated[Path | None, typer.Option(help="Also draw it into this PNG.")] = None,
    as_json: AsJson = False,
) -> int:
    """Tell what is known of one thing, and draw it.

    Example: [bold]rpaug assets show mug_red --out mug.png[/]
    """
    from rpaug.assets import library, picture
    from rpaug.core.files import encode_png, write_atomic

    asset = library.get(name)
    thing = library.mesh(name)
    if out is not None:
        write_atomic(out, encode_png(picture.portrait(thing)))
    facts = asdict(asset) | {"points": len(thing.points), "triangles": len(thing.faces)}
    if as_json:
        print_json(facts)
        return 0
    say(_line(asset))
    made = f"{asset.gaussians} Gaussians" if asset.gaussians else f"{len(thing.faces)} triangles"
    say(f"{made}, from: {asset.source}")
    for key, value in asset.provenance.items():
        say(f"{key}: {value}")
    return 0


def _check_up(up: str) -> None:
    from rpaug.core.errors import RpaugError

    if up not in ("y", "z"):
        raise RpaugError(f"--up {up}: give y or z")


def _added(asset, as_json: bool) -> int:
    """Say what joined the library."""
    from rpaug.assets import library

    if as_json:
        print_json(asdict(asset))
        return 0
    say(f"added to {library.folder()}:")
    say(_line(asset))
    return 0


def _line(asset) -> str:
    x, y, z = (100 * side for side in asset.size)
    return f"{asset.name:16} {asset.category:10} {asset.color:10} {x:5.1f} x {y:4.1f} x {z:4.1f} cm"
