"""A small policy after RVT: where the gripper goes next, read off three orthographic images by a shared U-Net.

Goyal et al. 2023 (arXiv 2306.14896), made small: heat maps on a cube of 64 cells a side, the approach axis, the axis
along which the fingers open (its sign is free, as a gripper is the same after half a turn), and open or closed.
"""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Float32, Int
from torch import Tensor, nn
from torch.nn import functional

from tools.bench.closed_loop.views import AXES, CHANNELS, GRID, cells, metres

WIDTHS = (16, 24, 32, 48)
SPREAD = 0.8  # cells: standard deviation of the heat that is asked for
AROUND = 2  # cells to each side of the peak that its position is averaged over


@dataclass(frozen=True)
class Action:
    """Where the gripper goes: its pose in the world, and whether it is open then."""

    pose: Float[np.ndarray, "4 4"]
    open: bool


@dataclass(frozen=True)
class Targets:
    """What a batch asks for: positions in cells, approach axes, opening axes, open (1) or closed (0)."""

    cell: Float[Tensor, "b 3"]
    approach: Float[Tensor, "b 3"]
    across: Float[Tensor, "b 3"]
    open: Float[Tensor, "b"]


class Policy(nn.Module):
    """Images and what is going on to heat maps and features; `tasks` counts goals, `most` the key poses of one."""

    def __init__(self, tasks: int, most: int) -> None:
        super().__init__()
        self.tasks, self.most = tasks, most
        first, *rest = WIDTHS
        self.enter = _block(CHANNELS + 3, first)
        self.down = nn.ModuleList([_block(a, b) for a, b in zip(WIDTHS, rest, strict=False)])
        self.up = nn.ModuleList(
            [_block(a + b, a) for a, b in zip(WIDTHS[-2::-1], WIDTHS[:0:-1], strict=True)]
        )
        self.told = nn.ModuleList([nn.Linear(tasks * most, 2 * wide) for wide in WIDTHS[::-1]])
        self.heat = nn.Conv2d(first, 1, 1)
        self.head = nn.Sequential(
            nn.Linear(3 * (first + WIDTHS[-1]) + tasks * most, 64), nn.ReLU(), nn.Linear(64, 10)
        )

    def forward(
        self, images: Float[Tensor, "b 3 c h w"], goal: Int[Tensor, "b"]
    ) -> tuple[Float[Tensor, "b 3 h w"], Float[Tensor, "b 3 f h w"], Float[Tensor, "b k"]]:
        """Heat of each view, features of each pixel, and what the whole says. `goal` numbers task and key pose."""
        batch = len(images)
        which = torch.eye(3)[:, :, None, None].expand(3, 3, GRID, GRID)
        x = torch.cat([images, which.expand(batch, 3, 3, GRID, GRID)], 2).flatten(0, 1)
        goals = functional.one_hot(goal, self.tasks * self.most).float()
        x = self.enter(x)
        kept = [x]
        for layer in self.down:
            x = layer(functional.max_pool2d(x, 2))
            kept.append(x)
        x = _told(self.told[0], goals, x)
        whole = x.amax((2, 3)).unflatten(0, (batch, 3)).flatten(1)
        for layer, told, skip in zip(self.up, self.told[1:], kept[-2::-1], strict=True):
            x = layer(torch.cat([functional.interpolate(x, scale_factor=2.0), skip], 1))
            x = _told(told, goals, x)
        heat = self.heat(x).squeeze(1).unflatten(0, (batch, 3))
        return heat, x.unflatten(0, (batch, 3)), torch.cat([whole, goals], 1)

    def turned(
        self,
        features: Float[Tensor, "b 3 f h w"],
        whole: Float[Tensor, "b k"],
        at: Float[Tensor, "b 3"],
    ) -> Float[Tensor, "b 10"]:
        """Approach axis (3), the opening axis's outer product (6), open (1, a logit), at positions in cells."""
        pixel = at.long().clamp(0, GRID - 1)
        rows = torch.arange(len(at))
        local = [
            features[rows, view, :, pixel[:, up], pixel[:, right]]
            for view, (right, up, _) in enumerate(AXES)
        ]
        return self.head(torch.cat([*local, whole], 1))


def loss(
    policy: Policy, images: Float[Tensor, "b 3 c h w"], goal: Int[Tensor, "b"], wanted: Targets
) -> Float[Tensor, ""]:
    """Cross-entropy of the heat maps and of open or closed, squared errors of the axes."""
    heat, features, whole = policy(images, goal)
    asked = _asked(wanted.cell)
    found = functional.log_softmax(heat.flatten(2), -1)
    where = -(asked.flatten(2) * found).sum(-1).mean()
    head = policy.turned(features, whole, wanted.cell)
    axes = functional.mse_loss(head[:, :3], wanted.approach)
    outer = functional.mse_loss(head[:, 3:9], _outer(wanted.across))
    grip = functional.binary_cross_entropy_with_logits(head[:, 9], wanted.open)
    return where + 5 * axes + 5 * outer + 0.5 * grip


