"""What an episode holds: cameras, frames, words, and every instance with its role, color, size and motion."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from rpaug.core import keyframes, registry
from rpaug.core.errors import RpaugError
from rpaug.core.progress import told
from rpaug.core.types import CameraView, Episode, Scene
from rpaug.pipeline import prepare, role_facts
from rpaug.pipeline.run import group_of
from rpaug.providers.models_settings import Models
from rpaug.scene.instances import rgb_episode
from rpaug.scene.lighting import beliefs
from rpaug.scene.targets import agreement
from rpaug.scene.targets.roles import NAMES
from rpaug.scene.targets.settled import SettledRole, settle
from rpaug.scene.targets.survey import InstanceSummary, survey
from rpaug.scene.tracking import arms, calibration
from rpaug.scene.video.video_scene import VideoScene

NOTHING: Mapping[str, Mapping[str, Any]] = {}


def inspect(
    episode: Episode,
    files: Sequence[Path] = (),
    roles: Mapping[str, SettledRole] | None = None,
    models: Models = Models(),  # noqa: B008 - it is frozen
) -> tuple[dict[str, Any], tuple[InstanceSummary, ...], Episode]:
    """Plain values about the episode, one summary per instance, and the episode with instance ids where they were
    found.

    `files` are URDF or MJCF files of arms whose links are looked for first, `roles` what a person settled, `models`
    what the instruction's words are looked for with. Of a video whose camera can be worked out they are those of its
    registered frames, with the instance ids that edits go by.
    """
    described: dict[str, Any] = {
        "episode": episode.key,
        "instruction": episode.instruction,
        "descriptions": list(episode.descriptions),
        "frames": episode.length,
        "key_frames": keyframes.find(episode.robot),
        "cameras": {name: _camera(view) for name, view in episode.views.items()},
    }
    described["misplaced"] = {m.camera: str(m) for m in calibration.check(episode)}
    described["arms"] = list(arms.misfits(files, episode.robot))
    described["assumed"], described["unread"] = [], list(episode.unread)
    told(episode.key, "finding what is in the scene")
    found = prepare.found_instances(episode, files, models)
    scene, wrong = settle(found.scene(), roles or {})
    if isinstance(scene.back, VideoScene):
        described["film"] = scene.back.describe()
    if not scene.bodies:
        return described | {"instances": []}, (), episode
    assumed = rgb_episode.assumptions(scene.episode)
    described["assumed"] = [*found.notes, *found.told, *wrong, *assumed]
    told(episode.key, "measuring instances")
    rows = survey(scene.episode, scene.bodies, scene.roles)
    if isinstance(scene.back, VideoScene) and len(scene.back.spans) > 1:
        # Nothing tells how pieces lie beside each other: what is in several has no size.
        spread = agreement.playing(scene, "background") | agreement.playing(scene, "robot")
        rows = tuple(
            replace(row, size_cm=(0.0, 0.0, 0.0)) if row.instance_id in spread else row
            for row in rows
        )
    described["roles"] = role_facts.describe(scene)
    described["light"] = beliefs.described(scene)
    described["antialiased"] = scene.antialiased
    recorded = recorded_frames(described)
    described["instances"] = [
        _described(row, recorded) | _steadiness(scene, row.instance_id) for row in rows
    ]
    return described, rows, scene.episode


def _steadiness(scene: Scene, instance_id: int) -> dict[str, Any]:
    """Of a video, in how many steps between frames what is seen of an instance jumps, and whether it may be painted."""
    if not isinstance(scene.back, VideoScene):
        return {}
    steps, found = scene.back.jumps([instance_id])
    return {
        "steps": steps,
        "jumps": len(found),
        "steady": not scene.back.unsteady([instance_id]),
    }


def roles_of_all(
    dataset: Path,
    files: Sequence[Path] = (),
    roles: Mapping[str, SettledRole] | None = None,
    models: Models = Models(),  # noqa: B008 - it is frozen
) -> dict[str, dict[str, Any]]:
    """What is believed of the roles of each episode of a dataset that can be read, by its key."""
    adapter = registry.adapter_for(dataset)
    found, keys = {}, adapter.episodes(dataset)
    for number, key in enumerate(keys):
        told(key, "finding roles, episode", number, len(keys))
        try:
            scene = prepare.found_instances(adapter.read(dataset, key), files, models).scene()
        except RpaugError:
            continue  # `augment` names it
        found[key] = role_facts.describe(settle(scene, roles or {})[0])
    return found


def disagreement(dataset: Path, found: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """In which roles episodes of one group differ, in sentences."""
    adapter, groups = registry.adapter_for(dataset), dict[str, dict[str, Any]]()
    for key, one in found.items():
        groups.setdefault(group_of(adapter, key), {})[key] = one
    return role_facts.disagreements(groups)


def roles_file(
    rows: Sequence[InstanceSummary],
    every: Sequence[Mapping[str, Any]],
    lasting: bool = True,
    believed: Mapping[str, Mapping[str, Any]] = NOTHING,
) -> str:
    """A `roles.yaml` of one episode's roles: by mask id where all episodes believe the same ids, else by a color that
    nothing else has; a role that neither tells is a comment, and so is the best guess at one that is doubted.
    `believed` is what `inspect` described of each role.

    Ids are not `lasting` where each of several episodes is numbered anew: none is written then, since it would be
    refused.
    """
    lines = []
    elsewhere = "other ids elsewhere" if lasting else "without recorded masks ids hold in one alone"
    known = dict.fromkeys(row.role for row in rows if row.role)
    for role in known:
        own = [row for row in rows if row.role == role]
        ids, colors = [row.instance_id for row in own], sorted({row.color_name for row in own})
        alone = {row.instance_id for row in rows if row.color_name in colors} == {*ids}
        if lasting and all(one.get(role, {}).get("handles") == ids for one in every):
            lines.append(f"  {role}: {{handle: {ids}}}")
        elif alone and len(colors) == 1:
            lines.append(f"  {role}: {{color: {colors[0]}, all: true}}")
        else:
            lines.append(f"  # {role}: {ids} in this episode; {elsewhere}, and no color of its own")
    for role in NAMES:
        if role not in known:
            lines += _guessed(role, believed.get(role, {}), rows, lasting)
    return "\n".join(["version: 1", "roles:", *lines]) + "\n"


def _guessed(
    role: str, belief: Mapping[str, Any], rows: Sequence[InstanceSummary], lasting: bool
) -> list[str]:
    """Lines of a comment that settles a role once its mark is taken away: the best guess of `rpaug inspect`."""
    own = {row.instance_id: row for row in rows if row.instance_id in belief.get("handles", ())}
    if not own:
        how = "{handle: [ID, ...]}" if lasting else "{color: WORD, all: true}"
        return [
            f"  # {role}: {how}  # nothing was taken for it; `rpaug inspect` lists what there is"
        ]
    largest = max(own.values(), key=lambda row: sum(row.pixels.values()))
    guess = (
        f"{{handle: {sorted(own)}}}" if lasting else f"{{color: {largest.color_name}, all: true}}"
    )
    return [
        f"  # {role} is doubted: {'; '.join(belief['reasons'])}.",
        "  # This is the best guess. If it is right, or once you mended it, take away the mark before it:",
        f"  # {role}: {guess}",
    ]


def recorded_frames(described: Mapping[str, Any]) -> list[int]:
    """Which recorded frame each one is that instances were told in: of a video those alone that have a camera pose."""
    lost = set(described.get("film", {}).get("passed_through", ()))
    return [t for t in range(described["frames"]) if t not in lost]


def measured(described: Mapping[str, Any]) -> bool:
    """Whether lengths are in metres: of a video nothing may tell its scale."""
    return described.get("film", {}).get("metric", True)


def _described(row: InstanceSummary, recorded: Sequence[int]) -> dict[str, Any]:
    """Plain values; the instance id goes by the key that recipes use, frames by their recorded numbers."""
    facts = asdict(row) | {
        "first_frame": recorded[row.first_frame],
        "last_frame": recorded[row.last_frame],
        "body": sorted(row.body),
        "pixels": dict(row.pixels),
        "moving": row.moving,
    }
    return {"handle": facts.pop("instance_id"), **facts}


def _camera(view: CameraView) -> dict[str, Any]:
    images = ["rgb", *(["depth"] if view.depth else []), *(["mask"] if view.ids else [])]
    camera = view.camera
    return {
        "width": camera.width,
        "height": camera.height,
        "focal": float(camera.K[0, 0]),
        "fixed": camera.fixed,
        "assumed": camera.assumed,
        "placed": camera.placed,
        "images": images,
    }
