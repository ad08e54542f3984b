"""Reads videos with FFmpeg (PyAV). Each frame is a view from a moving camera, or an elemental image array.

The frames of a video are `L[v, u, y, x, c]` with v = frame // U and u = frame % U. Unless the grid is given, they are a
single row of views from a camera that moves to the right.
"""

from __future__ import annotations

import io
import math
from contextlib import contextmanager
from itertools import islice
from typing import TYPE_CHECKING, Any

import av
import numpy as np

from ciir.errors import InvalidOption, TooLarge, Unreadable, UnsupportedType
from ciir.renderer.light_field import LightField
from ciir.renderer.readers.containers.samples import check_array
from ciir.renderer.readers.eia import reader as eia
from ciir.renderer.readers.eia.period import Periods

if TYPE_CHECKING:
    from collections.abc import Iterator

    from av import Packet, VideoFrame
    from av.container import InputContainer
    from av.video.stream import VideoStream
    from numpy.typing import NDArray

    from ciir.renderer.limits import Limits
    from ciir.renderer.readers.layout import Layout
    from ciir.renderer.readers.pictures import Pixels

CODECS = frozenset({
    "av1", "ffv1", "gif", "h264", "hevc", "libdav1d", "libvpx", "libvpx-vp9", "mjpeg", "mpeg4", "png", "rawvideo",
    "vp8", "vp9",
})  # fmt: skip
"""FFmpeg's names of the decoders that may process untrusted bytes."""
_CONTAINERS = {b"\x1aE\xdf\xa3": "matroska", b"GIF": "gif"}
"""First bytes of a file -> FFmpeg's name of its format; MP4 and QuickTime begin with a length."""
MOVES_RIGHT = "frames are taken as views of a camera that moves from left to right; flip u if it moves to the left"
ONE_ROW = "frames are taken as one row of views; give pixels ROWSxCOLUMNS (of views) if they are a grid, row by row"


def read(data: bytes, *, name: str, layout: Layout, limits: Limits) -> LightField:
    """Reads frame `layout.frame` as an elemental image array, or all frames as views (`Layout.selects_frame`)."""
    with _open(data, name, limits) as (file, stream):
        if layout.selects_frame:
            pixels = _take_frame(file.decode(stream), layout.frame, name)
            return eia.read_pixels(pixels, name=f"{name}, frame {layout.frame}", layout=layout)
        frames = sum(1 for _ in _list_packets(file, stream))
    rows, columns = layout.pixels or (1, frames)
    if rows * columns != frames:
        raise InvalidOption(
            f"pixels: {rows}x{columns} asks for {rows * columns} views, but {name} has {frames} frames; "
            "give the rows and columns of views, or leave it out for one row; arrangement eia reads a frame as an "
            "elemental image array"
        )
    with _open(data, name, limits) as (file, stream):
        views = _read_views(map(_convert, file.decode(stream)), layout.sequence or (rows, columns), name, limits)
    notes = (MOVES_RIGHT,) if layout.pixels else (MOVES_RIGHT, ONE_ROW)
    return LightField(views, (*notes, *_note_arrays(views[0, 0])), depth_sense="cameras")


def read_frame(data: bytes, number: int, *, name: str, limits: Limits) -> Pixels:
    """Reads the frame `number`, counted from 0, as RGB `(H, W, 3)`. Raises `InvalidOption` if there is none, and like
    `list_times`.
    """
    with _open(data, name, limits) as (file, stream):
        return _take_frame(file.decode(stream), number, name)


def list_times(data: bytes, name: str, limits: Limits) -> tuple[tuple[int, int], list[float]]:
    """Returns the height and width of a video's frames, and the time of each in seconds, starting at 0. Raises like
    `read`.
    """
    with _open(data, name, limits) as (file, stream):
        packets = list(_list_packets(file, stream))
        size, step = (stream.height, stream.width), float(1 / (stream.average_rate or 30))
    stamps = sorted(float(packet.pts * packet.time_base) for packet in packets if packet.pts is not None)
    if len(stamps) < len(packets):
        return size, [step * number for number in range(len(packets))]
    return size, [stamp - stamps[0] for stamp in stamps]


