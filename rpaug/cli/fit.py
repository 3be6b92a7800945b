"""`rpaug fit`: Gaussians of one episode."""

from enum import Enum
from pathlib import Path
from typing import Annotated, Any

import typer

from rpaug.cli.console import (
    Arms,
    AsJson,
    Dataset,
    DeviceChoice,
    EpisodeKey,
    OnDevice,
    print_json,
    say,
)
from rpaug.cli.progress import progress_bar
from rpaug.core.errors import RpaugError


class StopChoice(Enum):
    """When a fit ends."""

    HELDOUT = "heldout"
    FIDELITY = "fidelity"


def fit(
    dataset: Dataset,
    out: Annotated[Path, typer.Option(help="Folder of the scene store; scenes are added to it.")],
    episode: EpisodeKey = None,
    ply: Annotated[
        Path | None,
        typer.Option(help="Also export to this new file: .ply in 3DGS layout, or .spz."),
    ] = None,
    stop: Annotated[
        StopChoice,
        typer.Option(
            help="Until held-out views stop improving, or until recorded views are shown to --target."
        ),
    ] = StopChoice.HELDOUT,
    target: Annotated[
        float | None,
        typer.Option(min=0, max=60, help="Decibels that --stop fidelity is to reach; 35."),
    ] = None,
    seed: Annotated[int, typer.Option(min=0)] = 0,
    steps: Annotated[
        int | None, typer.Option(min=1, help="Most steps of the fit; more is slower and better.")
    ] = None,
    share: Annotated[
        bool,
        typer.Option(
            help="Borrow static Gaussians from the dataset's first episode of the same place."
        ),
    ] = False,
    device: OnDevice = DeviceChoice.AUTO,
    arm: Arms = None,
    as_json: AsJson = False,
) -> int:
    """Fit Gaussians to an episode's static background and bodies, store them, and say how well they show it.

    Example: [bold]rpaug fit sample --out scenes --ply drawer.ply[/]
    """
    from rpaug.core import devices, registry
    from rpaug.gaussians.descent import settings_for
    from rpaug.pipeline.fit import fit_episode

    if target is not None and stop is StopChoice.HELDOUT:
        raise RpaugError("--target: only --stop fidelity has one")
    used = devices.chosen(device.value)
    settings = settings_for(stop.value, target=target, steps=steps)
    found = registry.read(dataset, episode)
    donor = _donor(dataset, found.key) if share else None
    with progress_bar("fitting", as_json) as progress:
        described = fit_episode(
            found, out, export=ply, seed=seed, settings=settings, progress=progress,
            donor=donor, files=arm or (), device=used.name,
        )  # fmt: skip
    described["device"] = {"fits": used.name, "why": used.why}
    _tell(described, out, as_json)
    return 0


def _tell(described: dict[str, Any], out: Path, as_json: bool) -> None:
    if as_json:
        print_json(described)
        return
    from rpaug.pages import told

    for name, value in described.items():
        say(f"{name.replace('_', ' ')}: {told.short(value)}")
    say(f"what the store holds: rpaug scenes ls {out}")


def _donor(dataset: Path, key: str) -> Any:
    """The episode that lends Gaussians to this one; None if it is the first of its place."""
    from rpaug.core import registry
    from rpaug.pipeline import prepare

    adapter = registry.adapter_for(dataset)
    first = prepare.donors(adapter, dataset, [key]).get(key)
    return None if first is None else adapter.read(dataset, first)
