"""Learned models of poses: what a scripted one says becomes a model, and what contradicts itself is refused."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch
import walks

from rpaug import Unsupported
from rpaug.core import geometry
from rpaug.providers import poses
from rpaug.providers.poses import Posed
from rpaug.scene.video import colmap, posed, reconstruct, world

LENGTH = 10
SIZE = (182, 140)  # what 192 x 144 becomes in whole patches of 14 pixels


def truth(length: int) -> Posed:
    """What a model should say of the walk, in a world that is turned and three times as large."""
    track = walks.poses(length)
    factor = np.array(SIZE) / [walks.WIDTH, walks.HEIGHT]
    fit = np.diag([*factor, 1.0])
    fit[:2, 2] = (factor - 1) / 2
    K = fit @ walks.K()
    rows, columns = np.mgrid[: SIZE[1], : SIZE[0]]
    rays = np.stack([columns, rows, np.ones_like(rows)], -1) @ np.linalg.inv(K).T
    points = []
    for pose in track:
        ahead = rays @ pose[:3, :3].T
        with np.errstate(divide="ignore"):
            met = (walks.LEVEL - pose[2, 3]) / ahead[..., 2]
            wall = (walks.WALL - pose[1, 3]) / ahead[..., 1]
        met, wall = (np.where(z > 0, z, np.inf) for z in (met, wall))
        points.append(pose[:3, 3] + np.minimum(met, wall)[..., None] * ahead)
    motion = geometry.rigid(np.array([0.2, 0.4, -0.1]), np.array([5.0, 1.0, 2.0]))
    far = 3.0 * np.stack(points)
    track = track.copy()
    track[:, :3, 3] *= 3.0
    return Posed(
        motion @ track, np.repeat(K[None], length, 0),
        geometry.transform(motion, far).astype(np.float32), np.ones(far.shape[:3], np.float32),
    )  # fmt: skip


class Told(torch.nn.Module):
    """Knows the walk by heart, and finds the frames that it is shown in it by their mean colors."""

    def __init__(self, images: np.ndarray, known: Posed) -> None:
        super().__init__()
        shown = torch.from_numpy(images).permute(0, 3, 1, 2).float() / 255
        self.register_buffer("means", shown.mean((2, 3)))
        for name in ("cam_to_world", "K", "points", "confidence"):
            self.register_buffer(name, torch.from_numpy(np.ascontiguousarray(getattr(known, name))))

    def forward(
        self, images: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]:
        off = (images.mean((2, 3))[:, None] - self.means[None]).abs().sum(2)
        at = off.argmin(1)
        return self.cam_to_world[at], self.K[at], self.points[at], self.confidence[at]


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scripted model on disk."""
    import cv2

    view = walks.walk(LENGTH).views["ego"]
    small = [cv2.resize(view.rgb(t), SIZE, interpolation=cv2.INTER_AREA) for t in range(LENGTH)]
    path = tmp_path_factory.mktemp("models") / "walk.pt"
    torch.jit.script(Told(np.stack(small), truth(LENGTH))).save(str(path))
    return path


def misplaced(found: np.ndarray) -> float:
    """How far camera positions are from the walk's, aligned; metres."""
    at, true = found[:, :3, 3], walks.poses(LENGTH)[:, :3, 3]
    motion, scale = world.aligned(at, true)
    return float(np.abs(scale * at @ motion[:3, :3].T + motion[:3, 3] - true).max())


@pytest.mark.parametrize("window", [24, 7])
def test_a_scripted_models_answer_is_the_videos_model(
    file: Path, window: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(posed, "WINDOW", window)
    view = walks.walk(LENGTH).views["ego"]
    found = posed.reconstruct(view.rgb, range(LENGTH), poses.poses(f"torchscript:{file}"))
    assert len(found.times) == LENGTH
    assert misplaced(found.cam_to_world) < 1e-4
    assert found.focal == pytest.approx(walks.FOCAL, rel=0.02)
    assert (found.width, found.height) == (walks.WIDTH, walks.HEIGHT)


def test_an_exported_program_says_the_same(file: Path, tmp_path: Path) -> None:
    view = walks.walk(LENGTH).views["ego"]
    import cv2

    small = np.stack(
        [cv2.resize(view.rgb(t), SIZE, interpolation=cv2.INTER_AREA) for t in range(LENGTH)]
    )
    shown = torch.from_numpy(small).permute(0, 3, 1, 2).float() / 255
    torch.export.save(
        torch.export.export(Told(small, truth(LENGTH)), (shown,)), tmp_path / "walk.pt2"
    )
    one, other = (
        poses.poses(name)(small)
        for name in (f"torchscript:{file}", f"export:{tmp_path / 'walk.pt2'}")
    )
    for a, b in zip(vars(one).values(), vars(other).values(), strict=True):
        assert np.array_equal(a, b)


def test_it_is_asked_where_structure_from_motion_fails(
    file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(*args: object, **named: object) -> None:
        raise Unsupported("nothing in 10 frames")

    monkeypatch.setattr(colmap, "reconstruct", refused)
    named = partial(poses.poses, f"torchscript:{file}")
    video = reconstruct.develop(walks.walk(LENGTH), model_of=named, cache=tmp_path)
    assert video.describe()["mapper"] == "pose model"
    assert misplaced(video.model.cam_to_world) < 1e-4
    with pytest.raises(Unsupported, match=r"nothing in 10 frames; by the model of poses: no model"):
        reconstruct.develop(
            walks.walk(LENGTH), model_of=partial(poses.poses, "walk.pt"), cache=tmp_path
        )


def test_answers_that_cannot_be_are_refused() -> None:
    view = walks.walk(LENGTH).views["ego"]
    good = truth(LENGTH)
    still = np.repeat(good.cam_to_world[:1], LENGTH, 0)
    same = np.repeat(good.points[:1], LENGTH, 0)
    for wrong, words in (
        (Posed(good.cam_to_world[::-1], good.K, good.points, good.confidence), "off the pixels"),
        (Posed(1.3 * good.cam_to_world, good.K, good.points, good.confidence), "rotations"),
        (Posed(still, good.K, same, good.confidence), "degrees between the rays"),
    ):

        def given(images: np.ndarray, wrong: Posed = wrong) -> Posed:
            return wrong

        with pytest.raises(Unsupported, match=words):
            posed.reconstruct(view.rgb, range(LENGTH), given)


def test_files_that_hold_no_model_are_named(tmp_path: Path) -> None:
    junk = tmp_path / "junk.pt"
    junk.write_bytes(b"no")
    for kind in poses.KINDS:
        with pytest.raises(Unsupported, match=r"junk\.pt: no"):
            poses.poses(f"{kind}:{junk}")
    torch.jit.script(torch.nn.Identity()).save(str(junk))
    with pytest.raises(Unsupported, match="expected poses, K, points"):
        poses.poses(f"torchscript:{junk}")(np.zeros((2, 14, 14, 3), np.uint8))
