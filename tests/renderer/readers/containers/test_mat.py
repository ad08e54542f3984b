"""MATLAB's layouts, written here element by element: `LF(j, i, l, k, c)`, column-major, its first axis the fastest."""

import io
import struct
import zlib

import numpy as np
import pytest
import scipy.io

from ciir.errors import InvalidOption, TooLarge, Unreadable, UnsupportedType
from ciir.renderer.limits import Limits
from ciir.renderer.readers.containers import mat
from ciir.renderer.readers.layout import Layout

V, U, H, W = 2, 3, 4, 5
INT8, INT32, UINT32, MATRIX, COMPRESSED = 1, 5, 6, 14, 15
CLASSES = {"u1": (9, 2), "<u2": (11, 4), "<f4": (7, 7), "<f8": (6, 9)}
"""Sample type -> numbers of the array class and of the data type (MAT-File Format, tables 1-1 and 1-3)."""


def value(v, u, y, x, c):
    """Another one where any two axes are exchanged or one is reversed."""
    return (97 * v + 41 * u + 13 * y + 5 * x + 61 * c) % 251


def element(kind, data):
    return struct.pack("<II", kind, len(data)) + data + bytes(-len(data) % 8)


def make_mat5(dtype="u1", channels=3, *, is_compressed=False, scale=1):
    """A MAT file of version 5 with one variable `LF`."""
    samples = [
        value(v, u, y, x, c) / scale
        for c in range(channels)
        for x in range(W)
        for y in range(H)
        for u in range(U)
        for v in range(V)
    ]
    class_, kind = CLASSES[dtype]
    shape = (V, U, H, W, channels)[: 4 if channels == 1 else 5]
    body = element(UINT32, struct.pack("<II", class_, 0))
    body += element(INT32, struct.pack(f"<{len(shape)}i", *shape)) + element(INT8, b"LF")
    body += element(kind, np.array(samples).astype(dtype).tobytes())
    matrix = element(MATRIX, body)
    if is_compressed:
        packed = zlib.compress(matrix)
        matrix = struct.pack("<II", COMPRESSED, len(packed)) + packed
    return b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + matrix


def read(data, **limits):
    return mat.read(data, name="a", layout=Layout(), limits=Limits(**limits))


@pytest.mark.parametrize("is_compressed", [False, True])
@pytest.mark.parametrize(("dtype", "channels"), [("u1", 1), ("u1", 3), ("<u2", 3)])
def test_version_5(dtype, channels, is_compressed):
    found = read(make_mat5(dtype, channels, is_compressed=is_compressed))
    assert found.views.shape == (V, U, H, W, channels)
    assert found.views.dtype == np.dtype(dtype)
    for place in np.ndindex(found.views.shape):
        assert found.views[place] == value(*place)
    assert found.depth_sense == "cameras"
    assert len(found.notes) == (channels == 1)
    assert all("if they are 2 views of 3 colours, (N, 3, H, W), give" in note for note in found.notes)


@pytest.mark.parametrize("dtype", ["<f4", "<f8"])
def test_floating_point(dtype):
    found = read(make_mat5(dtype, scale=255))
    for place in np.ndindex(found.views.shape):
        assert found.views[place] == 257 * value(*place)
    assert "rounded to 16 bit" in found.notes[0]


def test_whole_doubles_stay_floating_point():
    """MATLAB stores doubles that are whole numbers as bytes: 1 is white, not the darkest grey but black."""
    file = io.BytesIO()
    ones = np.ones((1, 1, 2, 2, 3))
    scipy.io.savemat(file, {"LF": ones})
    assert (read(file.getvalue()).views == 65535).all()


def test_the_weight_is_left_out_with_a_note():
    found = read(make_mat5("u1", 4))
    assert found.views.shape == (V, U, H, W, 3)
    assert found.views[1, 2, 3, 4, 2] == value(1, 2, 3, 4, 2)
    assert "weight" in found.notes[0]


def saved(**variables):
    file = io.BytesIO()
    scipy.io.savemat(file, variables)
    return file.getvalue()


def test_lf_among_other_variables():
    field = np.arange(120, dtype=np.uint8).reshape(V, U, H, W, 1).repeat(3, axis=4)
    data = saved(LF=field, other=field, settings={"a": 1}, cells=np.array([1, "b"], object), text="x")
    np.testing.assert_array_equal(read(data).views, field)
    np.testing.assert_array_equal(read(saved(scene=field, text="x")).views, field)


@pytest.mark.parametrize(
    "variables",
    [
        lambda field: {"LF": {"f": 100.0, "LF": field, "name": "knights"}},
        lambda field: {"data": {"camera": {"f": 1.0}, "scene": {"none": np.zeros((0, 0)), "views": field}}},
    ],
)
def test_a_light_field_in_a_struct(variables):
    """As of the HCI benchmark's tools for MATLAB: `LF.LF`."""
    field = np.arange(360, dtype=np.uint8).reshape(V, U, H, W, 3)
    np.testing.assert_array_equal(read(saved(**variables(field))).views, field)
    other = np.zeros_like(field)  # what lies in no struct comes first
    np.testing.assert_array_equal(read(saved(scene=other, **variables(field))).views, other)