@torch.no_grad()
def decide(policy: Policy, images: Float32[np.ndarray, "3 c h w"], goal: int) -> Action:
    """The next key pose."""
    heat, features, whole = policy(torch.from_numpy(images)[None], torch.tensor([goal]))
    cell = located(heat[0])
    head = policy.turned(features, whole, torch.tensor(cell.copy())[None].float())[0].numpy()
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation(head[:3], head[3:9]), metres(cell)
    return Action(pose, bool(head[9] > 0))


def located(heat: Float[Tensor, "3 h w"]) -> Float[np.ndarray, "3"]:
    """The position in cells where the views' heat agrees best, averaged around the peak."""
    from_above, ahead, left = heat
    volume = (  # indexed z, y, x
        from_above[None] + ahead[:, :, None] + left[:, None, :]
    )
    peak = np.array(np.unravel_index(int(volume.argmax()), volume.shape))
    low, high = np.maximum(peak - AROUND, 0), np.minimum(peak + AROUND + 1, GRID)
    part = volume[low[0] : high[0], low[1] : high[1], low[2] : high[2]]
    weights = torch.softmax(part.flatten(), 0).reshape(part.shape).numpy()
    grids = np.meshgrid(
        *(np.arange(a, b) + 0.5 for a, b in zip(low, high, strict=True)), indexing="ij"
    )
    return np.array([(weights * grid).sum() for grid in grids])[::-1]


def rotation(
    approach: Float[np.ndarray, "3"], outer: Float[np.ndarray, "6"]
) -> Float[np.ndarray, "3 3"]:
    """The gripper's axes: z the approach, y the strongest direction of the outer product, turned towards +y."""
    z = np.asarray(approach, float) / max(float(np.linalg.norm(approach)), 1e-9)
    xx, yy, zz, xy, xz, yz = outer
    y = np.linalg.eigh(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], float))[1][:, -1]
    y = y - (y @ z) * z
    y *= (1.0 if y[1] >= 0 else -1.0) / max(float(np.linalg.norm(y)), 1e-9)
    return np.stack([np.cross(y, z), y, z], 1)


def targets(poses: Float[np.ndarray, "b 4 4"], opened: Float[np.ndarray, "b"]) -> Targets:
    """What poses of the gripper ask of the policy."""

    def tensor(values: np.ndarray) -> Tensor:
        return torch.from_numpy(np.ascontiguousarray(values, np.float32))

    return Targets(
        tensor(np.clip(cells(poses[:, :3, 3]), 0.5, GRID - 0.5)),  # the home pose is above the cube
        tensor(poses[:, :3, 2]),
        tensor(poses[:, :3, 1]),
        tensor(opened),
    )


def _told(layer: nn.Module, goals: Float[Tensor, "b g"], x: Float[Tensor, "v f h w"]) -> Tensor:
    """Features scaled and shifted by what is to be done (Perez et al. 2018, arXiv 1709.07871)."""
    scale, shift = layer(goals).repeat_interleave(3, 0)[..., None, None].chunk(2, 1)
    out: Tensor = x * (1 + scale) + shift
    return out


def _outer(across: Float[Tensor, "b 3"]) -> Float[Tensor, "b 6"]:
    x, y, z = across.unbind(1)
    return torch.stack([x * x, y * y, z * z, x * y, x * z, y * z], 1)


def _asked(cell: Float[Tensor, "b 3"]) -> Float[Tensor, "b 3 h w"]:
    """Each view's heat: a Gaussian around where the position falls in it."""
    line = torch.arange(GRID) + 0.5
    bumps = torch.exp(-((line - cell[..., None]) ** 2) / (2 * SPREAD**2))  # b 3 n
    maps = [bumps[:, up, :, None] * bumps[:, right, None, :] for right, up, _ in AXES]
    heat = torch.stack(maps, 1)
    return heat / heat.sum((2, 3), keepdim=True).clamp_min(1e-9)


def _block(entering: int, leaving: int) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(entering, leaving, 3, padding=1),
        nn.GroupNorm(4, leaving),
        nn.ReLU(),
        nn.Conv2d(leaving, leaving, 3, padding=1),
        nn.GroupNorm(4, leaving),
        nn.ReLU(),
    )
