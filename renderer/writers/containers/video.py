"""Writes what a camera sees on a path among the views, or one view at several times.

FFmpeg encodes MP4 and WebM, Pillow encodes GIF and WebP.
"""

from __future__ import annotations

import io
from abc import abstractmethod
from fractions import Fraction
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from ciir.bit_depth import count_unused_camera_bits
from ciir.errors import InvalidOption
from ciir.renderer.displays.quilt import parse_name
from ciir.renderer.levels import note_rounding
from ciir.renderer.writers.containers.camera_paths import draw_frames, list_positions, to_rgb8
from ciir.renderer.writers.options import WriterOptions
from ciir.renderer.writers.pictures import SUFFIXES
from ciir.renderer.writers.whole import WholeWriter

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from ciir.renderer.light_field import LightField
    from ciir.renderer.readers.pictures import Pixels
    from ciir.renderer.writers.writer import Contents

MOST_SIDE = 16_383
"""Most pixels along a side of a frame: WebP's limit, the smallest of the four formats'."""
MOST_ANIMATION_FPS = 50
"""Most frames per second of an animation: browsers show a frame of less than 20 ms for 100 ms."""
RATES = 1 / 60, 240.0
"""Range of frames per second for pictures at several times, if no rate is requested."""
_SAME_STEP = 0.1
"""Share of the largest step between two times by which others may differ, as times of 30 a second in milliseconds
do."""
_USUAL_FPS = 30.0
_BT601, _LIMITED = 6, 1
"""How FFmpeg converts RGB to luminance and chrominance: the numbers of SMPTE 170M and of the range 16 to 235."""


class PathWriter(WholeWriter):
    """Draws the frames of the path that the options give, or takes those of the times, in 8-bit RGB."""

    def check(self, contents: Contents) -> None:
        """Refuses views that are too large for a frame, path options if each picture is a frame, and a quilt's name."""
        if (layout := parse_name(self.options.name)) is not None:
            raise InvalidOption(
                f"{self.options.name}: {layout.suffix} names a quilt, and {self.name} holds no quilts; end the name "
                f"with {', '.join(SUFFIXES)} for a quilt, or leave {layout.suffix} out for a video"
            )
        if contents.times and (self.options.path, self.options.frames) != (WriterOptions.path, WriterOptions.frames):
            raise InvalidOption("path, frames: with several times or yaws, each is a frame; leave them out")
        list_positions(self.options.path, 1, contents.grid)
        self.times = contents.times
        self.count = len(self.times) or self.options.frames
        self.fps = self.options.fps or find_rate(self.times) or _USUAL_FPS
        if max(contents.height, contents.width) > MOST_SIDE:
            raise InvalidOption(
                f"format: {self.name} holds frames of up to {MOST_SIDE:,} pixels a side and the views have "
                f"{contents.height}x{contents.width}; give smaller ones"
            )

    def encode(self, light_field: LightField) -> list[str]:
        """Writes the frames, and returns notes on what is lost."""
        views = light_field.views
        unused = count_unused_camera_bits(views)
        if self.times:
            notes = self.write_frames(to_rgb8(views[0, number], unused) for number in range(self.count))
        else:
            notes = self.write_frames(draw_frames(light_field, self.options.path, self.count, unused))
            if views.shape[0] * views.shape[1] > 1:
                notes.append("frames between views are interpolated")
        return [*notes, *self._list_losses(views.shape[4], views.dtype, unused)]

    def stream(self, contents: Contents, pictures: Iterable[Pixels]) -> list[str]:
        """Writes one view at several times, as `begin` and `write` do, but keeps no picture; returns notes."""
        self.check(contents)
        notes = self.write_frames(map(to_rgb8, pictures))
        return [*notes, *self._list_losses(contents.channels, contents.dtype)]

    def _list_losses(self, channels: int, dtype: np.dtype[Any], unused: int = 0) -> list[str]:
        notes = []
        if len(self.times) > 2 and np.ptp(steps := np.diff(self.times)) > _SAME_STEP * abs(steps).max():
            notes.append(f"time: the times are uneven, but the frames are shown evenly, {self.fps:g} per second")
        notes += note_rounding(self.name, dtype, unused)
        if channels in (2, 4):
            notes.append(f"{self.name}: alpha is left out")
        return notes

    @abstractmethod
    def write_frames(self, frames: Iterator[NDArray[np.uint8]]) -> list[str]:
        """Writes the frames, `(H, W, 3)` each; returns notes."""


def find_rate(times: Sequence[float]) -> float | None:
    """Returns the frames per second at which frames of these times, in seconds, pass as fast as they do, within
    `RATES`; None if no time passes.
    """
    span = abs(times[-1] - times[0]) if times else 0.0
    return float(np.clip((len(times) - 1) / span, *RATES)) if span else None


