"""Materials keep their ranges, and those that ship are whole."""

import pytest

from rpaug.errors import Unsupported
from rpaug.physics import materials
from rpaug.physics.materials import RANGES, Law, Material


@pytest.mark.parametrize("name", RANGES)
def test_values_out_of_range_are_refused_with_the_range(name: str) -> None:
    low, high = RANGES[name]
    for value in (high * 1.01 + 1e-3, low - 1e-3, float("nan")):
        with pytest.raises(Unsupported, match=f"{name} .*allowed are {low:g} to ") as caught:
            Material(**{name: value})
        assert f"{high:g}" in str(caught.value)


def test_the_materials_that_ship() -> None:
    wanted = {"rubber", "cloth", "foam", "sand", "jelly", "wood", "metal", "ceramic"}
    assert set(materials.shipped()) == wanted
    assert materials.named("sand").law is Law.SAND
    assert materials.named("metal").young > 1e11
    with pytest.raises(Unsupported, match="'cheese'; there are: rubber, cloth"):
        materials.named("cheese")


def test_waves_in_steel_go_at_about_six_kilometres_a_second() -> None:
    assert materials.named("metal").sound == pytest.approx(5800, rel=0.05)
