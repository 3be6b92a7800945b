"""Fitted scenes from a store, fitted only if the store lacks them."""

from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from rpaug.scene import fit, store
from rpaug.scene.descent import FitSettings
from rpaug.types import Scene


def fitted(
    scene: Scene,
    folder: Path | None,
    *,
    settings: FitSettings | None = None,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> tuple[Scene, Mapping[str, Any]]:
    """The scene with its Gaussians and the poses they belong to, and the fit's report as plain values.

    With a `folder`, a scene fitted before to the same recordings with the same settings is taken from there, and
    a new one is put there. Raises BadInput for a damaged stored scene, Unsupported if nothing can be fitted.
    """
    settings = settings or FitSettings()
    name = store.key(scene.episode, settings, seed) if folder else ""
    found = store.load(folder, name) if folder else None
    if found:
        known = replace(scene, gaussians=found.gaussians, bodies=found.bodies)
        return replace(known, drift=found.drift, irradiance=found.irradiance), found.report
    made, full = fit.fitted(scene, settings=settings, seed=seed, progress=progress)
    facts = {
        name: value
        for name, value in vars(full).items()
        if name not in ("bodies", "drift", "irradiance")
    }
    if folder:
        store.save(folder, name, made, settings=asdict(settings), report=facts)
    return made, facts
