import io
import pickle
import re
import tracemalloc
import zipfile

import numpy as np
import pytest
import tifffile

import ciir
from ciir.errors import InvalidOption, TooLarge, Unreadable, UnsupportedType
from ciir.renderer.light_field import LightField
from ciir.renderer.limits import Limits
from ciir.renderer.readers import inputs
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.containers import arrays
from ciir.renderer.readers.containers.samples import TAKEN_AS_CAMERAS
from ciir.renderer.readers.layout import Layout

GRID, SIZE = (2, 3), (4, 5)


def read(data, kind="npy", *, layout=Layout(), **limits):  # noqa: B008 - it is frozen
    reader = arrays.read_npy if kind == "npy" else arrays.read_npz
    return reader(data, name="a", layout=layout, limits=Limits(**limits))


def saved(array, **options):
    file = io.BytesIO()
    np.save(file, array, **options)
    return file.getvalue()


def numbered(dtype, channels=3):
    """Each sample holds its own place: view, pixel and channel."""
    array = np.zeros((*GRID, *SIZE, channels), dtype)
    for v, u, y, x, c in np.ndindex(array.shape):
        array[v, u, y, x, c] = 100 * v + 50 * u + 10 * y + 2 * x + c
    return array


@pytest.mark.parametrize("dtype", ["u1", "<u2", ">u2"])
@pytest.mark.parametrize("order", ["C", "F"])
def test_npy_is_v_u_y_x_c(dtype, order):
    found = read(saved(np.asarray(numbered(dtype), order=order)))
    assert found.views.dtype == np.dtype(dtype).newbyteorder("=")
    for v, u, y, x, c in np.ndindex(found.views.shape):
        assert found.view(v, u)[y, x, c] == 100 * v + 50 * u + 10 * y + 2 * x + c
    assert (found.notes, found.depth_sense) == ((TAKEN_AS_CAMERAS,), "cameras")


def test_grey_views_need_no_axis_of_channels():
    grey = np.arange(2 * 3 * 4 * 5, dtype=np.uint8).reshape(2, 3, 4, 5)
    np.testing.assert_array_equal(read(saved(grey)).views, grey[..., None])
    np.testing.assert_array_equal(read(saved(np.asfortranarray(grey))).views, grey[..., None])
    np.testing.assert_array_equal(read(zipped(grey=grey), "npz").views, grey[..., None])


def test_views_one_after_another_are_a_grid():
    views = numbered("u1")
    rows, columns, *size = views.shape
    flat = views.reshape(-1, *size)
    asked = Layout(pixels=(rows, columns))
    for array, expected in ((flat, views), (np.asfortranarray(flat), views), (flat[..., 0], views[..., :1])):
        for data, kind in ((saved(array), "npy"), (zipped(any=array), "npz")):
            found = read(data, kind, layout=asked)
            np.testing.assert_array_equal(found.views, expected)
            assert not any("row by row" in note for note in found.notes)
    found = read(saved(flat[:4]))
    np.testing.assert_array_equal(found.views, flat[:4].reshape(2, 2, *size))
    assert "the 4 views are taken as 2x2 views, row by row; pixels gives another grid" in found.notes
    with pytest.raises(
        InvalidOption, match=r"a: 5 views, which is not a square number; give pixels ROWSxCOLUMNS \(of views\)"
    ):
        read(saved(flat[:5]))
    with pytest.raises(InvalidOption, match="pixels: 2x2 asks for 4 views, but a has 5 views; give the rows"):
        read(saved(flat[:5]), layout=Layout(pixels=(2, 2)))


@pytest.mark.parametrize("kind", ["npy", "tif"])
def test_views_one_after_another_fill_columns_where_these_come_first(kind):
    views = numbered("u1")
    flat = views.swapaxes(0, 1).reshape(-1, *views.shape[2:])
    file = io.BytesIO()
    tifffile.imwrite(file, flat, photometric="rgb", metadata=None)
    data = saved(flat) if kind == "npy" else file.getvalue()
    bundle = Bundle.from_upload(f"a.{kind}", data)
    np.testing.assert_array_equal(inputs.read(bundle, Layout(pixels=GRID, order="columns")).views, views)


