import numpy as np
import pytest

from ciir.renderer.view_order.tiles import make_luma


@pytest.mark.parametrize("colours", [1, 3])
@pytest.mark.parametrize("factor", [1, 2])
def test_alpha_is_no_part_of_luma(colours, factor):
    views = np.random.default_rng(0).integers(0, 256, (2, 12, 15, colours + 1), np.uint8)
    opaque = views[..., :-1]
    np.testing.assert_array_equal(make_luma(views, factor, 0), make_luma(opaque, factor, 0))
    height, width = 12 // factor, 15 // factor
    mean = opaque[:, :, : width * factor].reshape(2, height, factor, width, factor, colours).mean(axis=(2, 4, 5)) / 255
    np.testing.assert_allclose(make_luma(views, factor, 0), mean, rtol=1e-6)
