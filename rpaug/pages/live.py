"""A space in the browser, by viser: orbit it, scrub through time, color it by image or by instance."""

from types import TracebackType
from typing import Any

import numpy as np
from jaxtyping import Float64

from rpaug.core import geometry
from rpaug.core.errors import MissingExtra
from rpaug.core.types import CameraView
from rpaug.pages.space import Space

HOST = "127.0.0.1"
MOST_POINTS = 150_000
LOOKED = 4_000  # points that tell where the middle is
BACK = 2.2  # times as far from it as the cameras are
POINT = 0.004  # metres
FRUSTUM = 0.08  # metres that a camera's pyramid is deep
LINE = 0.003  # metres
WIDEST = 320  # pixels of a camera's image
IMAGE, INSTANCE = "image", "instance"


class LiveView:
    """A running viewer of one space on this machine alone, at the port or the next free one. Raises MissingExtra."""

    def __init__(self, space: Space, port: int, most: int = MOST_POINTS) -> None:
        self.space, self.most, self.t, self.colored = space, most, 0, IMAGE
        self.server = _server(space.title, port)
        self._meshes: list[Any] = []
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
        cloud = self.space.cloud(t, self.most)
        colors = cloud.colors if self.colored == IMAGE else self.space.by_instance(cloud.ids)
        with self.server.atomic():
            if len(cloud.points):
                scene.add_point_cloud("/seen", cloud.points, colors, point_size=POINT)
            for name, view in (self.space.episode.views if self.space.episode else {}).items():
                _camera(scene, name, view, t)
            for mesh in self._meshes:
                mesh.remove()
            self._meshes = [
                scene.add_mesh_simple(
                    f"/put in/{one.name}", one.vertices, one.faces, wireframe=True
                )
                for one in self.space.meshes(t)
            ]
            if (splats := self.space.splats(t)) is not None:
                scene.add_gaussian_splats(
                    "/Gaussians",
                    splats.centers,
                    splats.covariances,
                    splats.colors,
                    splats.opacities[:, None],
                )

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
