import numpy as np
import pytest

from ciir.renderer.backends.reverses import find_reverses


@pytest.mark.parametrize("turned", [0, 1, 2])
def test_faces_in_reverse_order_at_the_same_positions(turned: int) -> None:
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    vertices = np.concatenate([corners, corners])  # the others have vertices of their own
    others = np.roll([[4, 6, 5], [4, 5, 7], [6, 5, 7]], turned, axis=1)
    faces = np.concatenate([[[0, 1, 2], [0, 1, 3], [0, 2, 3]], others]).astype(np.int32)
    place, reverse = find_reverses(vertices, faces)
    assert (place[:4] == place[4:]).all()
    assert reverse.tolist() == [3, -1, -1, 0, -1, -1]  # the second of each lies alike, the third elsewhere
