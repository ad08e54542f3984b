"""Each layout written here by h5py, element by element, as its source does it."""

import io
import zlib

import h5py
import numpy as np
import pytest

from ciir.errors import InvalidOption, TooLarge, Unreadable, UnsupportedType
from ciir.renderer.limits import Limits
from ciir.renderer.readers import inputs
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.containers import hdf5
from ciir.renderer.readers.layout import Layout

V, U, H, W = 2, 3, 4, 6


def value(v, u, y, x, c=0):
    """Another one where any two axes are exchanged or one is reversed."""
    return (97 * v + 41 * u + 13 * y + 5 * x + 61 * c) % 251


def made(fill):
    buffer = io.BytesIO()
    with h5py.File(buffer, "w") as file:
        fill(file)
    return buffer.getvalue()


def read(data, *, pixels=None, **limits):
    return hdf5.read(data, name="a", layout=Layout(pixels=pixels), limits=Limits(**limits))


def check_places(found, channels=3, scale=1):
    assert found.views.shape == (V, U, H, W, channels)
    for place in np.ndindex(found.views.shape):
        assert found.views[place] == scale * value(*place)
    assert found.depth_sense == "cameras"


def fill_reversed(dtype, channels, **options):
    """As MATLAB's HDF5: `LF[c, x, y, u, v]`."""

    def fill(file):
        stored = np.zeros((channels, W, H, U, V), dtype)
        for v, u, y, x, c in np.ndindex(V, U, H, W, channels):
            stored[c, x, y, u, v] = value(v, u, y, x, c)
        file.create_dataset("LF", data=stored[0] if channels == 1 else stored, **options)
        file["LF"].attrs["MATLAB_class"] = np.bytes_(stored.dtype.name)

    return fill


@pytest.mark.parametrize("dtype", ["u1", "u2"])
@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("options", [{}, *({"compression": name, "shuffle": True} for name in ("gzip", "lzf"))])
def test_matlab_counts_axes_from_the_other_end(dtype, channels, options):
    check_places(read(made(fill_reversed(dtype, channels, **options))), channels)


@pytest.mark.parametrize("dtype", ["u1", ">u2"])
@pytest.mark.parametrize("options", [{}, {"shuffle": True}, {"shuffle": True, "fletcher32": True}, {"fillvalue": 7}])
def test_chunks_that_are_not_whole_or_not_there(dtype, options):
    def fill(file):
        stored = np.zeros((V, U, H, W, 3), dtype)
        for place in np.ndindex(stored.shape):
            stored[place] = value(*place)
        file.create_dataset("LF", stored.shape, dtype, chunks=(1, 2, 3, 4, 2), compression="gzip", **options)
        file["LF"][:, :2] = stored[:, :2]  # nothing is stored of the views of u = 2

    found = read(made(fill)).views
    for v, u, y, x, c in np.ndindex(found.shape):
        assert found[v, u, y, x, c] == (value(v, u, y, x, c) if u < 2 else options.get("fillvalue", 0))


def test_a_fill_value_of_no_size():
    """HDF5 ends the process where it is read."""
    data = bytearray(made(lambda file: file.create_dataset("LF", (V, U, H, W, 3), "f8", chunks=True)))
    place = data.index(b"\x02\x03\x02\x01" + bytes(4))  # the message of the fill value, version 2: its size is 0
    data[place + 4 : place + 8] = (-2).to_bytes(4, "little", signed=True)
    with pytest.raises(ValueError, match="fill value"):
        read(bytes(data))


@pytest.mark.parametrize("compression", ["lzf", "gzip"])
def test_all_that_a_filter_packs_comes_out(compression):
    stored = np.random.default_rng(0).integers(0, 2000, (2, 2, 20, 24, 3), np.uint16) // 500
    options = {"compression": compression, "fletcher32": True}
    found = read(made(lambda file: file.create_dataset("LF", data=stored, **options)))
    np.testing.assert_array_equal(found.views, stored)


@pytest.mark.parametrize("packed", [b"\0A\xff\xff\0", b"\x1f" + bytes(32) + b"\x1f" + bytes(32) + b"\x1f" + bytes(32)])
def test_a_chunk_of_lzf_that_is_corrupt_or_unpacks_to_more(packed):
    def fill(file):
        found = file.create_dataset("LF", (1, 1, 4, 4, 3), "u1", chunks=(1, 1, 4, 4, 3), compression="lzf")
        found.id.write_direct_chunk((0,) * 5, packed)

    with pytest.raises(Unreadable, match=r"damaged or cut off|a chunk unpacks to"):
        inputs.read(Bundle.from_upload("a.h5", made(fill)))


def fill_groups(file):
    file["data/LF"] = np.arange(240, dtype=np.uint8).reshape(2, 2, 4, 5, 3)
    file["data/depth"] = np.zeros((4, 5))
    file["scene/name"] = "knights"


def test_a_light_field_in_a_group():
    views = read(made(fill_groups)).views
    np.testing.assert_array_equal(views, np.arange(240).reshape(2, 2, 4, 5, 3))


