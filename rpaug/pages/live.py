"""A space in the browser, by viser: orbit it, scrub through time, color it by image or by instance. Surfaces are
oriented discs, what was put in has its texture, and each name is shown, labelled and hidden by itself."""

from collections.abc import Iterable
from types import TracebackType
from typing import Any

import numpy as np
from jaxtyping import Bool, Float64, UInt8

from rpaug.core import geometry
from rpaug.core.errors import MissingExtra
from rpaug.core.types import CameraView
from rpaug.pages.space import REST, Cloud, MeshInPlace, Space

HOST = "127.0.0.1"
MOST_POINTS = 150_000
LOOKED = 4_000  # points that tell where the middle is
BACK = 2.2  # times as far from it as the cameras are
FRUSTUM = 0.08  # metres that a camera's pyramid is deep
LINE = 0.003  # metres
WIDEST = 320  # pixels of a camera's image
IMAGE, INSTANCE = "image", "instance"
HEIGHT = 0.02  # metres of a label's letters
PUT_IN, LABELS = "meshes of what was put in", "names"


class LiveView:
    """A running viewer of one space on this machine alone, at the port or the next free one. Raises MissingExtra."""

    def __init__(self, space: Space, port: int, most: int = MOST_POINTS) -> None:
        self.space, self.most, self.t, self.colored = space, most, 0, IMAGE
        self.server = _server(space.title, port)
        self.hidden: set[str] = {LABELS}
        self._nodes: dict[str, Any] = {}
        self._controls()
        self._stand()
        self.show(0)

    @property
    def url(self) -> str:
        return f"http://{HOST}:{self.server.get_port()}"

    def __enter__(self) -> "LiveView":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.server.stop()

    def show(self, t: int) -> None:
        """Bring what is drawn to frame t, all of it at once."""
        self.t, scene = t, self.server.scene
        cloud, meshes = self.space.cloud(t, self.most), self.space.meshes(t)
        whole = [one for one in meshes if self._shown(one)]
        own = list(frozenset[int]().union(*(one.instance_ids for one in whole)))
        with self.server.atomic():
            for name, part in self.space.apart(cloud).items():
                colors = part.colors
                if self.colored == INSTANCE:
                    colors = self.space.by_instance(part.ids)
                self._draw(name, part, colors, ~np.isin(part.ids, own))
            for name, view in (self.space.episode.views if self.space.episode else {}).items():
                _camera(scene, name, view, t)
            for one in meshes:
                self._place(one)
            if (splats := self.space.splats(t)) is not None:
                scene.add_gaussian_splats(
                    "/Gaussians",
                    splats.centers,
                    splats.covariances,
                    splats.colors,
                    splats.opacities[:, None],
                )

    def toggle(self, name: str, shown: bool) -> None:
        """Show or hide what has this name: an entity, all labels, or the meshes."""
        self.hidden = self.hidden - {name} if shown else self.hidden | {name}
        self.show(self.t)

    def _shown(self, one: MeshInPlace) -> bool:
        """Whether a mesh stands for its pixels."""
        wanted = one.solid and self.colored != INSTANCE
        return wanted and not self.hidden & {PUT_IN, one.name}

    def _draw(
        self,
        name: str,
        part: Cloud,
        colors: UInt8[np.ndarray, "n 3"],
        keep: Bool[np.ndarray, "n"],
    ) -> None:
        """An entity's label, and its discs that are kept; nothing of one that is out of sight or hidden."""
        for path in (f"/instances/{name}", f"/names/{name}"):
            if (old := self._nodes.pop(path, None)) is not None:
                old.remove()
        if not len(part.points) or name in self.hidden:
            return
        if keep.any():
            self._nodes[f"/instances/{name}"] = self.server.scene.add_gaussian_splats(
                f"/instances/{name}",
                part.points[keep],
                part.covariances[keep],
                colors[keep],
                np.ones((int(keep.sum()), 1), np.float32),
            )
        if LABELS not in self.hidden and name != REST:
            self._nodes[f"/names/{name}"] = self.server.scene.add_label(
                f"/names/{name}",
                name,
                position=np.median(part.points, axis=0),
                font_size_mode="scene",
                font_scene_height=HEIGHT,
                anchor="bottom-center",
            )

    def _place(self, one: MeshInPlace) -> None:
        """Bring a mesh to where it is; it is sent once."""
        path = f"/put in/{one.name}"
        if path not in self._nodes:
            self._nodes[path] = self.server.scene.add_mesh_trimesh(path, _textured(one))
        node, (wxyz, position) = self._nodes[path], _placed(one.to_world)
        node.wxyz, node.position = wxyz, position
        node.visible = self._shown(one)

    def _stand(self) -> None:
        """Where a browser looks from at first: behind the cameras, at the middle of what they see."""
        cloud, splats = self.space.cloud(0, LOOKED), self.space.splats(0)
        points = cloud.points if splats is None else splats.centers
        if not len(points):
            return
        middle = np.median(points, axis=0)
        views = self.space.episode.views.values() if self.space.episode else ()
        eyes = [view.camera.cam_to_world[0, :3, 3] for view in views]
        away = np.mean(eyes, axis=0) - middle if eyes else np.ones(3)
        start = self.server.initial_camera
        start.look_at, start.position = tuple(middle), tuple(middle + BACK * away)

    def _controls(self) -> None:
        scene, gui = self.server.scene, self.server.gui
        scene.set_up_direction("+z")
        gui.add_markdown(f"**{self.space.title}**")
        if self.space.length > 1:
            frame = gui.add_slider("frame", 0, self.space.length - 1, 1, 0)
            frame.on_update(lambda _: self.show(int(frame.value)))
        if self.space.names:
            colored = gui.add_dropdown("colors", (IMAGE, INSTANCE))

            def recolor(_: Any) -> None:
                self.colored = colored.value
                self.show(self.t)

            colored.on_update(recolor)
            legend = (
                f"- <span style='color:rgb{color}'>&#9632;</span> {name}"
                for name, color in self.space.names.values()
                if name
            )
            with gui.add_folder("instances", expand_by_default=False):  # long, on a phone
                gui.add_markdown("\n".join(legend))
        if entities := self.space.entities():
            self._switches(entities)

    def _switches(self, entities: Iterable[str]) -> None:
        """A box for all labels, for the meshes, and for each entity."""
        with self.server.gui.add_folder("shown", expand_by_default=False):
            meshes = [PUT_IN] if any(one.solid for one in self.space.meshes(0)) else []
            for name in (LABELS, *meshes, *entities, REST):
                box = self.server.gui.add_checkbox(name, name not in self.hidden)
                box.on_update(lambda event: self.toggle(event.target.label, event.target.value))


