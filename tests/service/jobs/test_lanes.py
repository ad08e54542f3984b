import io
import zipfile

import pytest

from ciir.models import processor
from ciir.service.jobs import lanes
from ciir.service.jobs.job import Request
from ciir.service.jobs.lanes import Content, choose_lane, measure, order_lanes
from tests.support.inputs import CUBE, make_png_header

RAYS_OF_2_MEGAPIXELS = {
    "lenses": "1000x2000",
    "model": "none",
    "scale": "1",
    "backend": "raytrace",
    "sampling": "lenslet",
}

PANEL = "panel = {{pixels = [{}, {}], pitch = 0.1}}\nlenses = {{pitch = 1, gap = 3}}"


def choose(options, data=b""):
    return choose_lane(Request("upload.glb", options, None), io.BytesIO(data))


def make_zip(*files, suffix=""):
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for number, data in enumerate(files):
            archive.writestr(f"{number}{suffix}", data)
    return file.getvalue()


@pytest.mark.parametrize(
    ("options", "size", "expected"),
    [
        ({}, 1000, "small"),
        ({"lenses": "50x50"}, 1000, "small"),
        ({}, 4 << 20, "small"),
        ({}, 5 << 20, "large"),
        ({"views": "all"}, 1000, "large"),
        ({"views": "all", "pixels": "3x3"}, 1000, "small"),
        ({"lenses": "1000x1000"}, 1000, "large"),
        ({"lenses": "350x350"}, 1000, "small"),
        ({"lenses": "350x350", "views": "cross"}, 1000, "large"),
        ({"lenses": "350x350", "views": "0,0;0,1;0,2;0,3;0,4"}, 1000, "large"),
        ({"lenses": "350x350", "scale": "8"}, 1000, "large"),
        ({"lenses": "1000x1000", "model": "none", "scale": "1"}, 1000, "small"),
        ({"lenses": "1000x1000", "model": "none", "scale": "1", "sampling": "lenslet"}, 1000, "large"),
        ({"lenses": "300x300", "strategy": "direct"}, 1000, "small"),
        ({"lenses": "300x300", "strategy": "direct", "views": "cross"}, 1000, "large"),
        ({"lenses": "10x10", "views": "all", "backend": "raytrace"}, 1 << 20, "small"),
        ({"lenses": "10x10", "views": "all", "backend": "raster"}, 1 << 20, "large"),
    ],
)
def test_the_lane_depends_on_the_work(options, size, expected):
    assert choose(options, bytes(size)) == expected


@pytest.mark.parametrize(
    ("kind", "options", "side", "expected"),
    [
        ("plane", {"disparity": "1"}, 1000, "small"),
        ("plane", {"stack": "0:1:999"}, 1000, "large"),
        ("plane", {"disparity": "1", "model": "quality"}, 1000, "large"),
        ("disparity", {}, 1000, "small"),
        ("disparity", {}, 7000, "large"),
    ],
)
def test_the_lane_of_planes_and_disparities(kind, options, side, expected):
    request = Request("upload.png", {"pixels": "9x9", **options}, None, kind)
    assert choose_lane(request, io.BytesIO(make_png_header(side, side))) == expected


@pytest.mark.parametrize(("options", "expected"), [({}, "small"), ({"sampling": "lenslet"}, "large")])
def test_the_lane_of_elemental_images(options, expected):
    assert choose_lane(Request("upload.x", options, None, "elemental"), io.BytesIO(bytes(1000))) == expected


@pytest.mark.parametrize(
    ("options", "side", "expected"),
    [
        ({"model": "quality", "skip": "none"}, 3900, "large"),
        ({"model": "quality"}, 450, "small"),
        ({"model": "quality"}, 600, "large"),
        ({"model": "quality-int8"}, 800, "small"),
        ({"model": "quality-int8"}, 1000, "large"),
        ({"model": "bicubic"}, 1000, "small"),
        ({"model": "bicubic", "scale": "8"}, 1000, "large"),
    ],
)
def test_pictures_count_by_their_pixels_and_the_model(options, side, expected):
    request = Request("upload.png", options, None, "upscale")
    assert choose_lane(request, io.BytesIO(make_png_header(side, side))) == expected


