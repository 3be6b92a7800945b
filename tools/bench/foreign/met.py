"""First frames of rollouts with things truly changed; runs in the simulators' environment, without rpaug.

    python -m tools.bench.foreign.met --rollouts rollouts.json --out met.npz

`rollouts.json` has for each rollout `layout`, the neutral folder that it starts like, and `change` (see `changed`).
The file gets `rgb` and `ids` of one camera, a row each.
"""

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np

from tools.bench.foreign.changed import Changed

CAMERA = "front"


def meet(rollout: dict[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    """The first frame as color and ids."""
    world = Changed(Path(rollout["layout"]), rollout["change"])
    world.eyes = {CAMERA: world.eyes[CAMERA]}
    seen = world.film([0])[CAMERA]
    return seen["rgb"][0], seen["ids"][0]


def main() -> None:
    """Render all of them."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rollouts", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args()
    seen = [meet(one) for one in json.loads(given.rollouts.read_text())]
    rgb, ids = (np.stack(some) for some in zip(*seen, strict=True))
    np.savez_compressed(given.out, rgb=rgb, ids=ids)


if __name__ == "__main__":
    main()
