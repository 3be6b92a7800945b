"""What the hdf5_sim adapter writes is read by robomimic's, LIBERO's and ManiSkill's own datasets, each in a process of
its own; what it re-observes is what robosuite sees."""

import sys
from pathlib import Path

import drivers
import h5py
import numpy as np
import pytest
from rpaug_adapters.hdf5_sim import HDF5Sim
from runs import augment

from rpaug.pipeline import recipe

sys.path.insert(0, str(Path(__file__).parents[1] / "adapters/hdf5_sim"))
import sim_samples

ADAPTER = HDF5Sim()
LIGHT = {"op": "light_color", "range": [[0.5, 0.5, 0.5], [0.6, 0.6, 0.6]]}
WANTED = {"version": 1, "keep_originals": True, "edits": [LIGHT]}


def written(source: Path, out: Path) -> Path:
    """Originals and copies of the samples in a folder."""
    assert augment(source, recipe.build(WANTED), out).exit_code == 0
    return out


def see_frames(frames: dict[str, np.ndarray], root: Path, key: str, ends: tuple[str, str]) -> None:
    """See that the first and last images that a reader gave of a demonstration are those that we read."""
    episode = ADAPTER.read(root, key)
    demo = key.rpartition("/")[2]
    last = sim_samples.STEPS - 1
    for name, view in episode.views.items():
        color = next(f"{name}{end}" for end in ends if f"{demo}/first/{name}{end}" in frames)
        for which, t in (("first", 0), ("last", last)):
            image = frames[f"{demo}/{which}/{color}"][0]
            image = image if image.shape[-1] == 3 else np.moveaxis(image, 0, -1)
            image = np.rint(image * 255) if image.max() <= 1 else image
            image = image[::-1] if ends == ("_rgb", "_rgb") else image
            assert np.array_equal(image.astype(np.uint8), view.rgb(t))


@pytest.mark.parametrize("libero", [False, True])
def test_sequence_datasets_read_what_we_write(libero: bool, tmp_path: Path) -> None:
    python = drivers.reader("robomimic/bin/python")
    repository = drivers.reader("robomimic_libero" if libero else "robomimic_now")
    name = "bowl" if libero else "lift"
    path = tmp_path / "in" / f"{name}.hdf5"
    (sim_samples.libero if libero else sim_samples.robomimic)(path)
    out = written(path.parent, tmp_path / "out")
    more = [drivers.reader("LIBERO")] if libero else []
    seen = tmp_path / "frames.npz"
    stated = drivers.run(python, "read_with_robomimic.py", repository, out / path.name, seen, *more)
    count = 2 if libero else 4
    assert stated["length"] == count * sim_samples.STEPS
    assert stated["filters"][""] == [f"demo_{i}" for i in range(count)]
    if not libero:
        assert stated["filters"]["train"] == ["demo_0", "demo_2"]
        assert stated["filters"]["valid"] == ["demo_1", "demo_3"]
    frames = dict(np.load(seen))
    for key in ADAPTER.episodes(out):
        see_frames(frames, out, key, ("_rgb", "_rgb") if libero else ("_image", "_image"))
    half = count // 2
    for i in range(half):
        same = (frames[f"demo_{n}/first/actions"] for n in (i, i + half))
        assert np.array_equal(*same)


def test_maniskills_own_dataset_reads_what_we_write(tmp_path: Path) -> None:
    python = drivers.reader("maniskill/bin/python")
    path = sim_samples.maniskill(tmp_path / "in/cube.h5")
    out, seen = written(path.parent, tmp_path / "out"), tmp_path / "frames.npz"
    stated = drivers.run(
        python, "read_with_maniskill.py", out / "cube.h5", seen, HOME=str(tmp_path)
    )
    assert stated["length"] == 4 * sim_samples.STEPS
    assert stated["seeds"] == [40, 41, 40, 41]
    frames = dict(np.load(seen))
    for i, key in enumerate(ADAPTER.episodes(out)):
        view = ADAPTER.read(out, key).views["base"]
        for t in range(sim_samples.STEPS):
            row = i * sim_samples.STEPS + t
            assert np.array_equal(frames["base/rgb"][row], view.rgb(t))
            assert np.array_equal(frames["base/segmentation"][row][..., 0], view.ids(t))


def test_robosuite_sees_what_was_reobserved(tmp_path: Path) -> None:
    """Depth bit for bit, and each instance a union of the geoms that robosuite's own segmentation names."""
    python = drivers.reader("robosuite/bin/python")
    here = {
        "PYTHONPATH": str(Path(__file__).parents[2]),
        "MUJOCO_GL": "egl",
        "CUDA_VISIBLE_DEVICES": "0",
    }
    seen = tmp_path / "seen.npz"
    drivers.run(python, "see_with_robosuite.py", tmp_path / "in/lift.hdf5", seen, **here)
    done, failures = ADAPTER.reobserve(
        tmp_path / "in", tmp_path / "out", python, lambda done, total: None
    )
    assert (done, failures) == (1, {})
    shown = dict(np.load(seen))
    with h5py.File(tmp_path / "out/lift.hdf5") as file:
        obs = file["data/demo_0/obs"]
        for name in ("agentview", "robot0_eye_in_hand"):
            assert np.array_equal(obs[f"{name}_depth"][()], shown[f"{name}_depth"])
            ids, geoms = obs[f"{name}_segmentation_instance"][()], shown[f"{name}_geoms"]
            for geom in np.unique(geoms):
                (same,) = np.unique(ids[geoms == geom])  # no geom in two instances
                assert (same == 0) == (geom < 0)