def _server(title: str, port: int) -> Any:
    try:
        import viser
    except ImportError:
        raise MissingExtra("viser", "view") from None
    return viser.ViserServer(HOST, port, label=title, verbose=False)


def _camera(scene: Any, name: str, view: CameraView, t: int) -> None:
    camera = view.camera
    wxyz, position = _placed(camera.cam_to_world[t])
    image = view.rgb(t)
    stride = max(1, -(-camera.width // WIDEST))
    scene.add_camera_frustum(
        f"/cameras/{name}",
        fov=float(2 * np.arctan(camera.height / (2 * camera.K[1, 1]))),
        aspect=camera.width / camera.height,
        scale=FRUSTUM,
        thickness=LINE,
        image=image[::stride, ::stride],
        wxyz=wxyz,
        position=position,
    )


def _placed(pose: Float64[np.ndarray, "4 4"]) -> tuple[np.ndarray, np.ndarray]:
    """Quaternion (w, x, y, z) and place; viser's cameras look along +z, y down, as ours do."""
    return geometry.quaternion_of(pose)[[3, 0, 1, 2]], pose[:3, 3]


def _textured(one: MeshInPlace) -> Any:
    """A mesh as viser takes it, in its own frame, of its true size."""
    import trimesh  # only here: it takes a second
    from PIL import Image

    material = trimesh.visual.material.PBRMaterial(
        baseColorTexture=Image.fromarray(one.mesh.image), metallicFactor=0.0, roughnessFactor=1.0
    )
    return trimesh.Trimesh(
        one.scale * one.mesh.points,
        one.faces,
        vertex_normals=one.mesh.normals,
        visual=trimesh.visual.TextureVisuals(uv=one.mesh.uv, material=material),
        process=False,
    )
