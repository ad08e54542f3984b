"""Videos are made here by PyAV itself, with lossless codecs, so that each frame is known to the bit."""

import io
import struct

import av
import numpy as np
import pytest

from ciir.errors import InvalidOption, TooLarge, Unreadable, UnsupportedType
from ciir.renderer.displays.quilt import QuiltLayout, split_quilt
from ciir.renderer.light_field import LightField
from ciir.renderer.limits import Limits
from ciir.renderer.readers import inputs
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.containers import video
from ciir.renderer.readers.layout import Layout
from tests.support.light_fields import make_views

FRAMES = np.random.default_rng(0).integers(0, 255, (6, 16, 24, 3), np.uint8)
FRAMES[:, :, :, 1:] = FRAMES[:, :, :, :1]  # grey: all codecs below keep it


def make(frames=FRAMES, codec="ffv1", container="matroska", pixel_format="bgr0", source="rgb24"):
    file = io.BytesIO()
    with av.open(file, "w", format=container) as output:
        stream = output.add_stream(codec, rate=25)
        stream.height, stream.width, stream.pix_fmt = *frames.shape[1:3], pixel_format
        for number, pixels in enumerate(frames):
            frame = av.VideoFrame.from_ndarray(pixels, format=source)
            frame.pts = number
            output.mux(stream.encode(frame))
        output.mux(stream.encode())
    return file.getvalue()


def read(data, limits=None, **layout):
    return video.read(data, name="a", layout=Layout(**layout), limits=limits or Limits())


def test_frames_are_a_row_of_views_from_the_left():
    found = read(make())
    assert found.views.shape == (1, 6, 16, 24, 3)
    for number, frame in enumerate(FRAMES):
        np.testing.assert_array_equal(found.view(0, number), frame)
    assert found.depth_sense == "cameras"
    assert "from left to right" in found.notes[0]


def test_frames_fill_a_grid_row_by_row():
    found = read(make(), pixels=(2, 3))
    for v, u in np.ndindex(2, 3):
        np.testing.assert_array_equal(found.view(v, u), FRAMES[3 * v + u])
    assert found.notes == (video.MOVES_RIGHT,)  # no word of one row


def test_a_frame_as_an_elemental_image_array():
    data = make()
    first = read(data, lenses=(4, 8))
    fourth = read(data, lenses=(4, 8), frame=3)
    turned = read(data, lenses=(4, 8), frame=3, pickup="optical")
    for v, u, y, x in np.ndindex(4, 3, 4, 8):
        assert (first.view(v, u)[y, x] == FRAMES[0, 4 * y + v, 3 * x + u]).all()
        assert (fourth.view(v, u)[y, x] == FRAMES[3, 4 * y + v, 3 * x + u]).all()
        assert (turned.view(v, u)[y, x] == FRAMES[3, 4 * y + 3 - v, 3 * x + 2 - u]).all()
    assert first.depth_sense == "lenses"
    with pytest.raises(InvalidOption, match="a has no frame 6; they are counted from 0"):
        read(data, lenses=(4, 8), frame=6)


def test_a_frame_is_of_elemental_image_arrays():
    with pytest.raises(InvalidOption, match="frame: this is for a video of elemental image arrays"):
        inputs.read(Bundle.from_upload("a.mkv", make()), Layout(frame=3))


@pytest.mark.parametrize("number", [0, 3])
def test_a_frame_of_a_video_named_as_a_quilt_is_one(number):
    found = inputs.read(Bundle.from_upload("a_qs3x2a0.5.mkv", make()), Layout(frame=number))
    assert np.array_equal(found.views[0], split_quilt(FRAMES[number], QuiltLayout(3, 2, 0.5), name="a"))
    assert (found.depth_sense, found.pixel_aspect) == ("cameras", 0.5)  # views of 8x8 pixels
    assert found.notes[0].startswith(f"frame {number} is read as a quilt, as the video's name")
    assert found.notes[1] == "read as a quilt of 3 columns and 2 rows of views"


@pytest.mark.parametrize(
    ("layout", "message"),
    [
        ({"frame": 6}, "frame: a_qs3x2a0.5.mkv has no frame 6; they are counted from 0"),
        ({"pixels": (1, 6)}, "pixels: a_qs3x2a0.5.mkv is a quilt of 3x2 views"),
    ],
)
def test_what_is_not_read_of_a_video_of_quilts(layout, message):
    with pytest.raises(InvalidOption, match=message):
        inputs.read(Bundle.from_upload("a_qs3x2a0.5.mkv", make()), Layout(**layout))


def test_gif():
    grey = np.zeros((3, 16, 24), np.uint8)
    grey[1], grey[2] = 85, 255
    data = make(grey, "gif", "gif", "gray", "gray")
    found = read(data)
    assert found.views.shape == (1, 3, 16, 24, 3)
    assert [found.view(0, u)[5, 5, 0] for u in range(3)] == [0, 85, 255]


def test_lossy_codecs_keep_the_order():
    steps = np.repeat(np.arange(6, dtype=np.uint8) * 40, 16 * 24 * 3).reshape(FRAMES.shape)
    for codec, container in (("libx264", "mp4"), ("libvpx-vp9", "webm"), ("mpeg4", "mp4")):
        data = make(steps, codec, container, "yuv420p")
        found = read(data).views[0, :, 8, 12, 0]
        np.testing.assert_allclose(found, [0, 40, 80, 120, 160, 200], atol=4)


