import pytest

from ciir.service.jobs.job import Request
from ciir.service.jobs.lanes import SMALL_BYTES, lane, order


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
def test_by_bytes_and_output_pixels(options, size, expected):
    assert lane(Request("upload.glb", options, None), size) == expected


def test_one_thread_is_kept_for_small_ones():
    assert {order(0, 2, turn) for turn in range(10)} == {("small",)}


@pytest.mark.parametrize(("thread", "threads"), [(0, 1), (1, 2), (3, 4)])
def test_small_ones_first_and_yet_the_large_ones_get_through(thread, threads):
    firsts = [order(thread, threads, turn)[0] for turn in range(40)]
    assert all(set(order(thread, threads, turn)) == {"small", "large"} for turn in range(40))
    assert firsts.count("large") == 10
    assert firsts[:3] == ["small"] * 3