def test_views_that_the_last_axis_may_count_have_a_remedy():
    for channels in ((), (3,)):
        array = np.zeros((16, 20, 9, *channels), np.uint8)
        advice = "; if they are 9 views of 16x20 pixels, save np.moveaxis(array, 2, 0)"
        assert any(note.endswith(advice) for note in read(saved(array)).notes)  # 4x4 views of 20x9 pixels
        for layout in (Layout(), Layout(pixels=(3, 3))):
            with pytest.raises(InvalidOption) as caught:
                read(saved(array[:15]), layout=layout)
            assert str(caught.value).endswith(advice.replace("16x20", "15x20"))
    assert not any("np.moveaxis" in note for note in read(saved(np.zeros((16, 20, 24), np.uint8))).notes)


def test_axes_that_seem_to_be_exchanged_are_noted():
    for shape, is_noted in (((9, 9, 4, 5, 3), True), ((4, 5, 9, 9, 3), False)):
        found = inputs.read(Bundle.from_upload("a.npy", saved(np.zeros(shape, np.uint8))))
        noted = [note for note in found.notes if note.startswith("axes: 9x9 views of 4x5 pixels; if these are 4x5 ")]
        assert bool(noted) == is_noted


@pytest.mark.parametrize("dtype", ["f2", "f4", "f8"])
def test_floating_point_becomes_16_bit_with_a_note(dtype):
    found = read(saved(numbered("u1").astype(dtype) / 255))
    # Half precision has 11 bits: an error of 2**-12 near 1 is 16 of 65535.
    tolerance = 16 if dtype == "f2" else 0
    np.testing.assert_allclose(found.views, numbered("u1").astype(np.uint16) * 257, atol=tolerance, rtol=0)
    assert found.views.dtype == np.uint16
    assert "rounded to 16 bit" in found.notes[0]


@pytest.mark.parametrize(
    ("worst", "words"),
    [
        (-0.1, "from -0.1 to "),
        (1.5, "to 1.5"),
        (np.nan, "that are NaN"),
        (np.inf, "to inf"),
    ],
)
def test_floating_point_out_of_range_is_refused(worst, words):
    array = numbered("u1") / 255
    array[1, 2, 3, 4, 0] = worst
    with pytest.raises(Unreadable, match=rf"view 1,2 has samples .*{words}.*; give floating-point numbers from 0 to 1"):
        read(saved(array))


def test_the_remedy_for_nan_removes_it():
    array = numbered("u1") / 255
    array[1, 2, 3, 4, 0] = np.nan
    with pytest.raises(Unreadable, match=r"such as np\.nan_to_num\(array\)\.clip\(0, 1\), or uint8"):
        read(saved(array))
    read(saved(np.nan_to_num(array).clip(0, 1)))


@pytest.mark.parametrize(("times", "advice"), [(1, "array.round().astype('u1')"), (257, "array.round().astype('u2')")])
def test_levels_as_floating_point_are_not_to_be_clipped(times, advice):
    """That would make all of them white."""
    with pytest.raises(Unreadable, match=re.escape(f"from 0 to 1, or uint8 or uint16, as in {advice}")):
        read(saved(numbered("u1").astype("f4") * times))


def test_floating_point_may_pass_the_range_by_rounding():
    array = numbered("u1").astype("f4") / 255
    array[0, 0, 0, 0, 0], array[1, 2, 3, 4, 0] = np.float32(-2e-7), np.nextafter(np.float32(1), np.float32(2))
    found = read(saved(array))
    assert (found.views[0, 0, 0, 0, 0], found.views[1, 2, 3, 4, 0]) == (0, 65535)


