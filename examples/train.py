"""Train on edited episodes that no disk holds: every epoch draws anew, as `rpaug augment` would.

python train.py data/train recipe.yaml
"""

import sys

import torch
from torch.utils.data import DataLoader

from rpaug.training import AugmentedEpisodes, Schedule

DATASET, RECIPE = sys.argv[1:]
EPOCHS = 3

episodes = AugmentedEpisodes(
    DATASET,
    RECIPE,
    frames="key",  # PerAct's key frames
    cameras=["front"],
    schedule=Schedule(ratio=(1, 3)),  # of four episodes one is shown as recorded
    scenes="cache/scenes",  # what is found once is kept for later runs
)
loader = DataLoader(episodes, batch_size=None, num_workers=2, shuffle=True, persistent_workers=True)
policy = torch.nn.Sequential(
    torch.nn.AdaptiveAvgPool2d(8), torch.nn.Flatten(), torch.nn.LazyLinear(3)
)
optimizer = None
for epoch in range(EPOCHS):
    episodes.set_epoch(epoch)  # reaches running workers
    for item in loader:
        front = item["cameras"][
            "front"
        ]  # rgb (n, h, w, 3) uint8, depth in metres, ids, K, cam_to_world
        images = front["rgb"].permute(0, 3, 1, 2) / 255
        places = item["gripper_to_world"][:, :3, 3].float()
        loss = (policy(images) - places).square().mean()
        optimizer = optimizer or torch.optim.Adam(policy.parameters())
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    print(f"epoch {epoch}: loss {loss:.3f}")
