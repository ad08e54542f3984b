"""Elemental image arrays and mosaics as arrays: read as the same picture in PNG is."""

import io
import zlib
from functools import partial

import h5py
import numpy as np
import pytest
import scipy.io

import ciir
from ciir.errors import InputError, InvalidOption, TooLarge, Unreadable, UnsupportedType
from ciir.renderer.levels import ROUNDED
from ciir.renderer.limits import Limits
from ciir.renderer.readers import inputs
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.containers.hdf5_data_set import find_shape
from ciir.renderer.readers.layout import Layout
from ciir.renderer.readers.lenslet.grid import Known
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
                kind = {"float64": "double", "bool": "logical"}.get(array.dtype.name, array.dtype.name)
                hdf5[name].attrs["MATLAB_class"] = np.bytes_(kind)
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
    assert inspect(Bundle.from_upload(name, save(eia=array / 255)), Options())["notes"] == [ROUNDED]


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
@pytest.mark.parametrize("limits", [{"bytes": 15_000}, {"bytes": 10**9, "ratio": 10**6}])
def test_limits_of_the_caller_hold(array, kind, limits):
    """They are those of light fields: unpacked sizes of npz and MAT files, whatever the defaults are."""
    name, save = FILES[kind]
    flat = np.zeros((3000, 3000), np.uint8)
    flat[:60, :112] = array[..., 0]
    data = save(eia=flat)
    if "packed" in kind and limits["bytes"] < flat.size:
        with pytest.raises(TooLarge, match=rf"^{name}: .*unpacks to over|^{name}: .* at most 15,000"):
            read(data, name, lenses=(30, 30), limits=Limits(**limits))
    elif limits["bytes"] > flat.size:
        assert read(data, name, lenses=(30, 30), limits=Limits(**limits)).views.shape == (100, 100, 30, 30, 1)


@pytest.mark.parametrize("kind", FILES)
def test_a_light_field_comes_first(array, kind):
    name, save = FILES[kind]
    views = np.zeros((2, 3, 40, 50, 3), np.uint8)
    assert read(save(eia=array, LF=views), name).views.shape == views.shape
    assert read(save(eia=array, field=views), name).views.shape == views.shape
    with pytest.raises(InputError, match=rf"^{name}: .*(int32|logical|bool)"):
        read(save(eia=array, LF=views.astype(np.int32)), name, pixels=PIXELS)


@pytest.mark.parametrize("kind", FILES)
@pytest.mark.parametrize("other", [np.zeros((60, 112), np.uint8), np.zeros((9, 40, 50), np.uint8)])
def test_which_of_several_is_meant_is_not_guessed(array, kind, other):
    name, save = FILES[kind]
    with pytest.raises(
        Unreadable, match=rf"^{name}: holds .*eia (60x112x3|3x112x60).*; give .* without other pictures"
    ):
        read(save(eia=array, other=other), name, lenses=LENSES)


@pytest.mark.parametrize("kind", FILES)
def test_of_one_that_is_not_read_the_type_is_named(array, kind):
    name, save = FILES[kind]
    mask = array[..., 0] > 99
    assert read(save(eia=array, labels=array.astype(np.int16), mask=mask), name, lenses=LENSES).views.shape[0] == 5
    for made in (mask, array.astype(np.int16), array[..., 0].astype(complex)):
        with pytest.raises(UnsupportedType, match=rf"^{name}: eia is of (class )?(logical|bool|.*int16|complex)"):
            read(save(eia=made), name, lenses=LENSES)


def test_a_light_field_in_a_struct_or_group_comes_first(array):
    views = np.zeros((2, 3, 40, 50, 3), np.uint8)
    settings = {"pitch": 0.5, "camera": np.eye(4)}
    thumb = np.random.default_rng(0).random((400, 400, 3))
    assert read(save_mat5(eia=array, scene={"LF": views}), "a.mat").views.shape == views.shape
    assert read(save_mat5(True, eia=array, scene={"LF": views}), "a.mat").views.shape == views.shape
    assert read(save_hdf5(**{"eia": array, "scene/LF": views}), "a.h5").views.shape == views.shape
    for is_packed in (False, True):
        deep = save_mat5(is_packed, thumb=thumb, data={"scene": {"LF": views}})
        assert read(deep, "a.mat").views.shape == views.shape
    assert read(save_hdf5(**{"thumb": thumb, "data/scene/LF": views}), "a.h5").views.shape == views.shape
    assert read(save_mat5(eia=array, scene=settings), "a.mat", lenses=LENSES).depth_sense == "lenses"
    grouped = save_hdf5(**{"eia": array, "scene/pitch": 0.5, "scene/camera": np.eye(4)})
    assert read(grouped, "a.h5", lenses=LENSES).depth_sense == "lenses"
    cells = np.array([array, array], object)
    assert read(save_mat5(eia=array, views=cells), "a.mat", lenses=LENSES).depth_sense == "lenses"


