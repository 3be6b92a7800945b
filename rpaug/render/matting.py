"""How much of each outline pixel an anti-aliased object covers, and in what color it does.

There a pixel is a mixture a F + (1 - a) B of the object's color F and what lies behind, B. All three are unknown;
F and B are taken from pixels nearby (sampling matting, Wang and Cohen 2007), and the mask says where a half is likely.
"""

import numpy as np
from jaxtyping import Bool, Float32

from rpaug.core.jit import kernel

REACH = 4  # pixels: how far to look for unmixed colors
MOST = 10  # of them, on each side
MIXED = 6  # pixels of the outline itself, on each side
BLUR = 0.001  # cost of a sample that may itself be mixed
HUES = 4  # colors that stand for all of the object's
LEAST_HUE = 0.01  # squared color distance between two of them
PAIR = 0.0003  # cost of taking the object's part for a mixture of two of its own colors
TEXTURE = 0.02  # color distance by which neighbouring pixels of one surface differ
DOUBT = 0.35  # of a pixel: how far a share may well be from what the mask suggests
WEIGHT = (TEXTURE / DOUBT) ** 2
SHADING = 0.03  # how much a difference in light between neighbouring faces costs
UNMIXED = 0.008  # cost of taking a pixel on the outline for unmixed though a mixture explains it


@kernel
def matte(
    color: Float32[np.ndarray, "h w 3"], inside: Bool[np.ndarray, "h w"]
) -> tuple[Float32[np.ndarray, "h w"], Float32[np.ndarray, "h w 3"]]:
    """The object's share a of each pixel, 0..1, and its own color F there.

    Only pixels with one of their 8 neighbours across the outline can be mixed. For those, every pair of unmixed colors
    (F, B) nearby proposes a share, and the pair that explains the pixel best is taken (sampling matting, Wang and
    Cohen 2007). How much of the 3 x 3 neighbourhood is inside serves as the prior share, which alone decides where both
    sides look alike. What the pair leaves unexplained is split between F and B.
    """
    height, width = inside.shape
    share = np.zeros((height, width), np.float32)
    foreground = color.copy()
    rim = _rim(inside)
    palette, hues = _palette(color, inside, rim)
    behind, found = np.empty((8, MOST + MIXED)), np.empty((3, MOST + MIXED))
    for y in range(height):
        for x in range(width):
            share[y, x] = 1.0 if inside[y, x] else 0.0
            if not rim[y, x]:
                continue
            front, fronts = _candidates(inside, rim, y, x, True)
            back, backs = _candidates(inside, rim, y, x, False)
            prior = _prior(inside, y, x)
            least = WEIGHT * (share[y, x] - prior) ** 2 + UNMIXED
            _compare(color, y, x, back, backs, behind)
            for f in range(fronts):
                blur = BLUR * rim[front[f, 0], front[f, 1]]
                if blur >= least:
                    break  # those that follow are of the outline too
                _explain(color, y, x, front[f], behind, backs, prior, found)
                for b in range(backs):
                    cost = found[0, b] + blur + BLUR * rim[back[b, 0], back[b, 1]]
                    if cost < least:
                        least = cost
                        share[y, x] = found[1, b]
                        light = found[2, b] / found[1, b] if found[1, b] > 0 else 1.0
                        _own_color(color, y, x, front[f], back[b], found[1, b], light, foreground)
            if least <= PAIR:
                continue  # a pair costs as much
            for p in range(hues):
                for q in range(p):
                    for b in range(backs):
                        one, other = palette[p], palette[q]
                        cost, a, c = _explain_two(color, y, x, one, other, back[b], prior)
                        if cost < least:
                            least = cost
                            share[y, x] = a + c
                            for k in range(3):
                                foreground[y, x, k] = (a * one[k] + c * other[k]) / (a + c)
    return share, foreground


@kernel
def _palette(color: np.ndarray, inside: np.ndarray, rim: np.ndarray) -> tuple[np.ndarray, int]:
    """Up to `HUES` colors of the object that differ most: each the farthest from those before it."""
    height, width = inside.shape
    palette = np.zeros((HUES, 3), np.float32)
    count = 0
    while count < HUES:
        best, at_y, at_x = LEAST_HUE if count else -1.0, -1, -1
        for y in range(height):
            for x in range(width):
                if not inside[y, x] or rim[y, x]:
                    continue
                nearest = 0.0 if count == 0 else np.inf
                for p in range(count):
                    away = 0.0
                    for c in range(3):
                        away += (color[y, x, c] - palette[p, c]) ** 2
                    nearest = min(nearest, away)
                if nearest > best:
                    best, at_y, at_x = nearest, y, x
        if at_y < 0:
            break
        palette[count] = color[at_y, at_x]
        count += 1
    return palette, count


@kernel
def _explain_two(
    color: np.ndarray,
    y: int,
    x: int,
    one: np.ndarray,
    other: np.ndarray,
    back: np.ndarray,
    prior: float,
) -> tuple[float, float, float]:
    """Cost and shares a, c of the best mixture of two colors of the object and one behind; infinite if none is."""
    aa = ac = cc = da = dc = 0.0
    for k in range(3):
        b = color[back[0], back[1], k]
        f, g, rest = one[k] - b, other[k] - b, color[y, x, k] - b
        aa, ac, cc, da, dc = aa + f * f, ac + f * g, cc + g * g, da + f * rest, dc + g * rest
    aa, ac, cc = aa + WEIGHT, ac + WEIGHT, cc + WEIGHT
    da, dc = da + WEIGHT * prior, dc + WEIGHT * prior
    determinant = aa * cc - ac * ac
    if determinant < 1e-6:
        return np.inf, 0.0, 0.0
    a, c = (da * cc - dc * ac) / determinant, (dc * aa - da * ac) / determinant
    if a < 0 or c < 0 or a + c > 1 or a + c < 1e-3:
        return np.inf, 0.0, 0.0
    cost = WEIGHT * (a + c - prior) ** 2 + PAIR
    for k in range(3):
        mixed = a * one[k] + c * other[k] + (1.0 - a - c) * color[back[0], back[1], k]
        cost += (color[y, x, k] - mixed) ** 2
    return cost, a, c


