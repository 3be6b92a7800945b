"""LeRobotDataset with edited images. Wants the extra `lerobot`, and LeRobot itself."""

from lerobot.datasets.lerobot_dataset import LeRobotDataset

from rpaug.training import wrap

ROOT = "data/my_dataset"

lerobot = LeRobotDataset("me/my_dataset", root=ROOT)
colors = [key for key in lerobot.meta.camera_keys if key not in lerobot.meta.depth_keys]
augmented = wrap(
    lerobot,
    ROOT,
    "recipe.yaml",
    episode=lambda s: int(s["episode_index"]),
    frame=lambda s: int(s["frame_index"]),
    cameras={key.removeprefix("observation.images."): key for key in colors},
    scenes="cache/scenes",
)
