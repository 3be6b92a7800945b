"""The page of an episode's instances: outlines in their colors, names, escaped words."""

import base64
from dataclasses import replace

import cv2
import numpy as np

from rpaug.core import registry
from rpaug.core.types import CameraView
from rpaug.pages import instances
from rpaug.pages.document import color_of, outlined
from rpaug.pipeline import inspect


def test_every_instance_is_outlined_in_its_color_and_named() -> None:
    image, ids = np.full((20, 30, 3), 100, np.uint8), np.zeros((20, 30), np.int32)
    ids[4:16, 4:26] = 7
    made = outlined(image, ids, {7: ("cup", (230, 159, 0))}, scale=4)
    assert made.shape == (80, 120, 3)
    assert (made[16, 20:100] == (230, 159, 0)).all()  # the upper edge
    assert (made[:14] == 100).all()
    assert (made[24:56, 24:96] != 100).any()  # its name
    bare = outlined(image, ids, {7: ("", (230, 159, 0))}, scale=4)
    assert (bare[24:56, 24:96] == 100).all()


def test_the_page_of_the_sample() -> None:
    described, rows, seen = inspect.inspect(registry.read(registry.SAMPLE, None))
    described["instruction"] = "open <b>it"
    page = instances.page(seen, described, rows).decode()
    assert "open &lt;b&gt;it" in page
    assert page.count("<figure>") == len(seen.views)
    assert "width=device-width" in page
    assert "manipulated" in page
    names = instances.labels(rows)
    assert names[94][0] == "manipulated 94"
    assert names[94][1] == color_of(0, "manipulated")
    assert sum(bool(name) for name, _ in names.values()) < len(rows)  # of the arm one link is named


def test_frames_of_a_video_go_by_their_recorded_numbers() -> None:
    described, rows, seen = inspect.inspect(registry.read(registry.SAMPLE, None))
    described |= {"film": {"passed_through": [0, 1]}, "frames": described["frames"] + 2}
    page = instances.page(seen, described, rows).decode()
    assert f", frame {seen.length // 2 + 2}<" in page
    assert any(f"({row.first_frame + 2}–{row.last_frame + 2})" in page for row in rows)


def test_a_video_is_shown_at_several_times_and_large_images_small() -> None:
    _, rows, seen = inspect.inspect(registry.read(registry.SAMPLE, None))
    view = seen.views["front"]
    track = np.tile(np.eye(4), (seen.length, 1, 1))
    track[:, 0, 3] = np.linspace(0, 0.1, seen.length)
    assert view.ids is not None
    filmed = CameraView(
        replace(view.camera, cam_to_world=track),
        lambda t: np.kron(view.rgb(t), np.ones((8, 8, 1), np.uint8)),
        ids=lambda t: np.kron(view.ids(t), np.ones((8, 8), np.int32)),  # type: ignore[misc]
        inferred=True,
    )
    episode, names = replace(seen, views={"ego": filmed}), instances.labels(rows)
    made = instances._views(episode, names, range(99))
    times = [round(share * (seen.length - 1)) for share in instances.SPREAD]
    assert [one.split("frame ")[1].split("<")[0] for one in made] == list(map(str, times))
    data = base64.b64decode(made[0].split("base64,")[1].split("'")[0])
    assert cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR).shape[0] == 640
