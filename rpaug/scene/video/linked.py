"""What hangs together, told by pairs."""

import numpy as np


def joined(count: int, edges: np.ndarray) -> np.ndarray:
    """A number for each of `count` nodes, the same for those that edges join (pointer jumping)."""
    root = np.arange(count)
    while len(edges):
        a, b = root[edges[:, 0]], root[edges[:, 1]]
        if (a == b).all():
            break
        np.minimum.at(root, np.maximum(a, b), np.minimum(a, b))
        while (root[root] != root).any():
            root = root[root]
    return root
