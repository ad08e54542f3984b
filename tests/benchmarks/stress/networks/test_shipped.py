import numpy as np
import pytest

from ciir.benchmarks.stress.case import Effort
from ciir.benchmarks.stress.networks import shipped


def noise(*shape):
    return np.random.default_rng(5).random(shape, dtype=np.float32)


def test_looking_inside_changes_nothing():
    pytest.importorskip("onnx", reason="needs the training extra")
    images = noise(2, 3, 9, 11)
    weights = shipped.weights("fast")
    nodes = shipped.nodes(weights)
    inside = shipped.looking_inside(weights, [node.output[0] for node in nodes])(images)
    assert [len(values) for values in inside.values()] == [2] * len(nodes)
    assert np.array_equal(inside[nodes[-1].output[0]], shipped.raw("fast")(images))
    assert (inside["relu"] == np.maximum(inside["conv2d"], 0)).all()


def test_measures():
    images = np.zeros((2, 3, 2, 2), np.float32)
    images[1, 0, 0, 0] = -12
    assert shipped.peak(images).tolist() == [0, 12]
    assert shipped.rms(images).tolist() == [0, pytest.approx(12**0.5 * 1.0)]
    assert shipped.worst(shipped.peak(images), ["first", "second"]) == (12, "second")
    images[0] = np.nan
    assert shipped.worst(shipped.peak(images), ["first", "second"])[1] == "first"
    assert shipped.rms(np.full((1, 3, 2, 2), 1e-30, np.float32))[0] == pytest.approx(1e-30)


def test_box_is_the_mean_of_each_four():
    images = np.arange(16, dtype=np.float32).reshape(1, 1, 4, 4)
    assert shipped.box(images).tolist() == [[[[2.5, 4.5], [10.5, 12.5]]]]


def test_many_pictures_go_in_parts():
    images = noise(shipped.TOGETHER + 1, 3, 8, 8)
    run = shipped.raw("fast")
    assert np.array_equal(run(images)[-1:], run(images[-1:]))


def test_twins():
    effort = Effort(("fast", "fast-int8", "gan"))
    assert list(shipped.twins(effort)) == [("fast", "fast-int8")]
    assert list(shipped.floats(effort)) == ["fast", "gan"]
