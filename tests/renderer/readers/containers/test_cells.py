"""Cell arrays of views: as SciPy writes MAT version 5, and as MATLAB writes 7.3, references that are transposed."""

import io
import itertools

import h5py
import numpy as np
import pytest
import scipy.io
from hypothesis import given
from hypothesis import strategies as st

import ciir
from ciir.errors import InputError, InvalidOption, TooLarge, Unreadable, UnsupportedType
from ciir.renderer.levels import ROUNDED
from ciir.renderer.limits import Limits
from ciir.renderer.readers import inputs
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.containers import cells as cell_arrays
from ciir.renderer.readers.containers import hdf5, mat
from ciir.renderer.readers.containers.hdf5_data_set import DataSet
from ciir.renderer.readers.layout import Layout
from ciir.service.pipeline.inspection.report import inspect
from ciir.service.pipeline.options import Options

VIEWS = np.random.default_rng(0).integers(0, 256, (2, 3, 20, 25, 3), np.uint8)
EIA = np.arange(40 * 60, dtype=np.uint8).reshape(40, 60)
EMPTY = np.zeros((0, 0))
NUMBERS = itertools.count()


def make_cells(views):
    """`cells{v, u}` of `views[v, u]`."""
    cells = np.empty(views.shape[:2], object)
    for v, u in np.ndindex(cells.shape):
        cells[v, u] = views[v, u]
    return cells


def list_cells(*values):
    """A row of cells."""
    cells = np.empty((1, len(values)), object)
    cells[0] = [*values, None][:-1]
    return cells


def save_mat5(is_packed=False, **variables):
    file = io.BytesIO()
    scipy.io.savemat(file, variables, do_compression=is_packed)
    return file.getvalue()


def save_mat73(**variables):
    file = io.BytesIO()
    with h5py.File(file, "w", userblock_size=512) as made:
        made.create_group("#refs#")
        for name, value in variables.items():
            put(made, name, value)
    return b"MATLAB 7.3 MAT-file".ljust(512) + file.getvalue()[512:]


def put(group, name, value):
    """A variable as MATLAB 7.3 writes it."""
    if isinstance(value, dict):
        for field, inner in value.items():
            put(group.require_group(name), field, inner)
        return
    array, refs = np.atleast_2d(value), group.file["#refs#"]
    kind = {"float64": "double", "float32": "single", "bool": "logical"}.get(array.dtype.name, array.dtype.name)
    if isinstance(value, str):
        array, kind = np.array([[ord(character) for character in value]], np.uint16), "char"
    if array.dtype == object:
        kind, stored = "cell", np.empty(array.shape[::-1], object)
        for row, column in np.ndindex(array.shape):
            key = f"r{next(NUMBERS)}"
            put(refs, key, array[row, column])
            stored[column, row] = refs[key].ref
        group.create_dataset(name, data=stored, dtype=h5py.ref_dtype)
    elif array.size == 0:
        group[name] = np.array(array.shape, np.uint64)
        group[name].attrs["MATLAB_empty"] = np.uint8(1)
    else:
        group[name] = array.T.astype(np.uint8) if kind == "logical" else array.T
    group[name].attrs["MATLAB_class"] = np.bytes_(kind)


def save_mat5_packed(**variables):
    return save_mat5(True, **variables)


FORMATS = pytest.mark.parametrize("save", [save_mat5, save_mat5_packed, save_mat73])


def read(data, limits=None, **layout):
    return inputs.read(Bundle.from_upload("a.mat", data, *([limits] if limits else [])), Layout(**layout))


@FORMATS
@pytest.mark.parametrize(
    "convert", [lambda views: views, lambda views: views[..., 0], lambda views: views * np.uint16(9)]
)
def test_each_cell_is_a_view(save, convert):
    views = convert(VIEWS)
    found = read(save(views=make_cells(views), pitch=0.5, names=list_cells("left", "right")))
    np.testing.assert_array_equal(found.views, views.reshape(*views.shape[:4], -1))
    assert (found.views.dtype, found.depth_sense, found.notes) == (views.dtype, "cameras", ())


