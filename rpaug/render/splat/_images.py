"""From blended channels to images, and from image losses back to the channels."""

import numpy as np

from rpaug.core.jit import kernel
from rpaug.render.splat._pinhole import DEPTH_CHANNEL

SMALLEST_ALPHA = 1e-10  # expected depth is D / max(A, this): 0 where nothing is drawn
HALF_COVERED = 0.5  # alpha from which a pixel's expected depth is compared with a measured one


@kernel
def assemble(out, left_over, background, color, depth, alpha):
    """Fill the color over its background, the expected depth and alpha."""
    height, width = left_over.shape
    for row in range(height):
        for column in range(width):
            left = left_over[row, column]
            for channel in range(3):
                color[row, column, channel] = out[row, column, channel] + left * background[channel]
            alpha[row, column] = np.float32(1) - left
            depth[row, column] = out[row, column, DEPTH_CHANNEL] / max(
                alpha[row, column], np.float32(SMALLEST_ALPHA)
            )


@kernel
def channel_gradients(
    out, left_over, background, d_color, d_depth, d_alpha, d_features, d_out, d_left_over
):  # fmt: skip
    """Fill `d_out` and `d_left_over` from the gradients by color, expected depth, alpha and features.

    A gradient whose array is empty is zero.
    """
    height, width = left_over.shape
    d_out[:] = 0.0
    for row in range(height):
        for column in range(width):
            d_left = np.float32(0)
            if len(d_alpha):
                d_left -= d_alpha[row, column]
            if len(d_color):
                for channel in range(3):
                    d_out[row, column, channel] = d_color[row, column, channel]
                    d_left += d_color[row, column, channel] * background[channel]
            if len(d_depth):
                alpha = np.float32(1) - left_over[row, column]
                if alpha > SMALLEST_ALPHA:
                    pull = d_depth[row, column] / alpha
                    d_out[row, column, DEPTH_CHANNEL] = pull
                    d_left += pull * out[row, column, DEPTH_CHANNEL] / alpha
            if len(d_features):
                for channel in range(d_features.shape[2]):
                    d_out[row, column, DEPTH_CHANNEL + 1 + channel] = d_features[
                        row, column, channel
                    ]
            d_left_over[row, column] = d_left


@kernel
def pixel_errors(
    out, left_over, background, target, weight, depth, by_square, by_size, by_depth, structure, d_out,
    d_left_over,
):  # fmt: skip
    """Mean squared and mean absolute color error, mean squared relative depth error; the loss's gradient.

    `weight` (h, w) scales a pixel's errors; empty means 1 everywhere. Depth counts where `depth` > 0 and at least
    half is drawn, as (expected - depth) / depth so that it has no unit; an empty `depth` means none. The gradient
    by the channels is that of the three errors times `by_square`, `by_size` and `by_depth`, plus `structure`, a
    gradient by the color, if not empty.
    """
    height, width = left_over.shape
    share = 1.0 / (width * height)
    squared = absolute = depth_error = 0.0
    d_out[:] = 0.0
    for row in range(height):
        for column in range(width):
            left = left_over[row, column]
            alpha = np.float32(1) - left
            pixel = np.float32(share) * (weight[row, column] if len(weight) else np.float32(1))
            third = pixel * np.float32(1 / 3)
            d_left = np.float32(0)
            for channel in range(3):
                seen = out[row, column, channel] + left * background[channel]
                error = seen - target[row, column, channel]
                pull = third * np.float32(2 * by_square * error + by_size * np.sign(error))
                if len(structure):
                    pull += structure[row, column, channel]
                d_out[row, column, channel] = pull
                d_left += pull * background[channel]
                squared += third * error * error
                absolute += third * abs(error)
            if len(depth) and depth[row, column] > 0.0 and alpha >= HALF_COVERED:
                expected = out[row, column, DEPTH_CHANNEL] / alpha
                error = expected / depth[row, column] - np.float32(1)
                slope = np.float32(2.0 * by_depth) * pixel * error
                pull = slope / (depth[row, column] * alpha)
                d_out[row, column, DEPTH_CHANNEL] = pull
                d_left += pull * expected
                depth_error += pixel * error * error
            d_left_over[row, column] = d_left
    return squared, absolute, depth_error
