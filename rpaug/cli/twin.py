"""`rpaug twin`: a simulated tabletop that knows the truth."""

from pathlib import Path
from typing import Annotated

import typer

from rpaug.cli.console import AsJson, counted, print_json, say
from rpaug.cli.progress import progress_bar


# Long: the options of a command are its signature.
def record(
    out: Annotated[Path, typer.Option(help="Dataset folder to add the task's episodes to.")],
    task: Annotated[
        str,
        typer.Option(
            help="open_drawer, pick_block, push_button, slide_block, stack_cups, put_in_box,"
            " put_on_stove, close_box."
        ),
    ] = "open_drawer",
    seed: Annotated[int, typer.Option(min=0)] = 0,
    factor: Annotated[
        str | None,
        typer.Option(
            help="Truly change object_color, object_texture, object_finish, light_color, lamp_color, "
            "light_direction, table_color, table_texture, background_texture or camera_pose."
        ),
    ] = None,
    target: Annotated[
        str | None,
        typer.Option(help="A part, manipulated or receiver, instead of the factor's usual parts."),
    ] = None,
    episodes: Annotated[int, typer.Option(min=1)] = 1,
    frames: Annotated[int, typer.Option(min=2)] = 60,
    size: Annotated[int, typer.Option(min=8, help="Pixels a side.")] = 128,
    antialias: Annotated[bool, typer.Option(help="Anti-alias the color images.")] = False,
    specular: Annotated[bool, typer.Option(help="Give surfaces highlights.")] = False,
    shadows: Annotated[bool, typer.Option(help="Let the lamps cast shadows.")] = False,
    lamps: Annotated[int, typer.Option(min=1, max=3, help="How many lamps there are.")] = 3,
    roam: Annotated[
        float,
        typer.Option(
            min=0, help="Metres each way that tasks may lie elsewhere, other things strewn anew."
        ),
    ] = 0.0,
    as_json: AsJson = False,
) -> int:
    """Record episodes of a simulated tabletop in RLBench's format, with the truth beside them.

    The same seed records the same motion, so a second call with --factor shows what a true change looks like.

    Example: [bold]rpaug twin record --task open_drawer --seed 3 --factor object_color --out truth[/]
    """
    from rpaug import twin

    look = twin.Look(
        antialias=antialias, specular=specular, shadows=shadows, lamps=twin.RIG[:lamps]
    )
    with progress_bar("recording", as_json) as progress:
        progress(0, episodes)
        takes = twin.record(
            task,
            seed,
            out,
            factor=factor,
            target=target,
            look=look,
            size=size,
            frames=frames,
            episodes=episodes,
            roam=roam,
        )
    written = [str(out / take.episode.key) for take in takes]
    if as_json:
        print_json({"episodes": written, "truth": [take.truth.describe() for take in takes]})
    else:
        for path in written:
            say(path)
        say(f"{counted(len(written), 'episode')}; look at one: rpaug inspect {out}")
    return 0
