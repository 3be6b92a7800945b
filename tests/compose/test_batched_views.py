"""Frames drawn several at once on a device: those of the host, within a level, in whatever order they are asked for."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from analytic import BALL, BOX, EYES, LENGTH, TABLE, scene
from devices import DEVICES

from rpaug.compose import batched, views
from rpaug.core import devices
from rpaug.core.types import Scene
from rpaug.operators.camera_pose import CameraPose
from rpaug.operators.insert import Insert
from rpaug.operators.light_color import LightColor
from rpaug.operators.recolor import Recolor
from rpaug.operators.retexture import Retexture
from rpaug.operators.sensor_noise import SensorNoise
from rpaug.pipeline import plan

EDITS: dict[str, list[Any]] = {
    "painted": [Recolor(target={"handle": BALL}, color="blue")],
    "laid": [Retexture(target={"handle": BALL}), Retexture(target={"handle": TABLE})],
    "lit": [LightColor(range=((0.2, 0.2, 0.2), (0.3, 0.3, 0.3)))],
    "all": [
        Recolor(target={"handle": BOX}, color="red"),
        Retexture(target={"handle": TABLE}),
        LightColor(range=((0.2, 0.2, 0.2), (0.3, 0.3, 0.3))),
        SensorNoise(),
    ],
    "moved": [
        Recolor(target={"handle": BALL}, color="blue"),
        CameraPose(camera="front", shift=0.04),
    ],
    "put in": [Insert(asset="puck", near={"handle": BOX}), Retexture(target={"handle": TABLE})],
}


def edited(whole: Scene, operators: list[Any]) -> Scene:
    rng = np.random.default_rng(3)
    for operator in operators:
        whole = operator.apply(whole, operator.sample(whole, rng))
    return whole


def shown(whole: Scene, operators: list[Any], device: str) -> tuple[Any, list[views.RenderedFrame]]:
    told: list[views.RenderedFrame] = []
    settled = plan.settle(plan.make(operators, whole.episode), whole)
    return views.edited(whole, settled.representations, told.append, device=device), told


@pytest.fixture(params=DEVICES)
def device(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """A device that is drawn on by torch."""
    monkeypatch.setattr(devices, "torch_device", lambda name: request.param)
    monkeypatch.setattr(batched, "AT_ONCE", 3 * 96 * 80)
    batched.drawing.cache_clear()
    yield "cuda"
    batched.drawing.cache_clear()


@pytest.mark.parametrize("mixes", [False, True])
@pytest.mark.parametrize("name", list(EDITS))
def test_frames_are_those_of_the_host(device: str, name: str, mixes: bool) -> None:
    roles = {"table": frozenset([TABLE])}
    whole = edited(replace(scene(EYES), antialiased=mixes, roles=roles), EDITS[name])
    (found, told), (expected, by_host) = (shown(whole, EDITS[name], one) for one in (device, "cpu"))
    off = []
    for camera, view in found.views.items():
        for t in (0, 1, LENGTH - 1, 2):
            image, like = view.rgb(t), expected.views[camera].rgb(t)
            off.append(np.abs(image.astype(int) - like).max(-1).ravel())
            assert np.array_equal(view.depth(t), expected.views[camera].depth(t))
            assert np.array_equal(view.ids(t), expected.views[camera].ids(t))
    assert (np.concatenate(off) > 1).mean() <= 1e-3
    assert [(one.camera, one.t) for one in told] == [(one.camera, one.t) for one in by_host]


def test_what_cannot_be_stacked_is_drawn_by_the_host(
    device: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    operators = EDITS["painted"]
    whole = edited(scene(EYES), operators)
    (painted,) = whole.appearance

    class Alone:
        instance_ids = painted.instance_ids

        def __call__(self, color: np.ndarray, surface: Any) -> np.ndarray:
            return painted(color, surface)

    alone = replace(whole, appearance=(Alone(),))
    monkeypatch.setattr(batched, "ahead", None)
    found, _ = shown(alone, operators, device)
    expected, _ = shown(whole, operators, "cpu")
    assert np.array_equal(found.views["front"].rgb(3), expected.views["front"].rgb(3))


def test_recorded_images_are_kept_on_the_device_up_to_a_limit() -> None:
    whole = edited(scene(EYES), EDITS["all"][:3])
    shots = [batched.Shot(whole, "front", t) for t in range(6)]
    camera = whole.cameras["front"]
    size = camera.height, camera.width
    expected = batched.Drawing(torch.device("cpu"))(shots)
    small = batched.Drawing(torch.device("cpu"), kept_bytes=3 * batched.BYTES * size[0] * size[1])
    for chosen in ([0, 1], [4, 5], [1, 2, 3], [5, 0], [0, 1, 2, 3, 4, 5], [3]):
        found = small([shots[n] for n in chosen])
        assert torch.equal(found, expected[chosen])
        assert len(small.kept[size]) <= max(3, len(chosen)) or chosen == [3]
    decoded = []
    view = whole.episode.views["front"]
    counted = replace(view, rgb=lambda t: decoded.append(t) or view.rgb(t))
    episode = replace(whole.episode, views=whole.episode.views | {"front": counted})
    again = batched.Drawing(torch.device("cpu"))
    same = [batched.Shot(replace(whole, episode=episode), "front", t) for t in (0, 1)]
    again(same)
    first = len(decoded)
    again(same)
    assert len(decoded) == first > 0
