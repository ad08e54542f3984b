import numpy as np
import pytest

from ciir.renderer.light_field import LightField


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_npy_is_v_u_y_x_c(tmp_path, dtype):
    views = np.arange(2 * 3 * 4 * 5 * 2).astype(dtype).reshape(2, 3, 4, 5, 2)
    assert LightField(views, depth_sense="cameras").save(tmp_path / "a.npy") == ()
    found = np.load(tmp_path / "a.npy", allow_pickle=False)
    assert found.dtype == dtype
    assert found[1, 2, 3, 4, 1] == views[1, 2, 3, 4, 1]
    np.testing.assert_array_equal(found, views)


def test_views_of_a_lens_array_are_written_as_cameras_see_them(tmp_path):
    views = np.arange(6, dtype=np.uint8).reshape(2, 3, 1, 1, 1)
    (note,) = LightField(views, depth_sense="lenses").save(tmp_path / "a.npy")
    assert note.startswith("npy counts cameras: views are written in reversed order in v and in u")
    np.testing.assert_array_equal(np.load(tmp_path / "a.npy"), views[::-1, ::-1])