@given(
    st.sampled_from([save_mat5, save_mat5_packed, save_mat73]),
    st.tuples(*[st.integers(1, 3)] * 2, *[st.integers(16, 19)] * 2, st.sampled_from([1, 3])),
    st.sampled_from(["u1", "u2"]),
)
def test_cells_are_read_as_the_array(save, shape, dtype):
    views = np.random.default_rng(0).integers(0, 256, shape).astype(dtype)
    if shape[:2] == (1, 1):
        return
    layout = Layout(pixels=shape[:2])
    reader = hdf5 if save is save_mat73 else mat
    data = save(LF=make_cells(views if shape[4] == 3 else views[..., 0]))
    found = reader.read(data, name="a", layout=layout, limits=Limits())
    np.testing.assert_array_equal(found.views, views)


@FORMATS
@pytest.mark.parametrize("dtype", ["f4", "f8"])
def test_floating_point_numbers(save, dtype):
    found = read(save(LF=make_cells((VIEWS / 255).astype(dtype))))
    np.testing.assert_array_equal(found.views, VIEWS.astype(np.uint16) * 257)
    assert found.notes == (ROUNDED,)
    with pytest.raises(Unreadable, match="view 0,0 has samples from 0 to 255"):
        read(save(LF=make_cells(VIEWS.astype(dtype))))


@FORMATS
@pytest.mark.parametrize("shape", [(1, 6), (6, 1)])
def test_a_row_or_a_column_is_a_stack_of_views(save, shape):
    data = save(views=make_cells(VIEWS).reshape(shape))
    np.testing.assert_array_equal(read(data, pixels=(2, 3)).views, VIEWS)
    columns = read(data, pixels=(2, 3), order="columns").views
    np.testing.assert_array_equal(columns, VIEWS.reshape(3, 2, *VIEWS.shape[2:]).swapaxes(0, 1))
    with pytest.raises(InvalidOption, match=r"a.mat: 6 cells, which is not a square number; give pixels ROWSxCOLUMNS"):
        read(data)
    with pytest.raises(InvalidOption, match=r"pixels: 5x5 asks for 25 views, but a.mat has 6 cells"):
        read(data, pixels=(5, 5))
    square = read(save(views=make_cells(VIEWS).reshape(-1)[:4].reshape(1, 4)))
    assert square.views.shape[:2] == (2, 2)
    assert "the 4 cells are taken as 2x2 views, row by row" in square.notes[0]


@FORMATS
def test_structs_and_groups_up_to_two_deep(save):
    cells = make_cells(VIEWS)
    np.testing.assert_array_equal(read(save(LF={"views": cells, "f": 2.0})).views, VIEWS)
    np.testing.assert_array_equal(read(save(data={"scene": {"views": cells}, "f": 2.0})).views, VIEWS)
    with pytest.raises(Unreadable, match=r"holds a.* give a light field LF"):
        read(save(a={"b": {"c": {"views": cells}}}))


@FORMATS
def test_which_of_several_is_read(save):
    cells, array = make_cells(VIEWS), VIEWS[:, :2] // 2
    np.testing.assert_array_equal(read(save(LF=cells, other=array)).views, VIEWS)
    np.testing.assert_array_equal(read(save(LF=cells, other=cells)).views, VIEWS)
    np.testing.assert_array_equal(read(save(LF=array, other=cells)).views, array)
    np.testing.assert_array_equal(read(save(scene=array, other=cells)).views, array)
    np.testing.assert_array_equal(read(save(scene={"x": array}, other=cells)).views, array)
    masks = make_cells(VIEWS[..., 0] > 99)
    np.testing.assert_array_equal(read(save(masks=masks, views=cells, bad=list_cells(EIA, EMPTY))).views, VIEWS)
    with pytest.raises(Unreadable, match=r"2 arrays have five axes \(a, b\); name the light field LF"):
        read(save(a=cells, b=cells))


@FORMATS
def test_views_come_before_an_elemental_image_array(save, tmp_path):
    path = tmp_path / "a.mat"
    for cells in ({"views": make_cells(VIEWS)}, {"scene": {"views": make_cells(VIEWS)}}):
        path.write_bytes(save(eia=EIA, **cells))
        np.testing.assert_array_equal(ciir.open(path).views, VIEWS)
        assert inspect(Bundle.from_path(path), Options())["kind"] == "views"
        assert inputs.holds_views(Bundle.from_path(path), Layout())


