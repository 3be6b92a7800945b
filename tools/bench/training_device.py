"""Augmented frames per second on a device, straight into training batches, and their share of a training step.

    python tools/bench/training_device.py DATASET [--device cuda] [--episodes 8] [--epochs 6] [--batch 64] [--json]

DATASET is in RLBench's layout; its first episode is copied so many times, so that each epoch draws as many copies. An
epoch shows every frame of every episode once, in batches of random ones that lie on the device already, as after a
loader; seconds run until the device has finished. `color` recolors the manipulated thing; `looks` edits every
appearance that `robust` knows. `host` is the same by the host on one thread. The step is a stand-in for RVT's: a
transformer of its size (Goyal et al. 2023: 8 layers of 512, heads of 64, patches of 11 over five 220 x 220 views, and
77 tokens of language), forward, backward and AdamW in bfloat16, which augments its batch first.
"""

import argparse
import json
import shutil
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import torch

from rpaug.core import registry
from rpaug.training import wrap

COLOR = {"op": "recolor", "target": {"role": "manipulated"}, "color": {"sample": "colosseum"}}
LOOKS = [
    COLOR,
    {"op": "retexture", "target": {"role": "receiver"}},
    {"op": "table_texture"},
    {"op": "background_texture"},
    {"op": "light_color", "range": [[0.36, 0.36, 0.33], [0.5, 0.5, 0.5]]},
]
RECIPES: dict[str, list[dict[str, Any]]] = {"color": [COLOR], "looks": LOOKS}
WIDTH, LAYERS, HEADS, PATCH, SIDE, WORDS = 512, 8, 8, 11, 220, 77  # RVT's


class Batches:
    """Recorded frames of all cameras as batches on a device, in an order drawn anew each time."""

    def __init__(self, root: Path, device: str, size: int) -> None:
        adapter = registry.adapter_for(root)
        self.keys = list(adapter.episodes(root))
        episode = adapter.read(root, self.keys[0])
        self.names, self.device, self.size = list(episode.views), device, size
        self.frames = {
            name: torch.from_numpy(
                np.stack([view.rgb(t).transpose(2, 0, 1) for t in range(episode.length)])
            ).to(device)
            for name, view in episode.views.items()
        }
        every = [(key, t) for key in self.keys for t in range(episode.length)]
        self.every, self.rng = every, np.random.default_rng(0)

    def __iter__(self) -> Iterator[dict[str, Any]]:
        order = self.rng.permutation(len(self.every))
        for start in range(0, len(order) - self.size + 1, self.size):
            chosen = [self.every[n] for n in order[start : start + self.size]]
            times = torch.tensor([t for _, t in chosen], device=self.device)
            images = {name: frames[times] / 127.5 - 1 for name, frames in self.frames.items()}
            yield {"where": chosen, **images}


def augmented(batches: Batches, root: Path, edits: list[dict[str, Any]], device: str) -> Any:
    """The batches, edited."""
    return wrap(
        batches,
        root,
        {"version": 1, "edits": edits},
        episode=lambda sample: [key for key, _ in sample["where"]],
        frame=lambda sample: [t for _, t in sample["where"]],
        cameras={name: name for name in batches.names},
        device=device,
        scenes=root.parent / "scenes",
    )


def linked(dataset: Path, folder: Path, episodes: int) -> Path:
    """A dataset of copies of the first episode, in a folder beside which there is room."""
    folder = folder / "dataset"
    adapter = registry.adapter_for(dataset)
    key = adapter.episodes(dataset)[0]
    for number in range(episodes):
        place = folder / Path(key).parent / f"episode{number}"
        place.parent.mkdir(parents=True, exist_ok=True)
        shutil.copytree(dataset / key, place)
    return folder


def waited(device: str) -> float:
    """The time once the device has finished."""
    if device != "cpu":
        torch.cuda.synchronize()
    return time.perf_counter()


def rates(
    root: Path, edits: list[dict[str, Any]], device: str, epochs: int, size: int
) -> dict[str, Any]:
    """Seconds to the first batch, and of each epoch after the first the frames a second, drawing of copies in it."""
    batches = Batches(root, device, size)
    start = waited(device)
    edited = augmented(batches, root, edits, device)
    next(iter(edited))
    first = waited(device) - start
    found = []
    for epoch in range(epochs):
        edited.set_epoch(epoch)
        start, count = waited(device), 0
        for batch in edited:
            count += sum(len(batch[name]) for name in batches.names)
        found.append(count / (waited(device) - start))
    plain = waited(device)
    for _ in batches:
        pass
    bare = waited(device) - plain
    return {
        "first_batch_s": round(first, 2),
        "first_epoch": round(found[0]),
        "frames_a_second": round(float(np.median(found[1:] or found))),
        "range": [round(min(found[1:] or found)), round(max(found[1:] or found))],
        "unedited_batches_s": round(bare, 3),
    }


