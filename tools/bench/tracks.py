"""How well bodies are followed: against the twin's true poses, and by their residual on recorded episodes.

    python tools/bench/tracks.py --seeds 3 [--dataset RECORDINGS] [--json]

On the twin, the error of a body at a time is the median distance in millimetres between where its recorded surface
points are carried and where they truly were; the table has the median and the 90 % over times, of each body of each
task, the worst of the seeds. On recordings the residual is the median point-to-plane distance over the episode.
"""

import argparse
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from rpaug.core import geometry, registry
from rpaug.core.types import Body, Episode
from rpaug.scene.build import build
from rpaug.twin.look import Look
from rpaug.twin.record import Take, perform
from rpaug.twin.tabletop import ARM

TASKS = ("open_drawer", "slide_block", "pick_block")
LOOKED_AT = 12  # frames that surface points are taken from
MOST = 400  # points of a body


def main() -> None:
    """Follow everything, print a table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--tasks", nargs="*", default=TASKS)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--frames", type=int, default=60)
    parser.add_argument("--dataset", type=Path, help="recordings to follow as well")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    found: dict[str, list[dict[str, Any]]] = {"twin": [], "recorded": []}
    for task in given.tasks:
        for seed in range(given.seeds):
            take = perform(task, seed, look=Look(), frames=given.frames)
            found["twin"] += list(_twin(take, task, seed))
    if given.dataset:
        adapter = registry.adapter_for(given.dataset)
        for key in adapter.episodes(given.dataset):
            found["recorded"] += list(_recorded(adapter.read(given.dataset, key)))
    print(json.dumps(found, indent=1) if given.json else _table(found))


def _twin(take: Take, task: str, seed: int) -> Iterator[dict[str, Any]]:
    bodies = build(take.episode, with_bodies=True).bodies
    links = np.stack([ARM.links(q) for q in take.episode.robot.joint_positions], 1)
    poses = {f"link{number}": track for number, track in enumerate(links, start=1)}
    poses |= {"hand": links[-1], **take.poses}
    for name, instance_ids in take.truth.bodies.items():
        truth = poses.get(name)
        points = (
            {h: _points(take.episode, h, truth) for h in instance_ids} if truth is not None else {}
        )
        for instance_id, (own, _) in points.items():
            body = next((b for b in bodies if instance_id in b.instance_ids), None)
            if body is None or not len(own):
                continue
            off = _errors(body, truth, own)
            yield {
                "task": task,
                "seed": seed,
                "body": name,
                "moves_m": float(np.linalg.norm(np.ptp(truth[:, :3, 3], 0))),
                "motion": body.motion,
                "ambiguous": body.ambiguous,
                "median_mm": 1e3 * float(np.median(off)),
                "p90_mm": 1e3 * float(np.quantile(off, 0.9)),
            }


def _points(episode: Episode, instance_id: int, truth: np.ndarray | None) -> tuple[np.ndarray, int]:
    """Surface points of a handle in its true body's frame, from the moment that shows it best."""
    best, most, when = np.zeros((0, 3)), 0, 0
    for t in np.linspace(0, episode.length - 1, LOOKED_AT).round().astype(int):
        for view in episode.views.values():
            shown = view.ids(int(t)) == instance_id
            if shown.sum() > most:
                points = geometry.world_points(view.depth(int(t)).astype(float), view.camera, t)
                best, most, when = points[shown], int(shown.sum()), int(t)
    step = max(1, len(best) // MOST)
    return geometry.transform(geometry.inverse(truth[when]), best[::step]), when


def _errors(body: Body, truth: np.ndarray, own: np.ndarray) -> np.ndarray:
    """Median distance in metres at each time."""
    start = geometry.inverse(truth[body.reference])
    held = geometry.transform(geometry.inverse(start), own)
    off = [
        np.linalg.norm(geometry.transform(a, held) - geometry.transform(b @ start, held), axis=-1)
        for a, b in zip(body.to_world, truth, strict=True)
    ]
    return np.median(np.array(off), 1)


def _recorded(episode: Episode) -> Iterator[dict[str, Any]]:
    for body in build(episode, with_bodies=True).bodies:
        path = np.linalg.norm(np.ptp(body.to_world[:, :3, 3], 0))
        yield {
            "episode": episode.key,
            "handles": sorted(map(int, body.instance_ids)),
            "motion": body.motion,
            "moves_m": float(path),
            "ambiguous": body.ambiguous,
            "residual_mm": 1e3 * body.residual,
        }


def _table(found: dict[str, list[dict[str, Any]]]) -> str:
    lines = [f"{'task':16}{'body':14}{'motion':9}{'median mm':>10}{'90 % mm':>9}{'ambiguous':>11}"]
    worst: dict[tuple[str, str], dict[str, Any]] = {}
    for row in found["twin"]:
        at = row["task"], row["body"]
        if at not in worst or row["p90_mm"] > worst[at]["p90_mm"]:
            worst[at] = row
    for (task, name), row in worst.items():
        lines.append(
            f"{task:16}{name:14}{row['motion']:9}{row['median_mm']:10.2f}{row['p90_mm']:9.2f}"
            f"{row['ambiguous']!s:>11}"
        )
    lines += [
        f"{row['episode'][-10:]:12}{str(row['handles'])[:18]:18}{row['motion']:9}"
        f"{row['moves_m']:7.3f} m{row['residual_mm']:9.3f}{row['ambiguous']!s:>11}"
        for row in found["recorded"]
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    main()
