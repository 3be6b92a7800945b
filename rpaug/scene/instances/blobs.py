"""Connected patches of one tint in one camera's backdrop: what stands still there, piece by piece."""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float32, Int, Int32, UInt8

from rpaug.core.pixels import grown
from rpaug.scene.instances.color_clusters import ColorClusters, weighted

LEAST = 0.0035  # share of the image: smaller patches belong to what is around them
SMALL = (
    0.0012  # share of the image that is enough for a patch whose color is far from that around it
)
LOUD = 30.0  # of the weighted Lab distance from which it is


@dataclass(frozen=True)
class Blob:
    """One patch: its tint, mean weighted Lab color, pixels, and share of its outline that lies on the image's edge."""

    cluster: int
    color: Float32[np.ndarray, "3"]
    mask: Bool[np.ndarray, "h w"]
    edge: float

    @property
    def area(self) -> int:
        """Pixels."""
        return int(self.mask.sum())


def find(
    image: UInt8[np.ndarray, "h w 3"], label: Int[np.ndarray, "h w"], clusters: ColorClusters
) -> list[Blob]:
    """The patches of a labelled image, largest first; together they cover it.

    Those that are small or no more than a thin line (outlines mix two colors into a third) go to the neighbour that
    they share most of their outline with.
    """
    pieces = _absorbed(_pieces(label), label, clusters)
    shown = weighted(image)
    found = []
    for number in np.unique(pieces):
        mask = pieces == number
        cluster = int(np.bincount(label[mask], minlength=len(clusters)).argmax())
        color = np.median(shown[mask & (label == cluster)], 0).astype(np.float32)
        found.append(Blob(cluster, color, mask, _edge(mask)))
    return sorted(found, key=lambda blob: -blob.area)


def ring(mask: Bool[np.ndarray, "h w"], width: int = 1) -> Bool[np.ndarray, "h w"]:
    """Pixels just outside."""
    return grown(mask, width) & ~mask


def _pieces(label: Int[np.ndarray, "h w"]) -> Int32[np.ndarray, "h w"]:
    out, count = np.zeros(label.shape, np.int32), 0
    for cluster in np.unique(label):
        number, parts = cv2.connectedComponents((label == cluster).astype(np.uint8), connectivity=4)
        out[parts > 0] = parts[parts > 0] + count
        count += number - 1
    return out


def _absorbed(
    pieces: Int32[np.ndarray, "h w"], label: Int[np.ndarray, "h w"], clusters: ColorClusters
) -> Int32[np.ndarray, "h w"]:
    """The same without pieces that are too small or too thin, smallest first."""
    pieces = pieces.copy()
    least, small = (max(8, int(share * pieces.size)) for share in (LEAST, SMALL))
    numbers, areas = np.unique(pieces, return_counts=True)
    square = np.ones((3, 3), np.uint8)
    for number in numbers[np.argsort(areas, kind="stable")]:
        mask = pieces == number
        core = cv2.erode(mask.astype(np.uint8), square, borderValue=1)
        thick = core.sum() >= 0.1 * mask.sum()
        if mask.sum() >= least and thick:
            continue
        around = ring(mask)
        if not around.any():
            continue
        if mask.sum() >= small and thick:
            beside = clusters[np.bincount(label[around]).argmax()]
            if np.linalg.norm(clusters[label[mask][0]] - beside) > LOUD:
                continue
        pieces[mask] = np.bincount(pieces[around]).argmax()
    return pieces


def _edge(mask: Bool[np.ndarray, "h w"]) -> float:
    border = np.zeros_like(mask)
    border[[0, -1]] = True
    border[:, [0, -1]] = True
    inner = cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8), borderValue=0) > 0
    outline = mask & ~inner
    return float((outline & border).sum() / max(outline.sum(), 1))