@pytest.mark.parametrize("place", ["LF/LF", "LF/data", "train/000/LF"])
def test_a_group_named_lf_and_groups_two_deep(place):
    views = np.arange(240, dtype=np.uint8).reshape(2, 2, 4, 5, 3)
    np.testing.assert_array_equal(read(made(lambda file: file.create_dataset(place, data=views))).views, views)


@pytest.mark.parametrize("is_matlab", [False, True])
def test_views_one_after_another_are_a_grid(is_matlab):
    views = np.arange(2 * 3 * 6 * 4 * 3, dtype=np.uint8).reshape(6, 6, 4, 3)

    def fill(file):
        file["LF"] = views.T if is_matlab else views
        if is_matlab:
            file["LF"].attrs["MATLAB_class"] = np.bytes_("uint8")

    np.testing.assert_array_equal(read(made(fill), pixels=(2, 3)).views, views.reshape(2, 3, 6, 4, 3))
    with pytest.raises(InvalidOption, match="a: 6 views, which is not a square number; give pixels"):
        read(made(fill))


def test_several_in_groups_and_links_there():
    def fill(file):
        fill_groups(file)
        file["scene/LF"] = np.zeros((2, 2, 4, 5, 3), np.uint8)

    def link(file):
        file["data/LF"] = h5py.ExternalLink("/etc/other.h5", "LF")
        file["other"] = h5py.ExternalLink("/etc/other.h5", "/")
        file["deep/er/than/LF"] = np.zeros((2, 2, 4, 5, 3), np.uint8)

    with pytest.raises(Unreadable, match=r"2 arrays have five axes \(data/LF, scene/LF\); name the light field LF"):
        read(made(fill))
    with pytest.raises(
        Unreadable, match=r"holds data, deep, other, data/LF, deep/er; give .* at the top or up to two groups"
    ):
        read(made(link))


def test_what_lies_in_no_group_comes_first():
    def fill(file):
        fill_groups(file)
        file["views"] = np.full((2, 2, 4, 5, 3), 9, np.uint8)

    assert (read(made(fill)).views == 9).all()


@pytest.mark.parametrize("options", [{"fletcher32": True}, {"shuffle": True}, {"compression": "gzip"}])
def test_a_chunk_of_another_size(options):
    def fill(file):
        dataset = file.create_dataset("LF", (V, U, H, W, 3), "u1", chunks=(1, 1, H, W, 3), **options)
        dataset.id.write_direct_chunk(
            (0, 0, 0, 0, 0), zlib.compress(b"short") if "compression" in options else b"short"
        )

    with pytest.raises(Unreadable, match=r"a chunk unpacks to \d bytes, not its 72"):
        read(made(fill))


def test_samples_that_are_cut_off():
    data = made(lambda file: file.create_dataset("LF", data=np.zeros((V, U, H, W, 3), "u1")))
    with pytest.raises((Unreadable, OSError), match=r"cut off|truncated"):
        read(data[:-10])


def test_matlabs_logical_is_refused():
    """Its 1 is white, and would be read as nearly black."""

    def fill(file):
        fill_reversed("u1", 1)(file)
        file["LF"].attrs["MATLAB_class"] = np.bytes_("logical")

    with pytest.raises(UnsupportedType, match=r"a: LF is of class logical; give uint8, as in 255 \* uint8\(LF\)"):
        read(made(fill))


@pytest.mark.parametrize(
    ("dtype", "kind", "message"),
    [
        ("i4", "int32", r"a: LF is of class int32; give .*, as in uint8\(LF\) for levels up to 255, else uint16\(LF\)"),
        (
            [("real", "f8"), ("imag", "f8")],
            "double",
            r"a: LF is of class complex double; give .* from 0 to 1, as in abs\(LF\)",
        ),
        ("i4", None, r"of int32; give uint8, .*, as in array\.clip\(0, 255\)\.astype\('u1'\)"),
    ],
)
def test_other_classes_have_a_remedy(dtype, kind, message):
    def fill(file):
        file["LF"] = np.zeros((3, W, H, U, V), dtype)
        if kind:
            file["LF"].attrs["MATLAB_class"] = np.bytes_(kind)

    with pytest.raises(UnsupportedType, match=message):
        read(made(fill))


def test_matlab_without_its_class():
    def fill(file):
        fill_reversed("u1", 3)(file)
        del file["LF"].attrs["MATLAB_class"]

    check_places(read(made(fill)))


def test_a_row_of_more_views_than_columns_of_pixels_is_not_matlabs():
    """MATLAB leaves out a last axis of 1, which would be the first one here."""
    stored = np.random.default_rng(0).integers(0, 256, (1, 9, H, W, 3), np.uint8)
    found = read(made(lambda file: file.create_dataset("LF", data=stored)))
    np.testing.assert_array_equal(found.views, stored)


def test_the_weight_is_left_out_with_a_note():
    found = read(made(fill_reversed("u1", 4)))
    check_places(found)
    assert "weight" in found.notes[0]


