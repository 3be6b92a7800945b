"""A small policy that sees the table from above: a U-Net's heat map says where the gripper goes next.

What is there then says how high, the approach axis, the axis along which the fingers open (its sign is free, as a
gripper is the same after half a turn), and open or closed. Heat maps over a table are those of Zeng et al. 2020
(Transporter Networks, arXiv 2010.14406), key poses one after the other RVT's (Goyal et al. 2023, arXiv 2306.14896).
"""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Float32, Int
from torch import Tensor, nn
from torch.nn import functional

from tools.bench.closed_loop.views import CHANNELS, GRID, cells, metres

WIDTHS = (16, 24, 32, 48)
HIDDEN = 96  # of the head
AXES = 9  # numbers of its axes: the approach, and the opening axis's outer product
TILT = np.deg2rad(10.0)  # an approach leans by a whole number of these; RVT's bins are 5 degrees
SPREAD = 0.8  # cells: standard deviation of the heat that is asked for
AROUND = 2  # cells to each side of a peak that its position is averaged over


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


@dataclass(frozen=True)
class Grip:
    """What the policy says at a place: heat of each height, approach axis, the opening axis's outer product (xx, yy,
    zz, xy, xz, yz), and a logit of open."""

    height: Float[Tensor, "b z"]
    approach: Float[Tensor, "b 3"]
    outer: Float[Tensor, "b 6"]
    open: Float[Tensor, "b"]


class Policy(nn.Module):
    """An image and what is going on to heat and features; `tasks` counts goals, `most` the key poses of one."""

    def __init__(self, tasks: int, most: int) -> None:
        super().__init__()
        self.tasks, self.most = tasks, most
        goals = tasks * most
        first, *rest = WIDTHS
        self.enter = _block(CHANNELS, first)
        self.down = nn.ModuleList([_block(a, b) for a, b in zip(WIDTHS, rest, strict=False)])
        self.up = nn.ModuleList(
            [_block(a + b, a) for a, b in zip(WIDTHS[-2::-1], WIDTHS[:0:-1], strict=True)]
        )
        self.given = nn.ModuleList([nn.Linear(goals, 2 * wide) for wide in WIDTHS[::-1]])
        self.heat = nn.Conv2d(first, 1, 1)
        self.head = nn.Sequential(
            nn.Linear(first + 9 * CHANNELS + WIDTHS[-1] + goals, HIDDEN),
            nn.ReLU(),
            nn.Linear(HIDDEN, GRID + AXES + 1),
        )

    def forward(
        self, images: Float[Tensor, "b c h w"], goal: Int[Tensor, "b"]
    ) -> tuple[Float[Tensor, "b h w"], Float[Tensor, "b f h w"], Float[Tensor, "b k"]]:
        """Heat and features of each pixel, and what the whole says. `goal` numbers task and key pose."""
        goals = functional.one_hot(goal, self.tasks * self.most).float()
        x = self.enter(images.contiguous(memory_format=torch.channels_last))
        kept = [x]
        for layer in self.down:
            x = layer(functional.max_pool2d(x, 2))
            kept.append(x)
        x = _given(self.given[0], goals, x)
        whole = x.amax((2, 3))
        for layer, given, skip in zip(self.up, self.given[1:], kept[-2::-1], strict=True):
            x = layer(torch.cat([functional.interpolate(x, scale_factor=2.0), skip], 1))
            x = _given(given, goals, x)
        return self.heat(x).squeeze(1), x, torch.cat([whole, goals], 1)

    def grip(
        self,
        images: Float[Tensor, "b c h w"],
        features: Float[Tensor, "b f h w"],
        whole: Float[Tensor, "b k"],
        at: Float[Tensor, "b n"],
    ) -> Grip:
        """How the gripper is to be there; `at` begins with x and y in cells.

        The pixels around go along as they are: a height must be as exact as what was measured.
        """
        x, y = at[:, :2].long().clamp(0, GRID - 1).unbind(1)
        rows = torch.arange(len(at))
        edge = functional.pad(images, (1, 1, 1, 1))
        around = [edge[rows, :, y + j, x + i] for j in range(3) for i in range(3)]
        local = features[rows, :, y, x]
        out = self.head(torch.cat([local, *around, whole], 1).float())
        height, approach, outer, opened = out.split([GRID, 3, 6, 1], 1)
        return Grip(height, approach, outer, opened[:, 0])


def loss(
    policy: Policy, images: Float[Tensor, "b c h w"], goal: Int[Tensor, "b"], wanted: Targets
) -> Float[Tensor, ""]:
    """Cross-entropy of the heat, of the height and of open or closed, squared errors of the axes."""
    heat, features, whole = policy(images, goal)
    where = _cross(heat.flatten(1), asked(wanted.cell).flatten(1))
    grip = policy.grip(images, features, whole, wanted.cell)
    height = _cross(grip.height, _bump(wanted.cell[:, 2]))
    axes = functional.mse_loss(grip.approach, wanted.approach)
    outer = functional.mse_loss(grip.outer, outer_product(wanted.across))
    opened = functional.binary_cross_entropy_with_logits(grip.open, wanted.open)
    return where + height + 5 * axes + 5 * outer + 0.5 * opened


