"""Only the views that are needed are decoded."""

import numpy as np
import pytest

import ciir
from ciir.errors import TooLarge
from ciir.renderer.limits import Limits
from ciir.renderer.readers import pictures
from ciir.renderer.readers.view_set import reader as view_set
from ciir.renderer.writers.pictures import encode_png
from tests.support.inputs import make_zip
from tests.support.light_fields import make_views

GRID = 27


@pytest.fixture(scope="module")
def views():
    """5x5 views of a light field in the middle of 27x27; the files of the others are no pictures."""
    middle = make_views((5, 5), side=64, channels=3)
    first = (GRID - 5) // 2
    named = {f"view_{v:02}_{u:02}.png": b"" for v, u in np.ndindex(GRID, GRID)}
    return named | {f"view_{first + v:02}_{first + u:02}.png": encode_png(middle[v, u]) for v, u in np.ndindex(5, 5)}


@pytest.fixture
def decoded(monkeypatch):
    """The names of the pictures that are decoded."""
    names, decode = [], pictures.decode

    def count(data, *, name, **options):
        names.append(name)
        return decode(data, name=name, **options)

    monkeypatch.setattr(pictures, "decode", count)
    return names


@pytest.mark.parametrize("is_zip", [False, True])
def test_a_window_of_729_views_decodes_25(views, decoded, tmp_path, is_zip):
    source = tmp_path / "views.zip" if is_zip else tmp_path
    if is_zip:
        source.write_bytes(make_zip(views))
    else:
        for name, data in views.items():
            (tmp_path / name).write_bytes(data)
    made = ciir.reconstruct(source)
    assert made.report["plan"]["model"].startswith("field")
    assert list(made.views) == [(13, 13)]
    assert sorted(decoded) == sorted(name for name, data in views.items() if data)
    assert made.report["input"]["files"] == 25


def test_single_views_decode_what_the_order_needs_besides(views, decoded):
    light_field = view_set.read(views, name="set", views="13,13")
    assert light_field.shape == (27, 27, 64, 64, 3)
    light_field.take([(13, 13)])
    assert len(decoded) == len(set(decoded)) <= 17


def test_the_limit_counts_what_is_decoded(views):
    some = view_set.read(views, name="set", limits=Limits(set_bytes=25 * 64 * 64 * 3), views="center")
    assert some.take([(13, 13)])[0].shape == (64, 64, 3)
    with pytest.raises(TooLarge, match=r"729 views of 64x64 pixels .* come to 8,957,952 bytes"):
        some.load()


def test_transparency_is_looked_for_in_the_views_that_are_needed():
    opaque, clear = (encode_png(np.full((4, 4, 4), level, np.uint8)) for level in (255, 9))
    files = {f"{v}_{u}.png": opaque for v in range(3) for u in range(3)} | {"0_0.png": clear}
    light_field = view_set.read(files, name="set")
    assert not light_field.is_transparent([(1, 1), (2, 2)])
    assert light_field.is_transparent([(1, 1), (0, 0)])