def test_hci_counts_cameras_from_the_right():
    def fill(file):
        stored = np.zeros((V, U, H, W, 3), np.uint8)
        for v, u, y, x, c in np.ndindex(stored.shape):
            stored[v, U - 1 - u, y, x, c] = value(v, u, y, x, c)
        file["LF"] = stored
        file["GT_DEPTH"] = np.zeros((V, U, H, W), np.float32)
        file.attrs.update({"dH": 0.1, "dV": 0.1, "focalLength": 9.2, "shift": 3.4, "hRes": U, "vRes": V})

    check_places(read(made(fill)))


def test_a_plain_array():
    def fill(file):
        stored = np.zeros((V, U, H, W, 3), np.uint8)
        for place in np.ndindex(stored.shape):
            stored[place] = value(*place)
        file["scene"] = stored

    check_places(read(made(fill)))


def fill_mosaic(name):
    """As BasicLFSR: view (u, v) at row u and column v of the mosaic, which is stored transposed, from 0 to 1."""

    def fill(file):
        stored = np.zeros((U * W, V * H), np.float32)
        for v, u, y, x in np.ndindex(V, U, H, W):
            stored[u * W + x, v * H + y] = value(v, u, y, x) / 255
        file[name] = stored

    return fill


@pytest.mark.parametrize("name", ["Hr_SAI_y", "Lr_SAI_y"])
def test_the_mosaic_of_basiclfsr(name):
    found = read(made(fill_mosaic(name)), pixels=(V, U))
    check_places(found, 1, 257)
    assert f"{name}: a mosaic of luminance" in found.notes[-1]


def test_a_mosaic_is_of_5x5_views_unless_the_grid_is_given():
    data = made(lambda file: file.create_dataset("Hr_SAI_y", data=np.zeros((20, 30), "f4")))
    found = read(data)
    assert found.views.shape == (5, 5, 6, 4, 1)
    assert "5x5 views, as BasicLFSR's are; pixels gives another grid" in found.notes[-1]
    with pytest.raises(InvalidOption, match=r"7x7 views don't divide the mosaic of 30x20 pixels"):
        read(data, pixels=(7, 7))


def link_out(file):
    file["LF"] = h5py.ExternalLink("/etc/other.h5", "LF")


def lie_outside(file):
    file.create_dataset("LF", (2, 2, 4, 4, 3), "u1", external="/etc/hostname")


def be_virtual(file):
    layout = h5py.VirtualLayout((2, 2, 4, 4, 3), "u1")
    layout[:] = h5py.VirtualSource("/etc/other.h5", "LF", (2, 2, 4, 4, 3))
    file.create_virtual_dataset("LF", layout)


def be_packed_in_a_rare_way(file):
    file.create_dataset("LF", data=np.zeros((2, 2, 4, 4, 3), "u1"), scaleoffset=0)


def hold_text(file):
    file.create_dataset("LF", (2, 2, 4, 4, 3), h5py.string_dtype())


def be_large(file):
    file.create_dataset("LF", (15, 15, 8000, 8000, 3), "f8", chunks=(1, 1, 8, 8, 3))


@pytest.mark.parametrize(
    ("fill", "error", "message"),
    [
        (link_out, Unreadable, "holds LF; give a light field LF with five axes"),
        (lie_outside, UnsupportedType, "LF lies in another file"),
        (be_virtual, UnsupportedType, "LF lies in another file"),
        (be_packed_in_a_rare_way, UnsupportedType, "packed by filter"),
        (hold_text, UnsupportedType, "an array .* of object"),
        (be_large, TooLarge, "comes to"),
        (lambda file: None, Unreadable, "holds nothing; give a light field"),
    ],
)
def test_what_is_refused(fill, error, message):
    with pytest.raises(error, match=message):
        read(made(fill))


def test_a_chunk_that_unpacks_to_more_than_its_samples():
    def fill(file):
        found = file.create_dataset("LF", (1, 1, 4, 4, 3), "u1", chunks=(1, 1, 4, 4, 3), compression="gzip")
        found.id.write_direct_chunk((0,) * 5, zlib.compress(bytes(2**20)))

    with pytest.raises(Unreadable, match="unpacks to 53 bytes, not its 48"):
        read(made(fill))


def test_chunks_that_are_packed_twice():
    def fill(file):
        plan = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        plan.set_chunk((1, 1, 4, 4, 3))
        plan.set_deflate()
        plan.set_deflate()
        h5py.h5d.create(file.id, b"LF", h5py.h5t.STD_U8LE, h5py.h5s.create_simple((1, 1, 4, 4, 3)), plan)

    with pytest.raises(UnsupportedType, match=r"packed by filter \[1, 1\]"):
        read(made(fill))


def test_a_chunk_that_is_not_packed_though_others_are():
    views = np.arange(48, dtype="u1").reshape(1, 1, 4, 4, 3)

    def fill(file):
        found = file.create_dataset("LF", views.shape, "u1", chunks=views.shape, compression="gzip")
        found.id.write_direct_chunk((0,) * 5, views.tobytes(), filter_mask=1)

    assert np.array_equal(read(made(fill)).views, views)
