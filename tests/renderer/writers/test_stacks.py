import io
import json
import os
import zipfile

import av
import numpy as np
import pytest
import tifffile

from ciir.errors import InvalidOption
from ciir.renderer.readers.pictures import decode
from ciir.renderer.writers import stacks
from ciir.renderer.writers.formats import FORMATS
from ciir.renderer.writers.stacks import PLANE, STACK, Stack

PLANES = np.random.default_rng(0).uniform(-5, 260, (3, 6, 7, 3)).astype(np.float32)  # cubic kernels overshoot
ROUNDED = np.rint(PLANES).clip(0, 255).astype(np.uint8)


def make_stack(planes=PLANES, dtype=np.uint8, asked=None):
    def make(order):
        for number in order:
            (asked if asked is not None else []).append(number)
            yield planes[number]

    return Stack(
        names=tuple(f"plane_{number:03d}_d{number:+.3f}" for number in range(len(planes))),
        kind="disparities",
        values=tuple(map(float, range(len(planes)))),
        shape=planes.shape[1:],
        dtype=np.dtype(dtype),
        make=make,
        describe=lambda: {"planes": [{"name": f"plane_{number:03d}_d{number:+.3f}"} for number in range(len(planes))]},
    )


def write(name, stack, writers=STACK):
    file = io.BytesIO()
    notes = writers[name](file, stack)
    file.seek(0)
    return file, notes


def test_pictures_are_rounded_and_named_by_what_is_in_focus():
    file, _ = write("zip", make_stack())
    with zipfile.ZipFile(file) as archive:
        names = ["plane_000_d+0.000.png", "plane_001_d+1.000.png", "plane_002_d+2.000.png", "report.json"]
        assert archive.namelist() == names
        for name, expected in zip(names, ROUNDED, strict=False):
            np.testing.assert_array_equal(decode(archive.read(name), name=name), expected)
        assert len(json.loads(archive.read("report.json"))["planes"]) == 3


@pytest.mark.parametrize(("channels", "dtype"), [(1, np.uint8), (2, np.uint8), (3, np.uint16), (4, np.uint16)])
def test_a_tiff_has_a_page_for_each_plane(channels, dtype):
    planes = np.random.default_rng(1).uniform(0, np.iinfo(dtype).max, (3, 6, 7, channels)).astype(np.float32)
    file, _ = write("stack", make_stack(planes, dtype))
    with tifffile.TiffFile(file) as tiff:
        assert [page.tags[285].value for page in tiff.pages] == list(make_stack().names)
        pages = np.stack([page.asarray().reshape(6, 7, channels) for page in tiff.pages])
    np.testing.assert_array_equal(pages, np.rint(planes).astype(dtype))


def test_tiffs_are_written_into_files_without_a_name(tmp_path):
    target = os.open(tmp_path / "stack", os.O_RDWR | os.O_CREAT)
    with open(target, "w+b") as file:  # noqa: PTH123 - as worker processes do
        STACK["stack"](file, make_stack())
    expected, _ = write("stack", make_stack())
    assert (tmp_path / "stack").read_bytes() == expected.getvalue()


def test_arrays_are_not_rounded():
    file, _ = write("npy", make_stack())
    np.testing.assert_array_equal(np.load(file), PLANES)
    file, _ = write("npz", make_stack())
    arrays = np.load(file)
    np.testing.assert_array_equal(arrays["planes"], PLANES)
    np.testing.assert_array_equal(arrays["disparities"], [0, 1, 2])
    assert len(json.loads(str(arrays["report"]))["planes"]) == 3


@pytest.mark.parametrize("picture", ["png", "tiff", "webp"])
def test_one_plane_is_a_picture(picture):
    file, _ = write(picture, make_stack(PLANES[:1]), PLANE)
    np.testing.assert_array_equal(decode(file.read(), name=f"x{FORMATS[picture].suffixes[0]}"), ROUNDED[0])


@pytest.mark.parametrize(("kept", "asked"), [(2**28, [0, 1, 2, 3, 4]), (0, [0, 1, 2, 3, 4, 3, 2, 1])])
def test_a_video_goes_to_the_last_plane_and_back(monkeypatch, kept, asked):
    monkeypatch.setattr(stacks, "KEPT", kept)
    levels = np.array([30, 80, 130, 180, 230], np.float32)
    order = []
    planes = np.broadcast_to(levels[:, None, None, None], (5, 64, 64, 1))
    file, notes = write("webm", make_stack(planes, asked=order))
    assert order == asked
    assert "lossy" in notes[0]
    with av.open(file) as video:
        shown = [frame.to_ndarray(format="rgb24").mean() for frame in video.decode(video=0)]
    assert shown == pytest.approx([30, 80, 130, 180, 230, 180, 130, 80], abs=4)  # lossy


def test_a_video_of_10_bits_fills_the_range():
    planes = np.broadcast_to(np.array([120, 1000], np.float32)[:, None, None, None], (2, 64, 64, 1))
    stack = Stack(**{**vars(make_stack(planes, np.uint16)), "unused": 6})
    file, notes = write("webm", stack)
    rounded, raised = "webm: 16 bits are rounded to 8", "no level is over 1023, so levels are multiplied by 64"
    assert notes[1:] == [rounded, f"webm: {raised}"]
    with av.open(file) as video:
        shown = [frame.to_ndarray(format="rgb24").mean() for frame in video.decode(video=0)]
    assert shown == pytest.approx([30, 249], abs=4)  # lossy
    file, _ = write("stack", stack)
    with tifffile.TiffFile(file) as tiff:
        assert [page.asarray().max() for page in tiff.pages] == [120, 1000]  # 16 bits keep their levels


def test_a_rate_that_viewers_dont_keep_is_refused_before_any_plane():
    order = []
    stack = make_stack(asked=order)
    with pytest.raises(InvalidOption, match="fps: 60 is over the 50"):
        write("gif", Stack(**{**vars(stack), "fps": 60.0}))
    assert not order


def test_planes_of_an_earlier_run_are_removed_from_a_folder(tmp_path):
    (tmp_path / "mine.png").write_bytes(b"mine")
    sharp = {"names": ("all_in_focus",), "describe": lambda: {"planes": [{"name": "all_in_focus"}]}}
    assert stacks.write_folder(tmp_path, Stack(**{**vars(make_stack(PLANES[:1])), **sharp})) == []
    assert "1" in stacks.write_folder(tmp_path, make_stack())[0]
    assert not (tmp_path / "all_in_focus.png").exists()
    assert len(list(tmp_path.glob("plane_*"))) == 3
    assert "2" in stacks.write_folder(tmp_path, make_stack(PLANES[:1]))[0]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["mine.png", "plane_000_d+0.000.png", "report.json"]


def test_a_plane_that_fails_leaves_nothing(tmp_path):
    def fail(order):
        yield PLANES[0]
        raise InvalidOption(str(order))

    with pytest.raises(InvalidOption):
        stacks.write_folder(tmp_path / "out", Stack(**{**vars(make_stack()), "make": fail}))
    assert not list(tmp_path.iterdir())
