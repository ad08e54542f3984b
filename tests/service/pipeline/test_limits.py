import pytest

from ciir.errors import TooLarge
from ciir.renderer.lens_array import LensArray
from ciir.service.pipeline import limits


def array(rows, cols, pixels=15):
    return LensArray(rows, cols, pixels, pixels)


def test_number_of_views():
    limits.check_view_count("all", (4096, 4096), 4096**2)
    with pytest.raises(TooLarge, match="all of 4096x4096"):
        limits.check_view_count("all", (4096, 4096), 4096**2 - 1)
    limits.check_view_count("center", (4096, 4096), 1)
    limits.check_view_count("0,0;1,1;", (4, 4), 2)
    with pytest.raises(TooLarge, match="3 are over the limit of 2; name fewer"):
        limits.check_view_count("0,0;1,1;2,2", (4, 4), 2)


def test_size_of_views():
    limits.check_size((100, 100), 2, count=225, limit=225 * 40_000)
    with pytest.raises(TooLarge, match="225 views of 200x200"):
        limits.check_size((100, 100), 2, count=225, limit=225 * 40_000 - 1)
    with pytest.raises(TooLarge, match=r"a\.png: 8192x8192 pixels, 2 times 4096x4096, are over"):
        limits.check_size((4096, 4096), 2, what="a.png")
    with pytest.raises(TooLarge, match="a side"):
        limits.check_size((70_000, 9), 2)
    with pytest.raises(TooLarge, match=r"give a smaller scale or fewer lenses$"):
        limits.check_size((70_000, 9), 2, remedy="fewer lenses")


def test_samples_of_a_view():
    limits.check_view_samples(array(2000, 2000), 4, "upscale")
    with pytest.raises(TooLarge, match=r"2001x2000.*give fewer lenses or sampling pinhole$"):
        limits.check_view_samples(array(2001, 2000), 4, "upscale")
    with pytest.raises(TooLarge, match=r"9000x9000.*give fewer lenses$"):
        limits.check_view_samples(array(9000, 9000), 1, "upscale")
    with pytest.raises(TooLarge, match=r"2001x2000.*give fewer lenses, a smaller scale or strategy upscale$"):
        limits.check_view_samples(array(2001, 2000), 4, "direct")


def test_samples_of_all_views():
    limits.check_samples(10_000, 25, 250_000, "upscale", samples=1)
    limits.check_samples(10_000, 25, None, "upscale", samples=1)
    with pytest.raises(TooLarge, match=r"25 views of 10,000 samples each are 250,000.*fewer views or fewer lenses$"):
        limits.check_samples(10_000, 25, 249_999, "upscale", samples=1)
    with pytest.raises(TooLarge, match=r"fewer views, fewer lenses or sampling pinhole$"):
        limits.check_samples(10_000, 25, 249_999, "upscale", samples=4)
    with pytest.raises(TooLarge, match=r"24 of them around those asked for, are 250,000.*model quality"):
        limits.check_samples(10_000, 25, 249_999, "upscale", samples=1, neighbours=24)
    with pytest.raises(TooLarge, match=r"fewer lenses, a smaller scale or strategy upscale$"):
        limits.check_samples(10_000, 25, 249_999, "direct", samples=1)


def test_elemental_image_arrays():
    with pytest.raises(TooLarge, match="a side"):
        limits.check_eia(array(70_000, 9, pixels=2))
    with pytest.raises(TooLarge, match="elemental"):
        limits.check_eia(array(1000, 1000))
