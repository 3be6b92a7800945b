"""`rpaug fit`: one episode to stored Gaussians, with the figures that say how well they show it."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from rpaug.core.types import Episode, Scene
from rpaug.gaussians import cached, descent, fit_static_rgb, gaussian_files, store
from rpaug.gaussians.descent import FitSettings
from rpaug.gaussians.gaussians import placed
from rpaug.pipeline import prepare
from rpaug.scene.build import build
from rpaug.scene.tracking import arms
from rpaug.scene.video import reconstruct


def fit_episode(
    episode: Episode,
    folder: Path,
    *,
    export: Path | None = None,
    seed: int = 0,
    settings: FitSettings | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
    donor: Episode | None = None,
    files: Sequence[Path] = (),
    device: str = "cpu",
) -> dict[str, Any]:
    """Fit, store under `folder`, export to `.ply` or `.spz` if asked, and return plain values.

    A scene that the store has already is not fitted again. `founder` lends its static Gaussians; `files` are URDF or
    MJCF files of arms; `device` (cpu, cuda) fits. A video of a moving camera is fitted by its own rules
    (docs/video.md), whatever `settings` say.
    Raises BadInput if the export exists or ends otherwise, Unsupported for a video without a model.
    """
    if export is not None:
        gaussian_files.check(export)
    if reconstruct.unplaced(episode):
        return _fit_video(episode, folder, export, device)
    settings = descent.on(settings or FitSettings(), device)

    def built(one: Episode) -> Scene:
        return build(one, with_bodies=True, arms=arms.for_robot(files, one.robot))

    scene, borrowed_from = built(episode), None if donor is None else built(donor)
    stored: list[tuple[Path, bool]] = []

    def fit(one: Scene) -> tuple[Scene, cached.Facts]:
        path = store.path_of(folder, cached.name_of(one, settings, seed, borrowed_from))
        stored.append((path, path.is_dir()))
        return cached.fitted(
            one,
            folder,
            settings=settings,
            seed=seed,
            progress=lambda share: progress(round(100 * share), 100),
            donor=borrowed_from,
        )

    made, facts = fit_static_rgb.fitted(scene, fit)
    ((path, again),) = stored
    described = {
        "episode": episode.key,
        "scene": str(path),
        "found_in_store": again,
        **facts,
    }
    if given := arms.misfits(files, episode.robot):
        described["warnings"] = list(given)
    if export is not None:
        gaussian_files.write(export, placed(made, t=0))
        described["file"] = str(export)
    return described


def _fit_video(episode: Episode, folder: Path, export: Path | None, device: str) -> dict[str, Any]:
    from rpaug.gaussians import fit_video

    found = reconstruct.develop(episode, progress=prepare.told_of(episode.key))
    usual = fit_video.on(fit_video.SplatSettings(width=found.fit_width), device)
    where = store.path_of(folder, fit_video.name_of(found, usual))
    again = where.is_dir()
    made, facts = fit_video.kept(found.scene(), found, folder, usual)
    described = {
        "episode": episode.key, "scene": str(where), "found_in_store": again,
        "film": found.describe(), **facts,
    }  # fmt: skip
    if export is not None:
        gaussian_files.write(export, placed(made, t=0))
        described["file"] = str(export)
    return described