@pytest.mark.parametrize(("reason", "expected"), [("", "small"), ("no VNNI", "large")])
def test_pictures_count_as_those_of_the_default_that_runs_here(monkeypatch, reason, expected):
    monkeypatch.setattr(processor, "int8_unsupported_reason", lambda: reason)
    assert choose_lane(Request("upload.png", {}, None, "upscale"), io.BytesIO(make_png_header(600, 600))) == expected


@pytest.mark.parametrize(
    ("options", "side", "expected"),
    [
        ({"pixels": "15x15"}, 1500, "small"),
        ({"lenses": "100x100"}, 1500, "small"),
        ({"pixels": "15x15", "views": "all"}, 1500, "large"),
        ({"lenses": "100x100", "views": "all"}, 1500, "large"),
        ({"pixels": "2x2"}, 3900, "large"),
        ({"pixels": "15x15"}, 8000, "large"),
        ({"pixels": "15x15", "views": "all", "model": "none"}, 1500, "small"),
        ({"lens_pitch": "15"}, 3900, "large"),
        ({"pixels": "9x9", "model": "field-quality"}, 1800, "large"),
        ({"pixels": "9x9", "model": "field-quality", "fusion": "never"}, 1800, "small"),
        ({"pixels": "3x3", "model": "field-quality-int8"}, 945, "large"),
        ({"pixels": "3x3", "model": "field-quality-int8"}, 990, "small"),  # too large for `auto` to fuse them
        ({"pixels": "3x3", "model": "field", "views": "all"}, 621, "small"),
        ({"pixels": "3x3", "model": "field", "views": "all", "fusion": "always"}, 621, "large"),
        ({"pixels": "9x9", "model": "quality", "fusion": "always"}, 1800, "small"),
    ],
)
def test_elemental_image_arrays_count_by_their_views(options, side, expected):
    assert choose(options, make_png_header(side, side)) == expected


def test_meshes_count_at_each_time_and_yaw():
    file, options = io.BytesIO(b"glTF" + bytes(9000)), {"lenses": "50x50", "model": "none"}
    given = {}, {"time": "0:1:600"}, {"rotate": "0:360:600"}
    lanes = [choose_lane(Request("upload.glb", options | more, "mp4"), file) for more in given]
    assert lanes == ["small", "large", "large"]


def test_videos_count_by_their_frames():
    data = make_png_header(3000, 3000)
    options = {"pixels": "15x15", "model": "none"}
    for frames, expected in (("10", "small"), ("1000", "large")):
        request = Request("upload.png", options | {"frames": frames}, "mp4")
        assert choose_lane(request, io.BytesIO(data)) == expected


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"display": PANEL.format(300, 200)}, "small"),
        ({"display": PANEL.format(1920, 1080)}, "large"),
        ({"device": "go"}, "large"),
        ({"device": "phone"}, "small"),  # refused at once
        ({"display": "["}, "small"),
    ],
)
def test_pictures_for_displays_count_by_their_rays(options, expected):
    request = Request("upload.glb", options, None, "display")
    assert choose_lane(request, io.BytesIO(CUBE)) == expected


@pytest.mark.parametrize(("model", "expected"), [("none", "small"), ("bicubic", "small"), ("best", "large")])
def test_pictures_for_displays_count_by_the_views_that_are_upscaled(model, expected):
    request = Request("upload.png", {"display": PANEL.format(300, 200), "model": model}, None, "display")
    assert choose_lane(request, io.BytesIO(make_png_header(1500, 1500))) == expected


@pytest.mark.parametrize(("fusion", "expected"), [("never", "small"), ("always", "large")])
def test_pictures_for_displays_count_matching(fusion, expected):
    options = {"display": PANEL.format(300, 200), "model": "field", "pixels": "9x9", "fusion": fusion}
    assert (
        choose_lane(Request("upload.png", options, None, "display"), io.BytesIO(make_png_header(600, 600))) == expected
    )


@pytest.mark.parametrize(
    ("options", "kind", "form", "expected"),
    [
        ({}, "inspection", None, "small"),
        ({"model": "none"}, "reconstruction", None, "small"),
        ({}, "reconstruction", None, "small"),
        ({"views": "all"}, "reconstruction", None, "large"),
        ({"model": "none"}, "disparity", "pfm", "small"),
        ({"model": "none"}, "disparity", "glb", "large"),
    ],
)
def test_sets_of_views_count_by_their_pixels(options, kind, form, expected):
    """81 views of 128x128 pixels, of as many bytes as a mesh that takes 8 s to read."""
    data = make_zip(make_png_header(128, 128), *[bytes(250_000)] * 80, suffix=".png")
    request = Request("upload.zip", options, form, kind)
    assert choose_lane(request, io.BytesIO(data)) == expected


