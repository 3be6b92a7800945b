"""What parts are made of: matte, satin, glossy; metals mirror lamps in their own color."""

import numpy as np
import pytest

from rpaug import twin
from rpaug.core.errors import RpaugError

ORANGE = (1.0, 0.5, 0.0)
pytestmark = pytest.mark.gl


def table(finish: str, **look: bool) -> np.ndarray:
    """Pixels of an orange table of that finish."""
    seen = twin.Look(tints={"table": ORANGE}, **look)
    take = twin.perform(
        "push_button",
        1,
        factor="object_finish",
        target="table",
        value=finish,
        look=seen,
        frames=13,
        size=48,
    )
    view = take.episode.views["front"]
    assert view.ids is not None
    return view.rgb(0)[view.ids(0) == take.truth.handles["table"]]


def test_metals_mirror_in_their_own_color_and_what_is_glossy_in_the_lamps() -> None:
    matte, glossy, metal = (table(finish) for finish in ("matte", "glossy", "metallic"))
    assert matte[:, 2].max() == 0
    assert glossy[:, 2].max() > 20
    assert metal[:, 2].max() == 0
    matte_part = 0.4 * matte[:, 0].astype(float)
    assert (metal[:, 0] - matte_part).max() > 20  # there are highlights


def test_satin_is_what_all_parts_are_under_highlights() -> None:
    np.testing.assert_array_equal(table("satin", specular=True), table("satin"))


def test_a_finish_that_there_is_not_is_refused_with_those_that_there_are() -> None:
    with pytest.raises(RpaugError, match="no finish is called 'wet'; there are: matte, satin"):
        table("wet")
