"""Fitted scenes from a store, fitted only if the store lacks them."""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from rpaug.scene import fit, store
from rpaug.scene.descent import FitSettings
from rpaug.scene.four import fit4
from rpaug.scene.four.fit4 import FourSettings
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
        return _known(scene, found), found.report
    made, full = fit.fitted(scene, settings=settings, seed=seed, progress=progress)
    facts = {
        name: value
        for name, value in vars(full).items()
        if name not in ("bodies", "drift", "irradiance")
    }
    if folder:
        store.save(folder, name, made, settings=asdict(settings), report=facts)
    return made, facts


@dataclass(frozen=True)
class Both:
    """What a fit with Gaussians in space and time depends on."""

    rigid: FitSettings = field(default_factory=FitSettings)
    four: FourSettings = field(default_factory=FourSettings)


def fitted_in_time(
    scene: Scene, folder: Path | None, *, settings: Both | None = None, seed: int = 0
) -> tuple[Scene, Mapping[str, Any]]:
    """As `fitted`, then what rigid motion leaves unexplained fitted in space and time; its report under `four`."""
    settings = settings or Both()
    name = store.key(scene.episode, settings, seed) if folder else ""
    found = store.load(folder, name) if folder else None
    if found:
        return _known(scene, found), found.report
    rigid, facts = fitted(scene, folder, settings=settings.rigid, seed=seed)
    made, four = fit4.fitted(rigid, settings=settings.four, seed=seed)
    told = {**facts, "four": four.describe()}
    if folder:
        store.save(folder, name, made, settings=settings, report=told)
    return made, told


def _known(scene: Scene, found: store.Stored) -> Scene:
    """The scene with all that a store gave back."""
    return replace(
        scene,
        gaussians=found.gaussians,
        bodies=found.bodies,
        drift=found.drift,
        irradiance=found.irradiance,
        flowing=found.flowing,
    )
