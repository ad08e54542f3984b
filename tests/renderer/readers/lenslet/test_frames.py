import numpy as np
import pytest

from ciir.renderer.readers.lenslet.frames import divide_by_white, subtract_dark


@pytest.mark.parametrize("correct", [subtract_dark, divide_by_white])
def test_alpha_stays(correct):
    picture, frame = (np.full((2, 3, 4), level, np.uint8) for level in ((90, 80, 70, 255), (9, 8, 7, 255)))
    assert (correct(picture, frame)[..., 3] == 255).all()


def test_a_dark_frame_is_subtracted():
    picture = np.array([[[10, 3, 200]]], np.uint8)
    assert subtract_dark(picture, np.full((1, 1, 3), 5, np.uint8)).tolist() == [[[5, 0, 195]]]