class StandIn(torch.nn.Module):
    """A transformer of RVT's size over patches of five views and tokens of language."""

    def __init__(self, views: int) -> None:
        super().__init__()
        self.patches = torch.nn.Conv2d(3, WIDTH, PATCH, PATCH)
        tokens = views * (SIDE // PATCH) ** 2 + WORDS
        self.place = torch.nn.Parameter(0.02 * torch.randn(1, tokens, WIDTH))
        layer = torch.nn.TransformerEncoderLayer(
            WIDTH, HEADS, 4 * WIDTH, 0.1, "gelu", batch_first=True, norm_first=True
        )
        self.body = torch.nn.TransformerEncoder(layer, LAYERS, enable_nested_tensor=False)
        self.head = torch.nn.Linear(WIDTH, 224)

    def forward(self, views: torch.Tensor) -> torch.Tensor:
        batch = len(views)
        large = torch.nn.functional.interpolate(
            views.flatten(0, 1), (SIDE, SIDE), mode="bilinear", antialias=False
        )
        seen = self.patches(large).flatten(2).transpose(1, 2).reshape(batch, -1, WIDTH)
        words = seen.new_zeros(batch, WORDS, WIDTH)
        return self.head(self.body(torch.cat([seen, words], 1) + self.place).mean(1))


def step_share(
    root: Path, edits: list[dict[str, Any]], device: str, size: int, steps: int = 40
) -> dict[str, Any]:
    """Milliseconds of a step by itself, with its batch edited first while frames are decoded, and later."""
    batches = Batches(root, device, size)
    model = StandIn(len(batches.names)).to(device)
    adam = torch.optim.AdamW(model.parameters(), 1e-4)
    edited = augmented(batches, root, edits, device)

    def step(batch: dict[str, Any]) -> None:
        views = torch.stack([batch[name] for name in batches.names], 1)
        with torch.autocast(device, torch.bfloat16):
            loss = model(views).float().square().mean()
        adam.zero_grad()
        loss.backward()
        adam.step()

    def timed(source: Callable[[], Any]) -> float:
        done, epoch = 0, 0
        while True:
            edited.set_epoch(epoch)
            for batch in source():
                if done == 5:
                    start = waited(device)
                step(batch)
                done += 1
                if done == steps + 5:
                    return 1e3 * (waited(device) - start) / steps
            epoch += 1

    alone = timed(lambda: batches)
    both = timed(lambda: edited)
    for _ in edited:  # every frame is decoded then
        pass
    later = timed(lambda: edited)
    again = timed(lambda: batches)
    plain = min(alone, again)
    return {
        "step_ms": round(plain, 2),
        "other_run_ms": round(max(alone, again), 2),
        "augmented_ms": round(both, 2),
        "added_percent": round(100 * (both / plain - 1), 1),
        "later_ms": round(later, 2),
        "later_added_percent": round(100 * (later / plain - 1), 1),
        "batch": size,
    }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("dataset", type=Path)
    parser.add_argument("--device", default="cuda")
    parser.add_argument("--episodes", type=int, default=8)
    parser.add_argument("--epochs", type=int, default=6)
    parser.add_argument("--batch", type=int, default=64)
    parser.add_argument("--step-batch", type=int, default=24)
    parser.add_argument("--host", action="store_true", help="measure the host's rates too")
    parser.add_argument("--no-step", action="store_true")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    which = "cpu" if given.device == "cpu" else torch.cuda.get_device_name(0)

    def tell(name: str, facts: dict[str, Any]) -> None:
        print(json.dumps({name: facts}) if given.json else f"{name}: {facts}", flush=True)

    tell("device", {"torch": torch.__version__, "name": which})
    with tempfile.TemporaryDirectory() as folder:
        root = linked(given.dataset, Path(folder), given.episodes)
        for name, edits in RECIPES.items():
            tell(name, rates(root, edits, given.device, given.epochs, given.batch))
            if not given.no_step:
                tell(f"{name}, step", step_share(root, edits, given.device, given.step_batch))
            if given.host:
                tell(f"{name}, host", rates(root, edits, "cpu", 1, given.batch))


if __name__ == "__main__":
    main()
