"""Fitted scenes from a store, fitted only if the store lacks them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from rpaug.core.errors import BadInput
from rpaug.core.types import Scene
from rpaug.gaussians import fit, fit4, gaussians, sharing, store
from rpaug.gaussians.descent import FitSettings
from rpaug.gaussians.fit4 import FourSettings

Progress = Callable[[float], None]
Facts = Mapping[str, Any]
SPARED = 0.5  # of the steps, times the share of the Gaussians that are borrowed: moving things are left to be fitted


def fitted(
    scene: Scene,
    folder: Path | None,
    *,
    settings: FitSettings | None = None,
    seed: int = 0,
    progress: Progress | None = None,
    donor: Scene | None = None,
) -> tuple[Scene, Facts]:
    """The scene with its Gaussians and the poses they belong to, and the fit's report as plain values.

    With a `folder`, a scene fitted before to the same recordings with the same settings is taken from there, and
    a new one is put there. `founder`, of the same place, lends its static Gaussians; it is fitted by itself, or
    taken from the folder. Raises BadInput for a damaged stored scene, Unsupported if nothing can be fitted.
    """
    settings = settings or FitSettings()
    return _fitted(scene, folder, settings, seed, progress, donor)[:2]


@dataclass(frozen=True)
class Both:
    """What a fit with Gaussians in space and time depends on."""

    rigid: FitSettings = field(default_factory=FitSettings)
    four: FourSettings = field(default_factory=FourSettings)


def fitted_in_time(
    scene: Scene,
    folder: Path | None,
    *,
    settings: Both | None = None,
    seed: int = 0,
    donor: Scene | None = None,
) -> tuple[Scene, Facts]:
    """As `fitted`, then what rigid motion leaves unexplained fitted in space and time; its report under `four`."""
    settings = settings or Both()
    name = name_of(scene, settings, seed, donor) if folder else ""
    found = store.load(folder, name) if folder else None
    if found:
        return known(scene, found), found.report
    rigid, facts, donated = _fitted(scene, folder, settings.rigid, seed, None, donor)
    made, four = fit4.fitted(rigid, settings=settings.four, seed=seed)
    given = {**facts, "four": four.describe()}
    if folder:
        still = donated.without(four.instance_ids) if donated else None
        keep(folder, name, made, settings, given, still)
    return made, given


def _fitted(
    scene: Scene,
    folder: Path | None,
    settings: FitSettings,
    seed: int,
    progress: Progress | None,
    donor: Scene | None,
) -> tuple[Scene, Facts, store.Borrowed | None]:
    """The fitted scene, its report, and which of its Gaussians are borrowed."""
    name = name_of(scene, settings, seed, donor) if folder else ""
    found = store.load(folder, name) if folder else None
    if found:
        return known(scene, found), found.report, found.borrowed
    donated, begun, shorter = None, None, settings
    if donor is not None:
        donor_key = store.key(donor, settings, seed)
        donated = sharing.borrowed(
            scene, donor_key, fitted(donor, folder, settings=settings, seed=seed)[0]
        )
        begun = fit.Begun(sharing.begun(scene, donated), len(donated))
        spared = SPARED * len(donated) / max(len(begun.gaussians), 1)
        shorter = replace(settings, steps=max(1, round((1 - spared) * settings.steps)))
    made, full = fit.fitted(scene, settings=shorter, seed=seed, progress=progress, begun=begun)
    facts = {
        name: value
        for name, value in vars(full).items()
        if name not in ("bodies", "pose_correction", "irradiance")
    }
    if donated is not None and donor is not None:
        assert made.gaussians is not None
        own = gaussians.chosen(made.gaussians, np.arange(len(donated), len(made.gaussians)))
        # What was held still came back through logits and unit quaternions: the last bit may differ.
        joint = gaussians.joined([donated.gaussians, own])
        made = replace(
            made, gaussians=replace(joint, frame_residuals=made.gaussians.frame_residuals)
        )
        facts["founder"], facts["borrowed"] = donor.episode.key, len(donated)
    if folder:
        keep(folder, name, made, settings, facts, donated)
    return made, facts, donated


def name_of(
    scene: Scene,
    settings: FitSettings | Both,
    seed: int,
    donor: Scene | None = None,
) -> str:
    """The key under which a scene fitted so is stored."""
    rigid = settings.rigid if isinstance(settings, Both) else settings
    donor_key = "" if donor is None else store.key(donor, rigid, seed)
    return store.key(scene, settings, seed, donor_key)


def keep(
    folder: Path,
    name: str,
    made: Scene,
    settings: Any,
    facts: Facts,
    donated: store.Borrowed | None,
) -> None:
    """Put a scene into the store. Another process may have been first: with the same scene, since fits are seeded."""
    try:
        store.save(folder, name, made, settings=settings, report=facts, borrowed=donated)
    except (BadInput, OSError):
        if not store.path_of(folder, name).is_dir():
            raise


def known(scene: Scene, found: store.Stored) -> Scene:
    """The scene with all that a store gave back."""
    return replace(
        scene,
        gaussians=found.gaussians,
        bodies=found.bodies,
        pose_correction=found.pose_correction,
        irradiance=found.irradiance,
        flowing=found.flowing,
    )
