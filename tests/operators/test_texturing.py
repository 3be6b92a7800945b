"""Textures stay where they were laid, in every camera and at every time, under the light that was there."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from analytic import BALL, BOX, TABLE, ball_at, look, pinhole, shoot
from analytic import scene as analytic_scene
from pydantic import TypeAdapter, ValidationError

from rpaug import BadInput, Body, Scene, TargetError, Unsupported
from rpaug.assets.textures import shipped
from rpaug.assets.textures.mapping import Texture
from rpaug.core import geometry
from rpaug.core.files import encode_png
from rpaug.operators.background_texture import BackgroundTexture
from rpaug.operators.retexture import Retexture
from rpaug.operators.table_texture import TableTexture
from rpaug.operators.texturing import Sample, _laid
from rpaug.pipeline.contracts import OperatorContract, shown
from rpaug.scene.targets.targets import Target

EYES = {"front": (1.6, 0.3, 1.0), "overhead": (0.1, -0.9, 1.5)}
LENGTH = 4


def small(grey: bool = False) -> Scene:
    """The analytic scene with the ball's true track; `grey` paints everything plain."""
    recorded = analytic_scene(EYES, length=LENGTH)
    poses = np.tile(np.eye(4), (LENGTH, 1, 1))
    poses[:, :3, 3] = np.array([ball_at(t, LENGTH) - ball_at(0, LENGTH) for t in range(LENGTH)])
    bodies = (recorded.bodies[0], Body(frozenset({BALL}), poses, "aligned"))
    roles = {"table": frozenset({TABLE}), "background": frozenset({BOX})}
    views = recorded.episode.views
    if grey:
        views = {
            name: replace(view, rgb=lambda t, view=view: np.full_like(view.rgb(t), 128))
            for name, view in views.items()
        }
    episode = replace(recorded.episode, views=views)
    return replace(recorded, episode=episode, bodies=bodies, roles=roles)


class TestContract(OperatorContract):
    frames = (0, LENGTH - 1)

    def operator(self) -> Retexture:
        return Retexture(target=Target(handle=BOX), texture=Sample(sample="checker"))

    def scene(self) -> Scene:
        return small()


class TestTableContract(TestContract):
    def operator(self) -> TableTexture:  # type: ignore[override]
        return TableTexture()


class TestBackgroundContract(TestContract):
    def operator(self) -> BackgroundTexture:  # type: ignore[override]
        return BackgroundTexture()


def edited(recorded: Scene, operator: Retexture):  # type: ignore[no-untyped-def]
    edit = operator.sample(recorded, np.random.default_rng(0))
    return shown(operator.apply(recorded, edit))


