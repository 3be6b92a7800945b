"""Cast shadows of an edited scene: what has moved takes its shadow along, and lies in those of others.

A pixel that still shows what was recorded there keeps its light, but for the lamps that something came between, or no
longer stands between: of those, its light changes by what known surfaces say, from the light that the pixel itself
had. What was carried there from elsewhere, or put in, has the light that known surfaces leave to it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial
from itertools import product

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32, Int64, UInt8

from rpaug.core import geometry
from rpaug.core.memo import once
from rpaug.core.pixels import grown
from rpaug.core.types import Camera, Episode, Relit, Rig, Scene
from rpaug.scene.lighting import casting, highlights, intrinsic, rig
from rpaug.scene.lighting.casting import Casters, Discs
from rpaug.scene.recorded.carry import carried

CHANGED = 0.05  # of a lamp's light, from which a place has gained or lost it
RIM = 1  # pixels around such places in which a recorded shadow may end
ASTRAY = 2  # pixels from the map's shadow of a thing that its recorded one may reach
ALIKE = 0.1  # log light by which a measured one may differ from one of few
TRUST = 3.0  # squared multiples of it, that it costs a lamp to be another than the surfaces say
KEPT = 16  # images: each is asked for again as it is drawn
DARKEST = 0.02  # of full light: no shadow is deeper
RINGS = 0.5, 0.9  # of a lamp's radius: where on its disc it is looked at from


def of(scene: Scene) -> "Recast | None":
    """The shadows of a scene that is `relit`; None where those that were recorded stay."""
    return None if scene.relit is None else Recast(scene, scene.relit)


@dataclass(frozen=True, eq=False)
class Recast:
    """The light of an edited scene, over that which its surfaces were recorded under where all lamps reach them."""

    scene: Scene
    relit: Relit

    @cached_property
    def recorded(self) -> Episode:
        """The recorded images without cast shadows and highlights."""
        views = {
            name: replace(view, rgb=partial(self.even, name), radiance=None)
            if view.depth and view.ids
            else view
            for name, view in self.scene.episode.views.items()
        }
        return replace(self.scene.episode, views=views)

    @cached_property
    def _was(self) -> Callable[[str, int], Float32[np.ndarray, "h w"]]:
        """Of their light, what recorded pixels have; the last ones are kept."""

        @lru_cache(KEPT)
        def share(name: str, t: int) -> Float32[np.ndarray, "h w"]:
            found = intrinsic.share_of(self.scene, self.relit.recorded, name, t)
            assert found is not None
            return found

        return share

    @cached_property
    def _before(self) -> Casters:
        return _casters(intrinsic.matte(self.scene))

    @cached_property
    def _after(self) -> Casters:
        edited = self.scene.recorded_bodies is not None or any(
            body.mesh is not None for body in self.scene.bodies
        )
        return casting.standing(self.scene, self._before) if edited else self._before

    def light(
        self, name: str, t: int, depth: Float32[np.ndarray, "h w"], ids: Int32[np.ndarray, "h w"]
    ) -> Float32[np.ndarray, "h w"]:
        """Of an image that the edited scene shows in a camera that stands as it was recorded."""
        view = self.scene.episode.views[name]
        assert view.depth is not None
        assert view.ids is not None
        same = (ids == view.ids(t)) & (depth == view.depth(t))
        out = np.empty(ids.shape, np.float32)
        out[same] = self._kept(name, t)[same]
        if self.relit.now != self.relit.recorded or self.relit.softness:
            lit = same & ~np.isin(ids, self.relit.unlit)
            rows = np.flatnonzero(lit)
            out[lit] = self._given(depth, ids, view.camera, t, rows, self._unseen(name, t)[:, rows])
        out[~same] = self._given(depth, ids, view.camera, t, np.flatnonzero(~same))
        return out

    def even(self, name: str, t: int) -> UInt8[np.ndarray, "h w 3"]:
        """One recorded image without cast shadows and highlights."""
        matte = highlights.matte(self.scene).views[name].rgb(t)
        return intrinsic.evened(matte, self._was(name, t))

    def shown(
        self,
        name: str,
        t: int,
        even: UInt8[np.ndarray, "h w 3"],
        light: Float32[np.ndarray, "h w"],
        shine: Float32[np.ndarray, "h w 3"] | None = None,
    ) -> UInt8[np.ndarray, "h w 3"]:
        """An image of evenly lit surfaces in that light, with what they mirror (`highlights.across`); where both are as
        recorded, the recorded bits."""
        was, recorded = self._was(name, t), self.scene.episode.views[name].rgb(t)
        kept = (even == self.even(name, t)).all(-1)
        anew = times(even, light)
        if shine is not None:
            anew = np.clip(np.rint(anew + shine), 0, 255).astype(np.uint8)
        lit = np.where(kept[..., None], times(recorded, light / was), anew)
        return np.where((kept & (light == was))[..., None], recorded, lit)

    def gain(
        self,
        camera: Camera,
        t: int,
        depth: Float32[np.ndarray, "h w"],
        ids: Int32[np.ndarray, "h w"],
    ) -> Float32[np.ndarray, "h w"]:
        """How much more light there is, by known surfaces alone, than where and when it was recorded: of an image that
        was drawn of recorded colors, shadows and all."""
        rows = np.arange(depth.size)
        places = casting.lifted(depth, ids, camera, t, rows)
        now = self._given(depth, ids, camera, t, rows)
        was = self._source(places, ids.reshape(-1), t)
        maps = self._before.maps(t, self.relit.recorded.directions)
        share = _share(self.relit.recorded, was.normals, [one.reached(was) for one in maps])
        new = np.isin(ids.reshape(-1), self._put_in)
        return np.where((ids.reshape(-1) > 0) & ~new, now / share, now).reshape(ids.shape)

    def tint(
        self,
        camera: Camera,
        t: int,
        depth: Float32[np.ndarray, "h w"],
        ids: Int32[np.ndarray, "h w"],
        name: str | None,
    ) -> Float32[np.ndarray, "h w 3"]:
        """What lamps of another color come to, over the light that an image would have with theirs as recorded.

        `name` is of a camera that stands as it was recorded: there pixels tell which lamps reached them.
        """
        now, rows = self.relit.now, np.arange(depth.size)
        places = casting.lifted(depth, ids, camera, t, rows)
        reached = [self._reached(places, t, np.array(one)) for one in now.directions]
        view = self.scene.episode.views[name] if name else None
        if name and view and view.depth and view.ids:
            same = np.flatnonzero((ids == view.ids(t)) & (depth == view.depth(t)))
            self._by_pixel(name, t, same, places.normals[same], reached)
        reached = [np.clip(1 - np.float32(self.relit.depth) * (1 - one), 0, 1) for one in reached]
        light = now.light(places.normals, reached)
        out = np.ones((len(rows), 3), np.float32)
        for k, gain in enumerate(self.relit.gains):
            alone = replace(
                now, ambient=0.0, directions=(now.directions[k],), strengths=(now.strengths[k],)
            )
            share = alone.light(places.normals, [reached[k]]) / light
            out += share[:, None] * (np.array(gain, np.float32) - 1)
        out[(depth.reshape(-1) <= 0) | np.isin(ids.reshape(-1), self.relit.unlit)] = 1
        return out.reshape(*depth.shape, 3)

    def _by_pixel(
        self,
        name: str,
        t: int,
        rows: Int64[np.ndarray, "n"],
        normals: Float32[np.ndarray, "n 3"],
        reached: list[Float32[np.ndarray, "m"]],
    ) -> None:
        """Correct which lamps reach recorded pixels, where their own light tells it."""
        if self.relit.now != self.relit.recorded:
            for one, stays in zip(reached, self._unseen(name, t)[:, rows], strict=True):
                one[rows[stays]] = 0
        elif not self.relit.softness:
            share = self._standing(name, t).reshape(-1)[rows]
            known = [one[rows] for one in reached]
            for one, state in zip(
                reached, _states(share, normals, known, self.relit.now), strict=True
            ):
                one[rows] = state

    def _kept(self, name: str, t: int) -> Float32[np.ndarray, "h w"]:
        """Of the recorded image, where only what stands in the lamps' way has changed."""
        return self._deeper(self._standing(name, t))

    def _standing(self, name: str, t: int) -> Float32[np.ndarray, "h w"]:
        share = self._was(name, t)
        changed = self._after is not self._before
        return self._exchanged(name, t, share) if changed else share

    def _exchanged(
        self, name: str, t: int, share: Float32[np.ndarray, "h w"]
    ) -> Float32[np.ndarray, "h w"]:
        view, lamps = self.scene.episode.views[name], self.relit.recorded
        _, places = casting.discs_of(view, t, np.arange(share.size))
        was, now = (
            [one.reached(places) for one in each.maps(t, lamps.directions)]
            for each in (self._before, self._after)
        )
        out = share.reshape(-1).copy()
        near = [_edges(old, new, share.shape) for old, new in zip(was, now, strict=True)]
        rows = np.flatnonzero(np.any(near, (0, 1)))
        if not len(rows):
            return share
        normals = places.normals[rows]
        old = _states(out[rows], normals, [one[rows] for one in was], lamps)
        new = [
            _changed(had, one[rows], other[rows], gained[rows], lost[rows])
            for had, one, other, (gained, lost) in zip(old, was, now, near, strict=True)
        ]
        lit = out[rows] * lamps.light(normals, new) / lamps.light(normals, old)
        out[rows] = np.minimum(lit, np.maximum(out[rows], 1))
        return out.reshape(share.shape)

    def _given(
        self,
        depth: Float32[np.ndarray, "h w"],
        ids: Int32[np.ndarray, "h w"],
        camera: Camera,
        t: int,
        rows: Int64[np.ndarray, "n"],
        unseen: Bool[np.ndarray, "l n"] | None = None,
    ) -> Float32[np.ndarray, "n"]:
        """What known surfaces leave to some pixels of an image, over what all recorded lamps gave their places where
        those were recorded. `unseen` are shadows by lamp that stay."""
        if not len(rows):
            return np.ones(0, np.float32)
        places, shown = casting.lifted(depth, ids, camera, t, rows), ids.reshape(-1)[rows]
        now, every = self.relit.now, [1.0] * len(self.relit.recorded.directions)
        reached = [self._reached(places, t, np.array(one)) for one in now.directions]
        if unseen is not None:
            reached = [np.where(stays, 0, one) for one, stays in zip(reached, unseen, strict=True)]
        share = self._deeper(_share(now, places.normals, reached))
        source = self._source(places, shown, t).normals
        full = now.light(places.normals, [1.0] * len(reached))
        known = (shown > 0) & ~np.isin(shown, self._put_in)
        return np.where(known, share * full / self.relit.recorded.light(source, every), share)

    @cached_property
    def _unseen(self) -> Callable[[str, int], Bool[np.ndarray, "l n"]]:
        """Of recorded pixels by lamp: where walls and floor lie in shadows that nothing seen casts. They stay, but for
        the rims of those that things do cast. The last images' are kept."""

        @lru_cache(KEPT)
        def stays(name: str, t: int) -> Bool[np.ndarray, "l n"]:
            view, lamps, was = (
                self.scene.episode.views[name],
                self.relit.recorded,
                self._was(name, t),
            )
            _, places = casting.discs_of(view, t, np.arange(was.size))
            reached = [one.reached(places) for one in self._before.maps(t, lamps.directions)]
            states = _states(was.reshape(-1), places.normals, reached, lamps)
            walls = np.isin(view.ids(t), sorted(self.scene.roles.get("background", ()))).reshape(-1)  # type: ignore[misc]
            cast = [
                (now == 0) & ~grown(known.reshape(was.shape) <= 0.5, ASTRAY).reshape(-1)
                for now, known in zip(states, reached, strict=True)
            ]
            return np.array(cast) & walls

        return stays

    def _reached(
        self, places: Discs, t: int, direction: Float64[np.ndarray, "3"]
    ) -> Float32[np.ndarray, "n"]:
        seen = [direction]
        if self.relit.softness:
            for ring in RINGS:
                seen += rig.around(direction, ring * self.relit.softness)
        x_y_z = [(float(one[0]), float(one[1]), float(one[2])) for one in seen]
        maps = self._after.maps(t, x_y_z)
        return np.stack([one.reached(places) for one in maps]).mean(0)

    def _deeper(self, share: Float32[np.ndarray, "*n"]) -> Float32[np.ndarray, "*n"]:
        if self.relit.depth == 1:
            return share
        return np.clip(1 - np.float32(self.relit.depth) * (1 - share), DARKEST, 1)

    @cached_property
    def _put_in(self) -> Int64[np.ndarray, "k"]:
        """Instance ids of what was never recorded."""
        bodies = (body for body in self.scene.bodies if body.mesh is not None)
        return np.array(sorted(one for body in bodies for one in body.instance_ids), int)

    def _source(self, places: Discs, ids: Int32[np.ndarray, "n"], t: int) -> Discs:
        """Where these places were recorded."""
        points, normals = places.points.copy(), places.normals.copy()
        for edit in carried(self.scene, t):
            mine = np.isin(ids, list(edit.shows.values()))
            if mine.any():
                back = geometry.inverse(edit.motion)
                there = geometry.transform(back, points[mine].astype(float)) / edit.scale
                points[mine] = there.astype(np.float32)
                normals[mine] = normals[mine] @ back[:3, :3].T.astype(np.float32)
        return Discs(points, normals, places.width)


