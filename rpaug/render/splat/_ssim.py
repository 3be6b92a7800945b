"""Structural similarity of an image and its target (Wang et al. 2004), and its gradient.

Local means, variances and covariance are blurs of x, y, xx, yy and xy, and a blur is its own transpose: the
gradient is three blurs of the derivatives by the blurred images.
"""

import math

import numpy as np

from rpaug.core.jit import inlined, kernel

REACH, SIGMA = 5, 1.5  # pixels: a window is 11 x 11
C1, C2 = np.float32(0.01**2), np.float32(0.03**2)  # of colors in 0..1


@inlined
def _window(taps):
    for k in range(2 * REACH + 1):
        taps[k] = math.exp(-0.5 * ((k - REACH) / SIGMA) ** 2)
    taps /= taps.sum()


@inlined
def _blurred(image, taps, across, out):
    """out = image under the window, zeros beyond its edges; `across` is room for one pass."""
    height, width = image.shape
    across[:] = 0
    for row in range(height):
        for k in range(2 * REACH + 1):
            shift = k - REACH
            for column in range(max(0, -shift), min(width, width - shift)):
                across[row, column] += taps[k] * image[row, column + shift]
    out[:] = 0
    for row in range(height):
        for k in range(max(0, REACH - row), min(2 * REACH + 1, height + REACH - row)):
            for column in range(width):
                out[row, column] += taps[k] * across[row + k - REACH, column]


@inlined
def _compare(x, mean_x, mean_y, xx, yy, xy, weight, scale):
    """Sum of weighted 1 - SSIM; the blurred images' derivatives, times scale * weight, replace three of them.

    `mean_x`, `xx` and `xy` come back as the derivatives by the blurs of x, xx and xy.
    """
    total = 0.0
    height, width = x.shape
    for row in range(height):
        for column in range(width):
            here = np.float32(weight[row, column]) if len(weight) else np.float32(1)
            a, b = mean_x[row, column], mean_y[row, column]
            spread_x, spread_y = xx[row, column] - a * a, yy[row, column] - b * b
            alike, varied = 2 * a * b + C1, 2 * (xy[row, column] - a * b) + C2
            bright, rough = a * a + b * b + C1, spread_x + spread_y + C2
            ssim = alike * varied / (bright * rough)
            total += here * (1.0 - ssim)
            pull = -np.float32(scale) * here
            by_xy = 2 * alike / (bright * rough)
            by_xx = -ssim / rough
            by_mean = 2 * b * varied / (bright * rough) - 2 * a * ssim / bright
            mean_x[row, column] = pull * (by_mean - b * by_xy - 2 * a * by_xx)
            xx[row, column] = pull * by_xx
            xy[row, column] = pull * by_xy
    return total


@kernel
def structural_error(
    start, step, out, left_over, background, target, weight, factor, d_color, shortfall
):
    """Of color channels start, start + step, ...: `shortfall`, whose sum over channels is the mean of 1 - SSIM,
    and `factor` times its gradient by the color.

    `weight` scales each pixel's share (no rows: 1). A pixel of weight 0 counts as exactly right: it adds
    no difference to its neighbours' windows and gets no pull.
    """
    height, width = left_over.shape
    taps = np.empty(2 * REACH + 1, np.float32)
    _window(taps)
    room = np.empty((9, height, width), np.float32)
    x, y, product, across, mean_x, mean_y, xx, yy, xy = (
        room[0], room[1], room[2], room[3], room[4], room[5], room[6], room[7], room[8],
    )  # fmt: skip
    share = 1.0 / (3 * width * height)
    for channel in range(start, 3, step):
        for row in range(height):
            for column in range(width):
                seen = out[row, column, channel] + left_over[row, column] * background[channel]
                known = not len(weight) or weight[row, column] > 0
                x[row, column] = seen
                y[row, column] = target[row, column, channel] if known else seen
        _blurred(x, taps, across, mean_x)
        _blurred(y, taps, across, mean_y)
        product[:] = x * x
        _blurred(product, taps, across, xx)
        product[:] = y * y
        _blurred(product, taps, across, yy)
        product[:] = x * y
        _blurred(product, taps, across, xy)
        total = _compare(x, mean_x, mean_y, xx, yy, xy, weight, factor * share)
        shortfall[channel] = total * share
        _blurred(mean_x, taps, across, product)
        _blurred(xx, taps, across, mean_y)
        _blurred(xy, taps, across, yy)
        for row in range(height):
            for column in range(width):
                known = not len(weight) or weight[row, column] > 0
                d_color[row, column, channel] = (
                    product[row, column]
                    + 2 * x[row, column] * mean_y[row, column]
                    + y[row, column] * yy[row, column]
                    if known
                    else np.float32(0)
                )
