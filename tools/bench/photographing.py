"""What a cheap camera makes of the twin's picture: exposure, white balance, blur, noise, and JPEG or H.264."""

import io
from collections.abc import Sequence
from dataclasses import dataclass, replace

import av
import cv2
import numpy as np
from jaxtyping import UInt8

from rpaug.core.types import CameraView, Episode

Image = UInt8[np.ndarray, "h w 3"]
RATE = 10  # frames a second


@dataclass(frozen=True)
class CameraFaults:
    """`gain` of each channel, `blur` in pixels (deviation), `noise` in grey levels (deviation), `jpeg` quality; a
    camera that films gives H.264 of this `crf` in its place. It stands where it is said to stand if `posed`."""

    gain: tuple[float, float, float]
    blur: float
    noise: float
    jpeg: int
    crf: int | None = None
    posed: bool = False

    def developed(self, image: Image) -> Image:
        """The picture as it would be without noise and files."""
        lit = np.clip(image.astype(np.float32) * np.array(self.gain, np.float32), 0, 255)
        return np.rint(cv2.GaussianBlur(lit, (0, 0), self.blur)).astype(np.uint8)

    def taken(self, image: Image, rng: np.random.Generator) -> Image:
        """The picture as it is recorded."""
        noisy = self.developed(image) + self.noise * rng.standard_normal(image.shape)
        noisy = np.clip(np.rint(noisy), 0, 255).astype(np.uint8)
        if self.crf is not None:
            return noisy  # files hold the whole clip: `filmed`
        ok, packed = cv2.imencode(".jpg", noisy[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, self.jpeg])
        assert ok
        return np.ascontiguousarray(cv2.imdecode(packed, cv2.IMREAD_COLOR)[..., ::-1])


def drawn(seed: int, crf: int | None = None, posed: bool = False) -> CameraFaults:
    """The faults of one recording's cameras; with `crf` they film, and with `posed` their places are known."""
    rng = np.random.default_rng([seed, 27])
    red, blue = rng.uniform(0.85, 1.1, 2)
    gain = rng.uniform(0.8, 1.0)
    return CameraFaults(
        (float(gain * red), float(gain), float(gain * blue)),
        float(rng.uniform(0.4, 0.7)),
        float(rng.uniform(1.0, 3.0)),
        int(rng.integers(85, 96)),
        crf,
        posed,
    )


def filmed(images: Sequence[Image], crf: int) -> list[Image]:
    """A clip as H.264 of half the colors' resolution gives it back."""
    height, width = images[0].shape[:2]
    packed = io.BytesIO()
    with av.open(packed, "w", format="mp4") as made:
        stream = made.add_stream("libx264", rate=RATE, options={"crf": str(crf)})
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        for image in images:
            made.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")))
        made.mux(stream.encode())
    packed.seek(0)
    with av.open(packed) as film:
        return [frame.to_ndarray(format="rgb24") for frame in film.decode(video=0)]


def photographed(episode: Episode, faults: CameraFaults, seed: int, noisy: bool = True) -> Episode:
    """The episode with its colors taken by such cameras; without noise and files if not `noisy`."""

    def of(view: CameraView, number: int) -> CameraView:
        def one(t: int) -> Image:
            rng = np.random.default_rng([seed, 28, number, t])
            return faults.taken(view.rgb(t), rng) if noisy else faults.developed(view.rgb(t))

        images = [one(t) for t in range(episode.length)]
        if noisy and faults.crf is not None:
            images = filmed(images, faults.crf)
        return replace(view, rgb=images.__getitem__, radiance=None)

    views = {name: of(view, number) for number, (name, view) in enumerate(episode.views.items())}
    return replace(episode, views=views)