@once
def _casters(recorded: Scene) -> Casters:
    return casting.with_supports(recorded, casting.casters(recorded))


def times(
    rgb: UInt8[np.ndarray, "h w 3"], gain: Float32[np.ndarray, "h w"] | Float32[np.ndarray, "h w 3"]
) -> UInt8[np.ndarray, "h w 3"]:
    """An image with each pixel that many times as bright."""
    gain = gain if gain.ndim == rgb.ndim else gain[..., None]
    return np.minimum(np.rint(rgb * gain), 255).astype(np.uint8)


def _edges(
    was: Float32[np.ndarray, "n"], now: Float32[np.ndarray, "n"], shape: tuple[int, ...]
) -> tuple[Bool[np.ndarray, "n"], Bool[np.ndarray, "n"]]:
    """Pixels that a lamp reaches again, and no longer, with those beside them, where a recorded shadow may end."""
    change = (now - was).reshape(shape)
    gained, lost = (grown(one, RIM).reshape(-1) for one in (change > CHANGED, change < -CHANGED))
    return gained, lost


def _changed(
    had: Float32[np.ndarray, "n"],
    was: Float32[np.ndarray, "n"],
    now: Float32[np.ndarray, "n"],
    gained: Bool[np.ndarray, "n"],
    lost: Bool[np.ndarray, "n"],
) -> Float32[np.ndarray, "n"]:
    """How much of places a lamp reaches now that it reached so much of: what the maps say where they have changed,
    and beside that where the recorded shadow ended elsewhere than theirs."""
    out = np.where(np.abs(now - was) > CHANGED, now, had)
    beside = np.abs(now - was) <= CHANGED
    out[beside & gained & (np.minimum(was, now) > 0.5)] = 1
    out[beside & lost & (np.maximum(was, now) < 0.5)] = 0
    return out


def _share(
    lamps: Rig,
    normals: Float32[np.ndarray, "n 3"],
    reached: Sequence[Float32[np.ndarray, "n"] | float],
) -> Float32[np.ndarray, "n"]:
    return lamps.light(normals, reached) / lamps.light(normals, [1.0] * len(reached))


def _states(
    share: Float32[np.ndarray, "n"],
    normals: Float32[np.ndarray, "n 3"],
    reached: Sequence[Float32[np.ndarray, "n"]],
    lamps: Rig,
) -> list[Float32[np.ndarray, "n"]]:
    """Which lamps reach places that have this share of their light, 1 or 0 each; surfaces have a say."""
    states = list(product((1.0, 0.0), repeat=len(reached)))
    level = np.log(np.maximum(share, DARKEST))
    costs = []
    for state in states:
        off = (level - np.log(_share(lamps, normals, state))) / ALIKE
        doubt = [np.abs(one - given) for one, given in zip(state, reached, strict=True)]
        costs.append(off**2 + TRUST * np.sum(doubt, 0))
    chosen = np.array(states, np.float32)[np.argmin(costs, 0)]
    return list(chosen.T)
