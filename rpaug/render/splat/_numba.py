"""The CPU backend: one object that renders a view and remembers what its backward pass needs."""

from typing import Any

import numpy as np
from jaxtyping import Float32

from rpaug.core.errors import Unsupported
from rpaug.render.splat import (
    _binning,
    _compositing,
    _compositing_backward,
    _images,
    _pinhole,
    _projection,
    _projection_backward,
)
from rpaug.render.splat._pinhole import DEPTH_CHANNEL, MOMENTS
from rpaug.render.splat._simd import WIDTH
from rpaug.render.splat._threads import ranges, together
from rpaug.render.splat.loss import Errors, Loss, pull
from rpaug.render.splat.settings import Gradients, Rendering, Settings, Splats, View

# Tiles are 32 pixels wide, or 16 where they would be few. The number of threads has no say: gradients are summed
# tile by tile, so they would round differently.
TILE_BITS, FEW_TILES = 5, 16
CHANNELS = (
    4,
    8,
    12,
    20,
    36,
    68,
)  # color, depth and features are padded to one of these: few kernels

CACHE_LINE = 64  # bytes
STALE_MARGIN = (
    1.0  # pixels a Gaussian may move or grow before a kept order cuts it at a tile's edge
)


def plain(array: np.ndarray | None, columns: int, dtype: type = np.float32) -> np.ndarray:
    """An array as the kernels want it (one layout, one type: one compilation); empty for None."""
    if array is None:
        return np.zeros((0, columns), dtype)
    return np.require(array, dtype, ["C", "A", "W"])


def channel_count(features: int) -> int:
    """Channels a kernel is made for, given the number of features. Raises Unsupported above 64."""
    for count in CHANNELS:
        if DEPTH_CHANNEL + 1 + features <= count:
            return count
    raise Unsupported(f"{features} features; the CPU rasteriser takes at most {CHANNELS[-1] - 4}")


def _on_cache_line(size: int, dtype: type) -> np.ndarray:
    """An array that begins on a cache line, so that vectors and records do not straddle two."""
    bytes_ = np.empty(size * np.dtype(dtype).itemsize + CACHE_LINE, np.uint8)
    skip = -bytes_.ctypes.data % CACHE_LINE
    return bytes_[skip : skip + size * np.dtype(dtype).itemsize].view(dtype)