@pytest.mark.parametrize(
    ("array", "error"),
    [
        (np.zeros((0, 2, 4, 4), "u1"), Unreadable),
        (np.zeros((2, 4, 3), "u1"), Unreadable),
        (np.zeros((1, 2, 2, 4, 4, 3), "u1"), Unreadable),
        (np.zeros((2, 2, 4, 4, 5), "u1"), Unreadable),
        (np.zeros((2, 0, 4, 4, 3), "u1"), Unreadable),
        (np.zeros((2, 2, 4, 4, 3), "i4"), UnsupportedType),
        (np.zeros((2, 2, 4, 4, 3), "c8"), UnsupportedType),
        (np.zeros((2, 2, 4, 4, 3), [("a", "u1")]), UnsupportedType),
    ],
)
def test_other_arrays_are_refused(array, error):
    with pytest.raises(error, match=r"a: an array .*; give"):
        read(saved(array))


@pytest.mark.parametrize(
    ("dtype", "most", "code"),
    [
        ("i8", 255, "array.clip(0, 255).astype('u1') for levels up to 255"),
        ("i2", 9999, "else array.clip(0, 65535).astype('u2')"),
        ("?", 1, "255 * array.astype('u1')"),
        ("c16", 1, "np.abs(array)"),
    ],
)
def test_other_types_have_a_remedy_that_works(dtype, most, code):
    array = np.zeros((2, 3, 16, 16, 3), dtype)
    array[1] = most
    picture = np.full((60, 80), most, dtype)
    for data in (saved(array), zipped(scene=array), saved(picture)):
        with pytest.raises(UnsupportedType, match=rf"of {array.dtype}; give uint8, .*{re.escape(code)}"):
            inputs.read(Bundle.from_upload("a.npz" if data.startswith(b"PK") else "a.npy", data), Layout(pixels=(2, 3)))
    made = eval(code.removeprefix("else ").removesuffix(" for levels up to 255"), {"array": array, "np": np})  # noqa: S307
    found = read(saved(made)).views
    assert (found[0].max(), found[1].min()) == (0, {"?": 255, "c16": 65535}.get(dtype, most))


@pytest.mark.parametrize("levels", [1, 255, 65535])
def test_the_remedy_for_nan_fits_the_levels(levels):
    array = np.full((2, 2, 4, 4, 3), levels, float)
    array[0, 1], array[1, 1] = np.nan, np.inf
    with pytest.raises(InvalidOption) as caught:
        LightField(array)
    views = eval(str(caught.value).split("as in ")[1], {"views": array, "np": np})  # noqa: S307
    white = 255 if levels < 256 else 65535
    assert views[:, :, 0, 0, 0].tolist() == [[white, 0], [white, white]]
    with pytest.raises(Unreadable) as caught:
        read(saved(array))
    code = re.search(r"(?:such as|as in) (.*?)(?:, or uint8.*)?$", str(caught.value))[1]
    kept = read(saved(eval(code, {"array": array, "np": np}))).views  # noqa: S307
    assert kept[:, :, 0, 0, 0].tolist() == [[kept.max(), 0], [kept.max()] * 2]
    assert kept.max() == (white if levels > 1 else 65535)


def test_pickle_is_never_read():
    class Bomb:
        def __reduce__(self):
            return pytest.fail, ("it was unpickled",)

    data = saved(np.zeros((1, 1, 1, 1, 1), object))
    data = data[: data.index(b"\n") + 1] + pickle.dumps(Bomb())
    with pytest.raises(UnsupportedType, match="never read"):
        read(data)


def test_sizes_are_checked_before_anything_is_allocated():
    header = io.BytesIO()
    shape = (15, 15, 4000, 4000, 3)
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": shape})
    tracemalloc.start()
    with pytest.raises(TooLarge, match="comes to"):
        read(header.getvalue())
    with pytest.raises(Unreadable, match="cut off"):
        read(header.getvalue(), set_bytes=2**50)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 2**20
    with pytest.raises(TooLarge, match="at most 4 views"):
        read(saved(numbered("u1")), views=4)


