"""Plates take what each pixel shows of standing things, and nothing of pixels that are of no use."""

from dataclasses import replace

import numpy as np
import pytest
from rolling import demonstration

from rpaug.core.types import CameraView
from rpaug.render.zbuffer import Source
from rpaug.scene.recorded import plates


def test_pixels_that_are_of_no_use_are_taken_from_another_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    view = next(iter(demonstration(6).views.values()))
    size = (view.camera.height, view.camera.width)
    still = replace(
        view,
        rgb=lambda t: np.full((*size, 3), 40, np.uint8),
        depth=lambda t: np.ones(size, np.float32),
        ids=lambda t: np.full(size, 7, np.int32),
    )
    source_at = plates.source_at

    def spoilt(view: CameraView, t: int, **how: bool) -> Source:
        """A ghost at the left, which is known for one, in all frames but one."""
        made = source_at(view, t, **how)
        use, rgb = np.ones(size, bool), made.rgb.copy()
        if t != 3:
            use[:, :4], rgb[:, :4] = False, 250
        return replace(made, use=use, rgb=rgb)

    monkeypatch.setattr(plates, "source_at", spoilt)
    made = plates.plate(still, 6, frozenset({7}), 0.0, 0.01, mixed=True)
    assert made.known.all()
    assert (made.rgb == 40).all()
