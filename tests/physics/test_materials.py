"""Materials keep their ranges, and those that ship are whole."""

import re
from pathlib import Path

import pytest
import rpaug_recipes

from rpaug.core.errors import Unsupported
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


def test_each_number_that_ships_has_a_source_to_point_at_or_the_range_it_is_assumed_from() -> None:
    text = (Path(rpaug_recipes.__file__).parent / materials.FILE).read_text()
    sources = dict(re.findall(r"^# \[([\w-]+)\] (.*(?:\n#   .*)*)", text, re.M))
    assert all("https://" in stated or "http://" in stated for stated in sources.values()), sources
    numbers = re.findall(r"^  (\w+): (\d[\d.e+]*)(.*)$", text, re.M)
    assert len(numbers) >= 3 * len(materials.shipped())
    for name, value, stated in numbers:
        cited = re.findall(r"\[([\w-]+)\]", stated)
        assumed = re.search(r"# assumed, ([\d.e+]+) to ([\d.e+]+): \w", stated)
        assert bool(cited) != bool(assumed), (name, value, stated)
        assert set(cited) <= set(sources), cited
        if assumed:
            assert float(assumed[1]) <= float(value) <= float(assumed[2])
