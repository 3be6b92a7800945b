"""Two outputs are the same if they differ in seconds alone, and one flipped byte is found."""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from tools.compare_checkouts import compare

EPISODE = "task/episode0"
REPORT = {
    "seed": 7,
    "draws": [{"op": "recolor", "rgb": [0.1, 0.2, 0.3]}],
    "plan": {"warnings": ["the front camera is not where it says"]},
    "words": {"recorded": "open the red drawer"},
    "seconds": {"read": 0.25, "write": 1.5},
}
SUMMARY = {"copies": 1, "failures": {"task/episode1": "no depth"}, "seconds": {"read": 0.25}}


def output(root: Path, report: dict[str, Any] = REPORT, summary: dict[str, Any] = SUMMARY) -> Path:
    """A small output folder: an image, a pickle, a report, a summary, a card, a contact sheet and a journal."""
    episode = root / EPISODE
    episode.mkdir(parents=True)
    cv2.imwrite(str(episode / "0.png"), np.arange(48, dtype=np.uint8).reshape(4, 4, 3))
    (episode / "low_dim_obs.pkl").write_bytes(bytes(range(64)))
    (episode / "rpaug.json").write_text(json.dumps(report))
    (root / "rpaug.summary.json").write_text(json.dumps(summary))
    (root / "README.md").write_text("# The card")
    (root / "rpaug.contact.html").write_text("<p>The sheet</p>")
    (root / "rpaug.journal.jsonl").write_text('{"pid": 1}')
    return root


@pytest.fixture
def before(tmp_path: Path) -> Path:
    return output(tmp_path / "before")


def test_other_seconds_are_no_difference(before: Path, tmp_path: Path) -> None:
    slower = {**REPORT, "seconds": {"read": 0.5, "build": 2.0}}
    after = output(tmp_path / "after", slower, {**SUMMARY, "seconds": {"read": 0.5}})
    assert compare(before, after) == []


def test_one_flipped_byte_is_found(before: Path, tmp_path: Path) -> None:
    after = output(tmp_path / "after")
    pickle = after / EPISODE / "low_dim_obs.pkl"
    flipped = bytearray(pickle.read_bytes())
    flipped[33] ^= 1
    pickle.write_bytes(flipped)
    (found,) = compare(before, after)
    assert (found.where, found.counts) == (f"{EPISODE}/low_dim_obs.pkl", True)
    assert found.what == "64 bytes before, 64 after"


def test_differing_pixels_are_counted(before: Path, tmp_path: Path) -> None:
    after = output(tmp_path / "after")
    image = np.arange(48, dtype=np.uint8).reshape(4, 4, 3)
    image[1, 2] = image[3, 0, 1] = 255
    cv2.imwrite(str(after / EPISODE / "0.png"), image)
    (found,) = compare(before, after)
    assert found.counts
    assert found.what.endswith("2 of 16 pixels differ")


@pytest.mark.parametrize(
    ("change", "where"),
    [
        ({"draws": [{"op": "recolor", "rgb": [0.1, 0.2, 0.4]}]}, ":draws:0:rgb:2"),
        ({"words": {"recorded": "open the blue drawer"}}, ":words:recorded"),
        ({"seed": True}, ":seed"),
        ({"plan": {"warnings": []}}, ":plan:warnings"),
        ({"gates": {}}, ""),
    ],
)
def test_another_value_in_a_report_is_found(
    before: Path, tmp_path: Path, change: dict[str, Any], where: str
) -> None:
    (found,) = compare(before, output(tmp_path / "after", {**REPORT, **change}))
    assert (found.where, found.counts) == (f"{EPISODE}/rpaug.json{where}", True)


def test_another_skipped_episode_is_found(before: Path, tmp_path: Path) -> None:
    other = {**SUMMARY, "failures": {"task/episode2": "no depth"}}
    (found,) = compare(before, output(tmp_path / "after", summary=other))
    assert (found.where, found.counts) == ("rpaug.summary.json:failures", True)


def test_what_is_made_for_people_and_the_journal_are_listed_and_do_not_count(
    before: Path, tmp_path: Path
) -> None:
    reworded = {**REPORT, "plan": {"warnings": ["the front camera stands elsewhere"]}}
    after = output(tmp_path / "after", reworded, {**SUMMARY, "failures": {"task/episode1": "no z"}})
    (after / "README.md").write_text("# Another card")
    (after / "rpaug.contact.html").write_text("<p>Another sheet</p>")
    (after / "rpaug.journal.jsonl").write_text('{"pid": 2}')
    found = compare(before, after)
    assert [one.where for one in found] == [
        "README.md",
        "rpaug.contact.html",
        "rpaug.journal.jsonl",
        "rpaug.summary.json:failures:task/episode1",
        f"{EPISODE}/rpaug.json:plan:warnings:0",
    ]
    assert not any(one.counts for one in found)


def test_missing_and_additional_files_are_found(before: Path, tmp_path: Path) -> None:
    after = output(tmp_path / "after")
    (after / EPISODE / "0.png").rename(after / EPISODE / "1.png")
    found = [(one.where, one.what, one.counts) for one in compare(before, after)]
    assert found == [
        (f"{EPISODE}/0.png", "only before", True),
        (f"{EPISODE}/1.png", "only after", True),
    ]