def zipped(**members):
    file = io.BytesIO()
    np.savez(file, **members)
    return file.getvalue()


def test_npz_of_one_array_under_any_name():
    found = read(zipped(scene=numbered("u2"), notes=np.zeros(3)), "npz")
    np.testing.assert_array_equal(found.views, numbered("u2"))
    assert (found.notes, found.depth_sense) == ((TAKEN_AS_CAMERAS,), "cameras")


def test_npz_of_several_arrays_with_a_light_field():
    found = read(zipped(LF=numbered("u2"), disparity=numbered("u1")), "npz")
    np.testing.assert_array_equal(found.views, numbered("u2"))


def test_npz_with_disparity_maps_beside_the_light_field():
    found = read(zipped(views=numbered("u2"), disparity=np.zeros((*GRID, 9, 9), "f4")), "npz")
    np.testing.assert_array_equal(found.views, numbered("u2"))


def test_npz_of_two_arrays_names_them():
    with pytest.raises(Unreadable, match=r"2 arrays have five axes \(left, right\)"):
        read(zipped(left=numbered("u1"), right=numbered("u1")), "npz")
    with pytest.raises(Unreadable, match="a: holds nothing; give a light field LF with five axes, "):
        read(zipped(), "npz")


def test_views_at_positions_in_any_order():
    field = numbered("u1")
    positions = [(1, 2), (0, 1), (0, 0), (1, 0), (1, 1), (0, 2)]
    data = zipped(views=np.stack([field[place] for place in positions]), positions=np.array(positions))
    found = read(data, "npz")
    np.testing.assert_array_equal(found.views, field)
    assert (found.notes, found.depth_sense) == ((TAKEN_AS_CAMERAS,), "cameras")


@pytest.mark.parametrize(
    "positions",
    [[(0, 0), (0, 1), (1, 0), (1, 1), (2, 2), (0, 2)], [(0, 0)] * 6, [(0, 0), (0, 1), (0, 2), (1, 0), (1, 1), (1, 1)]],
)
def test_positions_that_fill_no_grid_are_refused(positions):
    views = numbered("u1").reshape(6, *SIZE, 3)
    with pytest.raises(Unreadable, match=r"fill no grid|occurs twice"):
        read(zipped(views=views, positions=np.array(positions)), "npz")


@pytest.mark.parametrize("sense", ["lenses", "cameras"])
def test_our_own_npz_keeps_the_depth_sense(tmp_path, sense):
    field = LightField(numbered("u2", 4), depth_sense=sense)
    field.save(tmp_path / "a.npz")
    found = read((tmp_path / "a.npz").read_bytes(), "npz")
    np.testing.assert_array_equal(found.views, field.views)
    assert (found.notes, found.depth_sense) == ((), sense)


def test_npy_of_a_lens_array_that_does_not_say_so():
    bundle = Bundle.from_upload("a.npy", saved(numbered("u1")))
    found = inputs.read(bundle, Layout(depth_sense="lenses"))
    np.testing.assert_array_equal(found.views, numbered("u1"))
    assert (found.notes, found.depth_sense) == ((), "lenses")
    flipped = inputs.read(bundle, Layout(flip="uv"))
    np.testing.assert_array_equal(flipped.views, found.with_depth_sense("cameras").views)
    assert flipped.depth_sense == "cameras"


@pytest.mark.parametrize("other", [saved(np.array("both")), saved(np.zeros(3)), saved(np.array(["lenses"])), b"lenses"])
def test_what_else_follows_an_array_is_no_depth_sense(other):
    found = read(saved(numbered("u1")) + other)
    np.testing.assert_array_equal(found.views, numbered("u1"))
    assert (found.notes, found.depth_sense) == ((TAKEN_AS_CAMERAS,), "cameras")


def test_a_depth_sense_that_is_cut_off_is_refused(tmp_path):
    LightField(numbered("u1")).save(tmp_path / "a.npy")
    with pytest.raises(Unreadable, match="cut off"):
        inputs.read(Bundle.from_upload("a.npy", (tmp_path / "a.npy").read_bytes()[:-1]))