@FORMATS
@pytest.mark.parametrize(
    "cells",
    [
        list_cells("a", "b"),
        list_cells(1.0, 2.0, EMPTY),
        list_cells(EIA),
        list_cells(EIA, EIA[:-1]),
        list_cells(EIA, EIA / 255),
        list_cells(EIA, EMPTY),
        list_cells(*[np.eye(3, 4)] * 5),
        list_cells(*[EIA[:15, :15]] * 4),
        list_cells(list_cells(EIA, EIA), list_cells(EIA, EIA)),
        make_cells(VIEWS > 99),
        make_cells(VIEWS.astype(np.int16)),
        np.empty((0, 3), object),
    ],
)
def test_other_cells_beside_an_elemental_image_array_do_not_matter(save, cells):
    assert read(save(eia=EIA, cells=cells, scene={"cells": cells}), lenses=(10, 10)).views.shape == (4, 6, 10, 10, 1)


@FORMATS
@pytest.mark.parametrize(
    ("cells", "error", "message"),
    [
        (
            list_cells(EIA, EIA[:-1]),
            Unreadable,
            r"c\{1,2\} is 39x60 uint8, but c\{1,1\} is 40x60 uint8; give pict",
        ),
        (list_cells(EIA, EIA / 255), Unreadable, r"c\{1,2\} is 40x60 double, but c\{1,1\} is 40x60 uint8"),
        (list_cells(EIA, EMPTY), Unreadable, r"c\{1,2\} is empty, not a picture"),
        (
            list_cells("abc", "d"),
            Unreadable,
            r"c\{1,1\} is 1x3 char, not a picture; give pictures of one size and class",
        ),
        (list_cells(1.0, 2.0), Unreadable, r"c\{1,1\} is 1x1 double, not a picture"),
        (list_cells(EIA[:2], EIA[:2]), Unreadable, r"c\{1,1\} is 2x60 uint8, not a picture"),
        (list_cells(list_cells(EIA, EIA), EIA), Unreadable, r"c\{1,1\} is 1x2 cell, not a picture"),
        (
            list_cells(EIA),
            Unreadable,
            r"c has only one cell, and an elemental image array must be an array outside cells",
        ),
        (
            make_cells(VIEWS > 99),
            UnsupportedType,
            r"c\{1,1\} is of class logical; give uint8, as in 255 \* uint8\(c\{1",
        ),
        (make_cells(VIEWS.astype(np.int32)), UnsupportedType, "int32; give uint8, uint16"),
    ],
)
def test_what_is_refused(save, cells, error, message):
    with pytest.raises(error, match=rf"^a.mat: .*{message}"):
        read(save(c=cells, names=list_cells("a", "b"), pitch=1.0))


@FORMATS
def test_the_cell_that_differs_is_named(save):
    views = make_cells(VIEWS)
    views[1, 2] = VIEWS[0, 0, :-1]
    with pytest.raises(
        Unreadable, match=r"views 2x3; views\{2,3\} is 19x25x3 uint8, but views\{1,1\} is 20x25x3 uint8"
    ):
        read(save(names=list_cells("a", "b"), views=views))


@FORMATS
@pytest.mark.parametrize(
    ("limits", "message"),
    [({"views": 5}, "at most 5 views"), ({"pixels": 499}, "at most 499 pixels"), ({"set_bytes": 8999}, "9,000 bytes")],
)
def test_limits_of_the_caller_hold(save, limits, message, monkeypatch):
    """They are checked before samples are read."""
    for kind in (mat.Variable, DataSet):
        monkeypatch.setattr(kind, "read", lambda *_: pytest.fail("samples are read"))
    with pytest.raises(TooLarge, match=message):
        read(save(views=make_cells(VIEWS)), Limits(**limits))


def test_what_cells_unpack_to_is_limited():
    data = save_mat5(True, views=make_cells(VIEWS * 0))
    with pytest.raises(TooLarge, match="unpacks to over 5,000 bytes"):
        read(data, Limits(bytes=5000))


@FORMATS
def test_a_bounded_number_of_cells_is_looked_at(save, monkeypatch):
    monkeypatch.setattr(cell_arrays, "_MOST_CELLS", 8)
    np.testing.assert_array_equal(read(save(A=list_cells(*[EIA] * 6), LF=make_cells(VIEWS))).views, VIEWS)
    for names in (("a", "b"), ("b", "a")):
        with pytest.raises(Unreadable, match=r"2 arrays have five axes \([ab], [ab]\); name the light field LF"):
            read(save(**dict.fromkeys(names, make_cells(VIEWS))))
    with pytest.raises(
        Unreadable, match=r"LF 3x3; LF has 9 cells, and at most 8 of a file are looked at; give .* LF w"
    ):
        read(save(LF=list_cells(*[EIA] * 9).reshape(3, 3)))