def test_a_video_is_turned_as_its_track_header_says():
    """Telephones held upright write a matrix that turns frames clockwise by 90 degrees (ISO 14496-12, 6.2.2)."""
    steps = np.zeros((2, 16, 24, 3), np.uint8)
    steps[:, :, 12:] = 200  # bright on the right, and below once it is turned
    data = make(steps, "libx264", "mp4", "yuv420p")
    one = 1 << 16
    as_stored, clockwise = (one, 0, 0, 0, one, 0, 0, 0, 1 << 30), (0, one, 0, -one, 0, 0, 0, 0, 1 << 30)
    track = data.index(b"tkhd")
    place = data.index(struct.pack(">9i", *as_stored), track)
    found = read(data[:place] + struct.pack(">9i", *clockwise) + data[place + 36 :]).views
    assert found.shape == (1, 2, 24, 16, 3)
    np.testing.assert_allclose(found[0, 0, [3, 20], :, 0], np.repeat([[0], [200]], 16, axis=1), atol=4)


def test_more_than_8_bit_are_kept():
    deep = np.random.default_rng(0).integers(0, 2**16, (2, 16, 24, 3), np.uint16)
    found = read(make(deep, "ffv1", "matroska", "gbrp16le", "rgb48le"))
    assert found.views.dtype == np.uint16
    np.testing.assert_array_equal(found.views[0], deep)


@pytest.mark.parametrize(
    ("layout", "limits", "error", "message"),
    [
        ({"pixels": (2, 2)}, Limits(), InvalidOption, "2x2 asks for 4 views, but a has 6 frames"),
        ({"lenses": (5, 5)}, Limits(), InvalidOption, "5x5 does not divide the picture of 16x24"),
        ({}, Limits(pixels=300), TooLarge, "frames of 16x24 pixels; at most 300"),
        ({}, Limits(set_bytes=6000), TooLarge, "comes to 6,912 bytes"),
        ({}, Limits(views=5), TooLarge, "at most 5 views"),
    ],
)
def test_limits_and_grids(layout, limits, error, message):
    with pytest.raises(error, match=message):
        read(make(), limits=limits, **layout)


def test_other_codecs_and_sounds_are_refused():
    with pytest.raises(UnsupportedType, match="the codec mpeg2video is not read"):
        read(make(codec="mpeg2video", pixel_format="yuv420p"))
    file = io.BytesIO()
    with av.open(file, "w", format="matroska") as output:
        output.add_stream("pcm_s16le", rate=8000)
        sound = av.AudioFrame.from_ndarray(np.zeros((1, 800), np.int16), layout="mono")
        sound.sample_rate = 8000
        output.mux(output.streams[0].encode(sound))
    with pytest.raises(Unreadable, match="holds no video"):
        read(file.getvalue())


def test_a_video_that_is_cut_short():
    from ciir.renderer.readers import inputs
    from ciir.renderer.readers.bundle import Bundle

    data = make(codec="libx264", container="mp4", pixel_format="yuv420p")
    with pytest.raises(Unreadable, match=r"^a\.mp4: damaged or cut off \(while the video was read\); send"):
        inputs.read(Bundle.from_upload("a.mp4", data[: len(data) // 2]))


@pytest.fixture(scope="module")
def arrays():
    """A video of two elemental image arrays, of 40x40 lenses of 8x8 pixels."""
    views = make_views((8, 8), side=40, disparities=(-1, 1), channels=3, noise=4.0)
    eia = LightField(views).eia()
    return eia, make(np.stack([eia[::-1], eia]))


def test_a_frame_is_read_as_a_picture_of_all_views_is(arrays):
    eia, data = arrays
    field = read(data, pixels=(8, 8), arrangement="eia", frame=1)
    np.testing.assert_array_equal(field.eia(), eia)
    assert field.depth_sense == "lenses"
    cropped = read(data, lenses=(40, 39), crop=(0, 8, 0, 0), frame=1)
    np.testing.assert_array_equal(cropped.eia(), eia[:, 8:])
    (note,) = read(data, lenses=(20, 20), frame=1).notes
    assert note.startswith("arrangement: read as elemental images of 16x16 pixels, but the picture repeats about every")
    with pytest.raises(InvalidOption, match=r"a, frame 0: a picture is read as .*; the picture repeats about every"):
        read(data, arrangement="eia")
    with pytest.raises(InvalidOption, match=r"lenses: 30x40 does not divide the picture of 320x320 .* is 32x40;"):
        read(data, lenses=(30, 40))


def test_frames_that_look_like_elemental_image_arrays_are_noted(arrays):
    _, data = arrays
    with_note, without = read(data).notes, read(make()).notes
    assert without == (video.MOVES_RIGHT, video.ONE_ROW)
    assert with_note[2].startswith("frames: each repeats about every ")
    assert "if they are such, give arrangement eia and pixels 8x8" in with_note[2]
    with pytest.raises(InvalidOption, match="arrangement eia reads a frame as an elemental image array"):
        read(data, pixels=(8, 8))
