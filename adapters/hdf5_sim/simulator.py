"""Looks again at states that robosuite or LIBERO recorded: runs in the simulator's own environment, without rpaug.

Lines of JSON come in, `{path, group, cameras: {name: [width, height]}, out}`; each is answered by one, `{error}` or
`{instances: {name: id}, robot: [id, ...], moved: [id, ...]}`, and a file of arrays: color, the same with a part of the
light, depth in metres as robomimic has it, instance ids (h, w), K with integer pixel centres, cam_to_world with
OpenCV's axes. No action is played.

What moves as one is one instance (MuJoCo's welds); of what stands still it is each body of the world, and each geom
that the world itself has. Names of instances are those of their first bodies.
"""

import importlib
import json
import os
import sys
import tempfile
import xml.etree.ElementTree as ET
from typing import Any

os.environ.setdefault("MUJOCO_GL", "egl")
OPENGL = (1, -1, -1)  # its camera's axes in OpenCV's
MOVES = 0.01  # metres
LIGHT = 0.25  # of the recorded light in dimmed images: robosuite's lamps exceed white by less than four times
GEOM = 5  # mjOBJ_GEOM


class Watcher:
    """One environment, and the file that it was made for."""

    def __init__(self) -> None:
        self.env: Any = None
        self.made = "", ""

    def look(
        self, path: str, group: str, cameras: dict[str, list[int]], out: str
    ) -> dict[str, Any]:
        """Answer one question."""
        import h5py
        import numpy as np

        with h5py.File(path, "r") as file:
            told = file["data"].attrs
            self._make(told["env_args"], told.get("bddl_file_content", ""))
            states = file[group]["states"][()]
            model, words = file[group].attrs["model_file"], file[group].attrs.get("ep_meta", "{}")
        self._load(model, words)
        sim, found = self.env.sim, {}
        ids, answer = self._instances()
        where = []
        reels: dict[str, list[Any]] = {}
        for state in states:
            sim.set_state_from_flattened(state)
            sim.forward()
            where.append(np.array(sim.data._data.xpos))
            for name, size in cameras.items():
                for kind, shot in zip(
                    ("rgb", "dimmed", "depth", "ids", "pose"),
                    self._shoot(name, size, ids),
                    strict=True,
                ):
                    reels.setdefault(f"{name}/{kind}", []).append(shot)
        for name, (width, height) in cameras.items():
            fovy = np.radians(sim.model.cam_fovy[sim.model.camera_name2id(self._named(name))])
            focal = height / 2 / np.tan(fovy / 2)
            centre = [[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]]
            found[f"{name}/K"] = np.array(centre)
        found |= {name: np.stack(reel) for name, reel in reels.items()}
        np.savez(out, **found)
        way = np.ptp(np.stack(where), axis=0).max(1)
        bodies = np.array(sim.model._model.geom_bodyid)
        moved = {int(ids[geom]) for geom in range(len(ids)) if way[bodies[geom]] > MOVES}
        return {**answer, "moved": sorted(moved - {0, *answer["robot"]})}

    def _make(self, given: str, task: str) -> None:
        """The environment of a file's `env_args`, with LIBERO's task; controllers draw nothing, and other versions
        refuse them."""
        if (given, task) == self.made:
            return
        import robosuite

        settings = json.loads(given)
        left = ("controller_configs", "camera_segmentations")
        kwargs = {key: value for key, value in settings["env_kwargs"].items() if key not in left}
        seen = {"has_renderer": False, "has_offscreen_renderer": True, "use_camera_obs": False}
        with tempfile.NamedTemporaryFile("w", suffix=".bddl") as file:
            if task:
                importlib.import_module("libero.libero.envs")  # they are robosuite's from now on
                file.write(task)
                file.flush()
                kwargs["bddl_file_name"] = file.name
            self.env = robosuite.make(settings["env_name"], **kwargs | seen | {"ignore_done": True})
        self.made = given, task

    def _load(self, model: str, words: str) -> None:
        if hasattr(self.env, "set_ep_meta"):
            self.env.set_ep_meta(json.loads(words))
        libero = bool(self.made[1])
        own = self._with_files(model) if libero else self.env.edit_model_xml(model)
        self.env.reset_from_xml_string(own)
        self.env.sim.reset()

    def _with_files(self, model: str) -> str:
        """The model with the files of robosuite and LIBERO as they are installed, wherever the recorder's lay."""
        from robosuite.models import assets_root

        places = {"/robosuite/models/assets/": assets_root, "/assets/": self.env.custom_asset_dir}
        root = ET.fromstring(model)
        for one in root.iter():
            for place, here in places.items():
                _, found, below = one.get("file", "").rpartition(place)
                if found:
                    one.set("file", os.path.join(here, below))
                    break
        return ET.tostring(root, encoding="unicode")

    def _instances(self) -> tuple[Any, dict[str, Any]]:
        """The instance id of each geom, their names, and which are the robot's."""
        import numpy as np

        model = self.env.sim.model._model
        ids, names = np.zeros(model.ngeom, np.int32), {}
        roots = {robot.robot_model.root_body for robot in self.env.robots}
        mine = set()
        for geom in range(model.ngeom):
            body = int(model.geom_bodyid[geom])
            weld, root = int(model.body_weldid[body]), int(model.body_rootid[body])
            name = (
                model.body(weld or root).name if body else f"geom {model.geom(geom).name or geom}"
            )
            ids[geom] = names.setdefault(name, len(names) + 1)
            if model.body(root).name in roots:
                mine.add(int(ids[geom]))
        return ids, {"instances": names, "robot": sorted(mine)}

    def _named(self, name: str) -> str:
        """The model's name of a camera: LIBERO's files leave out the robot's."""
        return name if name in self.env.sim.model.camera_names else f"robot0_{name}"

    def _shoot(self, name: str, size: list[int], ids: Any) -> tuple[Any, ...]:
        import numpy as np

        sim, name = self.env.sim, self._named(name)
        given = {"camera_name": name, "width": size[0], "height": size[1]}
        rgb, depth = sim.render(**given, depth=True)
        lights = _lights(sim.model._model)
        recorded = [light.copy() for light in lights]
        for light in lights:
            light *= LIGHT
        dimmed, _ = sim.render(**given, depth=True)
        for light, one in zip(lights, recorded, strict=True):
            light[:] = one
        marks, sim.model._model.site_size[:] = (
            sim.model._model.site_size.copy(),
            1e-8,
        )  # as robosuite
        kind, geom = np.moveaxis(sim.render(**given, segmentation=True)[::-1], -1, 0)
        sim.model._model.site_size[:] = marks
        far, near = (
            getattr(sim.model.vis.map, end) * sim.model.stat.extent for end in ("zfar", "znear")
        )
        metres = near / (1 - depth[::-1] * (1 - near / far))
        hit = (kind == GEOM) & (geom >= 0)
        shown = np.where(hit, ids[np.where(hit, geom, 0)], 0)
        camera = sim.model.camera_name2id(name)
        pose = np.eye(4)
        pose[:3, :3] = sim.data.cam_xmat[camera].reshape(3, 3) * OPENGL
        pose[:3, 3] = sim.data.cam_xpos[camera]
        color = rgb[::-1].copy(), dimmed[::-1].copy()
        return *color, metres.astype(np.float32), shown.astype(np.int32), pose


def _lights(model: Any) -> list[Any]:
    """All that gives light in a model, as arrays to write to."""
    kinds = ("ambient", "diffuse", "specular")
    lamps = [getattr(model, f"light_{kind}") for kind in kinds]
    return [*lamps, *(getattr(model.vis.headlight, kind) for kind in kinds), model.mat_emission]


def main() -> None:
    """Answer until there are no more lines."""
    watcher, answers = Watcher(), os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what the simulator prints is no answer
    for line in sys.stdin:
        try:
            answer = watcher.look(**json.loads(line))
        except Exception as error:
            answer = {"error": f"{type(error).__name__}: {error}"}
        answers.write(json.dumps(answer) + "\n")
        answers.flush()


if __name__ == "__main__":
    main()
