import numpy as np
import pytest

from ciir.errors import InvalidOption
from ciir.renderer.focus.depth_scale import DepthScale
from ciir.renderer.lens_array import LensArray


def test_a_lens_array():
    scale = DepthScale.from_lenses(LensArray(10, 10, 5, 5, pitch=2.0, delta=0.1))
    np.testing.assert_allclose(scale.to_disparity([-20, 0, 40]), [-1, 0, 2])
    assert scale.to_depth(2) == pytest.approx(40)


def test_the_disparity_of_a_file_behind_lenses():
    """Files have the sense of cameras, whatever was captured."""
    array = LensArray(10, 10, 5, 5, pitch=2.0, delta=0.1)
    saved = -DepthScale.from_lenses(array).to_disparity(40)
    assert DepthScale.from_lenses(array, sense="cameras").to_depth(saved) == pytest.approx(40)


def test_saii_5x5():
    """Its program shifts by `640 * 2 * 35 / (36 * depth)` pixels (kotaro-inoue/VCR, VCR_saii.py)."""
    scale = DepthScale.from_cameras(pitch=2, focal_length=35, sensor_width=36, columns=640)
    np.testing.assert_allclose(scale.to_disparity([30, 200]), [41.48148, 6.22222], rtol=1e-6)
    assert scale.to_disparity(np.inf) == 0
    np.testing.assert_allclose(scale.to_depth(scale.to_disparity([30, 200])), [30, 200])
    assert scale.to_depth(0) == np.inf


def test_cameras_aligned_at_a_depth():
    scale = DepthScale.from_cameras(10, 50, 36, 512, zero=1000)
    assert scale.to_disparity(1000) == pytest.approx(0)
    assert scale.to_disparity(500) == pytest.approx(512 * 50 / 36 * 10 / 1000)
    assert scale.to_depth(scale.to_disparity(2000)) == pytest.approx(2000)


def test_views_in_reverse_order_reverse_the_sign():
    lenses = LensArray(10, 10, 5, 5)
    assert DepthScale.from_lenses(lenses, "cameras").to_disparity(3) == -DepthScale.from_lenses(lenses).to_disparity(3)
    cameras = [DepthScale.from_cameras(2, 35, 36, 640, zero=90, sense=sense) for sense in ("lenses", "cameras")]
    assert cameras[0].to_disparity(60) == -cameras[1].to_disparity(60)
    assert cameras[0].to_depth(cameras[0].to_disparity(60)) == pytest.approx(60)


def test_lengths_that_are_none():
    with pytest.raises(InvalidOption, match="focal_length: 0 is out of range; give a positive number"):
        DepthScale.from_cameras(2, 0, 36, 640)


def test_an_unknown_depth_sense_is_refused():
    for make in (
        lambda: DepthScale.from_lenses(LensArray(10, 10, 5, 5), "camera"),
        lambda: DepthScale.from_cameras(2, 35, 36, 640, sense="camera"),
    ):
        with pytest.raises(InvalidOption, match="depth_sense: 'camera' is not known"):
            make()


@pytest.mark.parametrize("columns", [0, -640, np.nan, np.inf, "a"])
def test_columns_that_are_none(columns):
    with pytest.raises(InvalidOption, match=r"columns: .* is out of range; give a positive number"):
        DepthScale.from_cameras(2, 35, 36, columns)
