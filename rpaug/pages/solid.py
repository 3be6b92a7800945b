"""A space in the browser as it was seen: surfaces by oriented discs, what was put in with its texture, and names, each
of which is shown, labelled and hidden by itself."""

from typing import Any

import numpy as np
from jaxtyping import Bool, UInt8

from rpaug.pages import live
from rpaug.pages.live import INSTANCE, MOST_POINTS
from rpaug.pages.space import REST, Cloud, MeshInPlace, Space

HEIGHT = 0.02  # metres of a label's letters
PUT_IN, LABELS = "meshes of what was put in", "names"


class SolidView(live.LiveView):
    """A viewer whose points are surfels: flat Gaussians that face the way their surface does."""

    def __init__(self, space: Space, port: int, most: int = MOST_POINTS) -> None:
        self.hidden: set[str] = {LABELS}
        self._nodes: dict[str, Any] = {}
        super().__init__(space, port, most)

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
                live._camera(scene, name, view, t)
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
        node, (wxyz, position) = self._nodes[path], live._placed(one.to_world)
        node.wxyz, node.position = wxyz, position
        node.visible = self._shown(one)

    def _controls(self) -> None:
        super()._controls()
        gui, entities = self.server.gui, self.space.entities()
        if not entities:
            return
        with gui.add_folder("shown", expand_by_default=False):
            meshes = [PUT_IN] if any(one.solid for one in self.space.meshes(0)) else []
            for name in (LABELS, *meshes, *entities, REST):
                box = gui.add_checkbox(name, name not in self.hidden)
                box.on_update(lambda event: self.toggle(event.target.label, event.target.value))


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