def test_only_the_start_of_a_picture_in_a_zip_is_unpacked(monkeypatch):
    heads = []
    monkeypatch.setattr(lanes, "_measure_picture", lambda head: heads.append(len(head)) or 5)
    assert measure(io.BytesIO(make_zip(bytes(9_000_000), b"", suffix=".png"))).view == 5
    assert max(heads) <= 1 << 18
    for way in (zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA):  # zipfile would unpack all of it
        file = io.BytesIO()
        with zipfile.ZipFile(file, "w", way) as archive:
            archive.writestr("a.png", bytes(9_000_000))
        assert measure(file) == Content(float("inf"))
    assert len(heads) == 1


def test_what_is_no_view_in_a_zip():
    picture = make_png_header(30, 20)
    assert measure(io.BytesIO(make_zip(picture, suffix=".png")))[1:] == (600, None)
    for other in ("white.png", "__MACOSX/._0.png"):
        file = io.BytesIO()
        with zipfile.ZipFile(file, "w") as archive:
            archive.writestr(other, b"?")
            archive.writestr("0.png", picture)
        assert measure(file)[1:] == (600, None)


def test_views_state_their_own_number_of_pixels():
    """Two of 1500x1500; without their number, they would be those of an array of 15x15."""
    data = make_zip(make_png_header(1500, 1500), b"", suffix=".png")
    assert choose({}, data) == "large"
    assert choose({"model": "none"}, data) == "small"


def test_arrays_count_by_their_pixels():
    for options, expected in (({}, "small"), ({"views": "all"}, "large")):
        assert choose(options, b"\x93NUMPY" + bytes(16_000_000)) == expected
        assert choose(options, make_zip(bytes(16_000_000), suffix=".npy")) == expected
    assert choose({}, bytes(16_000_000)) == "large"  # it may be a mesh


def test_a_picture_whose_start_does_not_say_its_size_is_a_large_job():
    assert measure(io.BytesIO(make_png_header(30, 20))) == Content(57, 600)
    assert measure(io.BytesIO(b"\xff\xd8\xff damaged")).pixels == float("inf")
    assert measure(io.BytesIO(CUBE)) == Content(len(CUBE))
    assert choose({"lenses": "5x5"}, b"\xff\xd8\xff damaged") == "large"
    assert choose({}, make_zip(b"\xff\xd8\xff damaged", b"", suffix=".jpg")) == "large"


def test_a_small_zip_that_unpacks_to_a_large_mesh_is_a_large_job():
    data = make_zip(b"glTF".ljust(47_000_000))
    assert len(data) < 1_000_000
    assert choose(RAYS_OF_2_MEGAPIXELS, data) == choose({}, data) == "large"
    assert choose({}, make_zip(b"glTF".ljust(1000))) == "small"
    assert choose({}, make_zip(b"glTF".ljust(47_000_000), suffix=".glb")) == "large"


def test_the_directory_of_a_zip_is_at_its_end(monkeypatch):
    file = io.BytesIO(make_zip(bytes(3_000_000), *[b"x"] * 100))
    assert measure(file) == Content(3_000_100)
    monkeypatch.setattr(lanes, "_DIRECTORY_BYTES", 1000)
    assert measure(file) == Content(float("inf"))  # too long to be read in the web process
    assert measure(io.BytesIO(b"PK\x03\x04 damaged")) == Content(float("inf"))
    assert measure(io.BytesIO(bytes(5))) == Content(5)


def test_one_of_several_threads_only_takes_small_jobs():
    assert {order_lanes(0, 2, count) for count in range(10)} == {("small",)}


@pytest.mark.parametrize(("thread", "threads"), [(0, 1), (1, 2), (3, 4)])
def test_small_jobs_come_first_but_for_one_in_four(thread, threads):
    firsts = [order_lanes(thread, threads, count)[0] for count in range(40)]
    assert all(set(order_lanes(thread, threads, count)) == {"small", "large"} for count in range(40))
    assert firsts.count("large") == 10
    assert firsts[:3] == ["small"] * 3
