import pytest

from ciir.service.jobs.job import Request
from ciir.service.jobs.lanes import SMALL_BYTES, choose_lane, order_lanes


@pytest.mark.parametrize(
    ("options", "size", "expected"),
    [
        ({}, 1000, "small"),
        ({"lenses": "50x50"}, 1000, "small"),
        ({}, SMALL_BYTES, "small"),
        ({}, SMALL_BYTES + 1, "large"),
        ({"views": "all"}, 1000, "large"),
        ({"views": "all", "pixels": "3x3"}, 1000, "small"),
        ({"lenses": "1000x1000"}, 1000, "large"),
        ({"lenses": "350x350"}, 1000, "small"),
        ({"lenses": "350x350", "views": "cross"}, 1000, "large"),
        ({"lenses": "350x350", "views": "0,0;0,1;0,2;0,3;0,4"}, 1000, "large"),
        ({"lenses": "350x350", "scale": "8"}, 1000, "large"),
    ],
)
def test_the_lane_depends_on_bytes_and_output_pixels(options, size, expected):
    assert choose_lane(Request("upload.glb", options, None), size) == expected


def test_one_of_several_threads_only_takes_small_jobs():
    assert {order_lanes(0, 2, count) for count in range(10)} == {("small",)}


@pytest.mark.parametrize(("thread", "threads"), [(0, 1), (1, 2), (3, 4)])
def test_small_jobs_come_first_but_for_one_in_four(thread, threads):
    firsts = [order_lanes(thread, threads, count)[0] for count in range(40)]
    assert all(set(order_lanes(thread, threads, count)) == {"small", "large"} for count in range(40))
    assert firsts.count("large") == 10
    assert firsts[:3] == ["small"] * 3
