import numpy as np

from ciir.renderer.readers.meshes.geometry import normalise, triangulate_fans


def test_fans_keep_order_and_source() -> None:
    corners = np.array([4, 5, 6, 7, 1, 2, 1, 2, 3, 0, 1, 2, 3, 4])
    faces, source = triangulate_fans(np.array([4, 2, 3, 5]))
    assert corners[faces].tolist() == [[4, 5, 6], [4, 6, 7], [1, 2, 3], [0, 1, 2], [0, 2, 3], [0, 3, 4]]
    assert source.tolist() == [0, 0, 2, 3, 3, 3]


def test_normalised() -> None:
    assert normalise(np.array([0, 255], np.uint8)).tolist() == [0, 1]
    assert normalise(np.array([-32768, -32767, 32767], np.int16)).tolist() == [-1, -1, 1]
    assert normalise(np.array([0.5, 3.0])).tolist() == [0.5, 3.0]