def test_views_one_after_another_are_a_grid():
    views = np.arange(2 * 3 * 6 * 4 * 3, dtype=np.uint8).reshape(6, 6, 4, 3)
    found = mat.read(saved(LF=views), name="a", layout=Layout(pixels=(2, 3)), limits=Limits())
    np.testing.assert_array_equal(found.views, views.reshape(2, 3, 6, 4, 3))
    with pytest.raises(InvalidOption, match="a: 6 views, which is not a square number; give pixels"):
        read(saved(LF=views))


@pytest.mark.parametrize(
    ("variables", "error", "message"),
    [
        (
            {"a": 1, "b": "x"},
            Unreadable,
            "holds a 1x1, b 1x1; give a light field LF with five axes, or four if it is grey, at the top",
        ),
        (
            {"scene": {"depth": np.zeros((4, 4))}},
            Unreadable,
            r"scene 1x1, scene\.depth 4x4; .* at the top or up to two structs deep",
        ),
        ({"a": {"b": {"c": {"LF": np.zeros((2, 2, 4, 4, 3))}}}}, Unreadable, r"a\.b 1x1, a\.b\.c 1x1; give"),
        (
            {"LF": np.full((3, 5), "a", object)},
            Unreadable,
            r"LF 3x5; LF\{1,1\} is 1x1 char, .*; give .*, or a light field LF",
        ),
        (
            {"a": np.zeros((2, 2, 4, 4, 3)), "b": np.zeros((2, 2, 4, 4, 3))},
            Unreadable,
            r"2 arrays have five axes \(a, b\); name the light field LF",
        ),
        (
            {"LF": np.zeros((2, 2, 4, 4, 3), np.int32)},
            UnsupportedType,
            r"LF is of class int32; give .*, as in uint8\(LF\) for levels up to 255, else uint16\(LF\)",
        ),
        ({"LF": np.ones((2, 2, 4, 4, 3), bool)}, UnsupportedType, r"LF is of class logical; .* in 255 \* uint8\(LF\)"),
        ({"LF": np.zeros((2, 2, 4, 4, 3), complex)}, UnsupportedType, r"of class complex double; give .* abs\(LF\)"),
        ({"LF": np.full((2, 2, 4, 4, 3), "a", object)}, UnsupportedType, "LF is of class cell"),
        ({"LF": np.zeros((2, 2, 4, 4, 5), np.uint8)}, Unreadable, "1 to 4 channels"),
    ],
)
def test_other_variables_are_refused(variables, error, message):
    with pytest.raises(error, match=message):
        read(saved(**variables))


def test_the_oldest_byte_order_and_small_elements():
    """MATLAB on other processors wrote the most significant byte first; names of up to four bytes lie in the tag."""
    body = struct.pack(">IIII", UINT32, 8, 9, 0) + struct.pack(">II5i4x", INT32, 20, 1, 1, 2, 2, 1)
    body += struct.pack(">HH4s", 2, INT8, b"LF") + struct.pack(">HH4B", 4, 2, 1, 2, 3, 4)
    found = read(b"MATLAB 5.0 MAT-file".ljust(124) + b"\x01\x00MI" + struct.pack(">II", MATRIX, len(body)) + body)
    np.testing.assert_array_equal(found.views[0, 0, :, :, 0], [[1, 3], [2, 4]])


@pytest.mark.parametrize("number", [0, 8, 14, 15, 4000])
def test_numbers_of_no_known_type(number):
    """SciPy's reader would end the process."""
    data = bytearray(make_mat5())
    place = data.index(struct.pack("<II", 2, V * U * H * W * 3))
    data[place : place + 4] = struct.pack("<I", number)
    with pytest.raises(Unreadable, match=f"LF has samples of type {number}, which doesn't exist"):
        read(bytes(data))


def test_sizes_are_checked_by_the_header():
    data = bytearray(make_mat5())
    place = data.index(struct.pack("<5i", V, U, H, W, 3))
    data[place : place + 16] = struct.pack("<4i", 15, 15, 30000, 30000)
    with pytest.raises(TooLarge, match="pixels of a view"):
        read(bytes(data))


def test_what_unpacks_to_more_than_its_header_says_is_not_unpacked():
    body = make_mat5()[136:]
    packed = zlib.compress(struct.pack("<II", MATRIX, len(body) + 2**22) + body + bytes(2**22))
    data = make_mat5()[:128] + struct.pack("<II", COMPRESSED, len(packed)) + packed
    with pytest.raises(TooLarge, match=r"unpacks to over 1,...,... bytes"):
        read(data)
    with pytest.raises(TooLarge, match="unpacks to over 99 bytes"):
        read(make_mat5(is_compressed=True), bytes=99)


def test_two_variables_of_one_name():
    with pytest.raises(Unreadable, match="two variables of the same name"):
        read(make_mat5() + make_mat5()[128:])
