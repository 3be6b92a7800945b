"""Contracts that operators and adapters are held to: subclass one in your own tests and pytest runs it.

class TestMine(rpaug.OperatorContract):
    def operator(self): return MyOperator(target=rpaug.Target(role="manipulated"))
"""

import json
from dataclasses import FrozenInstanceError, fields
from functools import cache
from pathlib import Path

import numpy as np
from pydantic import TypeAdapter

from rpaug.compose import views
from rpaug.core import phrases, registry
from rpaug.core.errors import RpaugError
from rpaug.core.interfaces import Adapter, Added, Edit, Operator, Painted
from rpaug.core.types import CameraView, Effect, Episode, Scene
from rpaug.pipeline import plan, prepare, python_api

IMAGES = {Effect.RGB: "rgb", Effect.DEPTH: "depth", Effect.MASK: "ids"}


def shown(scene: Scene, tier: int = 0) -> Episode:
    """The episode an edited scene shows, rendered as the pipeline would."""
    made = plan.settle(plan.Plan(tier, dict.fromkeys(scene.episode.views, 0), True), scene)
    return views.edited(scene, made.representations, lambda *ignored: None)


def same(first: CameraView, second: CameraView, kind: str, t: int) -> bool:
    """Whether two views have the same image of one kind, bit for bit; none equals none."""
    one, other = getattr(first, kind), getattr(second, kind)
    if one is None or other is None:
        return one is other
    return bool(np.array_equal(one(t), other(t)))


@cache
def _sample() -> Scene:
    """The sample that ships, with its bodies and roles."""
    return prepare.found_instances(python_api.read(registry.SAMPLE), ()).scene()


class OperatorContract:
    """What every operator promises. Override `operator`; `frames` says which frames are compared."""

    frames = (0,)

    def operator(self) -> Operator:
        """The operator under test, set up so that its edits show."""
        raise RpaugError("override operator()")

    def scene(self) -> Scene:
        """A scene it works on: the sample that ships, unless you override this."""
        return _sample()

    def _edit(self, scene: Scene, seed: int = 0) -> Edit:
        return self.operator().sample(scene, np.random.default_rng(seed))

    def test_its_fields_cannot_be_changed(self) -> None:
        operator = self.operator()
        for field in fields(operator):  # type: ignore[arg-type]
            try:
                setattr(operator, field.name, None)
            except FrozenInstanceError:
                continue
            raise AssertionError(f"{field.name} can be set: declare @dataclass(frozen=True)")

    def test_its_edit_is_plain_json(self) -> None:
        edit = self._edit(self.scene())
        assert json.loads(json.dumps(edit)) == edit

    def test_the_same_seed_draws_the_same_edit(self) -> None:
        scene = self.scene()
        assert self._edit(scene, 3) == self._edit(scene, 3)

    def test_its_edit_replays_from_json(self) -> None:
        scene, operator = self.scene(), self.operator()
        edit = self._edit(scene)
        once = shown(operator.apply(scene, edit))
        again = shown(operator.apply(scene, json.loads(json.dumps(edit))))
        for name, view in once.views.items():
            assert all(
                same(view, again.views[name], kind, t)
                for kind in IMAGES.values()
                for t in self.frames
            )

    def test_the_scene_it_was_given_is_left_alone(self) -> None:
        scene, operator = self.scene(), self.operator()
        poses = {name: camera.cam_to_world.copy() for name, camera in scene.cameras.items()}
        kept = {field.name: getattr(scene, field.name) for field in fields(scene)}
        images = {name: view.rgb(0).copy() for name, view in scene.episode.views.items()}
        operator.apply(scene, self._edit(scene))
        assert all(getattr(scene, name) is value for name, value in kept.items())
        for name, camera in scene.cameras.items():
            assert np.array_equal(camera.cam_to_world, poses[name])
            assert np.array_equal(scene.episode.views[name].rgb(0), images[name])

    def test_it_changes_something_it_declared(self) -> None:
        scene, operator = self.scene(), self.operator()
        after = operator.apply(scene, self._edit(scene))
        assert self._changes(scene, after) & operator.effect

    def test_it_changes_nothing_it_did_not_declare(self) -> None:
        scene, operator = self.scene(), self.operator()
        after = operator.apply(scene, self._edit(scene))
        extra = self._changes(scene, after) & ~operator.effect
        assert not extra, f"changed {extra}, declared {operator.effect}"

    def test_what_it_needs_are_its_fields(self) -> None:
        operator = self.operator()
        named = {*operator.needs.targets, *operator.needs.anchors}
        unknown = named - {field.name for field in fields(operator)}  # type: ignore[arg-type]
        assert not unknown, f"needs name {unknown}: no such fields"

    def test_each_phrase_asks_for_a_valid_edit(self) -> None:
        kind = type(self.operator())
        for text in kind.phrases:
            phrase = phrases.parse(text, kind)
            for whole in (True, False):  # with what may be left out, and without
                slots = phrases.slots(phrase, whole)
                given = phrases.fields([(slot.field, slot.example[1]) for slot in slots])
                TypeAdapter(kind).validate_python(given)

    def test_each_example_is_a_valid_edit(self) -> None:
        kind = type(self.operator())
        for _, given in kind.examples:
            TypeAdapter(kind).validate_python(dict(given))

    def test_what_it_says_is_plain_and_covers_what_it_paints(self) -> None:
        scene, operator = self.scene(), self.operator()
        edit = self._edit(scene)
        changes = operator.says(json.loads(json.dumps(edit)))
        assert all(isinstance(change, Painted | Added) for change in changes)
        assert list(changes) == list(operator.says(edit))
        laid = operator.apply(scene, edit).appearance[len(scene.appearance) :]
        painted = [change.instance_ids for change in changes if isinstance(change, Painted)]
        for instance_id in frozenset[int]().union(*painted):
            layers = sum(instance_id in (one.instance_ids or ()) for one in laid)
            words = sum(instance_id in one for one in painted)
            assert layers <= words, f"{instance_id}: {layers} appearances, {words} times Painted"

    def _changes(self, before: Scene, after: Scene) -> Effect:
        changed = Effect.NONE
        old, new = shown(before), shown(after)
        for name, view in old.views.items():
            for effect, kind in IMAGES.items():
                if not all(same(view, new.views[name], kind, t) for t in self.frames):
                    changed |= effect
            camera, moved = view.camera, new.views[name].camera
            if not (
                np.array_equal(camera.K, moved.K)
                and np.array_equal(camera.cam_to_world, moved.cam_to_world)
            ):
                changed |= Effect.CAMERA
        if old.descriptions != new.descriptions:
            changed |= Effect.WORDS
        if before.bodies is not after.bodies:
            changed |= Effect.BODIES
        return changed