def test_another_grid_is_refused():
    bundle = Bundle.from_upload("a.npy", saved(numbered("u1")))
    assert inputs.read(bundle, Layout(pixels=GRID)).views.shape[:2] == GRID
    with pytest.raises(InvalidOption, match=r"pixels: a\.npy has 2x3 views; leave it out"):
        inputs.read(bundle, Layout(pixels=(3, 2)))


def test_a_bomb_is_not_unpacked():
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("views.npy", bytes(2**22))
    with pytest.raises(TooLarge, match="unpacks to over"):
        read(file.getvalue(), "npz")


@pytest.mark.parametrize(
    ("shape", "advice"),
    [
        ((36, 52, 3, 3), "if they are 3x3 grey views of 36x52 pixels, (H, W, V, U), save array.transpose(2, 3, 0, 1)"),
        ((36, 52, 5, 3), "if they are 5x3 grey views of 36x52 pixels, (H, W, V, U), save array.transpose(2, 3, 0, 1)"),
        ((3, 36, 52, 3, 3), "if the array is (C, H, W, V, U), save array.transpose(3, 4, 1, 2, 0)"),
        ((36, 52, 12, 3), None),
        ((1, 36, 52, 40, 3), None),
    ],
)
def test_few_columns_of_views_behind_pixels_are_noted(shape, advice):
    notes = "; ".join(read(saved(np.zeros(shape, np.uint8))).notes)
    assert advice in notes if advice else "transpose" not in notes


def test_colours_before_rows_are_noted(tmp_path):
    """PyTorch's (N, 3, H, W) has the shape of Nx3 grey views; 5 axes say what they are."""
    for shape, is_noted in (((9, 3, 16, 20), True), ((9, 2, 16, 20), False), ((9, 3, 16, 20, 1), False)):
        np.save(tmp_path / "views.npy", np.zeros(shape, np.uint8))
        notes = "; ".join(ciir.open(tmp_path / "views.npy").notes)
        assert ("9x3 grey views; if they are 9 views of 3 colours, (N, 3, H, W), give pixels" in notes) == is_noted


@pytest.mark.parametrize(
    ("shape", "advice"),
    [
        ((3, 4, 3, 16, 20), "; for (V, U, C, H, W), as in np.moveaxis({}, 2, -1)"),
        ((3, 9, 9, 16, 20), "; for (C, V, U, H, W), as in np.moveaxis({}, 0, -1)"),
        ((16, 20, 3, 4, 5), "; for (H, W, C, V, U), as in {}.transpose(3, 4, 0, 1, 2)"),
        ((3, 16, 20, 4, 5), "; for (C, H, W, V, U), as in {}.transpose(3, 4, 1, 2, 0)"),
        ((3, 4, 16, 20, 5), ", 1 to 4 channels"),
    ],
)
def test_axes_of_colours_before_pixels_have_a_remedy(shape, advice):
    views = np.zeros(shape, np.uint8)
    with pytest.raises(Unreadable) as caught:
        inputs.read(Bundle.from_upload("a.npy", saved(views)))
    assert str(caught.value).endswith(advice.format("array"))
    with pytest.raises(InvalidOption) as caught:
        LightField(views)
    assert str(caught.value).endswith(advice.format("views").replace(", 1 to", " with 1 to"))


@pytest.mark.parametrize("shape", [(60, 80), (60, 80, 3)])
def test_an_elemental_image_array_has_a_remedy(shape):
    with pytest.raises(InvalidOption, match=r"; for an elemental image array, use LightField\.from_eia$"):
        LightField(np.zeros(shape, np.uint8))


def test_grey_views_without_channels_have_a_remedy():
    with pytest.raises(InvalidOption, match=r"; for grey views \(V, U, H, W\), as in views\[\.\.\., None\]$"):
        LightField(np.zeros((3, 3, 16, 20), np.uint8))
