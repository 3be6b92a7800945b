"""Whether recorded actions hold after what was simulated: what a copy's faults and its report say."""

from collections.abc import Mapping, Sequence
from typing import Any

INVALID = "actions_valid"


def invalid(tellings: Sequence[Mapping[str, Any]]) -> list[str]:
    """Why recorded actions no longer hold, in words; nothing if they do."""
    return [
        f"{INVALID}: {'; '.join(one['reasons'])}" for one in tellings if not one["actions_valid"]
    ]


def described(tellings: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """What a report says of simulations; nothing where there were none."""
    if not tellings:
        return {}
    valid = all(one["actions_valid"] for one in tellings)
    return {"actions_valid": valid, "physics": [dict(one) for one in tellings]}
