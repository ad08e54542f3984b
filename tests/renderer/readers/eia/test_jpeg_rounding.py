"""Elemental image arrays that are JPEGs come closer to what was compressed, and stay what the file may stand for."""

import io
import os
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image
from scipy.fft import dctn

from ciir.renderer.light_field import LightField
from ciir.renderer.readers import inputs, jpeg, pictures
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.eia import jpeg_rounding
from ciir.renderer.readers.layout import Layout
from ciir.renderer.writers.pictures import encode_png


def encode(picture, quality=75, **options):
    kept = io.BytesIO()
    Image.fromarray(picture.squeeze()).save(kept, "JPEG", quality=quality, **options)
    return kept.getvalue()


def make_array(side=48, disparity=0.3):
    """An elemental image array of `side` x `side` lenses with 9x7 pixels each, `(H, W, 3)`, neither black nor white:
    waves of up to a third of a period a pixel, in views that move by `disparity` pixels."""
    random = np.random.default_rng(0)
    v, u, y, x = (np.arange(count) for count in (9, 7, side, side))
    rows, cols = (place[None] - disparity * number[:, None] for place, number in ((y, v), (x, u)))
    views = np.full((9, 7, side, side, 3), 128.0)
    for down, across, begin in random.uniform((-2, -2, 0), (2, 2, 6), (30, 3)):
        waves = np.sin(down * rows[:, None, :, None] + across * cols[None, :, None, :] + begin)
        views += waves[..., None] * random.uniform(2, 8, 3)
    return LightField(np.clip(views, 20, 235).round().astype(np.uint8)).eia().astype(np.uint8)


def read(data, **layout):
    name = "a.jpg" if data.startswith(b"\xff\xd8") else "a.png"
    return inputs.read(Bundle(name, name, {name: data}), Layout(**{"restores_jpeg": True, **layout}))


def error(picture, truth):
    return float(np.square(picture.astype(float) - truth).mean()) ** 0.5


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("options", [{}, {"subsampling": 0}, {"progressive": True}])
def test_views_come_closer_to_what_was_compressed(channels, options):
    array = make_array()[..., :channels]
    data = encode(array, **options)
    field = read(data, pixels=(9, 7))
    (note,) = field.notes
    changed = (field.eia() != pictures.decode(data, name="a")).any(axis=2).mean()
    assert note.startswith(f"the array is a JPEG: {100 * changed:.0f} % of its pixels were changed, by at most ")
    assert field.is_jpeg
    decoded = pictures.decode(data, name="a")
    assert error(field.eia(), array) < 0.9 * error(decoded, array)
    corners = [each[::9, ::7] for each in (field.eia(), decoded, array)]
    assert error(corners[0], corners[2]) < 0.9 * error(corners[1], corners[2])


