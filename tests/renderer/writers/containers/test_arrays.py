import numpy as np
import pytest

from ciir.renderer.light_field import LightField


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_npy_is_v_u_y_x_c(tmp_path, dtype):
    views = np.arange(2 * 3 * 4 * 5 * 2).astype(dtype).reshape(2, 3, 4, 5, 2)
    assert LightField(views).save(tmp_path / "a.npy") == ()
    found = np.load(tmp_path / "a.npy", allow_pickle=False)
    assert found.dtype == dtype
    assert found[1, 2, 3, 4, 1] == views[1, 2, 3, 4, 1]
    np.testing.assert_array_equal(found, views)


def test_a_depth_sense_that_is_lost_is_noted(tmp_path):
    views = np.zeros((1, 1, 2, 2, 3), np.uint8)
    (note,) = LightField(views, depth_sense="cameras").save(tmp_path / "a.npy")
    assert "no depth sense" in note