class AdapterContract:
    """What every adapter promises. Override `adapter` and `dataset`, which makes a small dataset in a folder."""

    def adapter(self) -> Adapter:
        """The adapter under test."""
        raise RpaugError("override adapter()")

    def dataset(self, folder: Path) -> Path:
        """The root of a small valid dataset, made under `folder`."""
        raise RpaugError("override dataset()")

    def test_it_finds_its_episodes_and_only_its_own(self, tmp_path: Path) -> None:
        adapter = self.adapter()
        assert adapter.episodes(self.dataset(tmp_path / "in"))
        (tmp_path / "empty").mkdir()
        assert not adapter.episodes(tmp_path / "empty")

    def test_images_have_the_shapes_and_types_promised(self, tmp_path: Path) -> None:
        adapter, root = self.adapter(), self.dataset(tmp_path / "in")
        episode = adapter.read(root, adapter.episodes(root)[0])
        assert episode.length > 0
        assert episode.views
        for view in episode.views.values():
            size = (view.camera.height, view.camera.width)
            assert view.camera.cam_to_world.shape == (episode.length, 4, 4)
            assert view.rgb(0).shape == (*size, 3)
            assert view.rgb(0).dtype == np.uint8
            if view.depth is not None:
                assert view.depth(0).shape == size
                assert view.depth(0).dtype == np.float32
            if view.ids is not None:
                assert view.ids(0).shape == size
                assert view.ids(0).dtype == np.int32

    def test_what_is_written_unedited_reads_back_the_same(self, tmp_path: Path) -> None:
        adapter, root = self.adapter(), self.dataset(tmp_path / "in")
        key = adapter.episodes(root)[0]
        before = adapter.read(root, key)
        adapter.write(
            before, tmp_path / "out", adapter.key_at(key, 0), lambda: {"note.txt": b"hello"}
        )
        written = adapter.episodes(tmp_path / "out")
        assert len(written) == 1
        after = adapter.read(tmp_path / "out", written[0])
        assert after.descriptions == before.descriptions
        assert list(after.views) == list(before.views)
        for field in fields(before.robot):
            old, new = getattr(before.robot, field.name), getattr(after.robot, field.name)
            pairs = (
                zip(old.values(), new.values(), strict=True)
                if isinstance(old, dict)
                else [(old, new)]
            )
            assert all(np.array_equal(a, b) for a, b in pairs), field.name
        for name, view in before.views.items():
            assert np.array_equal(view.camera.K, after.views[name].camera.K)
            assert np.array_equal(view.camera.cam_to_world, after.views[name].camera.cam_to_world)
            for t in range(before.length):
                assert all(same(view, after.views[name], kind, t) for kind in IMAGES.values())
        assert [path.read_bytes() for path in (tmp_path / "out").rglob("note.txt")] == [b"hello"]

    def test_it_never_overwrites(self, tmp_path: Path) -> None:
        adapter, root = self.adapter(), self.dataset(tmp_path / "in")
        key = adapter.episodes(root)[0]
        episode = adapter.read(root, key)
        adapter.write(episode, tmp_path / "out", key, dict)
        before = {
            path: path.read_bytes() for path in (tmp_path / "out").rglob("*") if path.is_file()
        }
        try:
            adapter.write(episode, tmp_path / "out", key, dict)
        except RpaugError:
            assert before == {path: path.read_bytes() for path in before}
        else:
            raise AssertionError("a second write of the same key was not refused")

    def test_a_failed_write_leaves_nothing(self, tmp_path: Path) -> None:
        adapter, root = self.adapter(), self.dataset(tmp_path / "in")
        key = adapter.episodes(root)[0]

        def fail() -> dict[str, bytes]:
            raise OSError(28, "No space left on device")

        try:
            adapter.write(adapter.read(root, key), tmp_path / "out", key, fail)
        except OSError:
            assert not [path for path in (tmp_path / "out").rglob("*") if path.is_file()]
        else:
            raise AssertionError("the failure was swallowed")

    def test_keys_of_a_group_count_from_zero(self, tmp_path: Path) -> None:
        adapter, root = self.adapter(), self.dataset(tmp_path / "in")
        key = adapter.episodes(root)[0]
        keys = [adapter.key_at(key, index) for index in range(3)]
        assert len(set(keys)) == 3
        assert adapter.key_at(keys[2], 0) == keys[0]
