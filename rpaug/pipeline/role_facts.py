"""What is believed of an episode's roles, in plain values, and where the episodes of one task differ in it."""

from collections.abc import Mapping, Sequence
from typing import Any

from rpaug.core.memo import of_episode
from rpaug.core.types import Body, Episode, Scene
from rpaug.scene.sampled_frames import look
from rpaug.scene.targets import roles
from rpaug.scene.targets.observed import surface
from rpaug.scene.targets.survey import size_cm

SAME = 1.5  # times: what is seen of one thing in two episodes differs in length by less
SIZED = ("manipulated", "receiver", "table")


def describe(scene: Scene) -> dict[str, dict[str, Any]]:
    """By role its instance ids, how sure that is (None where nothing measures it), whether it is believed, why, and how
    long its longest instance is."""
    found = {}
    for role in dict.fromkeys([*scene.beliefs, *scene.roles]):
        belief = scene.beliefs.get(role)
        ids = sorted(scene.roles[role] if belief is None else belief.instance_ids)
        lengths = [_length(scene, one) for one in ids] if role in SIZED else []
        found[role] = {
            "handles": ids,
            "confidence": None if belief is None else round(belief.confidence, 3),
            "believed": role in scene.roles,
            "longest_cm": round(max(lengths, default=0.0), 1),
            "reasons": [] if belief is None else list(belief.reasons),
        }
    return found


def compared(described: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """As much of what `describe` gave as episodes are compared by."""
    return {
        role: {"believed": one["believed"], "longest_cm": one["longest_cm"]}
        for role, one in described.items()
    }


def disagreements(
    groups: Mapping[str, Mapping[str, Mapping[str, Mapping[str, Any]]]],
) -> list[str]:
    """`disagreement` of every group of episodes; of several groups each is named."""
    return [
        words
        for name, found in groups.items()
        for words in disagreement(found, f" of {name}" if len(groups) > 1 else "")
    ]


def disagreement(
    found: Mapping[str, Mapping[str, Mapping[str, Any]]], where: str = ""
) -> list[str]:
    """In which roles the episodes of one task differ, in sentences, by what `describe` gave of each by its key.

    A role differs where some episodes have it and others have not, or where its longest instance is more than `SAME`
    times as long in some as in most. Colors may vary within a task, and ids often do.
    """
    stated = []
    for role in roles.NAMES:
        without = dict.fromkeys(
            key for key, one in found.items() if not one.get(role, {}).get("believed")
        )
        if 0 < len(without) < len(found):
            stated.append(
                f"{role}: {len(without)} of {len(found)} episodes{where} have none: {_few([*without])}"
            )
        lengths = {
            key: one[role]["longest_cm"]
            for key, one in found.items()
            if key not in without and one[role]["longest_cm"]
        }
        middle = sorted(lengths.values())[len(lengths) // 2] if lengths else 0.0
        odd = [key for key, one in lengths.items() if not middle / SAME <= one <= middle * SAME]
        if odd:
            stated.append(
                f"{role}: mostly {middle:.0f} cm long, otherwise in {len(odd)} of {len(lengths)} episodes{where}:"
                f" {', '.join(f'{key} ({lengths[key]:.0f} cm)' for key in odd[:4])}"
            )
    return stated


def sure(one: Mapping[str, Any]) -> str:
    """How sure a described role is, and whether it is believed, in words."""
    given = "" if one["confidence"] is None else f", {100 * one['confidence']:.0f} % sure"
    return given if one["believed"] else f"{given}, not believed"


def _length(scene: Scene, instance_id: int) -> float:
    body = next((body for body in scene.tracked if instance_id in body.instance_ids), None)
    if body is None:
        return 0.0
    return _longest(scene.episode, instance_id, body)


@of_episode
def _longest(episode: Episode, instance_id: int, body: Body) -> float:
    return max(size_cm(surface(look(episode), instance_id, body)[0]))


def _few(keys: Sequence[str]) -> str:
    return ", ".join(keys[:4]) + (f" and {len(keys) - 4} more" if len(keys) > 4 else "")
