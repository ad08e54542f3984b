import io

import av
import numpy as np
import pytest
from PIL import Image

from ciir.errors import InvalidOption
from ciir.renderer.light_field import LightField
from ciir.renderer.writers.containers.camera_paths import draw_frames
from ciir.renderer.writers.containers.video import find_rate
from ciir.renderer.writers.file_writer import FileWriter
from ciir.renderer.writers.options import WriterOptions
from ciir.renderer.writers.writer import Contents

FORMATS = {"mp4": ".mp4", "webm": ".webm", "gif": ".gif", "animated-webp": ".webp"}


def make_field(height=48, width=64, dtype=np.uint8, channels=3):
    """A bright square on grey, which moves by 4 pixels from one view to the next."""
    top = np.iinfo(dtype).max
    views = np.full((3, 5, height, width, channels), top // 4, dtype)
    for v, u in np.ndindex(3, 5):
        views[v, u, 8 + 4 * v :, 8 + 4 * u :, :1][:16, :16] = top
    return LightField(views, depth_sense="cameras")


def read(path, name):
    """Frames as players decode them, and the rate."""
    if name == "animated-webp":
        with Image.open(path) as image:
            frames, times = [], []
            for number in range(image.n_frames):
                image.seek(number)
                frames.append(np.array(image.convert("RGB")))
                times.append(image.info["duration"])
        return frames, 1000 * len(times) / max(1, sum(times))  # a single frame has no duration
    with av.open(path) as container:
        rate = container.streams.video[0].average_rate
        return [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)], float(rate)


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize(("frames", "fps"), [(1, 10), (12, 25)])
def test_every_frame_of_the_path_at_its_rate(tmp_path, name, frames, fps):
    field = make_field()
    path = tmp_path / f"a{FORMATS[name]}"
    notes = field.save(path, name, path="circle", frames=frames, fps=fps)
    found, rate = read(path, name)
    assert len(found) == frames
    assert rate == pytest.approx(fps, rel=0.01) or frames == 1  # GIF's clock has units of 10 ms
    for frame, expected in zip(found, draw_frames(field, "circle", frames), strict=True):
        # 4:2:0 chrominance, 256 colours and quality 90 change edges; a frame in another place differs by over 20.
        assert np.abs(frame.astype(int) - expected).mean() < 5
    assert "frames between views are interpolated" in notes


@pytest.mark.skipif("libx264" not in av.codecs_available, reason="this FFmpeg has no x264")
def test_x264_has_no_macroblock_tree(tmp_path):
    """With it, a few of a hundred files of the same frames differ on processors with AVX-512."""
    path = tmp_path / "a.mp4"
    make_field().save(path, frames=2)
    assert b" mbtree=0 " in path.read_bytes()  # x264 writes its settings into the stream


@pytest.mark.parametrize("name", ["gif", "animated-webp"])
def test_equal_frames_are_stored_as_one_of_their_duration(tmp_path, name):
    path = tmp_path / f"a{FORMATS[name]}"
    make_field().save(path, name, path="sweep", frames=13, fps=25)  # frames 6 and 7 are on either side of the turn
    with Image.open(path) as image:
        durations = []
        for number in range(image.n_frames):
            image.seek(number)
            image.load()
            durations.append(image.info["duration"])
    assert durations == [40] * 6 + [80] + [40] * 5


@pytest.mark.parametrize(("height", "width"), [(47, 63), (1, 1)])
def test_odd_sides_are_padded(tmp_path, height, width):
    views = np.full((2, 2, height, width, 3), 77, np.uint8)
    notes = LightField(views).save(tmp_path / "a.mp4", frames=2)
    (frame, _), _ = read(tmp_path / "a.mp4", "mp4")
    assert frame.shape == (height + height % 2, width + width % 2, 3)
    assert np.abs(frame.astype(int) - 77).max() < 4
    assert "an odd last row or column is repeated" in notes[0]