class VideoWriter(PathWriter):
    """Writes a video with 4:2:0 chrominance, which all players show; an odd last row or column is repeated."""

    container = ""
    """FFmpeg's name for the format."""
    codecs: tuple[tuple[str, dict[str, str]], ...] = ()
    """FFmpeg's names for encoders, the preferred one first, and their options."""

    def write_frames(self, frames: Iterator[NDArray[np.uint8]]) -> list[str]:
        """Encodes one frame after the other. The file has no dates, so that the same views make the same bytes."""
        import av
        from av.container import Flags

        codec, settings = next((name, settings) for name, settings in self.codecs if name in av.codecs_available)
        packed, size = io.BytesIO(), (0, 0)
        with av.open(packed, "w", format=self.container) as container:
            container.flags |= cast("int", Flags.bitexact.value)
            stream = container.add_stream(codec, rate=Fraction(self.fps).limit_denominator(1001))
            assert isinstance(stream, av.VideoStream)  # noqa: S101 - all of `codecs` are for videos
            for number, pixels in enumerate(frames):
                height, width = size = pixels.shape[:2]
                even = np.pad(pixels, ((0, height % 2), (0, width % 2), (0, 0)), "edge")
                if number == 0:
                    stream.height, stream.width, stream.pix_fmt = *even.shape[:2], "yuv420p"
                    stream.options = {**settings, "threads": "1"}  # otherwise the bytes depend on the number of cores
                    stream.codec_context.colorspace, stream.codec_context.color_range = _BT601, _LIMITED
                frame = av.VideoFrame.from_ndarray(even, format="rgb24")
                frame.pts = number
                container.mux(stream.encode(frame))
            container.mux(stream.encode())
        self.file.write(packed.getbuffer())
        lossy = f"{self.name}: lossy, {codec} with 4:2:0 chrominance"
        return [lossy + ", an odd last row or column is repeated" if size[0] % 2 or size[1] % 2 else lossy]


class Mp4Writer(VideoWriter):
    """Writes MP4: H.264, or MPEG-4 Visual if FFmpeg was built without x264.

    x264 is used without its macroblock tree, whose code for AVX-512 makes other bytes of the same frames now and then.
    Files are at most 3 % larger for it, and 0.2 to 0.7 dB further from the frames.
    """

    container = "mp4"
    codecs = (("libx264", {"crf": "18", "mbtree": "0"}), ("mpeg4", {"qscale": "2"}))


class WebmWriter(VideoWriter):
    """Writes WebM: VP9."""

    container = "webm"
    codecs = (("libvpx-vp9", {"crf": "24", "b": "0"}),)


class AnimationWriter(PathWriter):
    """Writes an animation that repeats from its start. Consecutive equal frames are stored as one."""

    unit = 1
    """Milliseconds of the format's clock."""
    lost = ""
    """The note on what the format changes."""
    settings: Mapping[str, Any] = {}
    """Pillow's name for the format, and its options."""

    def check(self, contents: Contents) -> None:
        """Refuses a rate that viewers don't keep."""
        super().check(contents)
        if self.fps > MOST_ANIMATION_FPS:
            raise InvalidOption(
                f"fps: {self.fps:g} is over the {MOST_ANIMATION_FPS} that viewers show of {self.name}; "
                "give fewer, or format mp4 or webm"
            )

    def write_frames(self, frames: Iterator[NDArray[np.uint8]]) -> list[str]:
        """Writes the frames, shown for whole units of the format's clock; their mean is the requested rate."""
        from PIL import Image

        ends = [round(1000 * (number + 1) / self.fps / self.unit) for number in range(self.count)]
        durations = [self.unit * (end - start) for start, end in zip([0, *ends], ends, strict=False)]
        first, *rest = [Image.fromarray(pixels) for pixels in frames]
        first.save(self.file, save_all=True, append_images=rest, duration=durations, loop=0, **self.settings)
        return [f"{self.name}: {self.lost}"]


class GifWriter(AnimationWriter):
    """Writes GIF; Pillow selects the colours of each frame."""

    unit, lost = 10, "256 colours a frame, and a clock of 10 ms"
    settings: Mapping[str, Any] = {"format": "GIF", "disposal": 1, "optimize": False}


class WebpWriter(AnimationWriter):
    """Writes animated WebP; method 4 of 6 is the usual compromise between time and size."""

    lost = "lossy, of quality 90"
    settings: Mapping[str, Any] = {"format": "WEBP", "quality": 90, "method": 4}
