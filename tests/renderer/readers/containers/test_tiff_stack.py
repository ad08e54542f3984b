"""Stacks are written here by tifffile, page by page."""

import io

import numpy as np
import pytest
import tifffile

from ciir.errors import InvalidOption, TooLarge, Unreadable, UnsupportedType
from ciir.renderer.levels import ROUNDED
from ciir.renderer.light_field import LightField
from ciir.renderer.limits import Limits
from ciir.renderer.readers import inputs
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.containers.samples import TAKEN_AS_CAMERAS
from ciir.renderer.readers.layout import Layout

PAGES = np.random.default_rng(0).integers(0, 2**16, (12, 5, 7, 3), np.uint16)


def make(pages=PAGES, descriptions=(), **options):
    file = io.BytesIO()
    with tifffile.TiffWriter(file, imagej=False) as writer:
        for number, page in enumerate(pages):
            text = descriptions[number] if number < len(descriptions) else None
            photometric = "rgb" if page.ndim == 3 else "minisblack"
            writer.write(page, photometric=photometric, description=text, metadata=None, **options)
    return file.getvalue()


def read(data, limits=None, **layout):
    return inputs.read(Bundle.from_upload("a.tif", data, limits or Limits()), Layout(order="given", **layout))


@pytest.mark.parametrize(
    ("descriptions", "layout"),
    [
        ((), {"pixels": (3, 4)}),
        (('{"shape": [3, 4, 5, 7, 3]}',), {}),
        (("ImageJ=1.53\nimages=12\nslices=4\nframes=3\nhyperstack=true\n",), {}),
        (('<?xml version="1.0"?><OME><Image><Pixels SizeC="3" SizeT="3" SizeX="7" SizeZ="4"/></Image></OME>',), {}),
        (('{"shape": [4, 3, 5, 7, 3]}',), {"pixels": (3, 4)}),
    ],
)
def test_pages_are_views_row_by_row(descriptions, layout):
    found = read(make(descriptions=descriptions), **layout)
    assert found.views.shape == (3, 4, 5, 7, 3)
    for v, u in np.ndindex(3, 4):
        np.testing.assert_array_equal(found.view(v, u), PAGES[4 * v + u])
    assert (found.notes, found.depth_sense) == ((TAKEN_AS_CAMERAS,), "cameras")


@pytest.mark.parametrize("grid", [(9,), (3, 3)])
def test_planes_of_each_channel_are_no_views(grid):
    """tifffile then counts channels before rows in its description, which looks like a grid."""
    file, planar = io.BytesIO(), np.moveaxis(PAGES[:9], 3, 1).reshape(*grid, 3, 5, 7)
    tifffile.imwrite(file, planar, photometric="rgb", planarconfig="separate")
    found = read(file.getvalue())
    np.testing.assert_array_equal(found.views.reshape(9, 5, 7, 3), PAGES[:9])


def test_a_square_is_a_guess():
    found = read(make(PAGES[:9]))
    np.testing.assert_array_equal(found.view(1, 2), PAGES[5])
    assert "9 pages are taken as 3x3 views, row by row; pixels gives another grid" in found.notes[0]
    with pytest.raises(InvalidOption, match="12 pages, which is not a square number; give pixels"):
        read(make())


@pytest.mark.parametrize(
    "options", [{"compression": "lzw"}, {"compression": "zlib", "predictor": True}, {"tile": (16, 16)}]
)
def test_packed_grey_pages(options):
    found = read(make(PAGES[:4, ..., 0], **options))
    np.testing.assert_array_equal(found.views[1, 0, ..., 0], PAGES[2, ..., 0])


@pytest.mark.parametrize("dtype", ["f2", "f4", "f8"])
def test_floating_point_samples_are_rounded_with_a_note(dtype):
    pages = PAGES[:4].astype(dtype) / PAGES.max()
    found = read(make(pages), pixels=(2, 2))
    assert np.abs(found.views - 65535 * pages.astype("f8").reshape(found.views.shape)).max() <= 0.51
    assert ROUNDED in found.notes


@pytest.mark.parametrize(
    "text", ['{"shape": [5, 5, 1, 1]}', '{"shape": [-3, -4, 5, 7]}', '{"shape"', "{" * 60_000, "é{"]
)
def test_a_description_of_others_is_ignored(text):
    assert read(make(PAGES[:4], descriptions=(text.encode(),))).views.shape == (2, 2, 5, 7, 3)


@pytest.mark.parametrize(
    ("data", "layout", "error", "message"),
    [
        (make(), {"pixels": (5, 5)}, InvalidOption, "5x5 asks for 25 views, but a.tif has 12 pages"),
        (make([*PAGES[:3], PAGES[3, :4]]), {}, Unreadable, "page 3 is not like the first"),
        (make(PAGES[:4].astype("i4")), {}, UnsupportedType, "32-bit INT samples"),
        (make(PAGES[:4].astype("f4")), {}, Unreadable, r"a.tif: page 0 has samples from 179 .* in array\.round\(\)"),
        (make()[:-300], {"pixels": (3, 4)}, Unreadable, "cut off|truncated"),
    ],
)
def test_what_is_refused(data, layout, error, message):
    with pytest.raises(error, match=message):
        read(data, **layout)


def test_limits():
    with pytest.raises(TooLarge, match="12 pages; at most 11 views"):
        read(make(), Limits(views=11), pixels=(3, 4))
    with pytest.raises(TooLarge, match="comes to 2,520 bytes"):
        read(make(), Limits(set_bytes=2500), pixels=(3, 4))


@pytest.mark.parametrize("sense", ["lenses", "cameras"])
@pytest.mark.parametrize("channels", [1, 2, 3, 4])
def test_our_own_stack_is_exact(tmp_path, sense, channels):
    views = np.random.default_rng(1).integers(0, 2**16, (2, 3, 5, 7, channels), np.uint16)
    assert LightField(views, depth_sense=sense).save(tmp_path / "a.tif", "stack") == ()
    found = read((tmp_path / "a.tif").read_bytes())
    np.testing.assert_array_equal(found.views, views)
    assert (found.notes, found.depth_sense) == ((), sense)
    with tifffile.TiffFile(tmp_path / "a.tif") as file:  # as others read it
        assert file.series[0].shape[:4] == (2, 3, 5, 7)


def test_our_own_stack_of_one_view(tmp_path):
    views = np.random.default_rng(1).integers(0, 256, (1, 1, 5, 7, 3), np.uint8)
    LightField(views, depth_sense="cameras").save(tmp_path / "a.tif", "stack")
    found = read((tmp_path / "a.tif").read_bytes())
    np.testing.assert_array_equal(found.views, views)
    assert found.depth_sense == "cameras"
    eia = make(views[0, 0][np.newaxis], ('{"shape": [1, 1, 5, 7, 3]}',))  # as tifffile describes any such array
    assert read(eia, lenses=(5, 7)).shape == (1, 1, 5, 7, 3)


def test_a_stack_that_is_cut_off_is_no_smaller_one():
    data = make(PAGES[:9], ('{"shape": [3, 4, 5, 7, 3]}',))
    with pytest.raises(Unreadable, match=r"^a\.tif: damaged or cut off \(9 pages of the 3x4 views that its"):
        read(data)
    assert read(data, pixels=(3, 3)).views.shape[:2] == (3, 3)
