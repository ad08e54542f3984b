import numpy as np

from renderer.polygons import fans, normalised


def test_fans_keep_order_and_source() -> None:
    faces, source = fans([[4, 5, 6, 7], [1, 2], [1, 2, 3], [0, 1, 2, 3, 4]])
    assert faces.tolist() == [[4, 5, 6], [4, 6, 7], [1, 2, 3], [0, 1, 2], [0, 2, 3], [0, 3, 4]]
    assert source.tolist() == [0, 0, 2, 3, 3, 3]


def test_fans_of_an_array_and_of_nothing() -> None:
    faces, source = fans(np.array([[0, 1, 2], [2, 1, 3]]))
    assert faces.tolist() == [[0, 1, 2], [2, 1, 3]]
    assert source.tolist() == [0, 1]
    assert fans([])[0].shape == (0, 3)


def test_normalised() -> None:
    assert normalised(np.array([0, 255], np.uint8)).tolist() == [0, 1]
    assert normalised(np.array([-32768, -32767, 32767], np.int16)).tolist() == [-1, -1, 1]
    assert normalised(np.array([0.5, 3.0])).tolist() == [0.5, 3.0]