def test_groups_are_looked_into_a_bounded_number_of_times(array, monkeypatch):
    """Each of 70 names stands for one group with 70 names for one other group: 343,000 paths."""
    file = io.BytesIO()
    with h5py.File(file, "w") as hdf5:
        hdf5["eia"] = array
        inner, outer = hdf5.create_group("inner"), hdf5.create_group("outer")
        for number in range(70):
            hdf5[f"g{number}"], outer[f"h{number}"], inner[f"k{number}"] = outer, inner, hdf5["eia"]
    found = []
    module = "ciir.renderer.readers.containers.hdf5.find_shape"
    monkeypatch.setattr(module, lambda *args: found.append(args) or find_shape(*args))
    assert read(file.getvalue(), "a.h5", lenses=LENSES).depth_sense == "lenses"
    assert len(found) < 10_000


@pytest.mark.parametrize("kind", ["npy", *FILES])
def test_arrays_of_too_many_bytes(array, kind):
    name, save = {"npy": ("a.npy", lambda **variables: saved(*variables.values()))}.get(kind) or FILES[kind]
    limits = Limits(set_bytes=8 * array.size - 1)
    with pytest.raises(TooLarge, match=rf"^{name}: (eia|the array) comes to {8 * array.size:,} bytes; at most "):
        read(save(eia=array / 255), name, lenses=LENSES, limits=limits)


def test_an_array_beside_a_white_picture(array):
    """It is a raw lenslet picture, as the same in PNG is."""
    for picture in ({"eia.npz": save_npz(eia=array)}, {"eia.png": encode_png(array)}):
        with pytest.raises(Unreadable, match=r"^folder: shows no lens grid by itself"):
            inspect(Bundle("folder", None, picture | {"white.png": encode_png(array)}), Options())


def test_what_else_hdf5_holds(array):
    file = io.BytesIO()
    with h5py.File(file, "w") as hdf5:
        hdf5["eia"] = array
        hdf5["title"], hdf5["names"] = "abc", ["a", "b"]
        hdf5["table"] = np.zeros(20, [("x", "f4"), ("y", "f4")])
        hdf5["same"], hdf5["again"] = h5py.SoftLink("/eia"), h5py.SoftLink("/nothing")
        hdf5["link"] = np.array([hdf5["eia"].ref], h5py.ref_dtype)
        h5py.h5d.create(hdf5.id, b"when", h5py.h5t.UNIX_D32LE, h5py.h5s.create_simple((2,)))
        hdf5["labels"] = np.zeros(3)
        hdf5["labels"].attrs["MATLAB_class"] = ["a", "b"]
    assert read(file.getvalue(), "a.h5", lenses=LENSES).depth_sense == "lenses"
    with h5py.File(file, "a") as hdf5:
        hdf5["LF"] = h5py.ExternalLink("other.h5", "/LF")
    with pytest.raises(Unreadable, match=r"a.h5: holds "):
        read(file.getvalue(), "a.h5", lenses=LENSES)


def test_matlab_73_without_classes_counts_axes_from_the_other_end(array):
    data = save_hdf5(eia=np.ascontiguousarray(array[..., 0].T))
    matlab = b"MATLAB 7.3 MAT-file".ljust(512) + data
    found = read(matlab, "a.mat", lenses=LENSES)
    np.testing.assert_array_equal(found.views, read(saved(array[..., 0]), lenses=LENSES).views)


def test_two_variables_of_one_name(array):
    data = save_mat5(eia=array)
    with pytest.raises(Unreadable, match=r"two variables of the same name"):
        read(data + data[128:], "a.mat", lenses=LENSES)


def test_only_the_picture_is_unpacked(array, monkeypatch):
    """Of a light field it is looked for only in the first bytes of each variable."""
    views = np.random.default_rng(0).integers(0, 256, (5, 5, 60, 80, 3), np.uint8)
    unpacked = []

    class Counting:
        def __init__(self):
            self.stream = decompressobj()

        def decompress(self, *args):
            made = self.stream.decompress(*args)
            unpacked.append(len(made))
            return made

    decompressobj = zlib.decompressobj
    monkeypatch.setattr("ciir.renderer.readers.containers.mat.zlib.decompressobj", Counting)
    read(save_mat5(True, LF=views), "a.mat")
    assert views.size < sum(unpacked) < views.size + 3 * 2**12


@pytest.mark.parametrize("kind", FILES)
@pytest.mark.parametrize("small", [np.eye(3), np.zeros((5000, 3)), np.zeros((15, 200))])
def test_small_arrays_are_no_pictures(kind, small):
    name, save = FILES[kind]
    with pytest.raises(InputError, match=rf"^{name}: .*; give "):
        read(save(camera=small), name, pixels=(3, 3))


def test_only_a_picture_is_a_raw_lenslet_picture():
    views = np.zeros((3, 3, 20, 30, 3), np.uint8)
    with pytest.raises(InvalidOption, match=r"lens_pitch: this is for one raw lenslet picture, and a\.npz is not one"):
        read(save_npz(LF=views), "a.npz", lens_grid=Known())


def test_only_a_picture_file_is_a_quilt_by_its_name(array):
    bundle = Bundle.from_upload("a_qs4x3a1.npz", save_npz(eia=array))
    assert not inputs.holds_views(bundle, Layout())
    assert inputs.read(bundle, Layout(lenses=LENSES)).depth_sense == "lenses"


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
