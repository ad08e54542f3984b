"""Elemental image arrays and mosaics as NPY: read as the same picture in PNG is."""

import io

import numpy as np
import pytest

import ciir
from ciir.errors import InputError, InvalidOption, TooLarge
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