@torch.no_grad()
def decide(policy: Policy, image: Float32[np.ndarray, "c h w"], goal: int) -> Action:
    """The next key pose."""
    images = torch.from_numpy(image)[None]
    heat, features, whole = policy(images, torch.tensor([goal]))
    y, x = located(heat[0])
    grip = policy.grip(images, features, whole, torch.tensor([[x, y]]))
    (z,) = located(grip.height[0])
    pose = np.eye(4)
    pose[:3, :3] = rotation(grip.approach[0].numpy(), grip.outer[0].numpy())
    pose[:3, 3] = metres(np.array([x, y, z]))
    return Action(pose, bool(grip.open[0] > 0))


def located(heat: Float[Tensor, "*n"]) -> Float[np.ndarray, "k"]:
    """The hottest place in cells, one number for each axis of `heat`, averaged around its peak."""
    peak = np.unravel_index(int(heat.argmax()), heat.shape)
    near = tuple(slice(max(at - AROUND, 0), at + AROUND + 1) for at in peak)
    part = heat[near].float()
    weights = torch.softmax(part.flatten(), 0).reshape(part.shape).numpy()
    grids = np.meshgrid(
        *(side.start + 0.5 + np.arange(n) for side, n in zip(near, part.shape, strict=True)),
        indexing="ij",
    )
    return np.array([(weights * grid).sum() for grid in grids])


def rotation(
    approach: Float[np.ndarray, "3"], outer: Float[np.ndarray, "6"]
) -> Float[np.ndarray, "3 3"]:
    """The gripper's axes: z the approach in steps of `TILT`, y the strongest direction of the outer product, turned
    towards +y.

    The steps matter where a gripper comes from above: two degrees move its hand by a centimetre, and the next pose
    would be read off a hand that stands where no recording had it.
    """
    z = _stepped(np.asarray(approach, float))
    xx, yy, zz, xy, xz, yz = outer
    y = np.linalg.eigh(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], float))[1][:, -1]
    y = y - (y @ z) * z
    y *= (1.0 if y[1] >= 0 else -1.0) / max(float(np.linalg.norm(y)), 1e-9)
    return np.stack([np.cross(y, z), y, z], 1)


def _stepped(approach: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    """The unit vector that leans by the nearest whole number of steps towards the same side."""
    level = float(np.hypot(*approach[:2]))
    lean = round(float(np.arctan2(level, -approach[2])) / TILT) * TILT
    side = approach[:2] / max(level, 1e-9)
    return np.array([*(np.sin(lean) * side), -np.cos(lean)])


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


def asked(cell: Float[Tensor, "b 3"]) -> Float[Tensor, "b h w"]:
    """The heat that is asked for: a Gaussian around where the position falls."""
    return _bump(cell[:, 1])[:, :, None] * _bump(cell[:, 0])[:, None, :]


def outer_product(across: Float[Tensor, "b 3"]) -> Float[Tensor, "b 6"]:
    """Of an axis with itself: the same for both its signs. Entries xx, yy, zz, xy, xz, yz."""
    x, y, z = across.unbind(1)
    return torch.stack([x * x, y * y, z * z, x * y, x * z, y * z], 1)


def _bump(at: Float[Tensor, "b"]) -> Float[Tensor, "b n"]:
    """A Gaussian over the cells of one axis; sums to one."""
    heat = torch.exp(-((torch.arange(GRID) + 0.5 - at[:, None]) ** 2) / (2 * SPREAD**2))
    return heat / heat.sum(1, keepdim=True)


def _cross(heat: Float[Tensor, "b n"], wanted: Float[Tensor, "b n"]) -> Float[Tensor, ""]:
    return -(wanted * functional.log_softmax(heat, -1)).sum(-1).mean()


def _given(layer: nn.Module, goals: Float[Tensor, "b g"], x: Float[Tensor, "b f h w"]) -> Tensor:
    """Features scaled and shifted by what is to be done (Perez et al. 2018, arXiv 1709.07871)."""
    scale, shift = layer(goals)[..., None, None].chunk(2, 1)
    out: Tensor = x * (1 + scale) + shift
    return out


def _block(entering: int, leaving: int) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(entering, leaving, 3, padding=1),
        nn.GroupNorm(4, leaving),
        nn.ReLU(),
        nn.Conv2d(leaving, leaving, 3, padding=1),
        nn.GroupNorm(4, leaving),
        nn.ReLU(),
    )
