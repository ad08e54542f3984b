"""Arrays whose axes are in another order than `(V, U, H, W, C)`."""

import io

import h5py
import numpy as np
import pytest
import scipy.io

from ciir.errors import InvalidOption, TooLarge, Unreadable
from ciir.renderer.readers import inputs
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.containers.axes import settle_axes
from ciir.renderer.readers.layout import Layout


def save_npy(array):
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


def save_npz(array):
    file = io.BytesIO()
    np.savez(file, scene=array, camera=np.eye(3))
    return file.getvalue()


def save_mat(array):
    file = io.BytesIO()
    scipy.io.savemat(file, {"scene": array, "camera": np.eye(3)})
    return file.getvalue()


def save_hdf5(array, **attributes):
    file = io.BytesIO()
    with h5py.File(file, "w") as hdf5:
        hdf5["scene"] = array
        hdf5["scene"].attrs.update(attributes)
        hdf5["camera"] = np.eye(3)
    return file.getvalue()


def save_mat73(array):
    return save_hdf5(array.T, MATLAB_class=np.bytes_("uint8"))


SAVE = {"npy": save_npy, "npz": save_npz, "mat": save_mat, "mat73": save_mat73, "h5": save_hdf5}


def read(array, kind="npy", **layout):
    name = "a.mat" if kind == "mat73" else f"a.{kind}"
    return inputs.read(Bundle.from_upload(name, SAVE[kind](array)), Layout(order="given", **layout))


def find_notes(light_field):
    return [note for note in light_field.notes if note.startswith("axes: ")]


@pytest.fixture(scope="module", params=[1, 3])
def views(request):
    """Six views of 18x22 pixels, one after another."""
    return np.random.default_rng(0).integers(0, 256, (6, 18, 22, request.param), np.uint8)


@pytest.mark.parametrize("kind", SAVE)
@pytest.mark.parametrize("order", [(1, 2, 3, 0), (0, 3, 1, 2)], ids=["views last", "colours second"])
def test_a_grid_says_which_axis_counts_the_views(views, kind, order):
    found = read(views.transpose(order), kind, pixels=(2, 3))
    np.testing.assert_array_equal(found.views, views.reshape(2, 3, *views.shape[1:]))
    assert not find_notes(found)
    with pytest.raises(InvalidOption, match="pixels: "):
        read(views.transpose(order), kind, pixels=(2, 4))


def test_colour_views_along_the_last_axis_are_read_with_a_note():
    """As of `cat(4, ...)` of MATLAB: views of 3 rows are not likely."""
    views = np.random.default_rng(0).integers(0, 256, (9, 18, 22, 3), np.uint8)
    found = read(views.transpose(1, 2, 3, 0), "mat")
    np.testing.assert_array_equal(found.views, views.reshape(3, 3, 18, 22, 3))
    assert find_notes(found) == ["axes: taken as (H, W, 3, N), 9 views of 18x22 pixels"]
    assert any(note.startswith("the 9 views are taken as 3x3 views, row by row") for note in found.notes)
    with pytest.raises(InvalidOption, match="8 views, which is not a square number; give pixels ROWSxCOLUMNS"):
        read(views[:8].transpose(1, 2, 3, 0))
    assert read(np.zeros((18, 22, 3, 9), np.uint8), pixels=(18, 22)).views.shape == (18, 22, 3, 9, 1)


def test_grey_views_along_the_last_axis_are_noted():
    array = np.zeros((18, 22, 1, 9), np.uint8)
    (note,) = find_notes(read(array))
    assert note.startswith(
        "axes: 18x22 grey views of 1x9 pixels; if they are 9 views of 18x22 pixels, (H, W, 1, N), give"
    )


