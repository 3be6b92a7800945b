"""libcom is asked only where it is named, and what is missing is said."""

import sys
import types

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from rpaug.core.errors import Unsupported
from rpaug.operators.insert import Insert
from rpaug.providers import harmonise


@pytest.fixture(autouse=True)
def forgotten(monkeypatch):
    harmonise._network.cache_clear()
    monkeypatch.setenv("LIBCOM_MODEL_DIR", "")
    yield
    harmonise._network.cache_clear()


def test_unknown_ones_and_missing_folders_are_refused(tmp_path):
    kind = TypeAdapter(Insert)
    for wrong, says in (("photoshop", "no harmoniser"), (f"libcom:{tmp_path}/no", "a folder of")):
        with pytest.raises(ValidationError, match=says):
            kind.validate_python({"asset": "die", "harmoniser": wrong})


def test_without_the_package_it_is_said_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "libcom", None)
    with pytest.raises(Unsupported, match="pip install libcom"):
        Insert(asset="die", harmoniser=f"libcom:{tmp_path}").ready()
    Insert(asset="die").ready()


def test_only_what_is_marked_changes(tmp_path, monkeypatch):
    class Model:
        def __init__(self, device, model_type):
            self.name = model_type

        def __call__(self, picture, mask):
            assert mask.max() == 255
            return picture // 2

    monkeypatch.setitem(sys.modules, "libcom", types.SimpleNamespace(ImageHarmonizationModel=Model))
    picture = np.full((4, 4, 3), [200, 100, 50], np.uint8)
    mask = np.eye(4, dtype=bool)
    made = harmonise.harmonised(f"libcom:{tmp_path}", picture, mask)
    np.testing.assert_array_equal(made[mask], np.tile([100, 50, 25], (4, 1)))
    np.testing.assert_array_equal(made[~mask], picture[~mask])
