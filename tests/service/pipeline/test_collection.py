"""Views of a reconstruction, collected as a light field in memory."""

import numpy as np
import pytest

from ciir.errors import InvalidOption, TooLarge
from ciir.renderer.light_field import LightField
from ciir.service.pipeline.collection import collect_views
from ciir.service.pipeline.options import Options
from ciir.service.pipeline.report import Clock

VIEWS = np.random.default_rng(0).integers(1, 256, (4, 3, 6, 5, 3), np.uint8)
FIELD = LightField(VIEWS, depth_sense="cameras", pixel_aspect=0.75)


def collect(views, *, source=FIELD, max_pixels=None, **options):
    crops_rows = options.pop("crops_rows", False)
    return collect_views(
        source,
        Options(views=views, model="none", **options),
        crops_rows=crops_rows,
        max_pixels=max_pixels,
        progress=lambda *_: None,
        clock=Clock(),
    )


def test_all_views_as_they_are():
    found, report = collect("all")
    np.testing.assert_array_equal(found.views, VIEWS)
    assert (found.depth_sense, found.pixel_aspect, found.is_ordered) == ("cameras", 0.75, True)
    assert len(report["views"]) == 12


def test_views_that_are_not_asked_for_are_black():
    found, _ = collect("1,2;2,0")
    assert found.views[1, 2].all()
    assert found.views[2, 0].all()
    assert np.count_nonzero(found.views) == 2 * 6 * 5 * 3


def test_rows_without_views_are_not_kept():
    found, _ = collect("1,0;1,1;1,2", crops_rows=True)
    np.testing.assert_array_equal(found.views, VIEWS[1:2])
    found, _ = collect("3,2;1,0", crops_rows=True)
    assert found.shape == (3, 3, 6, 5, 3)
    np.testing.assert_array_equal(found.views[2, 2], VIEWS[3, 2])
    assert not found.views[1].any()


def test_the_limit_counts_what_is_kept():
    collect("1,0;1,1;1,2", crops_rows=True, max_pixels=3 * 6 * 5)
    with pytest.raises(TooLarge, match="3 views of 6x5 pixels"):
        collect("1,0;1,1;1,2", crops_rows=True, max_pixels=3 * 6 * 5 - 1)


def test_several_yaws_are_no_light_field():
    with pytest.raises(InvalidOption, match="a light field holds no pictures at several times"):
        collect("center", source="vase", rotate=Options.parse({"rotate": "0:90:2"}).rotate, lenses=(4, 4))
