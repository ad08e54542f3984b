"""Elemental image arrays and mosaics as arrays: read as the same picture in PNG is."""

import io
from functools import partial

import h5py
import numpy as np
import pytest
import scipy.io

import ciir
from ciir.errors import InputError, InvalidOption, TooLarge, Unreadable
from ciir.renderer.levels import ROUNDED
from ciir.renderer.limits import Limits
from ciir.renderer.readers import inputs
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.layout import Layout
from ciir.renderer.writers.pictures import encode_png
from ciir.service.pipeline.inspection.report import inspect
from ciir.service.pipeline.options import Options

LENSES, PIXELS = (12, 16), (5, 7)


def saved(array):
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


def save_npz(save=np.savez, **variables):
    file = io.BytesIO()
    save(file, **variables)
    return file.getvalue()


def save_mat5(is_packed=False, **variables):
    file = io.BytesIO()
    scipy.io.savemat(file, variables, do_compression=is_packed)
    return file.getvalue()


def save_hdf5(is_matlab=False, **variables):
    """As h5py writes arrays, or as MATLAB 7.3: axes from the other end, and the class as an attribute."""
    file = io.BytesIO()
    with h5py.File(file, "w") as hdf5:
        for name, value in variables.items():
            array = np.asarray(value)
            hdf5[name] = array.T if is_matlab else array
            if is_matlab:
                hdf5[name].attrs["MATLAB_class"] = np.bytes_("double" if array.dtype.kind == "f" else array.dtype.name)
    return file.getvalue()


FILES = {
    "npz": ("a.npz", save_npz),
    "npz, packed": ("a.npz", partial(save_npz, np.savez_compressed)),
    "mat": ("a.mat", save_mat5),
    "mat, packed": ("a.mat", partial(save_mat5, True)),
    "mat73": ("a.mat", partial(save_hdf5, True)),
    "hdf5": ("a.h5", save_hdf5),
}


def read(data, name="eia.npy", limits=None, **layout):
    bundle = Bundle.from_upload(name, data, *([limits] if limits else []))
    return inputs.read(bundle, Layout(**layout))


@pytest.fixture(scope="module")
def array():
    views = ciir.render("scene:vase", lenses=LENSES, pixels=PIXELS, backend="raytrace")
    return np.ascontiguousarray(views.eia()[..., :3])


@pytest.mark.parametrize(
    "layout",
    [
        {"lenses": LENSES},
        {"pixels": PIXELS},
        {"lenses": LENSES, "pickup": "optical"},
        {"pixels": PIXELS, "arrangement": "mosaic"},
        {"lenses": (10, 16), "crop": (5, 0, 5, 0)},
    ],
)
@pytest.mark.parametrize("convert", [lambda eia: eia, lambda eia: eia[..., 0], lambda eia: eia.astype(">u2") * 257])
def test_it_is_read_as_the_same_picture_in_png(array, layout, convert):
    made = convert(array)
    got = read(saved(np.asfortranarray(made)), **layout)
    picture = made.reshape(*made.shape[:2], -1).astype(made.dtype.newbyteorder("="))
    want = read(encode_png(picture), "eia.png", **layout)
    np.testing.assert_array_equal(got.views, want.views)
    assert (got.views.dtype, got.depth_sense) == (want.views.dtype, want.depth_sense)
    assert [note.replace(".npy", ".png") for note in got.notes] == list(want.notes)


def test_floating_point_numbers_are_rounded_to_16_bit_with_a_note(array):
    found = read(saved(array / 255), lenses=LENSES)
    np.testing.assert_array_equal(found.views, read(saved(array.astype(np.uint16) * 257), lenses=LENSES).views)
    assert ROUNDED in found.notes
    with pytest.raises(InputError, match=r"eia.npy: .* from 0 to 1"):
        read(saved(array.astype(float)), lenses=LENSES)


def test_missing_and_wrong_numbers_are_answered_as_of_a_picture(array):
    with pytest.raises(InvalidOption, match=r"eia.npy: .*lenses"):
        read(saved(array))
    with pytest.raises(InvalidOption, match="lenses: 11x16 does not divide the picture of 60x112 pixels"):
        read(saved(array), lenses=(11, 16))


def test_other_arrays(array):
    with pytest.raises(TooLarge, match="60x112 pixels"):
        read(saved(array), lenses=LENSES, limits=Limits(pixels=1000))
    for data in (saved(array)[:-1], saved(array)[:40], saved(array.astype(np.int64)), saved(np.zeros((0, 4)))):
        with pytest.raises(InputError, match=r"^eia.npy: "):
            read(data, lenses=LENSES)


