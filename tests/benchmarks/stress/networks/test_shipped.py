import numpy as np
import pytest

from ciir.benchmarks.stress.case import Effort
from ciir.benchmarks.stress.networks import shipped


def noise(*shape):
    return np.random.default_rng(5).random(shape, dtype=np.float32)


def test_measures():
    images = np.zeros((2, 3, 2, 2), np.float32)
    images[1, 0, 0, 0] = -12
    assert shipped.peak(images).tolist() == [0, 12]
    assert shipped.rms(images).tolist() == [0, pytest.approx(12**0.5 * 1.0)]
    found = shipped.find_worst("x", 1.0, shipped.peak(images), ["first", "second"])
    assert (found.measured, found.where) == (12, "second")
    images[0] = np.nan
    assert shipped.find_worst("x", 1.0, shipped.peak(images), ["first", "second"]).where == "first"
    assert shipped.rms(np.full((1, 3, 2, 2), 1e-30, np.float32))[0] == pytest.approx(1e-30)


def test_downsample_is_the_mean_of_each_four():
    images = np.arange(16, dtype=np.float32).reshape(1, 1, 4, 4)
    assert shipped.downsample(images).tolist() == [[[[2.5, 4.5], [10.5, 12.5]]]]


def test_many_pictures_equal_each_alone():
    images = noise(shipped.BATCH + 1, 3, 8, 8)
    run = shipped.load_network("fast")
    assert np.array_equal(run(images)[-1:], run(images[-1:]))


def test_twins():
    effort = Effort(("fast", "fast-int8", "gan"))
    assert list(shipped.list_int8_twins(effort)) == [("fast", "fast-int8")]
    assert list(shipped.list_float_networks(effort)) == ["fast", "gan"]


@pytest.mark.parametrize("name", ["fast", "best-int8", "paper"])
def test_the_reference_computes_the_same(name):
    pytest.importorskip("onnx", reason="needs the training extra")
    images = noise(1, 3, 9, 12)
    difference = np.abs(shipped.load_network(name)(images) - shipped.load_reference(name)(images))
    # Codes of int8 may round to a neighbour; float sums are taken in another order.
    assert difference.max() <= (3 / 255 if shipped.is_int8(name) else shipped.UNSEEN)
