"""RDT's dataset with edited images; its samples do not name their file, so they are made to. In RDT's environment."""

from data.hdf5_vla_dataset import HDF5VLADataset

from rpaug.training import wrap


class Samples:
    """RDT's samples with the number of their episode."""

    def __init__(self):
        self.rdt = HDF5VLADataset()

    def __len__(self):
        return len(self.rdt)

    def __getitem__(self, index):
        return self.rdt.get_item(index) | {"episode": index}


augmented = wrap(
    Samples(),
    "data/datasets/mine",
    "recipe.yaml",
    episode=lambda s: s["episode"],
    frame=lambda s: [max(0, s["meta"]["step_id"] - 1), s["meta"]["step_id"]],
    cameras={
        "cam_high": "cam_high",
        "cam_right_wrist": "cam_right_wrist",
    },  # rpaug's names and RDT's
)
