"""RVT's replay buffer with edited images, depth, points and cameras. In RVT's environment, as in rvt/train.py."""

from rvt.utils.get_dataset import get_dataset
from rvt.utils.peract_utils import CAMERAS

from rpaug.training import Schedule, wrap

FOLDER = "all_variations/episodes/episode"

replay, _ = get_dataset(...)  # your arguments
augmented = wrap(
    replay,
    "data/train",
    "recipe.yaml",
    episode=lambda s: [
        f"{task}/{FOLDER}{int(n)}"
        for task, n in zip(s["tasks"], s["episode_idx"].flatten(), strict=True)
    ],
    frame=lambda s: s["sample_frame"].flatten().tolist(),
    cameras={
        name: {
            "rgb": f"{name}_rgb",
            "depth": f"{name}_depth",
            "points": f"{name}_point_cloud",
            "cam_to_world": f"{name}_camera_extrinsics",
        }
        for name in CAMERAS
    },
    schedule=Schedule(ratio=(1, 3)),
    scenes="cache/scenes",
)