@kernel
def _rim(inside: np.ndarray) -> np.ndarray:
    """Pixels with an 8-neighbour on the other side of the outline."""
    height, width = inside.shape
    rim = np.zeros((height, width), np.bool_)
    for y in range(height):
        for x in range(width):
            for j, i in ((y, x + 1), (y + 1, x - 1), (y + 1, x), (y + 1, x + 1)):
                if j < height and 0 <= i < width and inside[j, i] != inside[y, x]:
                    rim[y, x] = rim[j, i] = True
    return rim


@kernel
def _prior(inside: np.ndarray, y: int, x: int) -> float:
    """Share of the pixel that the mask's neighbourhood suggests: a 3 x 3 binomial filter."""
    height, width = inside.shape
    covered = total = 0.0
    for j in range(max(0, y - 1), min(height, y + 2)):
        for i in range(max(0, x - 1), min(width, x + 2)):
            weight = (2.0 - abs(j - y)) * (2.0 - abs(i - x))
            total += weight
            covered += weight * inside[j, i]
    return covered / total


@kernel
def _candidates(
    inside: np.ndarray, rim: np.ndarray, y: int, x: int, side: bool
) -> tuple[np.ndarray, int]:
    """The nearest pixels of one side as (row, column), and how many: `MOST` unmixed, then `MIXED` on the outline.

    A thing so thin that all of it is outline, or a part of another color, shows on the outline only.
    """
    height, width = inside.shape
    found = np.zeros((MOST + MIXED, 2), np.int64)
    distance = np.full(MOST + MIXED, 1 << 20)
    count = 0
    for mixed in (False, True):
        first, most = count, count + (MIXED if mixed else MOST)
        for j in range(max(0, y - REACH), min(height, y + REACH + 1)):
            for i in range(max(0, x - REACH), min(width, x + REACH + 1)):
                if rim[j, i] != mixed or inside[j, i] != side or (j == y and i == x):
                    continue
                away = (j - y) ** 2 + (i - x) ** 2
                place = min(count, most - 1)
                if count == most and away >= distance[place]:
                    continue
                while place > first and distance[place - 1] > away:
                    distance[place] = distance[place - 1]
                    found[place] = found[place - 1]
                    place -= 1
                distance[place] = away
                found[place, 0], found[place, 1] = j, i
                count = min(count + 1, most)
    return found, count


@kernel
def _compare(
    color: np.ndarray, y: int, x: int, back: np.ndarray, backs: int, out: np.ndarray
) -> None:
    """By column, of each color B behind: B, the pixel's color C less it, B . B, and B . (C - B)."""
    for b in range(backs):
        bb = bd = 0.0
        for c in range(3):
            behind = color[back[b, 0], back[b, 1], c]
            rest = color[y, x, c] - behind
            out[c, b], out[3 + c, b] = behind, rest
            bb, bd = bb + behind * behind, bd + behind * rest
        out[6, b], out[7, b] = bb, bd


@kernel
def _explain(
    color: np.ndarray,
    y: int,
    x: int,
    front: np.ndarray,
    behind: np.ndarray,
    backs: int,
    prior: float,
    out: np.ndarray,
) -> None:
    """By column, of the best mixture a s F + (1 - a) B with each color `behind` (of `_compare`): its cost, share a, and
    a times the light s.

    Least squares in (a s, a), held to the prior share and to s = 1: a face turned another way is darker or brighter.
    Without a branch, so that a processor does several at once.
    """
    f0, f1, f2 = color[front[0], front[1]]
    here0, here1, here2 = color[y, x]
    ff = 0.0 + f0 * f0 + f1 * f1 + f2 * f2
    steady = SHADING * ff + 1e-6
    own = ff + steady
    for b in range(backs):
        b0, b1, b2 = behind[0, b], behind[1, b], behind[2, b]
        fb = f0 * b0 + f1 * b1 + f2 * b2
        fd = f0 * behind[3, b] + f1 * behind[4, b] + f2 * behind[5, b]
        cross, other = fb + steady, behind[6, b] + steady + WEIGHT
        part = (own * (WEIGHT * prior - behind[7, b]) + cross * fd) / (own * other - cross * cross)
        part = min(1.0, max(0.0, part))
        lit = min(2.0 * part, max(0.0, (fd + cross * part) / own))
        off0 = lit * f0 + (1.0 - part) * b0 - here0
        off1 = lit * f1 + (1.0 - part) * b1 - here1
        off2 = lit * f2 + (1.0 - part) * b2 - here2
        held = WEIGHT * (part - prior) ** 2 + steady * (lit - part) ** 2
        out[0, b] = held + off0 * off0 + off1 * off1 + off2 * off2
        out[1, b], out[2, b] = part, lit


@kernel
def _own_color(
    color: np.ndarray,
    y: int,
    x: int,
    front: np.ndarray,
    back: np.ndarray,
    part: float,
    light: float,
    out: np.ndarray,
) -> None:
    """The object's color at the pixel: the sampled one, moved by its part of what the mixture leaves over."""
    for c in range(3):
        f, b = light * color[front[0], front[1], c], color[back[0], back[1], c]
        left = color[y, x, c] - part * f - (1.0 - part) * b
        own = f + left * part / (part**2 + (1.0 - part) ** 2)
        out[y, x, c] = min(1.0, max(0.0, own))