@pytest.mark.parametrize("instance_id", [BALL, TABLE])
def test_one_point_has_one_color_in_all_cameras_and_frames(instance_id: int) -> None:
    recorded = small(grey=True)
    smooth = Retexture(
        target=Target(handle=instance_id), texture="clouds", scale=0.8, albedo=(0.5,) * 3
    )
    after = edited(recorded, smooth)
    body = next(body for body in recorded.bodies if instance_id in body.instance_ids)
    points, colors = [], []
    for view in after.views.values():
        for t in (0, LENGTH - 1):
            rows = view.ids(t) == instance_id  # type: ignore[misc]
            world = geometry.world_points(view.depth(t), view.camera, t)[rows]  # type: ignore[misc]
            points.append(geometry.transform(geometry.inverse(body.to_world[t]), world))
            colors.append(view.rgb(t)[rows].astype(float))
    step = max(1, len(points[0]) // 500)
    reference, of_reference = points[0][::step], colors[0][::step]
    for other, of_other in zip(points[1:], colors[1:], strict=True):
        away = np.linalg.norm(other[:, None] - reference[None], axis=-1)
        pairs = away.argmin(1)
        near = away.min(1) < 0.006
        assert near.sum() > 10
        assert np.abs(of_other[near] - of_reference[pairs[near]]).mean() < 4
    assert np.concatenate(colors).std(0).max() > 10


def test_a_known_mapping_gives_the_true_picture() -> None:
    image = shipped.image("clouds")
    recorded = small(grey=True)
    operator = TableTexture(
        texture="clouds", scale=1.6, mapping="planar", origin=(0.1, 0.2, 0.0), turn=(0.0, 0.0, 0.5),
        albedo=(0.5, 0.5, 0.5),
    )  # fmt: skip
    after = edited(recorded, operator)
    frame = geometry.rigid(np.array([0.0, 0.0, 0.5]), np.array([0.1, 0.2, 0.0]))
    for name, eye in EYES.items():
        view = after.views[name]
        pose = look(eye, (0, 0, 0.1))
        width = view.camera.width
        _, depth, ids = shoot(pinhole(width, 80), pose, width, 80, ball_at(1, LENGTH))
        spots = geometry.world_points(depth, view.camera, 1)[ids == TABLE]
        local = geometry.transform(geometry.inverse(frame), spots)
        column = np.floor(local[:, 0] / 1.6 * 256).astype(int) % 256
        row = np.floor(-local[:, 1] / 1.6 * 256).astype(int) % 256
        error = view.rgb(1)[ids == TABLE] - image[row, column] * (128 / 127.5)
        assert 10 * np.log10(255**2 / (error**2).mean()) > 28


def test_brightness_is_a_guess_unless_it_is_stated() -> None:
    levels = []
    for albedo in (None, (0.5, 0.5, 0.5)):
        operator = Retexture(target=Target(handle=BALL), texture="clouds", albedo=albedo)
        (surface,) = operator.sample(small(), np.random.default_rng(0))["surfaces"]
        levels.append(surface["smooth"]["level"])
    assert levels[1] == 1
    assert abs(levels[0] - 1) > 0.01


def test_other_pixels_keep_their_bytes() -> None:
    recorded = small()
    after = edited(recorded, Retexture(target=Target(handle=BOX), texture="oak"))
    for name, view in recorded.episode.views.items():
        outside = view.ids(0) != BOX  # type: ignore[misc]
        assert np.array_equal(after.views[name].rgb(0)[outside], view.rgb(0)[outside])


def test_the_users_images_are_drawn_checked_and_mirrored(tmp_path: Path) -> None:
    ramp = np.repeat(np.linspace(0, 255, 32).astype(np.uint8)[None, :, None], 3, 2)
    (tmp_path / "ramp.png").write_bytes(encode_png(np.repeat(ramp, 32, 0)))
    operator = Retexture(target=Target(handle=BOX), textures=tmp_path, scale=0.1)
    recorded = small(grey=True)
    edit = operator.sample(recorded, np.random.default_rng(0))
    assert edit["texture"] == "ramp.png"
    (laid,) = operator.apply(recorded, edit).appearance
    assert isinstance(laid.texture, Texture)  # type: ignore[attr-defined]
    assert laid.texture.mirror  # type: ignore[attr-defined]
    (tmp_path / "ramp.png").write_bytes(encode_png(ramp))
    with pytest.raises(BadInput, match="drawn with"):
        operator.apply(recorded, edit)


@pytest.mark.parametrize(
    "fields",
    [
        {"texture": "plywood"},
        {"texture": {"sample": "plastic"}},
        {"scale": 0},
        {"mapping": "uv"},
        {"texture": {"sample": "wood"}, "textures": "somewhere"},
    ],
)
def test_senseless_fields_are_refused(fields: dict) -> None:
    with pytest.raises(ValidationError):
        TypeAdapter(TableTexture).validate_python(fields)


def test_what_cannot_be_textured_says_why() -> None:
    recorded = small()
    blind = {name: replace(view, depth=None) for name, view in recorded.episode.views.items()}
    flat = replace(recorded, episode=replace(recorded.episode, views=blind))
    with pytest.raises(Unsupported, match="depth"):
        TableTexture().sample(flat, np.random.default_rng(0))
    with pytest.raises(TargetError, match="table"):
        TableTexture().sample(replace(recorded, roles={}), np.random.default_rng(0))


@pytest.mark.parametrize("channels", [1, 3])
def test_a_texture_is_laid_in_shade_and_keeps_highlights(channels):
    rng = np.random.default_rng(0)
    new, shade = rng.random((500, 3), np.float32), 2 * rng.random(500, np.float32) - np.float32(0.2)
    highlight = np.broadcast_to(rng.random((500, channels), np.float32) / 2, new.shape)
    expected = np.clip(new * shade[:, None] + highlight, 0, 1)
    assert {0, 1} < set(expected.ravel())
    np.testing.assert_array_equal(_laid(new, shade, highlight), expected)
