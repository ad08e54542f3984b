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


@pytest.mark.parametrize("sense", ["lenses", "cameras"])
def test_numpy_loads_the_views_as_they_are_in_memory_and_then_their_depth_sense(tmp_path, sense):
    views = np.arange(6, dtype=np.uint8).reshape(2, 3, 1, 1, 1)
    assert LightField(views, depth_sense=sense).save(tmp_path / "a.npy") == ()
    np.testing.assert_array_equal(np.load(tmp_path / "a.npy"), views)
    np.testing.assert_array_equal(np.load(tmp_path / "a.npy", mmap_mode="r"), views)
    with (tmp_path / "a.npy").open("rb") as file:
        np.load(file)
        assert np.load(file) == sense
