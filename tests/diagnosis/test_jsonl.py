"""Evaluation files: what is right is read back, and what is wrong is told by line and field."""

import contextlib
import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rollouts import evaluation

from rpaug.core.errors import BadInput
from rpaug.core.files import encode_png
from rpaug.diagnosis import FrameImages, Line, jsonl, read, write

GOOD = {
    "version": 1,
    "episode": "a",
    "success": True,
    "frames": [{"t": 0, "images": {"front": "a.png"}}],
}


def stated(tmp_path: Path, *rows: object) -> Path:
    (tmp_path / "a.png").write_bytes(encode_png(np.zeros((8, 8, 3), np.uint8)))
    path = tmp_path / "eval.jsonl"
    path.write_text("".join((r if isinstance(r, str) else json.dumps(r)) + "\n" for r in rows))
    return path


def test_what_is_written_is_read(tmp_path: Path) -> None:
    path = evaluation(tmp_path, lambda image: image)
    found = read(path)
    assert (len(found.rollouts), len(found.failures)) == (16, 8)
    one = found.rollouts[0]
    assert one.instruction == "open the drawer"
    assert one.shots["front"][0].image().shape == (128, 128, 3)
    assert one.shots["front"][0].ids is None


def test_masks_poses_and_roles_are_read(tmp_path: Path) -> None:
    mask = np.zeros((8, 8, 3), np.uint8)
    mask[2, 3] = (1, 2, 0)
    (tmp_path / "m.png").write_bytes(encode_png(mask))
    moment = {
        "t": 3,
        "images": {"front": "a.png"},
        "masks": {"front": "m.png"},
        "poses": {"front": np.eye(4).tolist()},
    }
    found = read(stated(tmp_path, GOOD | {"frames": [moment], "roles": {"manipulated": [513]}}))
    shot = found.rollouts[0].shots["front"][3]
    assert shot.ids is not None
    assert shot.ids()[2, 3] == 513
    assert np.array_equal(shot.pose, np.eye(4))  # type: ignore[arg-type]
    assert found.rollouts[0].roles == {"manipulated": frozenset([513])}


@pytest.mark.parametrize(
    ("row", "field"),
    [
        ("{", "line"),
        ("[1]", "line"),
        ("[" * 100_000, "line"),
        (GOOD | {"success": "yes"}, "success"),
        (GOOD | {"success": 1}, "success"),
        ({k: v for k, v in GOOD.items() if k != "episode"}, "episode"),
        (GOOD | {"colour": "red"}, "colour"),
        (GOOD | {"version": 2}, "version"),
        (GOOD | {"frames": []}, "frames, video"),
        (GOOD | {"video": {"front": "a.mp4"}}, "frames, video"),
        (GOOD | {"frames": [{"t": -1, "images": {"front": "a.png"}}]}, "frames[0].t"),
        (GOOD | {"frames": [{"t": 0, "images": {}}]}, "frames[0].images"),
        (GOOD | {"frames": [GOOD["frames"][0], GOOD["frames"][0]]}, "frames"),  # type: ignore[index]
        (GOOD | {"frames": [{"t": 0, "images": {"front": "b.png"}}]}, "frames[0].images.front"),
        (GOOD | {"frames": [{"t": 0, "images": {"front": "../a.png"}}]}, "frames[0].images.front"),
        (GOOD | {"frames": [{"t": 0, "images": {"front": "/etc/passwd"}}]}, "frames[0].images.front"),
        (GOOD | {"frames": [{"t": 0, "images": {"front": ""}}]}, "frames[0].images.front"),
        (GOOD | {"frames": [{"t": 0, "images": {"front": "a\x00.png"}}]}, "frames[0].images.front"),
        (GOOD | {"frames": [{"t": 0, "images": {"c": "a.png"}, "poses": {"c": [[1]]}}]}, "frames[0].poses.c"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_told(tmp_path: Path, row: object, field: str) -> None:
    path = stated(tmp_path, GOOD | {"episode": "before"}, row)
    with pytest.raises(BadInput) as caught:
        read(path)
    assert caught.value.where == f"{path}:2"
    assert caught.value.field == field
    assert len(str(caught.value)) < 600


def test_a_name_is_given_once(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="line 1"):
        read(stated(tmp_path, GOOD, GOOD))


def test_a_link_that_leads_out_is_refused(tmp_path: Path) -> None:
    inner = tmp_path / "inner"
    inner.mkdir()
    path = stated(inner, GOOD | {"frames": [{"t": 0, "images": {"front": "link.png"}}]})
    (tmp_path / "out.png").write_bytes(b"")
    (inner / "link.png").symlink_to(tmp_path / "out.png")
    with pytest.raises(BadInput, match="inside the folder"):
        read(path)


def test_nothing_and_too_much_are_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="rollouts: found none"):
        read(stated(tmp_path, ""))
    with pytest.raises(BadInput, match="at most"):
        read(stated(tmp_path, GOOD | {"metadata": {"x": "y" * jsonl.MOST_LINE}}))
    with pytest.raises(BadInput, match="found nothing"):
        read(tmp_path / "none.jsonl")


def test_a_damaged_picture_is_told_when_it_is_looked_at(tmp_path: Path) -> None:
    path = stated(tmp_path, GOOD)
    (tmp_path / "a.png").write_bytes(b"\x89PNG\r\n\x1a\nrubbish")
    with pytest.raises(BadInput, match=r"a\.png"):
        read(path).rollouts[0].shots["front"][0].image()


@given(st.binary(max_size=300))
def test_any_bytes_are_a_line_or_an_error(data: bytes) -> None:
    with contextlib.suppress(BadInput):
        assert isinstance(jsonl.parse(data, "x:1"), Line)


def test_lines_come_back_as_they_were(tmp_path: Path) -> None:
    lines = [
        Line(
            episode="a",
            success=False,
            frames=(FrameImages(t=2, images={"front": "a.png"}),),
            failed_at=2,
        ),
        Line(episode="b", success=True, video={"front": "b.mp4"}, metadata={"seed": 3}),
    ]
    write(tmp_path / "e.jsonl", lines)
    assert [line for _, line in jsonl.read(tmp_path / "e.jsonl")] == lines