def test_options_of_elemental_image_arrays_are_taken(array, tmp_path):
    np.save(tmp_path / "eia.npy", array)
    found = ciir.open(tmp_path / "eia.npy", lenses=LENSES, pickup="optical")
    assert found.views.shape == (*PIXELS, *LENSES, 3)
    report = inspect(Bundle.from_path(tmp_path / "eia.npy"), Options(lenses=LENSES))
    assert report["kind"] == "eia"


@pytest.mark.parametrize("kind", FILES)
def test_what_an_array_may_be_is_listed_as_of_a_picture(kind):
    views = ciir.render("scene:vase", lenses=(40, 40), pixels=(9, 9), backend="raytrace")
    array = np.ascontiguousarray(views.eia()[..., :3])
    name, save = FILES[kind]
    got = inspect(Bundle.from_upload(name, save(eia=array)), Options())
    want = inspect(Bundle.from_upload("a.png", encode_png(array)), Options())
    assert got["candidates"] == want["candidates"]
    assert got["kind"] == want["kind"] == "eia"


@pytest.mark.parametrize("kind", FILES)
@pytest.mark.parametrize("convert", [lambda eia: eia, lambda eia: eia[..., 0], lambda eia: eia.astype("u2") * 257])
def test_in_other_files_it_is_read_as_in_npy(array, kind, convert):
    made = convert(array)
    name, save = FILES[kind]
    others = {"pitch": 0.5, "camera": np.eye(4), "offsets": np.zeros((1, 40))}
    want = read(saved(made), pixels=PIXELS)
    for variables in ({"eia": made}, others | {"eia": made}):
        got = read(save(**variables), name, pixels=PIXELS)
        np.testing.assert_array_equal(got.views, want.views)
        assert (got.views.dtype, got.depth_sense, got.notes) == (want.views.dtype, "lenses", want.notes)


@pytest.mark.parametrize("kind", FILES)
def test_floating_point_numbers_in_other_files(array, kind):
    name, save = FILES[kind]
    got, want = read(save(eia=array / 255), name, lenses=LENSES), read(saved(array / 255), lenses=LENSES)
    np.testing.assert_array_equal(got.views, want.views)
    assert got.notes == want.notes
    assert ROUNDED in got.notes
    with pytest.raises(InputError, match=rf"{name}: .* from 0 to 1"):
        read(save(eia=array.astype(float)), name, lenses=LENSES)


@pytest.mark.parametrize("kind", FILES)
def test_limits_and_other_numbers_in_other_files(array, kind):
    name, save = FILES[kind]
    with pytest.raises(TooLarge, match="60x112 pixels"):
        read(save(eia=array), name, lenses=LENSES, limits=Limits(pixels=1000))
    for made in (array.astype(np.int32), np.zeros((0, 4), np.uint8)):
        with pytest.raises(InputError, match=rf"^{name}: "):
            read(save(eia=made), name, lenses=LENSES)


@pytest.mark.parametrize("kind", FILES)
def test_a_light_field_comes_first(array, kind):
    name, save = FILES[kind]
    views = np.zeros((2, 3, 40, 50, 3), np.uint8)
    assert read(save(eia=array, LF=views), name).views.shape == views.shape
    assert read(save(eia=array, field=views), name).views.shape == views.shape


@pytest.mark.parametrize("kind", FILES)
@pytest.mark.parametrize("other", [np.zeros((60, 112), np.uint8), np.zeros((9, 40, 50), np.uint8)])
def test_which_of_several_is_meant_is_not_guessed(array, kind, other):
    name, save = FILES[kind]
    with pytest.raises(Unreadable, match=rf"^{name}: holds .*eia 60x112x3|^{name}: holds .*eia 3x112x60"):
        read(save(eia=array, other=other), name, lenses=LENSES)


def test_what_may_hold_a_light_field_is_looked_into_first(array):
    views = np.zeros((2, 3, 40, 50, 3), np.uint8)
    assert read(save_mat5(eia=array, scene={"LF": views}), "a.mat").views.shape == views.shape
    assert read(save_hdf5(**{"eia": array, "scene/LF": views}), "a.h5").views.shape == views.shape
    cells = np.array([array, array], object)
    with pytest.raises(Unreadable, match="holds eia"):
        read(save_mat5(eia=array, views=cells), "a.mat", lenses=LENSES)


def test_mosaics_of_basiclfsr_stay_light_fields():
    found = read(save_hdf5(Hr_SAI_y=np.full((100, 100), 128, np.uint8)), "a.h5", pixels=(5, 5))
    assert found.views.shape == (5, 5, 20, 20, 1)
    assert found.depth_sense == "cameras"


@pytest.mark.parametrize("kind", FILES)
def test_damaged_files(array, kind):
    name, save = FILES[kind]
    data = save(eia=array)
    for damaged in (data[: len(data) // 2], data[:150], data[:40]):
        with pytest.raises(InputError, match=rf"^{name}: "):
            read(damaged, name, lenses=LENSES)