class Rasteriser:
    """Renders one view after another, reusing its buffers; `backward` belongs to the latest `forward`.

    One object serves one thread at a time; for several small views make one object a thread, with
    `threads=1`: kernels hold no GIL. Results do not depend on the number of threads.
    """

    def __init__(
        self, settings: Settings | None = None, threads: int = 1, keep_order: int = 1
    ) -> None:
        """`keep_order` renders of the same view in a row share one order of the Gaussians, for fits that move them
        little: by then some blend in an order that is out of date, or end at a tile's edge.
        """
        self.settings = settings or Settings()
        self.threads, self.keep_order = threads, keep_order
        self._buffers: dict[str, np.ndarray] = {}
        self._ordered: tuple[Any, ...] = ()  # what the order was made for
        self._uses = 0

    def _buffer(self, name: str, shape: tuple[int, ...], dtype: type = np.float32) -> np.ndarray:
        """An array of this shape whose content is anything; kept from call to call while it is large enough."""
        size = int(np.prod(shape))
        kept = self._buffers.get(name)
        if kept is None or kept.size < size or kept.dtype != dtype:
            kept = self._buffers[name] = _on_cache_line(size + size // 4, dtype)
        return kept[:size].reshape(shape)

    def forward(
        self,
        splats: Splats,
        view: View,
        background: Float32[np.ndarray, "3"] | float = 0.0,
        surface: bool = True,
    ) -> Rendering:
        """Render. Without `surface` the surface's depth and index are left empty, which is faster."""
        nonfinite = self._draw(splats, view, background, surface)
        return self._rendering(surface, nonfinite)

    def prepare(
        self, splats: Splats, view: View, background: Float32[np.ndarray, "3"] | float = 0.0
    ) -> None:
        """Render for a backward pass alone: no image is handed out."""
        self._draw(splats, view, background, False)

    def _draw(
        self, splats: Splats, view: View, background: np.ndarray | float, surface: bool
    ) -> int:
        """Composite; how many splats are not finite."""
        self._take(splats, view, background)
        nonfinite = self._project()
        self._bin()
        self._composite(surface)
        return nonfinite

    def backward(
        self,
        color: Float32[np.ndarray, "h w 3"] | None = None,
        depth: Float32[np.ndarray, "h w"] | None = None,
        alpha: Float32[np.ndarray, "h w"] | None = None,
        features: Float32[np.ndarray, "h w f"] | None = None,
    ) -> Gradients:
        """Gradients by the splats, from those by the images of the latest `forward`."""
        d_out, d_left_over = self._channel_buffers()
        _images.channel_gradients(
            self._out, self._left_over, self._background,
            np.zeros((0, 0, 0), np.float32) if color is None else plain(color, 0), plain(depth, 0),
            plain(alpha, 0), np.zeros((0, 0, 0), np.float32) if features is None else plain(features, 0),
            d_out, d_left_over,
        )  # fmt: skip
        return self._backward(d_out, d_left_over)

    def backward_loss(
        self,
        loss: Loss,
        target: Float32[np.ndarray, "h w 3"],
        weight: Float32[np.ndarray, "h w"] | None = None,
        depth: Float32[np.ndarray, "h w"] | None = None,
    ) -> tuple[Errors, Gradients]:
        """Errors of the latest `forward`'s images, and the gradients of the loss, with no gradient image in between.

        `weight` scales each pixel's errors. Depth (metres) counts where `depth` > 0 and at least half is covered,
        as (expected - depth) / depth: it has no unit.
        """
        d_out, d_left_over = self._channel_buffers()
        errors = pull(
            loss, self._out, self._left_over, self._background, plain(target, 0), plain(weight, 0),
            plain(depth, 0), d_out, d_left_over, self.threads,
        )  # fmt: skip
        return errors, self._backward(d_out, d_left_over)

    def backward_squared_error(
        self,
        target: Float32[np.ndarray, "h w 3"],
        weight: Float32[np.ndarray, "h w"] | None = None,
        depth: Float32[np.ndarray, "h w"] | None = None,
        depth_weight: float = 0.0,
    ) -> tuple[float, float, Gradients]:
        """`backward_loss` of squared errors: that of color, that of depth, and the gradients."""
        loss = Loss(depth=depth_weight)
        errors, gradients = self.backward_loss(loss, target, weight, depth)
        return errors.l2, errors.depth, gradients

    def _take(self, splats: Splats, view: View, background: np.ndarray | float) -> None:
        self._splats, self._view = splats, view
        features = (
            splats.features
            if splats.features is not None
            else np.zeros((len(splats), 0), np.float32)
        )
        self._arrays = (
            plain(splats.means, 3, np.float64 if splats.means.dtype == np.float64 else np.float32),
            plain(splats.opacities, 0),
            plain(splats.sh, 0),
            plain(splats.quats, 4),
            plain(splats.scales, 3),
            plain(splats.covariances, 6),
            plain(features, 0),
        )
        self._eye = _pinhole.pinhole(view, self.settings)
        self._channels = channel_count(features.shape[1])
        self._background = np.array(np.broadcast_to(background, 3), np.float32)

    def _project(self) -> int:
        count = len(self._splats)
        self._records = self._buffer("records", (count, 8))
        self._depths = self._buffer("depths", (count,))
        self._values = self._buffer("values", (count, self._channels))
        self._values[:, DEPTH_CHANNEL + 1 + self._arrays[-1].shape[1] :] = 0.0
        outputs = (self._records, self._values, self._depths)
        parts = ranges(count, self.threads)
        return sum(
            together(
                _projection.project, [(*part, *self._arrays, self._eye, *outputs) for part in parts]
            )
        )

    def _order_serves(self) -> bool:
        """Whether the order at hand is for this view and not used up."""
        view = self._view
        wanted = (
            len(self._splats), view.width, view.height, view.K.tobytes(),
            view.world_to_camera.tobytes(),
        )  # fmt: skip
        self._uses = self._uses + 1 if wanted == self._ordered else 1
        self._ordered = wanted
        if self._uses > self.keep_order:
            self._uses = 1
        return self._uses > 1

    def _bin(self) -> None:
        if self._order_serves():
            return
        width, height, count = self._view.width, self._view.height, len(self._splats)
        margin = np.float32(STALE_MARGIN if self.keep_order > 1 else 0)
        shift = TILE_BITS
        if (-(-width >> shift)) * (-(-height >> shift)) < FEW_TILES:
            shift -= 1
        self._grid = (width, height, 1 << shift)
        across, tiles = -(-width >> shift), (-(-width >> shift)) * (-(-height >> shift))
        parts = ranges(count, self.threads)
        spans = self._buffer("spans", (count, 4), np.int16)
        counts = self._buffer("counts", (len(parts), tiles), np.int64)
        totals = together(
            _binning.count_entries,
            [
                (*part, self._records, width, height, shift, margin, spans, counts[k])
                for k, part in enumerate(parts)
            ],
        )
        self._starts = self._buffer("starts", (tiles + 1,), np.int64)
        _binning.lay_out(counts, self._starts)
        total = sum(totals)
        self._first_slot = self._buffer("first_slot", (count + 1,), np.int64)
        keys, spare = (self._buffer(name, (total,), np.uint64) for name in ("keys", "spare"))
        indices, slots = (self._buffer(name, (total,), np.int32) for name in ("indices", "places"))
        first = [sum(totals[:k]) for k in range(len(parts))]
        depths = self._depths.view(np.uint32)
        together(
            _binning.place_entries,
            [
                (
                    *part,
                    first[k],
                    spans,
                    depths,
                    across,
                    counts[k],
                    self._first_slot,
                    keys,
                    indices,
                    slots,
                )
                for k, part in enumerate(parts)
            ],
        )
        self._entries = self._buffer("entries", (total,), np.int32)
        self._slot_of = self._buffer("slot_of", (total,), np.int32)
        sorting = (
            np.zeros(1, np.int64), self._starts, keys, spare, indices, slots, self._entries, self._slot_of,
        )  # fmt: skip
        together(_binning.sort_tiles, [sorting] * self.threads)
        # The fullest tiles first, so that threads finish together.
        self._order = np.argsort(-np.diff(self._starts), kind="stable")

    def _composite(self, surface: bool) -> None:
        width, height = self._view.width, self._view.height
        self._out = self._buffer("out", (height, width, self._channels))
        self._left_over = self._buffer("left_over", (height, width))
        self._changed = self._buffer("changed", (len(self._entries),), np.int64)
        self._surface = self._buffer("surface", (height, width) if surface else (0, 0), np.int32)
        arguments = (
            np.zeros(1, np.int64), self._order, self._records, self._values, *self._grid, self._starts,
            self._entries, _compositing.rules(self.settings), self._changed, self._out, self._left_over,
            self._surface,
        )  # fmt: skip
        together(_compositing.forward_kernel(self._channels), [arguments] * self.threads)

    def _rendering(self, surface: bool, nonfinite: int) -> Rendering:
        shape, features = self._left_over.shape, self._arrays[-1].shape[1]
        color = np.empty((*shape, 3), np.float32)
        expected, alpha = np.empty(shape, np.float32), np.empty(shape, np.float32)
        _images.assemble(self._out, self._left_over, self._background, color, expected, alpha)
        index = self._surface.copy() if surface else np.full(shape, -1, np.int32)
        depth = np.zeros(shape, np.float32)
        if surface:
            drawn = index >= 0
            depth[drawn] = self._depths[index[drawn]]
        more = self._out[..., DEPTH_CHANNEL + 1 :][..., :features].copy() if features else None
        return Rendering(color, expected, depth, index, alpha, more, nonfinite)

    def _channel_buffers(self) -> tuple[np.ndarray, np.ndarray]:
        return self._buffer("d_out", self._out.shape), self._buffer(
            "d_left_over", self._left_over.shape
        )

    def _backward(self, d_out: np.ndarray, d_left_over: np.ndarray) -> Gradients:
        stride = -(-(MOMENTS + self._channels) // WIDTH) * WIDTH
        slots = self._buffer("slots", (len(self._entries) * stride,))
        arguments = (
            np.zeros(1, np.int64), self._order, self._records, self._values, *self._grid, self._starts,
            self._entries, _compositing.rules(self.settings), self._changed, self._slot_of, self._out,
            self._left_over, d_out, d_left_over, slots,
        )  # fmt: skip
        together(_compositing_backward.backward_kernel(self._channels), [arguments] * self.threads)

        results = [np.empty(array.shape, np.float32) for array in self._arrays]
        motion = np.empty(len(self._splats), np.float32)
        given = (
            *self._arrays,
            self._eye,
            self._records,
            self._channels,
            self._first_slot,
            slots,
            *results,
            motion,
        )
        parts = ranges(len(self._splats), self.threads)
        together(_projection_backward.project_backward, [(*part, *given) for part in parts])
        means, opacities, sh, quats, scales, covariances, features = results
        shaped = self._splats.covariances is None
        return Gradients(
            means, opacities, sh,
            quats if shaped else None, scales if shaped else None, None if shaped else covariances,
            None if self._splats.features is None else features, motion,
        )  # fmt: skip