@pytest.mark.parametrize("size", [(9 * 16, 7 * 16), (9 * 5, 7 * 5)])  # whole blocks, and some that the edge cuts
def test_it_stays_a_picture_that_the_file_may_stand_for(size):
    """Each coefficient of a whole block is within `KEPT` of a step, and what 8-bit pixels add."""
    array = make_array()[: size[0], : size[1]].mean(2, keepdims=True).round().astype(np.uint8)
    data = encode(array, quality=50)
    luma = jpeg.decode_luma(data)
    restored = jpeg_rounding.restore(luma.pixels[..., np.newaxis], luma, (9, 7)).pixels[..., 0]
    height, width = (side // 8 * 8 for side in size)
    assert not np.array_equal(restored, luma.pixels)
    assert np.array_equal(restored[height:], luma.pixels[height:])
    assert np.array_equal(restored[:, width:], luma.pixels[:, width:])

    def transform(picture):
        blocks = picture[:height, :width].reshape(height // 8, 8, width // 8, 8).astype(float)
        return dctn(blocks - 128, axes=(1, 3), norm="ortho") / luma.steps[None, :, None, :]

    multiples = np.round(transform(luma.pixels))
    pixels = 8 * 0.5 / luma.steps[None, :, None, :]  # at most: each of 64 pixels is rounded by up to half a level
    assert (np.abs(transform(restored) - multiples) <= jpeg_rounding.KEPT + pixels + 1e-3).all()


def test_transforms_are_those_of_scipy_and_each_others_inverse():
    pixels = np.random.default_rng(0).integers(-128, 128, (24, 40)).astype(np.float32)
    expected = dctn(pixels.reshape(3, 8, 5, 8), axes=(1, 3), norm="ortho").reshape(3, 8, 40)
    made, back = jpeg_rounding._transform(pixels), np.empty_like(pixels)
    assert np.abs(made - expected).max() < 1e-3  # float32
    jpeg_rounding._transform_back(made, out=back)
    assert np.abs(back - pixels).max() < 1e-3


@pytest.mark.parametrize("limit", [3.0, np.inf])
def test_smoothing_is_that_of_each_lens_by_itself(limit):
    """A step down the gradient of Huber's function of the first and second differences, first down, then across."""
    lens, count = (5, 4), (3, 6)
    pixels = np.random.default_rng(0).normal(0, 9, (lens[0] * count[0], lens[1] * count[1])).astype(np.float32)

    def smooth_down(column):
        moved = np.zeros_like(column)
        for order, weight in ((1, jpeg_rounding.SLOPE), (2, jpeg_rounding.BEND)):
            differences = np.diff(np.eye(len(column)), order, axis=0)
            moved -= weight * differences.T @ np.clip(differences @ column, -limit, limit)
        return column + moved

    lenses = pixels.astype(float).reshape(count[0], lens[0], count[1], lens[1])
    expected = np.apply_along_axis(smooth_down, 3, np.apply_along_axis(smooth_down, 1, lenses)).reshape(pixels.shape)
    weights = jpeg_rounding._find_weights((slice(10, 25), slice(8, 32)), lens)
    jpeg_rounding._smooth(pixels, weights, limit, np.empty_like(pixels))
    assert np.abs(pixels - expected).max() < 1e-4  # float32


@pytest.mark.parametrize("quality", [50, 75, 95])
@pytest.mark.parametrize("lens", [(9, 7), (1, 7), (2, 2), (144, 112)])
def test_views_that_differ_much_stay_as_decoded(quality, lens):
    """Lenses of two pixels show no bends; a dark row of lenses, as at the edge of a picture, decides nothing."""
    array = np.random.default_rng(1).integers(0, 256, (432, 336, 1), np.uint8)
    array[: lens[0]] = 0
    data = encode(array, quality)
    field = read(data, pixels=lens, arrangement="eia")
    assert np.array_equal(field.eia(), pictures.decode(data, name="a"))
    assert field.notes == ()


def test_a_tenth_of_the_array_that_is_noise_keeps_no_other_part_as_decoded():
    array = make_array()[..., :1].copy()
    array[:45] = np.random.default_rng(1).integers(0, 256, array[:45].shape)
    data = encode(array)
    field = read(data, pixels=(9, 7), arrangement="eia")
    assert error(field.eia()[64:], array[64:]) < 0.9 * error(pictures.decode(data, name="a")[64:], array[64:])


def test_edges_of_things_are_not_drawn_together():
    """Half of each elemental image is 100 levels brighter: smoothing without a limit would draw the two together."""
    array = np.full((144, 112, 1), 60, np.uint8)
    array.reshape(16, 9, 16, 7)[:, :, :, 4:] = 160
    luma = jpeg.decode_luma(encode(array, 90))
    restored = jpeg_rounding.restore(luma.pixels[..., np.newaxis], luma, (9, 7)).pixels
    assert error(restored, array) < 1.06 * error(luma.pixels[..., np.newaxis], array)


@pytest.mark.parametrize("shift", [-90, 90])
def test_black_and_white_pixels_do_not_wrap_around(shift):
    array = np.clip(make_array().astype(int) + shift, 0, 255).astype(np.uint8)
    data = encode(array)
    decoded, made = pictures.decode(data, name="a").astype(int), read(data, pixels=(9, 7)).eia().astype(int)
    assert np.isin(decoded, (0, 255)).mean() > 0.01
    assert 0 < np.abs(made - decoded).max() < 64


def test_pieces_join(monkeypatch):
    luma = jpeg.decode_luma(encode(make_array(96)[..., :1]))

    def restore():
        return jpeg_rounding.restore(luma.pixels[..., np.newaxis], luma, (9, 7)).pixels.astype(int)

    monkeypatch.setattr(jpeg_rounding, "ROWS", 1024)
    monkeypatch.setattr(jpeg_rounding, "COLS", 1024)
    whole = restore()
    monkeypatch.setattr(jpeg_rounding, "ROWS", 16)
    monkeypatch.setattr(jpeg_rounding, "COLS", 40)
    pieces = restore()
    assert (whole != luma.pixels[..., np.newaxis]).mean() > 0.1
    assert np.abs(pieces - whole).max() <= 1  # sums of float32 in another order, then rounded
    assert (pieces != whole).mean() < 1e-3


def test_the_number_of_threads_changes_nothing():
    """Not even before rounding to whole levels, which hides most differences."""
    script = """
import hashlib, numpy as np
from ciir.renderer.readers.jpeg import Luma
from ciir.renderer.readers.eia import jpeg_rounding
found = []
find_change = jpeg_rounding._find_change
jpeg_rounding._find_change = lambda *given: found.append(find_change(*given)) or found[-1]
picture = (np.add.outer(np.arange(64), np.arange(9600)) * 0.9 % 50 + 100).astype(np.uint8)
jpeg_rounding.restore(picture[..., None], Luma(picture, np.full((8, 8), 12, np.float32)), (8, 8))
print(*sorted(hashlib.sha256(change.tobytes()).hexdigest() for change in found), any(map(np.any, found)))
"""
    printed = set()
    for threads in "12":
        environment = os.environ | {"OPENBLAS_NUM_THREADS": threads, "OMP_NUM_THREADS": threads}
        done = subprocess.run(  # noqa: S603 - ours
            [sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=True
        )
        printed.add(done.stdout)
    assert len(printed) == 1
    assert printed.pop().endswith("True\n")


def test_what_no_smoothing_changes_stays_though_its_coefficients_were_clipped():
    """Black and white pixels: the decoded coefficients aren't multiples of steps."""
    array = np.where(np.random.default_rng(2).random((144, 112, 1)) < 0.5, 0, 255).astype(np.uint8)
    data = encode(array)
    luma = jpeg.decode_luma(data)
    assert np.array_equal(jpeg_rounding.restore(luma.pixels[..., np.newaxis], luma, (1, 1)).pixels[..., 0], luma.pixels)


def test_tables_of_steps_that_follow_the_first_scan_are_left_alone():
    """libjpeg takes each component's table when its own first scan begins, and Pillow lists those before all scans."""
    data = encode(make_array(), progressive=True)
    table = data[data.index(b"\xff\xdb") :][:69]
    second = data.index(b"\xff\xda", data.index(b"\xff\xda") + 2)
    late = data[:second] + table + data[second:]
    field = read(late, pixels=(9, 7), arrangement="eia")
    assert field.notes == ()
    assert np.array_equal(field.eia(), pictures.decode(late, name="a"))


def test_steps_of_zero_are_read_as_ones():
    """A damaged table: libjpeg reads it too."""
    data = bytearray(encode(make_array()[..., :1]))
    table = data.index(b"\xff\xdb") + 5
    data[table : table + 64] = bytes(64)
    field = read(bytes(data), pixels=(9, 7), arrangement="eia")
    assert np.array_equal(field.eia(), pictures.decode(bytes(data), name="a"))


@pytest.mark.parametrize("quality", [30, 75, 95])
def test_flat_pictures_and_small_ones_stay_exactly(quality):
    for shape in ((27, 21, 3), (144, 112, 3), (9, 7, 1), (3, 90, 1)):
        flat = np.full(shape, 77, np.uint8)
        data = encode(flat, quality)
        grid = shape[0] // 3, shape[1] // 3 if shape[1] % 3 == 0 else 7
        decoded = pictures.decode(data, name="a")
        field = read(data, pixels=grid, arrangement="eia", order="given")
        assert np.array_equal(field.eia(), decoded)
        assert field.notes == ()
        assert not field.is_jpeg


@pytest.mark.parametrize(
    ("data", "layout"),
    [
        (
            lambda array: encode(
                array, exif=b"Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x03\0\0\0\0\0\0\0"
            ),
            {},
        ),
        (encode, {"crop": (9, 7, 0, 0)}),
        (encode, {"arrangement": "mosaic"}),
        (encode_png, {}),
        (encode, {"restores_jpeg": False}),
    ],
    ids=["turned", "with margins", "a mosaic", "PNG", "not asked for"],
)
def test_others_are_read_as_decoded(data, layout):
    made = data(make_array())
    field = read(made, pixels=(9, 7), order="given", **layout)
    assert not any("JPEG" in note for note in field.notes)
    assert not field.is_jpeg
    top, left = layout.get("crop", (0, 0))[:2]
    decoded = pictures.decode(made, name="a")[top:, left:]
    if layout.get("arrangement") == "mosaic":
        height, width = decoded.shape[0] // 9, decoded.shape[1] // 7
        decoded = decoded.reshape(9, height, 7, width, 3).transpose(1, 0, 3, 2, 4).reshape(decoded.shape)
    assert np.array_equal(field.eia(), decoded)
