import numpy as np
import pytest

from ciir.errors import BrokenNetwork, InvalidImage
from ciir.models.upscaler import check_images, clip_output


def pictures(*shape: int) -> np.ndarray:
    return np.full(shape, 0.5, np.float32)


@pytest.mark.parametrize("shape", [(1, 3, 1, 1), (0, 3, 4, 4), (5, 3, 2, 9)])
def test_good_pictures_pass(shape):
    check_images(pictures(*shape))


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_values_that_are_not_finite_are_named_by_their_index(value):
    images = pictures(2, 3, 4, 5)
    images[1, 2, 3, 4] = value
    with pytest.raises(InvalidImage, match=r"\(1, 2, 3, 4\)"):
        check_images(images)


@pytest.mark.parametrize("value", [-0.01, 1.01, 255.0])
def test_values_out_of_range(value):
    images = pictures(1, 3, 2, 2)
    images[0, 0, 0, 0] = value
    with pytest.raises(InvalidImage, match="scale the pictures"):
        check_images(images)


@pytest.mark.parametrize("shape", [(3, 4, 4), (1, 1, 4, 4), (1, 4, 4, 3), (1, 3, 0, 4), (1, 3, 4, 0)])
def test_other_shapes(shape):
    with pytest.raises(InvalidImage, match="shape"):
        check_images(pictures(*shape))


def test_other_types():
    with pytest.raises(InvalidImage, match="float64"):
        check_images(pictures(1, 3, 2, 2).astype(np.float64))


def test_output_is_clipped():
    assert clip_output(np.array([-0.5, 0.25, 1.5], np.float32), "x").tolist() == [0.0, 0.25, 1.0]


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_output_that_is_not_finite_is_refused_naming_the_model(value):
    with pytest.raises(BrokenNetwork, match="fast"):
        clip_output(np.array([0.5, value], np.float32), "fast")