@pytest.mark.parametrize("name", FORMATS)
def test_what_is_lost_is_noted(tmp_path, name):
    notes = make_field(dtype=np.uint16, channels=4).save(tmp_path / f"a{FORMATS[name]}", frames=2)
    assert [f"{name}: 16 bits are rounded to 8", f"{name}: alpha is left out"] == list(notes[-2:])


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize("bits", [8, 10, 12])
def test_levels_of_cameras_of_fewer_bits_fill_the_range(tmp_path, name, bits):
    views = make_field(dtype=np.uint16).views >> (16 - bits)
    views[0, 0] //= 2  # a darker view stays darker
    notes = LightField(views, depth_sense="cameras").save(tmp_path / f"a{FORMATS[name]}", name, frames=2)
    assert f"{name}: no level is over {2**bits - 1}, so levels are multiplied by {2 ** (16 - bits)}" in notes
    make_field().save(tmp_path / f"b{FORMATS[name]}", name, frames=2)
    (found, _), (expected, _) = (read(tmp_path / f"{stem}{FORMATS[name]}", name) for stem in "ab")
    for one, other in zip(found, expected, strict=True):
        assert np.abs(one.astype(int) - other).mean() < 4  # lossy


@pytest.mark.parametrize(
    ("name", "options", "contents", "message"),
    [
        ("gif", {"fps": 60}, (8, 8), "fps: 60 is over the 50 that viewers show of gif"),
        ("mp4", {"path": "square"}, (8, 8), "path: 'square' is not known"),
        ("mp4", {"name": "a_qs8x6a0.75.mp4"}, (8, 8), "_qs8x6a0.75 names a quilt, .* end the name with .png, .tif,"),
        ("webm", {}, (8, 20_000), "webm holds frames of up to 16,383 pixels a side"),
    ],
)
def test_what_is_refused_before_any_view_is_made(name, options, contents, message):
    given = Contents(tuple(np.ndindex(2, 2)), (2, 2), *contents, 3, np.dtype(np.uint8))
    with (
        FileWriter(io.BytesIO(), name, WriterOptions(**options)) as writer,
        pytest.raises(InvalidOption, match=message),
    ):
        writer.begin(given)


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"frames": 0}, "frames: 0 is out of range; give 1 to 3600"),
        ({"frames": 2.5}, "frames: '2.5' is not accepted; give a whole number"),
        ({"fps": -5}, "fps: -5 is out of range; give 1 to 240"),
        ({"fps": 0}, "fps: 0 is out of range"),
        ({"fps": 1e9}, "fps: 1000000000.0 is out of range"),
    ],
)
def test_numbers_out_of_range_leave_the_earlier_file(tmp_path, name, options, message):
    path = tmp_path / f"a{FORMATS[name]}"
    path.write_bytes(b"earlier")
    with pytest.raises(InvalidOption, match=message):
        make_field().save(path, name, **options)
    assert path.read_bytes() == b"earlier"


@pytest.mark.parametrize(
    ("times", "is_noted"), [((0, 0.1, 0.3), True), ((0, 0.033, 0.067, 0.1), False), ((0, 2), False)]
)
def test_uneven_times_are_noted(times, is_noted):
    contents = Contents(tuple(np.ndindex(1, len(times))), (1, len(times)), 16, 16, 3, np.dtype(np.uint8), times=times)
    report = {"notes": []}
    with FileWriter(io.BytesIO(), "gif") as writer:
        writer.begin(contents)
        for view in contents.views:
            writer.write(view, np.full((16, 16, 3), 80 * view[1], np.uint8))
        writer.finish(report)
    assert any(note.startswith("time: the times are uneven") for note in report["notes"]) == is_noted


@pytest.mark.parametrize(
    ("times", "rate"),
    [
        ((), None),
        ((1.0,), None),
        ((2.0, 2.0), None),
        ((0, 0.5, 1), 2),
        ((3, 1), 0.5),
        ((0, 1e6), 1 / 60),
        ((0, 1e-9), 240),
    ],
)
def test_frames_pass_as_fast_as_their_times(times, rate):
    assert find_rate(times) == pytest.approx(rate)
