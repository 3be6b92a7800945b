"""Redraws docs/images/textures.png: every texture that ships, with its name."""

from pathlib import Path

import cv2
import numpy as np

from rpaug.assets.textures import shipped
from rpaug.core.files import encode_png, write_atomic

SIDE, BAND, COLUMNS = 84, 14, 10


def main() -> None:
    """Write the picture."""
    tiles = []
    for name in shipped.NAMES:
        tile = np.full((SIDE + BAND, SIDE + 4, 3), 255, np.uint8)
        tile[:SIDE, :SIDE] = cv2.resize(
            shipped.image(name), (SIDE, SIDE), interpolation=cv2.INTER_AREA
        )
        cv2.putText(
            tile, name, (0, SIDE + 10), cv2.FONT_HERSHEY_SIMPLEX, 0.29, (40, 40, 40), 1, cv2.LINE_AA
        )
        tiles.append(tile)
    tiles += [np.full_like(tiles[0], 255)] * (-len(tiles) % COLUMNS)
    rows = [np.concatenate(tiles[i : i + COLUMNS], 1) for i in range(0, len(tiles), COLUMNS)]
    write_atomic(Path("docs/images/textures.png"), encode_png(np.concatenate(rows)))


if __name__ == "__main__":
    main()
