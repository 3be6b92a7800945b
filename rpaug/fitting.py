"""`rpaug fit`: one episode to stored Gaussians, with the figures that say how well they show it."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from rpaug.errors import BadInput
from rpaug.scene import cached, ply, store
from rpaug.scene.build import build
from rpaug.scene.descent import FitSettings
from rpaug.scene.gaussians import placed
from rpaug.types import Episode


def fit_episode(
    episode: Episode,
    folder: Path,
    *,
    export: Path | None = None,
    seed: int = 0,
    settings: FitSettings | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> dict[str, Any]:
    """Fit, store under `folder`, export to `.ply` if asked, and return plain values.

    A scene that the store has already is not fitted again. Raises BadInput if the export exists.
    """
    if export is not None and export.exists():
        raise BadInput(export, "--ply", found="something there already", expected="a new path")
    settings = settings or FitSettings()
    scene = build(episode, with_bodies=True)
    name = store.key(episode, settings, seed)
    again = store.path_of(folder, name).is_dir()
    made, facts = cached.fitted(
        scene,
        folder,
        settings=settings,
        seed=seed,
        progress=lambda share: progress(round(100 * share), 100),
    )
    described = {
        "episode": episode.key,
        "scene": str(store.path_of(folder, name)),
        "found_in_store": again,
        **facts,
    }
    if export is not None:
        ply.write(export, placed(made, t=0))
        described["ply"] = str(export)
    return described
