"""Stored scenes: whole or absent, checked when read, found again by content."""

from dataclasses import replace
from pathlib import Path

import boxes
import numpy as np
import pytest
from boxes import World
from clouds import some

from rpaug.core.errors import BadInput
from rpaug.core.types import Body, Gaussians, Scene
from rpaug.gaussians import store
from rpaug.gaussians.fit import FitSettings


@pytest.fixture
def fitted(placed: tuple[World, Scene]) -> Scene:
    return replace(placed[1], gaussians=some(30))


def test_there_and_back(tmp_path: Path, fitted: Scene) -> None:
    store.save(tmp_path, "abc", fitted, settings=FitSettings(), report={"db": 35.5})
    stored = store.load(tmp_path, "abc")
    assert stored is not None
    assert fitted.gaussians is not None
    for name in Gaussians.ARRAYS:
        np.testing.assert_array_equal(
            getattr(stored.gaussians, name), getattr(fitted.gaussians, name)
        )
    assert [body.instance_ids for body in stored.bodies] == [
        body.instance_ids for body in fitted.bodies
    ]
    np.testing.assert_array_equal(stored.bodies[-1].to_world, fitted.bodies[-1].to_world)
    assert stored.report == {"db": 35.5}
    assert stored.settings["steps"] == FitSettings().steps


def test_absent_is_none(tmp_path: Path) -> None:
    assert store.load(tmp_path, "abc") is None


def test_a_second_save_is_refused(tmp_path: Path, fitted: Scene) -> None:
    store.save(tmp_path, "abc", fitted, settings={}, report={})
    with pytest.raises(BadInput, match="already"):
        store.save(tmp_path, "abc", fitted, settings={}, report={})


def test_a_scene_without_gaussians_is_refused_and_leaves_nothing(
    tmp_path: Path, placed: tuple[World, Scene]
) -> None:
    with pytest.raises(BadInput, match="no Gaussians"):
        store.save(tmp_path, "abc", placed[1], settings={}, report={})
    assert list(tmp_path.iterdir()) == []


def test_damage_is_found(tmp_path: Path, fitted: Scene) -> None:
    where = store.save(tmp_path, "abc", fitted, settings={}, report={})
    chunk = max((where / "gaussians/means").rglob("c/*/*"), key=lambda path: path.stat().st_size)
    data = bytearray(chunk.read_bytes())
    data[len(data) // 2] ^= 0xFF
    chunk.write_bytes(bytes(data))
    with pytest.raises(BadInput, match=r"gaussians/means: found .*expected an undamaged array"):
        store.load(tmp_path, "abc")


def test_another_version_is_refused(tmp_path: Path, fitted: Scene) -> None:
    where = store.save(tmp_path, "abc", fitted, settings={}, report={})
    facts = where / "zarr.json"
    facts.write_text(facts.read_text().replace(f'"version": {store.VERSION}', '"version": 99'))
    with pytest.raises(BadInput, match="rpaug scene 99; expected rpaug scene"):
        store.load(tmp_path, "abc")


def test_damaged_attributes_are_found(tmp_path: Path, fitted: Scene) -> None:
    facts = store.save(tmp_path, "abc", fitted, settings={}, report={}) / "zarr.json"
    facts.write_text(facts.read_text().replace('"residual": 0.0', '"residual": 0.5', 1))
    with pytest.raises(BadInput, match="attributes: found a wrong checksum"):
        store.load(tmp_path, "abc")


def test_arrays_are_compressed(tmp_path: Path, fitted: Scene) -> None:
    assert fitted.gaussians is not None
    flat = replace(fitted.gaussians, means=np.zeros_like(fitted.gaussians.means).repeat(500, 0))
    where = store.save(tmp_path, "abc", replace(fitted, gaussians=flat), settings={}, report={})
    files = [path for path in (where / "gaussians/means").rglob("*") if path.is_file()]
    assert sum(path.stat().st_size for path in files) < flat.means.nbytes / 20
    assert '"zstd"' in (where / "gaussians/means/zarr.json").read_text()


def test_a_failing_save_leaves_nothing(
    tmp_path: Path, fitted: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("zarr.Group.create_array", full)
    with pytest.raises(OSError, match="No space"):
        store.save(tmp_path, "abc", fitted, settings={}, report={})
    assert list(tmp_path.iterdir()) == []


def test_listing_naming_removing(tmp_path: Path, fitted: Scene) -> None:
    for name in ("abc", "abd"):
        store.save(tmp_path, name, fitted, settings={}, report={"db": 3})
    (tmp_path / ".half-x.part").mkdir()
    assert store.names(tmp_path) == ["abc", "abd"]
    given = store.described(tmp_path, "abd")
    assert (given["gaussians"], given["report"]) == (30, {"db": 3})
    assert store.named(tmp_path, "abd") == "abd"
    with pytest.raises(BadInput, match="2 scenes that begin with it; expected one of: abc, abd"):
        store.named(tmp_path, "ab")
    with pytest.raises(BadInput, match="no such scene"):
        store.named(tmp_path, "x")
    store.remove(tmp_path, "abc")
    assert store.names(tmp_path) == ["abd"]
    assert store.load(tmp_path, "abc") is None
    with pytest.raises(BadInput, match="no folder"):
        store.names(tmp_path / "elsewhere")


def test_the_key_follows_content_settings_and_seed_only() -> None:
    def name(
        world: World, settings: FitSettings, seed: int = 0, bodies: tuple[Body, ...] = ()
    ) -> str:
        episode = world.episode()
        cameras = {name: view.camera for name, view in episode.views.items()}
        return store.key(Scene(episode, cameras, bodies, {}, False, ()), settings, seed)

    plain = FitSettings()
    first = name(boxes.still(2), plain)
    assert name(boxes.still(2), plain) == first
    assert name(boxes.still(2), FitSettings(steps=7)) != first
    assert name(boxes.still(2), plain, 1) != first
    links = (Body(frozenset({boxes.OTHER}), np.tile(np.eye(4), (2, 1, 1)), "link"),)
    assert name(boxes.still(2), plain, 0, links) != first  # an arm's file that explains it
    painted = boxes.still(2)
    box = replace(painted.boxes[boxes.OTHER], color=(201, 0, 0))
    assert name(replace(painted, boxes={**painted.boxes, boxes.OTHER: box}), plain) != first
