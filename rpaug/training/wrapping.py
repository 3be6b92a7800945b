"""Augmentation around a dataset that people already have: its own samples, with edited images put in their place."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import torch
from torch.utils.data import Dataset, IterableDataset

from rpaug.core import devices, geometry, registry
from rpaug.core.errors import Unsupported
from rpaug.core.types import CameraView, Episode
from rpaug.pipeline import inputs
from rpaug.pipeline.inputs import RecipeLike
from rpaug.training import matching
from rpaug.training.drawing import Drawn, Draws
from rpaug.training.matching import Layout
from rpaug.training.scenes import Scenes
from rpaug.training.schedule import Schedule, epoch_number

if TYPE_CHECKING:
    from rpaug.training.on_device import OnDevice, Row

Kind = Literal["rgb", "depth", "ids", "points", "K", "cam_to_world"]
Sample = Any
Cameras = Mapping[str, str | Mapping[Kind, str]]
CHANNELS = {"rgb": 3, "depth": 1, "ids": 1, "points": 3}
AXES = (  # signs of a matrix's columns: of OpenCV's axes, CoppeliaSim's as RLBench and RVT have them, OpenGL's
    (1, 1, 1, 1),
    (-1, -1, 1, 1),
    (1, -1, -1, 1),
)
KINDS = (*CHANNELS, "K", "cam_to_world")


class Wrapper:
    """Puts edited images into samples. `cameras` says where: per camera of the recording, the key of its color image,
    or a mapping of kinds to keys; `a/b` is key b of what stands at key a, unless `a/b` is a key itself."""

    def __init__(
        self,
        draws: Draws,
        episode: Callable[[Sample], Any],
        frame: Callable[[Sample], Any],
        cameras: Cameras,
        device: "OnDevice | None" = None,
    ) -> None:
        self.draws, self.episode, self.frame, self.device = draws, episode, frame, device
        self.cameras: dict[str, dict[Kind, str]] = {
            name: {"rgb": keys} if isinstance(keys, str) else dict(keys)
            for name, keys in cameras.items()
        }
        adapter = registry.adapter(draws.scenes.adapter)
        self.every = list(adapter.episodes(draws.scenes.root))
        self.number = {key: number for number, key in enumerate(draws.keys)}
        self._epoch = torch.zeros((), dtype=torch.int64).share_memory_()

    @property
    def epoch(self) -> int:
        """The epoch whose draws samples show."""
        return int(self._epoch)

    def set_epoch(self, epoch: int) -> None:
        """Draw anew; reaches workers that are already running. Raises Unsupported below 0."""
        self.settle()
        self._epoch.fill_(epoch_number(epoch))

    def settle(self) -> None:
        """Raises Unsupported if a batch that a device drew did not show what was recorded: that is known later."""
        if self.device is not None:
            self.device.settle()

    def __call__(self, sample: Sample) -> Sample:
        """The sample with its images edited, everything else as it was. Raises Unsupported.

        A value that no edit changes stays as the sample has it.
        """
        named, asked = self.episode(sample), self.frame(sample)
        places = {
            place: _get(sample, place) for keys in self.cameras.values() for place in keys.values()
        }
        if isinstance(named, str | int | np.integer):
            made = self._edited(named, asked, places)
        else:
            made = self._batch(list(zip(named, asked, strict=True)), places)
        for place, value in made.items():
            if value is not places[place]:
                sample = _put(sample, place, value)
        return sample

    def _batch(self, asked: Sequence[tuple[Any, Any]], places: Mapping[str, Any]) -> dict[str, Any]:
        """What stands at the places of a batch once its episodes are edited: drawn on a device, where that serves."""
        made, on_host = dict(places), list(range(len(asked)))
        if self.device is not None:
            rows = [self._row(*one) for one in asked]
            at = self.device.rows(rows, self.cameras, places)
            on_host = [n for n in on_host if n not in set(at)]
            drawn = [row for n in at if (row := rows[n])]
            if at:
                shown = self.device(drawn, at, self.cameras, places)
                made |= {name: _with(places[name], at, images) for name, images in shown.items()}
        for n in on_host:
            own = {place: value[n] for place, value in places.items()}
            for place, value in self._edited(*asked[n], own).items():
                if value is not own[place]:
                    if made[place] is places[place]:
                        made[place] = _with(places[place], [], None)
                    made[place][n] = value
        return made

    def _row(self, named: Any, asked: Any) -> "Row | None":
        from rpaug.training.on_device import Row  # only here: it is asked for with a device

        drawn = self._drawn(self._key(named))
        return None if drawn is None else Row(drawn, self._frames(drawn.episode, asked))

    def _drawn(self, key: str) -> Drawn | None:
        """The copy of an episode; None where the recipe does not select it, or nothing is edited."""
        if key not in self.number:
            return None
        drawn = self.draws(self.number[key], self.epoch)
        return drawn if drawn.edits else None

    def _frames(self, episode: Episode, asked: Any) -> list[int]:
        frames = [int(t) for t in np.atleast_1d(np.asarray(asked))]
        for t in frames:
            if not 0 <= t < episode.length:
                raise Unsupported(
                    f"{episode.key}: found frame {t}; expected 0 to {episode.length - 1}"
                )
        return frames

    def _edited(
        self, named: str | int | np.integer, asked: Any, places: Mapping[str, Any]
    ) -> dict[str, Any]:
        """What stands at those places once the episode is edited."""
        made, key = dict(places), self._key(named)
        drawn = self._drawn(key)
        if drawn is None:
            return made
        edited, recorded = drawn.episode, self.draws.scenes(key).episode
        frames = self._frames(recorded, asked)
        for camera, keys in self.cameras.items():
            if camera not in recorded.views:
                known = ", ".join(recorded.views)
                raise Unsupported(f"{key}: no camera is called {camera!r}; there are: {known}")
            views = recorded.views[camera], edited.views[camera]
            for kind, place in keys.items():
                if np.prod(places[place].shape):
                    made[place] = _shown(*views, kind, frames, places[place], place)
        return made

    def _key(self, named: str | int | np.integer) -> str:
        if isinstance(named, int | np.integer):
            if not 0 <= named < len(self.every):
                raise Unsupported(f"episode {named}: expected 0 to {len(self.every) - 1}")
            return self.every[int(named)]
        if named not in self.every:
            few = ", ".join(self.every[:4])
            raise Unsupported(f"episode {named!r}: expected a number or a key such as {few}")
        return named


class WrappedDataset(Dataset[Any]):
    """A map-style dataset whose samples are edited; what it does not know itself it asks of `dataset`."""

    def __init__(self, dataset: Any, wrapper: Wrapper) -> None:
        self.dataset, self.wrapper = dataset, wrapper

    def set_epoch(self, epoch: int) -> None:
        """Draw anew; reaches workers that are already running."""
        self.wrapper.set_epoch(epoch)

    def __len__(self) -> int:
        return len(self.dataset)

    def __getitem__(self, index: Any) -> Any:
        return self.wrapper(self.dataset[index])


class WrappedStream(IterableDataset[Any]):
    """An iterable dataset whose samples are edited; how it is shared out among workers stays its own matter."""

    def __init__(self, dataset: Any, wrapper: Wrapper) -> None:
        self.dataset, self.wrapper = dataset, wrapper

    def set_epoch(self, epoch: int) -> None:
        """Draw anew; reaches workers that are already running."""
        self.wrapper.set_epoch(epoch)

    def __iter__(self) -> Iterator[Any]:
        yield from map(self.wrapper, self.dataset)
        self.wrapper.settle()


def wrap(
    dataset: Any,
    recordings: Path | str,
    recipe: RecipeLike,
    *,
    episode: Callable[[Sample], Any],
    frame: Callable[[Sample], Any],
    cameras: Cameras,
    schedule: Schedule | None = None,
    scenes: Path | str | None = None,
    tier: int = 0,
    device: str = "cpu",
) -> WrappedDataset | WrappedStream:
    """`dataset` with the images of its samples edited as the recipe says, one draw per (epoch, episode).

    `recordings` is the dataset on disk that the samples come from, in any layout rpaug reads; `recipe` a file, the name
    of a shipped one, a dict or a `Recipe`. `episode` names a
    sample's episode there, by key or by number in natural order; `frame` its frame, or frames where images are stacked.
    Of a batch both give a list, one entry a row.
    `cameras` maps cameras of the recording to keys of the sample: `{"front": "front_rgb"}`, or
    `{"front": {"rgb": "front_rgb", "points": "front_point_cloud"}}` with the kinds rgb, depth (metres), ids, points
    (metres, world), K and cam_to_world (camera axes of OpenCV, CoppeliaSim or OpenGL). Axes, range, normalisation and
    size of images are found by comparing with the recording; a sample that does not show the recorded frame is refused.
    Arrays and tensors keep their type and shape. With a `device` ("cuda", "cuda:1", "auto"), color images of batches
    are drawn there, where recorded frames stay: wrap the loader then, whose batches may lie on the device already. What
    is drawn on the host all the same, rows of copies with moved cameras or put-in things, is as it is without.
    Samples must be mappings; they are copied where they change. Raises BadInput, BadRecipe, Unsupported.
    """
    for camera, keys in cameras.items():
        unknown = [] if isinstance(keys, str) else [kind for kind in keys if kind not in KINDS]
        if unknown:
            known = ", ".join(KINDS)
            raise Unsupported(f"cameras: {camera}: found {unknown[0]!r}; expected some of: {known}")
    held = Scenes(
        registry.dataset(recordings),
        inputs.recipe(recipe),
        inputs.tier(tier),
        Path(scenes) if scenes else None,
    )
    drawer = _drawer(device)
    draws = Draws(held, schedule or Schedule(), drawer.cameras if drawer else None)
    wrapper = Wrapper(draws, episode, frame, cameras, drawer)
    if hasattr(dataset, "__getitem__") and hasattr(dataset, "__len__"):
        return WrappedDataset(dataset, wrapper)
    return WrappedStream(dataset, wrapper)


def _drawer(device: str) -> "OnDevice | None":
    """What draws on a GPU; None for the host. Raises Unsupported."""
    if device == "cpu" or (found := devices.torch_device(device)).type == "cpu":
        return None
    from rpaug.training.on_device import OnDevice  # only here: its modules are many

    return OnDevice(found)


def _shown(
    before: CameraView, after: CameraView, kind: Kind, frames: list[int], value: Any, name: str
) -> Any:
    """The value as it is after the edit, in the sample's own layout."""
    if kind in ("K", "cam_to_world"):
        return _matrices(before, after, kind, frames, value, name)
    layout = Layout.of(name, value, CHANNELS[kind])
    shown = layout.images(value)
    if len(shown) != len(frames):
        raise Unsupported(f"{name}: found {len(shown)} images; expected {len(frames)}, one a frame")
    size = shown.shape[1], shown.shape[2]
    near = kind != "rgb"
    old = matching.resized([_image(before, kind, t, name) for t in frames], size, near)
    new = matching.resized([_image(after, kind, t, name) for t in frames], size, near)
    factor, offset = matching.scale(name, shown, old, free=kind == "rgb")
    made = np.where(old == new, shown, new * factor + offset)
    return layout.back(made.astype(np.float32), value)


