"""What truly changes in a recording of the twin, for `tools.bench.photographed`.

Colors, lamps, cameras, sizes, and what is put in or taken away are recorded again. A thing that was moved is recorded
elsewhere; of a duplicated one both recordings are laid over each other by their depth. What physics does to a thing has
no second recording: there the truth is the same edit on exact depth, masks and poses.
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float64
from pydantic import TypeAdapter

from rpaug import twin
from rpaug.core import registry
from rpaug.core.types import Scene
from rpaug.pipeline import plan
from rpaug.pipeline.copies import Known, PreparedEpisode, draw_copy
from rpaug.pipeline.recipe import Recipe
from rpaug.scene.build import build
from tools.bench.harness import truths
from tools.bench.harness.cases import CASES, Ask, FactorCase
from tools.bench.harness.truths import CYLINDER

FALL: Mapping[str, Any] = {"material": "wood", "height": (0.05, 0.05)}


def made(scene: Scene, op: str, fields: Mapping[str, Any], edit: Any) -> Any:
    """The copy, by the pipeline's own stages. Raises RpaugError where it is refused."""
    operator = TypeAdapter(registry.operator(op)).validate_python(dict(fields))
    asked_for = plan.make([operator], scene.episode)
    plan.check(operator, scene)
    drawn = operator.sample(scene, np.random.default_rng(0)) if callable(edit) or not edit else edit
    plain = json.loads(json.dumps(edit(drawn) if callable(edit) else drawn))
    plan.check_shown(operator, scene, operator.apply(scene, plain))
    draws = [{"step": 0, "op": op, "fields": dict(fields), "edit": plain}]
    prepared = PreparedEpisode(scene, asked_for, Recipe.from_dict({"version": 1}))
    return draw_copy(prepared, 1, known=Known(draws=draws))


def changed(case: FactorCase, factor: str, recorded: twin.Take) -> twin.Take:
    """The same with the factor truly changed."""
    if factor in TRUTHS:
        return TRUTHS[factor](recorded)
    if case.truth:
        return case.truth(recorded)
    true = _again(recorded, factor, case.targets[0], case.value(recorded) if case.value else None)
    if true.truth.new.extras:
        new = tuple(extra.handle for extra in true.truth.new.extras)
        true = replace(true, truth=replace(true.truth, changed=new))
    return true


def _again(recorded: twin.Take, factor: str, target: str | None, value: Any) -> twin.Take:
    return twin.perform(
        recorded.truth.task,
        recorded.truth.seed,
        factor=factor,
        target=target,
        value=value,
        look=recorded.truth.new,
        size=next(iter(recorded.episode.views.values())).camera.width,
        frames=recorded.episode.length,
    )


def motion(recorded: twin.Take) -> Float64[np.ndarray, "4 4"]:
    """Where `move` would put the thing, unturned."""
    return np.array(truths.drawn(truths.moving(recorded), recorded)["motion"], float)


def _moved(recorded: twin.Take) -> twin.Take:
    return _again(recorded, "object_place", CYLINDER, truths.shift(recorded, motion(recorded)))


def _doubled(recorded: twin.Take) -> twin.Take:
    handle = recorded.truth.handles[CYLINDER]
    return truths.doubled(recorded, _moved(recorded), handle, handle)


def _fallen(recorded: twin.Take) -> twin.Take:
    """The same edit on exact depth, masks and poses."""
    handle = recorded.truth.handles[CYLINDER]
    scene = build(recorded.episode, with_bodies=True)
    copy = made(scene, "physics", {"target": {"handle": handle}, **FALL}, None)
    truth = replace(recorded.truth, changed=(handle,))
    return replace(recorded, episode=copy.episode, truth=truth)


def _asked(fields: Mapping[str, Any]) -> Callable[..., tuple[Ask, ...]]:
    return lambda recorded, true, folder: (Ask("rpaug", (fields,)),)


TRUTHS: Mapping[str, Callable[[twin.Take], twin.Take]] = {
    "move": _moved,
    "spread": _moved,
    "duplicate": _doubled,
    "physics": _fallen,
}
# No word names what object_place moves: `move` is of what one does.
MEASURED: Mapping[str, FactorCase] = {
    **{name: case for name, case in CASES.items() if name != "object_place"},
    "move": FactorCase("move", _asked({"turn": 0.0})),
    "spread": FactorCase("spread", _asked({"turn": 0.0})),
    "duplicate": FactorCase("duplicate", _asked({"turn": 0.0})),
    "physics": FactorCase("physics", _asked(FALL)),
}


MOVED = ("move", "spread", "duplicate")


def placed(factor: str, by: Float64[np.ndarray, "4 4"]) -> Callable[[Any], Any]:
    """What an operator drew, with the true motion in place of its own; a refusal of its own stays one."""

    def same(edit: Any) -> Any:
        match factor:
            case "move":
                return edit | {"motion": by.tolist()}
            case "spread":
                return edit | {"moves": [one | {"motion": by.tolist()} for one in edit["moves"]]}
            case _:
                return edit | {"copies": [one | {"motion": by.tolist()} for one in edit["copies"]]}

    return same
