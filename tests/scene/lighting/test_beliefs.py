"""What is believed of light is said with how much it explains, and what is not explained is said to stay."""

import re

import numpy as np
from analytic import TABLE, scene, seen_by

from rpaug import twin
from rpaug.core.types import Scene
from rpaug.scene.build import build
from rpaug.scene.lighting import beliefs, highlights, rig

LENGTH = 12


def test_lamps_that_are_found_are_said_with_what_they_explain() -> None:
    look = twin.Look(shadows=True, specular=True)
    seen = build(twin.perform("open_drawer", 1, look=look, frames=17).episode, with_bodies=True)
    found, mirrored = rig.find(seen), highlights.find(seen)
    assert found is not None
    assert mirrored is not None
    shadows, shine = beliefs.described(seen)
    assert _lamps(shadows) == len(found.directions)
    assert _lamps(shine) == len(mirrored.lamps.directions)
    assert f"{rig.told(seen)[1]:.0%}" in shadows
    assert f"{highlights.told(seen)[1]:.0%}" in shine


def test_shadows_that_nothing_explains_are_said_to_stay() -> None:
    def paint(name, t, rgb, depth, ids):  # type: ignore[no-untyped-def]
        dark = np.zeros(ids.shape, bool)
        width = ids.shape[1] // LENGTH
        dark[:, t * width : (t + 1) * width] = True
        gray = np.where(dark & (ids == TABLE), 120, 200)[..., None].repeat(3, 2)
        return np.where((ids == TABLE)[..., None], gray, rgb).astype(np.uint8), depth, ids

    seen = seen_by(scene({"front": (1.6, 0.3, 1.0)}, length=LENGTH), paint)
    assert rig.unexplained(seen)
    assert beliefs.described(seen)[0].endswith("shadows stay as recorded")


def test_matte_recordings_without_shadows_are_said_to_have_neither(real: Scene) -> None:
    shadows, shine = beliefs.described(real)
    assert shadows.endswith("edits take none to be there")
    assert shine.endswith("highlights go by hue")  # it shines, and no lamps explain half of that


def _lamps(sentence: str) -> int:
    found = re.search(r"(\d) lamps?", sentence)
    assert found is not None
    return int(found[1])