def test_few_colour_views_along_the_last_axis_have_a_remedy():
    """Up to four views look like channels, and 3xN like grey views of an array whose pixels come first."""
    array = np.random.default_rng(0).integers(0, 256, (40, 44, 3, 4), np.uint8)
    with pytest.raises(InvalidOption, match=r"; if they are 4 views of 3 colours, \(H, W, 3, N\), give pixels 1x4$"):
        read(array)
    np.testing.assert_array_equal(read(array, pixels=(1, 4)).views[0], array.transpose(3, 0, 1, 2))
    array = np.zeros((40, 44, 3, 5), np.uint8)
    advice = r"if these are 3x5 views of 40x44 pixels, \(H, W, V, U\), save array\.transpose\(2, 3, 0, 1\)$"
    for layout in ({}, {"pixels": (3, 5)}):
        with pytest.raises(InvalidOption, match=advice):
            read(array, **layout)


@pytest.mark.parametrize(
    ("shape", "advice"),
    [
        ((18, 22, 5, 7, 3), "(H, W, V, U, C), save array.transpose(2, 3, 0, 1, 4)"),
        ((18, 22, 5, 7), "(H, W, V, U), save array.transpose(2, 3, 0, 1)"),
    ],
)
@pytest.mark.parametrize("kind", SAVE)
def test_more_views_than_pixels_are_noted_with_the_transpose(kind, shape, advice):
    array = np.zeros(shape, np.uint8)
    advice = f"18x22 views of 5x7 pixels; if these are 5x7 views of 18x22 pixels, {advice}"
    found = read(array, kind)
    assert found.views.shape[:4] == (18, 22, 5, 7)
    assert find_notes(found) == [f"axes: {advice}"]
    with pytest.raises(InvalidOption) as caught:
        read(array, kind, pixels=(5, 7))
    assert str(caught.value).endswith(advice)
    assert not find_notes(read(array, kind, pixels=(18, 22)))  # the grid is confirmed


@pytest.mark.parametrize("kind", SAVE)
def test_too_many_views_are_pixels(kind):
    with pytest.raises(TooLarge) as caught:
        read(np.zeros((300, 301, 5, 5, 3), np.uint8), kind)
    assert str(caught.value).endswith(
        "; at most 65,536 views are read; if these are 5x5 views of 300x301 pixels, (H, W, V, U, C), save "
        "array.transpose(2, 3, 0, 1, 4)"
    )
    assert not caught.value.limit  # no setting is the remedy
    with pytest.raises(TooLarge, match=r"views are read; give fewer$") as caught:
        read(np.zeros((66000, 1, 2, 2, 1), np.uint8), kind)
    assert caught.value.limit == "views"


@pytest.mark.parametrize("kind", ["npz", "mat", "mat73", "h5"])
@pytest.mark.parametrize("shape", [(3, 5, 18, 22), (2, 2, 18, 22)])
def test_the_only_array_with_four_axes_is_a_grey_light_field(kind, shape):
    """MATLAB has no fifth axis of 1."""
    views = np.random.default_rng(0).integers(0, 256, shape, np.uint8)
    found = read(views, kind)
    np.testing.assert_array_equal(found.views, views[..., None])
    assert not find_notes(found)


@pytest.mark.parametrize("kind", ["mat", "h5"])
def test_several_arrays_with_four_axes_are_named(kind):
    array, file = np.zeros((3, 5, 18, 22), np.uint8), io.BytesIO()
    if kind == "mat":
        scipy.io.savemat(file, {"left": array, "right": array})
    else:
        with h5py.File(file, "w") as hdf5:
            hdf5["left"], hdf5["right"] = array, array
    with pytest.raises(Unreadable, match=r"2 arrays have four axes \(left, right\); name the light field LF"):
        inputs.read(Bundle.from_upload(f"a.{kind}", file.getvalue()))


def test_arrays_without_views_keep_their_shape():
    for shape in ((0, 18, 22, 3), (4, 0, 3, 9), (), (7,), (1, 2, 3, 4, 5, 6)):
        assert settle_axes(shape, Layout(), "a").shape[: len(shape)] == shape