def read_frames(data: bytes, name: str, limits: Limits, *, first: int, count: int) -> Iterator[NDArray[Any]]:
    """Yields `count` frames of a video from the frame `first` on, as RGB `(H, W, 3)`. Raises like `list_times`."""
    with _open(data, name, limits) as (file, stream):
        done = 0
        for number, frame in enumerate(file.decode(stream)):
            if number >= first and done < count:
                yield np.ascontiguousarray(_convert(frame))
                done += 1
            elif done == count:
                return
    if done < count:
        raise Unreadable(f"{name}: {first + done} frames can be decoded, {first + count} were expected; give it whole")


@contextmanager
def _open(data: bytes, name: str, limits: Limits) -> Iterator[tuple[InputContainer, VideoStream]]:
    """Opens the file in the format of its first bytes and no other, and yields it with its first video stream.

    Raises `Unreadable` if FFmpeg fails, also within the `with` block.
    """
    container = next((known for start, known in _CONTAINERS.items() if data.startswith(start)), "mp4")
    try:
        with av.open(io.BytesIO(data), "r", format=container) as file:
            yield file, _open_stream(file, name, limits)
    except av.FFmpegError as error:
        raise Unreadable(f"{name}: damaged or cut off (while the video was read); send the whole file") from error


def _open_stream(file: InputContainer, name: str, limits: Limits) -> VideoStream:
    """Returns the first video stream, with a decoder that refuses frames over the limit."""
    if not file.streams.video:
        raise Unreadable(f"{name}: holds no video; give one with a picture")
    stream = file.streams.video[0]
    codec = stream.codec_context
    if codec.name not in CODECS:
        raise UnsupportedType(f"{name}: the codec {codec.name} is not read; give H.264, VP9, AV1 or an animated GIF")
    height, width = stream.height, stream.width
    if height * width > limits.pixels:
        raise TooLarge(
            f"{name}: frames of {height}x{width} pixels; at most {limits.pixels:,} are read; scale it down", "pixels"
        )
    codec.options = {"max_pixels": str(limits.pixels)}  # a frame's own header may give another size
    return stream


def _list_packets(file: InputContainer, stream: VideoStream) -> Iterator[Packet[VideoStream]]:
    """Yields a packet for each frame, in order, because the number in the header may be missing or wrong."""
    return (packet for packet in file.demux(stream) if packet.size > 0)


def _convert(frame: VideoFrame) -> NDArray[Any]:
    """Returns RGB `(H, W, 3)`, turned upright; 16 bit if the video has more than 8."""
    is_deep = frame.format.components[0].bits > 8
    pixels = frame.to_ndarray(format="rgb48le" if is_deep else "rgb24")
    return np.rot90(pixels, round(frame.rotation / 90))


def _read_views(frames: Iterator[NDArray[Any]], grid: tuple[int, int], name: str, limits: Limits) -> NDArray[Any]:
    count = grid[0] * grid[1]
    first = next(frames, None)
    if first is None:
        raise Unreadable(f"{name}: no frame of the video can be decoded; give the whole file")
    check_array(name, (*grid, *first.shape), first.dtype, limits)
    views = np.empty((count, *first.shape), first.dtype)
    views[0] = first
    done = 1
    for frame in frames:
        if done == count or frame.shape != first.shape or frame.dtype != first.dtype:
            raise Unreadable(f"{name}: frame {done} is not like the first, or one too many; convert the video")
        views[done] = frame
        done += 1
    if done < count:
        raise Unreadable(f"{name}: {done} of {count} frames can be decoded; give the whole file")
    return views.reshape(*grid, *first.shape)


def _take_frame(frames: Iterator[VideoFrame], number: int, name: str) -> Pixels:
    frame = next(islice(frames, number, None), None)
    if frame is None:
        raise InvalidOption(f"frame: {name} has no frame {number}; they are counted from 0")
    return np.ascontiguousarray(_convert(frame))


def _note_arrays(frame: Pixels) -> tuple[str, ...]:
    """Returns a note if the frame of a video, read as a view, repeats as elemental image arrays do."""
    periods = Periods(frame)
    found = periods.find()
    # Elemental images have fewer pixels than there are lenses.
    if found is None or math.prod(found) ** 2 > math.prod(periods.size):
        return ()
    size = next(iter(periods.rank_sizes()), found)  # of the sizes that divide the frame
    note = (
        f"frames: each repeats about every {found[0]}x{found[1]} pixels, as elemental image arrays do; if they are "
        f"such, give arrangement eia and pixels {size[0]}x{size[1]}"
    )
    return (note,)