@FORMATS
def test_samples_are_read_once(save, monkeypatch):
    numbers = []
    for kind in (mat.Variable, DataSet):
        original = kind.read
        monkeypatch.setattr(kind, "read", lambda *given, read=original: numbers.append(1) or read(*given))
    read(save(eia=EIA, views=make_cells(VIEWS)))
    assert len(numbers) == 6


@FORMATS
def test_damaged_files(save):
    data = save(eia=EIA, views=make_cells(VIEWS))
    for end in range(130, len(data), len(data) // 40):
        with pytest.raises(InputError, match=r"^a.mat: "):
            read(data[:end])


def test_cells_without_a_header_are_empty():
    """A struct's empty field is such an element, and so may a cell be."""
    data = save_mat5(views=list_cells(EIA, EIA))
    cell = data.index(bytes([14, 0, 0, 0]), 136)
    size = 8 + int.from_bytes(data[cell + 4 : cell + 8], "little")
    made = data[:cell] + bytes([14, 0, 0, 0, 0, 0, 0, 0]) + data[cell + size :]
    made = made[:132] + (len(made) - 136).to_bytes(4, "little") + made[136:]
    with pytest.raises(Unreadable, match=r"views\{1,1\} is not an array of its own, not a picture"):
        read(made)


def edit(change, **options):
    """A file with six views, whose cells or what they refer to `change` replaces."""
    file = io.BytesIO(save_mat73(views=make_cells(VIEWS)))
    with h5py.File(file, "a") as made:
        refs, cells = made["#refs#"], made["views"][()]
        del made["views"]
        change(made, refs, cells)
        made.create_dataset("views", data=cells, dtype=h5py.ref_dtype, **options)
        made["views"].attrs["MATLAB_class"] = np.bytes_("cell")
    return file.getvalue()


def refer_twice(made, refs, cells):
    cells[2, 1] = cells[0, 0]


def refer_to_nothing(made, refs, cells):
    cells[2, 1] = h5py.Reference()


def refer_to_a_group(made, refs, cells):
    cells[2, 1] = refs.ref


def refer_elsewhere(made, refs, cells):
    made["x"] = np.zeros(1)
    cells[2, 1] = refs.create_dataset("x", (3, 25, 20), "u1", external="/etc/hostname").ref


def refer_to_a_virtual_one(made, refs, cells):
    layout = h5py.VirtualLayout((3, 25, 20), "u1")
    layout[:] = h5py.VirtualSource("/etc/other.h5", "x", (3, 25, 20))
    cells[2, 1] = refs.create_virtual_dataset("x", layout).ref


@pytest.mark.parametrize(
    "change", [refer_twice, refer_to_nothing, refer_to_a_group, refer_elsewhere, refer_to_a_virtual_one]
)
def test_references_to_anything_but_a_data_set_of_its_own(change):
    with pytest.raises(Unreadable, match=r"a.mat: holds views 2x3.*; views\{2,3\} is not an array of its own"):
        read(edit(change))


def test_references_that_are_packed_or_cut_off():
    with pytest.raises(Unreadable, match=r"views 2x3; cells of views are cut off, or references to them packed"):
        read(edit(lambda *_: None, compression="gzip"))


def test_references_to_nowhere():
    data = save_mat73(views=make_cells(VIEWS))
    with h5py.File(io.BytesIO(data)) as made:
        start = made["views"].id.get_offset()
    for address in (1, 600, 2**40, 2**64 - 2):
        with pytest.raises(InputError, match=r"^a.mat: "):
            read(data[:start] + address.to_bytes(8, "little") + data[start + 8 :])


def test_a_view_that_is_packed_in_a_rare_way():
    def change(made, refs, cells):
        cells[2, 1] = refs.create_dataset("x", data=VIEWS[1, 2].T, scaleoffset=0).ref
        refs["x"].attrs["MATLAB_class"] = np.bytes_("uint8")

    with pytest.raises(UnsupportedType, match=r"a cell of views is packed by filter \[6\]; save it with gzip"):
        read(edit(change))