def _image(view: CameraView, kind: Kind, t: int, name: str) -> np.ndarray:
    """One image of that kind, as recorded or rendered. Raises Unsupported where the recording has none."""
    read = {"rgb": view.rgb, "depth": view.depth, "ids": view.ids, "points": view.depth}[kind]
    if read is None:
        raise Unsupported(f"{name}: the recording has no {kind}")
    if kind != "points":
        return read(t)
    points = geometry.unproject(read(t).astype(np.float64), view.camera.K)
    return geometry.transform(view.camera.cam_to_world[t], points)


def _matrices(
    before: CameraView, after: CameraView, kind: Kind, frames: list[int], value: Any, name: str
) -> Any:
    """A camera matrix, or one a frame, where the sample holds the recorded one, by any of the `AXES`."""

    def of(view: CameraView) -> np.ndarray:
        return view.camera.K[None] if kind == "K" else view.camera.cam_to_world[frames]

    size = of(before).shape[-1]
    array = np.asarray(value, np.float64).reshape(-1, *of(before).shape[1:])
    for signs in AXES:
        old, new = (of(view) * np.array(signs)[:size] for view in (before, after))
        if np.allclose(array, old, atol=1e-3, rtol=1e-3):
            break
    else:
        raise Unsupported(f"{name}: found another matrix; expected the recorded {kind}")
    made = np.where(old == new, array, new).reshape(value.shape)
    if isinstance(value, torch.Tensor):
        return torch.from_numpy(made).to(value.dtype)
    return made.astype(value.dtype)


def _with(values: Any, at: Sequence[int], rows: Any) -> Any:
    """A batch's values with some rows replaced; a copy."""
    if len(at) == len(values):
        return rows
    made = values.clone() if isinstance(values, torch.Tensor) else np.copy(values)
    if at:
        made[list(at)] = rows
    return made


def _get(sample: Mapping[str, Any], place: str) -> Any:
    """What stands at a key, or at a path of keys. Raises Unsupported."""
    here: Any = sample
    for part in [place] if place in sample else place.split("/"):
        if not isinstance(here, Mapping) or part not in here:
            known = ", ".join(map(str, here))[:200] if isinstance(here, Mapping) else "no mapping"
            raise Unsupported(f"sample: no {place!r}; there are: {known}")
        here = here[part]
    return here


def _put(sample: Mapping[str, Any], place: str, value: Any) -> dict[str, Any]:
    """The sample with another value there; mappings on the way are copied."""
    if place in sample or "/" not in place:
        return {**sample, place: value}
    part, rest = place.split("/", 1)
    return {**sample, part: _put(sample[part], rest, value)}
