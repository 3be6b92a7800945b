"""`rpaug inspect`: what an episode holds."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rpaug.cli.console import (
    Arms,
    AsJson,
    Dataset,
    EpisodeKey,
    UsedModels,
    counted,
    print_json,
    say,
    write_new,
)
from rpaug.cli.progress import progress_bar

if TYPE_CHECKING:
    from rpaug.scene.targets.survey import InstanceSummary

LINES = 30  # of instances without a role; a video has a hundred
LISTED = ("dataset", "layout", "episodes")


# Long: the options of a command are its signature, and what it finds is said line by line.
def inspect(
    dataset: Dataset,
    episode: EpisodeKey = None,
    html: Annotated[
        Path | None, typer.Option(help="Also write a page with thumbnails to this new file.")
    ] = None,
    arm: Arms = None,
    models: UsedModels = None,
    every: Annotated[
        bool, typer.Option("--all", help="Look at all episodes: say where their roles differ.")
    ] = False,
    write_roles: Annotated[
        bool,
        typer.Option(help="Write the roles to DATASET/roles.yaml, to be settled there by hand."),
    ] = False,
    as_json: AsJson = False,
) -> int:
    """Show cameras, frames, instruction and every instance: instance id, role, color, size, motion.

    Example: [bold]rpaug inspect sample --html instances.html[/]
    """
    from rpaug.core import registry

    if episode is None and (below := _several(dataset)):
        return _listed(dataset, below, as_json)

    from rpaug.core.sampling import spans
    from rpaug.core.visible import quoted
    from rpaug.pipeline import inputs
    from rpaug.pipeline import inspect as inspection
    from rpaug.pipeline.role_facts import sure
    from rpaug.providers import models_settings
    from rpaug.providers.models_settings import Models
    from rpaug.scene.targets import settled as roles

    used = Models(**models_settings.given(models or (), {}))
    found, keys = registry.read_among(dataset, episode)
    with progress_bar("looking", as_json):  # a video takes minutes, and says what is being done
        settled = roles.read(dataset)
        described, rows, seen = inspection.inspect(found, arm or (), settled, used)
        described["episodes"] = len(keys)
        if every or write_roles:
            others = inspection.roles_of_all(dataset, arm or (), settled, used)
            described["differ"] = inspection.disagreement(dataset, others)
    if html is not None:
        from rpaug.pages import instances

        write_new(html, instances.page(seen, described, rows))
        described["html"] = str(html)
    if write_roles:
        path = dataset / roles.NAME
        lasting = inputs.handles_hold(found, len(keys))
        told = described.get("roles", {})
        text = inspection.roles_file(rows, list(others.values()), lasting, told)
        write_new(path, text.encode())
        described["roles_file"] = str(path)
    if as_json:
        print_json(described)
        return 0
    among = f", one of {len(keys)} episodes" if len(keys) > 1 else ""
    say(f"{described['episode']}: {quoted(described['instruction'])}, {found.length} frames{among}")
    say(f"key frames: {', '.join(map(str, described['key_frames'])) or 'none'}")
    for name, camera in described["cameras"].items():
        kind = "fixed" if camera["fixed"] else "moving"
        kind = kind if camera["placed"] else "unknown pose"
        say(
            f"  {name}: {camera['width']}x{camera['height']}, {kind}, {', '.join(camera['images'])}"
        )
    if video := described.get("film"):
        say(
            f"  structure from motion: {video['registered']} of {video['frames']} frames, focal length"
            f" {video['focal_px']:.0f} px; lengths are {video['unit']}"
        )
        if lost := video["passed_through"]:
            say(
                f"  no camera pose in frames {spans(lost)}: `light_color` and sensor edits alone reach them"
            )
        say("  kept in the cache, for `augment` too: camera, depth, hands, instances")
    for words in described["unread"]:
        say(f"  warning: not understood: {words}")
    for warning in (*described["misplaced"].values(), *described["arms"]):
        say(f"  warning: {warning}")
    for given in described["assumed"]:
        say(f"  {given}")
    if not rows:
        say("no instances: that takes masks, or several frames")
        return 0
    for role, one in described["roles"].items():
        ids = ", ".join(map(str, one["handles"])) or "none"
        why = "".join(f"; {reason}" for reason in one["reasons"])
        say(f"{role}: {ids}{sure(one)}{why}")
    for words in described["light"]:
        say(f"light: {words}")
    _tabled(
        rows,
        "size, cm" if inspection.measured(described) else "size, relative",
        {one["handle"]: one for one in described["instances"] if "jumps" in one},
    )
    for words in described.get("differ", ()):  # last: the table is long
        say(f"roles differ: {words}")
    if write_roles:
        say(
            f"roles written to {described['roles_file']}: mend them there; those in doubt are comments"
        )
    return 0


def _tabled(
    rows: Sequence["InstanceSummary"], sized: str, jumping: Mapping[int, Mapping[str, Any]]
) -> None:
    """A line for each instance that has a role, or of which much is seen and that does not come and go; how many more
    there are. Of videos it says in how many steps from frame to frame what is seen of each is `jumping`."""
    steady = [row for row in rows if jumping.get(row.instance_id, {}).get("steady", True)]
    most = sorted(steady, key=lambda row: -sum(row.pixels.values()))[:LINES]
    shown = [row for row in rows if row.role or row in most]
    say(
        f"{'handle':>8}  {'role':12}{'color':9}{sized:22}{'motion':20}{'off, mm':>8}{'frames':>8}"
        + (f"{'jumps':>11}" if jumping else "")
        + "  body"
    )
    for row in shown:
        motion = f"{row.motion} (ambiguous)" if row.ambiguous else row.motion
        size = " x ".join(f"{side:.1f}" for side in row.size_cm) if any(row.size_cm) else "unknown"
        body = ", ".join(map(str, sorted(row.body))) if len(row.body) > 1 else ""
        line = f"{row.instance_id:>8}  {row.role:12}{row.color_name:9}{size:22}{motion:20}{row.residual_mm:8.2f}"
        one = jumping.get(row.instance_id, {})
        jumps = f"{one['jumps']} of {one['steps']}" if one else ""
        say(
            f"{line}{row.frames:8d}{jumps:>11}  {body}"
            if jumping
            else f"{line}{row.frames:8d}  {body}"
        )
    if len(shown) < len(rows):
        less = "of which less is seen" + (
            ", or which come and go" if len(steady) < len(rows) else ""
        )
        say(
            f"and {len(rows) - len(shown)} {less}: --html FILE outlines all of them, --json lists them"
        )


def _several(root: Path) -> list[tuple[Path, str, int]]:
    """The datasets directly below a folder that is none itself, or in which datasets of several layouts lie."""
    from rpaug.core import registry
    from rpaug.core.errors import BadInput

    below = registry.datasets_below(root) if root.is_dir() else []
    own = {layout for _, layout, _ in below if not registry.adapter(layout).loose}
    if len(own) > 1:  # videos lie in datasets of other layouts too
        return below
    try:
        registry.adapter_for(root)
    except BadInput:
        return below
    return []


def _listed(root: Path, below: list[tuple[Path, str, int]], as_json: bool) -> int:
    """Say which datasets lie below a folder."""
    if as_json:
        found = [dict(zip(LISTED, (str(one[0]), *one[1:]), strict=True)) for one in below]
        print_json({"datasets": found})
        return 0
    say(f"{root} holds {counted(len(below), 'dataset')}:")
    for folder, layout, episodes in below:
        say(f"  {folder}: {layout}, {counted(episodes, 'episode')}")
    say(f"look at one: rpaug inspect {below[0][0]}")
    return 0
