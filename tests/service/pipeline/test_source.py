"""Which options fit which source, and light fields in memory."""

import numpy as np
import pytest

from ciir.errors import InvalidOption
from ciir.renderer.light_field import LightField
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.writers.pictures import encode_png
from ciir.renderer.writers.writer import MemoryWriter
from ciir.service.pipeline.options import Options
from ciir.service.pipeline.run import reconstruct
from tests.support.light_fields import make_views


def run(source, **options):
    writer = MemoryWriter()
    report = reconstruct(source, Options(**options), writer)
    return writer.views, report


def test_a_view_that_is_not_there_is_refused_with_what_was_taken_as_row_and_column():
    views = make_views((3, 5), channels=3)
    files = {f"{u}_{v}.png": encode_png(views[v, u]) for v in range(3) for u in range(5)}
    with pytest.raises(InvalidOption, match=r"views: 4,0 is not there; .* 3x5 views, .* 0 is the column and 2 the row"):
        run(Bundle("set", None, files), views="4,0", model="none")


@pytest.mark.parametrize("options", [{"flip": "u"}, {"transpose": "yes"}, {"order": "columns"}, {"crop": (1, 0, 0, 0)}])
def test_what_is_for_pictures_is_refused_for_a_mesh(options):
    with pytest.raises(InvalidOption, match=f"{next(iter(options))}: this is for pictures and"):
        run("vase", **options)


def test_a_light_field_in_memory_is_put_in_the_order_that_was_asked_for():
    field = LightField(make_views((2, 3), channels=3))
    taken, report = run(field, views="1,2", model="none", flip="uv")
    assert np.array_equal(taken[1, 2], field.views[0, 0])
    assert report["lens_array"]["depth_sense"] == "cameras"
    taken, _ = run(field, views="2,1", model="none", order="columns")
    assert np.array_equal(taken[2, 1], field.views[1, 2])
