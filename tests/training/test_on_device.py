"""Batches drawn by torch: what the host makes of the same samples, within a level."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from devices import DEVICES
from rpaug_adapters.rlbench import RLBench

from rpaug import Unsupported
from rpaug.core.devices import torch_device
from rpaug.training import wrap, wrapping
from rpaug.training.on_device import OnDevice

KEYS = [f"roll_ball/all_variations/episodes/episode{n}" for n in range(2)]
FRAMES = [(KEYS[0], 0), (KEYS[1], 5), (KEYS[0], 7), (KEYS[1], 2)]
PAINT = {"op": "recolor", "target": {"handle": 300}, "color": {"sample": "colosseum"}}
TEXTURE = {"op": "retexture", "target": {"handle": 300}, "texture": "oak"}
LIGHT = {"op": "light_color", "range": [[0.2, 0.2, 0.2], [0.4, 0.4, 0.4]]}
MOVE = {"op": "camera_pose", "camera": "front", "shift": 0.03}
CAMERAS = {"front": {"rgb": "front_rgb", "depth": "front_depth"}}
ON_CPU = torch.device("cpu")


class Batches:
    """Two batches of two samples, colors as tensors in -1..1, channels first."""

    def __init__(self, root: Path, device: torch.device) -> None:
        self.root, self.device = root, device

    def __iter__(self) -> Iterator[dict[str, Any]]:
        for start in range(0, len(FRAMES), 2):
            views = [RLBench().read(self.root, key).views["front"] for key, _ in FRAMES]
            shown = [(views[n], FRAMES[n][1]) for n in (start, start + 1)]
            rgb = np.stack([view.rgb(t).transpose(2, 0, 1) for view, t in shown])
            depth = np.stack([view.depth(t) for view, t in shown if view.depth])
            yield {
                "where": FRAMES[start : start + 2],
                "front_rgb": (torch.from_numpy(rgb) / 127.5 - 1).to(self.device),
                "front_depth": torch.from_numpy(depth).to(self.device),
            }


def batches(
    root: Path, folder: Path, edits: list[dict[str, Any]], where: torch.device, **more: Any
) -> list[dict[str, Any]]:
    recipe = folder / "r.yaml"
    made = {"version": 1, "seed": more.pop("seed", 5), "edits": edits, "gates": None}
    recipe.write_text(json.dumps(made))
    found = wrap(
        Batches(root, where), root, recipe,
        episode=lambda sample: [key for key, _ in sample["where"]],
        frame=lambda sample: [t for _, t in sample["where"]],
        cameras=CAMERAS, **more,
    )  # fmt: skip
    return list(found)


@pytest.fixture
def torch_draws(monkeypatch: pytest.MonkeyPatch) -> list[OnDevice]:
    """Batches are drawn by torch wherever they are asked to be drawn on a device."""
    made: list[OnDevice] = []

    def drawer(device: str) -> OnDevice | None:
        if device == "cpu":
            return None
        made.append(OnDevice(torch.device(device.removeprefix("torch-"))))
        return made[-1]

    monkeypatch.setattr(wrapping, "_drawer", drawer)
    return made


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize(
    "edits",
    [[PAINT], [TEXTURE], [LIGHT], [TEXTURE, LIGHT, PAINT]],
    ids=["paint", "texture", "light", "all"],
)
def test_batches_are_those_of_the_host(
    template: Path,
    tmp_path: Path,
    torch_draws: list[OnDevice],
    edits: list[dict[str, Any]],
    device: torch.device,
) -> None:
    expected = batches(template, tmp_path, edits, ON_CPU)
    found = batches(template, tmp_path, edits, device, device=f"torch-{device}")
    assert sum(map(len, torch_draws[0].drawing.kept.values())) == len(FRAMES)
    plain = list(Batches(template, ON_CPU))
    for one, other, before in zip(found, expected, plain, strict=True):
        image, like = one["front_rgb"], other["front_rgb"]
        assert image.device.type == device.type
        assert image.dtype == like.dtype
        assert float((image.cpu() - like).abs().max()) <= 1.01 / 127.5
        assert not torch.equal(like, before["front_rgb"])
        same = like == before["front_rgb"]
        assert torch.equal(image.cpu()[same], like[same])
        assert torch.equal(one["front_depth"].cpu(), other["front_depth"])


def test_moved_cameras_are_drawn_on_the_host(
    template: Path, tmp_path: Path, torch_draws: list[OnDevice]
) -> None:
    expected = batches(template, tmp_path, [MOVE], ON_CPU)
    found = batches(template, tmp_path, [MOVE], ON_CPU, device="torch-cpu")
    assert not torch_draws[0].drawing.kept
    for one, other in zip(found, expected, strict=True):
        assert torch.equal(one["front_rgb"], other["front_rgb"])
        assert torch.equal(one["front_depth"], other["front_depth"])


def test_a_batch_may_hold_rows_of_either(
    template: Path, tmp_path: Path, torch_draws: list[OnDevice]
) -> None:
    edits = [PAINT, MOVE | {"probability": 0.5}]
    expected = batches(template, tmp_path, edits, ON_CPU, seed=6)
    found = batches(template, tmp_path, edits, ON_CPU, seed=6, device="torch-cpu")
    drawn = sum(map(len, torch_draws[0].drawing.kept.values()))
    assert 0 < drawn < len(FRAMES)
    for one, other in zip(found, expected, strict=True):
        assert float((one["front_rgb"] - other["front_rgb"]).abs().max()) <= 1.01 / 127.5
        assert torch.equal(one["front_depth"], other["front_depth"])


def test_a_batch_that_shows_another_frame_is_refused(
    template: Path, tmp_path: Path, torch_draws: list[OnDevice], monkeypatch: pytest.MonkeyPatch
) -> None:
    plain = Batches.__iter__

    def turned(self: Batches) -> Iterator[dict[str, Any]]:
        for batch in plain(self):
            yield batch | {"front_rgb": batch["front_rgb"].flip(-1)}

    monkeypatch.setattr(Batches, "__iter__", turned)
    with pytest.raises(Unsupported, match="front_rgb: found another image"):
        batches(template, tmp_path, [PAINT], ON_CPU, device="torch-cpu")
    assert torch_draws


def test_what_is_known_late_is_asked_for_at_the_end(
    template: Path, tmp_path: Path, torch_draws: list[OnDevice], monkeypatch: pytest.MonkeyPatch
) -> None:
    class Later:
        """An event of a device that is busy."""

        def query(self) -> bool:
            return False

        def synchronize(self) -> None:
            pass

    def see(self: OnDevice, fits: torch.Tensor, name: str) -> None:
        self._unseen.append((Later(), torch.tensor(False), name))

    monkeypatch.setattr(OnDevice, "_see", see)
    with pytest.raises(Unsupported, match="front_rgb: found another image"):
        batches(template, tmp_path, [PAINT], ON_CPU, device="torch-cpu")
    assert len(torch_draws[0].drawing.kept) == 1


def test_devices_that_are_not_there_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    with pytest.raises(Unsupported, match="device cuda: "):
        torch_device("cuda")
    with pytest.raises(Unsupported, match="expected auto, cpu, cuda"):
        torch_device("gpu")
    with pytest.raises(Unsupported, match="expected auto, cpu, cuda"):
        torch_device("meta")
    assert torch_device("auto").type == "cpu"
    assert wrapping._drawer("auto") is None
