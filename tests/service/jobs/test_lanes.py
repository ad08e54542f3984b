import io
import zipfile

import pytest

from ciir.service.jobs import lanes
from ciir.service.jobs.job import Request
from ciir.service.jobs.lanes import choose_lane, measure_unpacked, order_lanes

RAYS_OF_2_MEGAPIXELS = {
    "lenses": "1000x2000",
    "model": "none",
    "scale": "1",
    "backend": "raytrace",
    "sampling": "lenslet",
}


def choose(options, data=b""):
    return choose_lane(Request("upload.glb", options, None), io.BytesIO(data))


def make_zip(*files):
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for number, data in enumerate(files):
            archive.writestr(str(number), data)
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
    ("kind", "options", "size", "expected"),
    [
        ("elemental", {}, 1000, "small"),
        ("elemental", {"sampling": "lenslet"}, 1000, "large"),
        ("upscale", {}, 100_000, "small"),
        ("upscale", {"scale": "4"}, 100_000, "large"),
    ],
)
def test_the_lane_of_other_kinds_of_jobs(kind, options, size, expected):
    assert choose_lane(Request("upload.x", options, None, kind), io.BytesIO(bytes(size))) == expected


def test_a_small_zip_that_unpacks_to_a_large_mesh_is_a_large_job():
    data = make_zip(b"glTF".ljust(47_000_000))
    assert len(data) < 1_000_000
    assert choose(RAYS_OF_2_MEGAPIXELS, data) == choose({}, data) == "large"
    assert choose({}, make_zip(b"glTF".ljust(1000))) == "small"


def test_the_directory_of_a_zip_is_at_its_end(monkeypatch):
    file = io.BytesIO(make_zip(bytes(3_000_000), *[b"x"] * 100))
    assert measure_unpacked(file) == 3_000_100
    monkeypatch.setattr(lanes, "_DIRECTORY_BYTES", 1000)
    assert measure_unpacked(file) == float("inf")  # too long to be read in the web process
    assert measure_unpacked(io.BytesIO(b"PK\x03\x04 damaged")) == float("inf")
    assert measure_unpacked(io.BytesIO(bytes(5))) == 5


def test_one_of_several_threads_only_takes_small_jobs():
    assert {order_lanes(0, 2, count) for count in range(10)} == {("small",)}


@pytest.mark.parametrize(("thread", "threads"), [(0, 1), (1, 2), (3, 4)])
def test_small_jobs_come_first_but_for_one_in_four(thread, threads):
    firsts = [order_lanes(thread, threads, count)[0] for count in range(40)]
    assert all(set(order_lanes(thread, threads, count)) == {"small", "large"} for count in range(40))
    assert firsts.count("large") == 10
    assert firsts[:3] == ["small"] * 3
