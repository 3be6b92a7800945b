"""Each value of a dataset's descriptions is of another kind once: it is read, or refused by file and field."""

import copy
import json
import os
import sys
from pathlib import Path

import pytest

from rpaug import BadInput

sys.path.insert(0, str(Path(__file__).parents[2] / "tools/fuzz"))
import run
import seeds
from trees import places

ODD = (0.5, "x", "..", [0.5], {"a": 1})


@pytest.mark.parametrize("layout", ["ego4d", "jpeg_rlds"])
def test_a_value_of_another_kind_is_refused_by_file_and_field(layout: str, tmp_path: Path) -> None:
    getattr(seeds, layout)(tmp_path)
    refused, turn = [], 0
    for path in sorted(tmp_path.rglob("*.json")):
        data = path.read_bytes()
        for i in range(len(places(json.loads(data)))):
            for odd in ODD:
                tree = json.loads(data)
                node, key = places(tree)[i]
                node[key] = copy.deepcopy(odd)
                path.write_text(json.dumps(tree))
                turn += 1
                os.utime(path, ns=(turn * 10**6, turn * 10**6))  # caches go by it
                try:
                    run.read(run.LAYOUTS[layout], tmp_path)
                except BadInput as error:
                    refused.append((bool(error.field), str(tmp_path) in error.where))
        path.write_bytes(data)
    assert len(refused) > 40
    assert set(refused) == {(True, True)}


def test_a_shard_that_is_a_folder_is_refused(tmp_path: Path) -> None:
    seeds.jpeg_rlds(tmp_path)
    shard = next(tmp_path.rglob("*.tfrecord-*"))
    shard.unlink()
    shard.mkdir()
    with pytest.raises(BadInput, match="Is a directory; expected a TFRecord file"):
        run.read("rlds", tmp_path)


def test_hands_that_are_no_list_are_refused(tmp_path: Path) -> None:
    seeds.ego4d(tmp_path)
    path = next(tmp_path.rglob("fho_hands*.json"))
    tree = json.loads(path.read_bytes())
    tree["clips"][0]["frames"][0]["pnr_frame"]["boxes"] = 0.5
    path.write_text(json.dumps(tree))
    with pytest.raises(BadInput, match=r"pnr_frame\.boxes: found 0\.5; expected a list of objects"):
        run.read("video", tmp_path)
