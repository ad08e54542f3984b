import numpy as np
import pytest

from ciir.benchmarks.bench.methods import list_methods
from ciir.benchmarks.bench.work import halve, list_works
from ciir.errors import InvalidOption
from ciir.renderer.light_field import LightField
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.writers.pictures import encode_png
from ciir.service.pipeline.options import Options


def field(rows=24, cols=20):
    """3x3 views of a smooth picture that moves by a pixel from view to view."""
    y, x = np.mgrid[:rows, :cols]
    every = [
        np.stack([100 + 60 * np.sin((x + u) / 3), 120 + 50 * np.cos((y + v) / 4), 90 + x + y], axis=-1)
        for v in range(3)
        for u in range(3)
    ]
    return np.stack(every).astype(np.uint8).reshape(3, 3, rows, cols, 3)


def given(views):
    return Bundle.from_upload("eia.png", encode_png(LightField(views).eia()))


def test_a_mesh_gives_one_work_for_each_count_and_sampling():
    done = list(list_works("vase", "vase", lenses=(8, 12), array=Options()))
    assert [(work.lenses, work.sampling) for work in done] == [
        ((8, 8), "pinhole"), ((8, 8), "lenslet"), ((12, 12), "pinhole"), ((12, 12), "lenslet"),
    ]  # fmt: skip
    work = done[0]
    assert work.truth.shape == (5, 16, 16, 3)
    assert work.object is not None
    # Where nothing of the vase shows, the truth is the background.
    assert 0.05 < work.object.mean() < 0.7
    assert work.truth[~work.object].mean() < work.truth[work.object].mean() / 4


def test_direct_rays_are_the_truth_and_nearest_is_the_view_itself():
    work = next(list_works("vase", "vase", lenses=(8,), array=Options()))
    by_name = {method.name: method for method in list_methods()[0]}
    np.testing.assert_array_equal(by_name["direct-rays"].reconstruct(work)[0], work.truth)
    nearest = by_name["nearest"].reconstruct(work)[0]
    np.testing.assert_array_equal(nearest[:, ::2, ::2], nearest[:, 1::2, 1::2])


def test_a_light_field_is_its_own_truth():
    views = field()
    pinhole, lenslet = list_works(given(views), "eia", lenses=(), array=Options(lenses=(24, 20)))
    assert (pinhole.lenses, lenslet.lenses) == ((6, 5), (12, 10))
    assert (pinhole.options.sampling, lenslet.options.sampling) == ("pinhole", "lenslet")
    np.testing.assert_array_equal(lenslet.truth[2], views[1, 1])  # cross: upper, left, centre, ...
    np.testing.assert_array_equal(lenslet.truth[0], views[0, 1])
    nearest = next(method for method in list_methods()[0] if method.name == "nearest")
    low = nearest.reconstruct(lenslet)[0][2, ::2, ::2].astype(float)
    mean = views[1, 1].astype(float).reshape(12, 2, 10, 2, 3).mean((1, 3))
    assert np.abs(low - mean).max() <= 0.5  # rounded to the nearest


def test_16_bits_of_which_10_are_used_keep_8():
    """Else they had 2, and scores of 60 dB."""
    views = field()
    deep = given(views.astype(np.uint16) * 4)
    lenslet = list(list_works(deep, "eia", lenses=(), array=Options(lenses=(24, 20))))[1]
    np.testing.assert_allclose(lenslet.truth[2], views[1, 1].astype(int), atol=1)


def test_halving_keeps_the_phase():
    """A ramp's cells have their own mean at their middle: any shift would show as a constant difference."""
    ramp = np.broadcast_to((np.arange(40) * 4).astype(np.uint8)[None, None, :, None], (1, 40, 40, 3))
    for sampling, cell in (("lenslet", 2), ("pinhole", 4)):
        low, high = halve(ramp, sampling)
        middle = 4 * (np.arange(40 // cell) * cell + (cell - 1) / 2)
        assert np.abs(low[0, 0, :, 0] - middle).max() <= 0.5
        assert high.shape[1:3] == (2 * low.shape[1], 2 * low.shape[2])
        assert np.abs(high[0, 0, :, 0].reshape(-1, 2).mean(1) - low[0, 0, :, 0]).max() <= 0.5


def test_views_that_are_too_small_are_named():
    with pytest.raises(InvalidOption, match="views of 3x3 pixels"):
        list(list_works(given(field(3, 3)), "eia", lenses=(), array=Options(lenses=(3, 3))))
