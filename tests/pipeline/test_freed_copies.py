"""What a copy holds goes when the copy goes."""

import gc
import weakref

import rpaug

MOVED = {"op": "camera_pose", "camera": "static", "shift": 0.01, "turn": 0.01}


def test_a_copy_takes_its_images_with_it() -> None:
    """Episodes of arrays are no cyclic garbage, which Python looks for seldom: copies of one run would add up."""
    recipe = {"version": 1, "edits": [{"op": "light_color"}, MOVED]}
    copy = rpaug.augment(rpaug.read("sample"), recipe, keep_invalid=True)
    moved = next(view for view in copy.views.values() if view.camera.fixed)
    moved.rgb(0)
    accessor = weakref.ref(moved.rgb)
    gc.collect()
    gc.disable()
    try:
        del copy, moved
        assert accessor() is None
    finally:
        gc.enable()
