"""Lytro's containers: against imageio's reader, and of pictures that are cast ray by ray."""

import numpy as np
import pytest

from ciir.errors import TooLarge, Unreadable, UnsupportedType
from ciir.renderer.limits import Limits
from ciir.renderer.readers import pictures
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.inputs import read
from ciir.renderer.readers.layout import Layout
from ciir.renderer.readers.lenslet.grid import Known, LensGrid
from ciir.renderer.readers.lytro.container import read_frame
from ciir.renderer.readers.lytro.metadata import F01, ILLUM, RAW_SENSORS, find_camera, read_camera
from ciir.renderer.readers.lytro.picture import unpack
from ciir.renderer.readers.registry import LYTRO_RAW_SIZES
from tests.support.lenslet.camera import make_camera, take_picture
from tests.support.lenslet.lytro import expose, make_metadata, pack, write_container
from tests.support.lenslet.trials import measure_errors

GRID = LensGrid(14.286, (5.3, 8.8), -0.05, "hexagonal", 1.0004)
SIZE = (400, 440)
CAMERA = make_camera("vase", GRID, SIZE, (90, 120, 150))
PICTURE = take_picture(CAMERA, edge=0.1)


def make_file(model="F01", picture=PICTURE, edit=lambda metadata: None):
    metadata = make_metadata(GRID, SIZE, model)
    bits = {"F01": 12, "ILLUM": 10}[model]
    packed = pack(expose(picture, metadata), bits)
    edit(metadata)
    return write_container(packed, metadata, model)


def open_file(data, name="a.lfp", **layout):
    return read(Bundle(name, name, {name: data}), Layout(**layout))


@pytest.mark.parametrize("model", ["F01", "ILLUM"])
def test_a_picture_is_developed_as_it_was(model):
    y, x = np.indices(SIZE)
    picture = np.stack([60 + 0.3 * y, 150 - 0.2 * y + 0.1 * x, 60 + 0.2 * x], axis=-1)
    found = pictures.decode(make_file(model, picture), name="a")
    assert found.dtype == np.uint16
    assert np.abs(found[2:-2, 2:-2] / 257 - picture[2:-2, 2:-2]).max() < 1  # level of 255; a step of 10 bit is 0.5


@pytest.mark.parametrize(("model", "name"), [("F01", "a.lfp"), ("ILLUM", "a.lfr")])
def test_its_light_field_is_that_of_the_picture(model, name):
    light_field = open_file(make_file(model), name)
    assert light_field.depth_sense == "cameras"
    assert light_field.lens_pitch == pytest.approx(GRID.pitch, abs=0.005)
    direct = open_file_of(PICTURE)
    assert light_field.views.shape == direct.views.shape
    assert np.abs(light_field.views / 257 - direct.views).mean() < 4


def open_file_of(picture):
    from ciir.renderer.writers.pictures import encode_png

    known = Known(GRID.pitch, GRID.offset, GRID.rotation, "hexagonal", GRID.stretch)
    return read(Bundle("a.png", "a.png", {"a.png": encode_png(picture)}), Layout(lens_grid=known))


def test_the_metadata_give_the_grid_where_the_picture_shows_none():
    over_all, offset = measure_errors(find_camera(make_file(), "a").grid, GRID, SIZE)
    assert over_all < 0.01
    assert offset < 0.01
    light_field = open_file(make_file(picture=np.full_like(PICTURE, 99)))
    assert light_field.notes[0].endswith(
        "as given by the camera's metadata, since the picture shows none; see --show-grid"
    )
    assert f"pitch {GRID.pitch:.3f} pixels" in light_field.notes[0]


@pytest.mark.parametrize("tiling", ["squareUniform", "hexUniformRowMajor", "hexUniformColumnMajor"])
@pytest.mark.parametrize("orientation", range(1, 9))
def test_the_grid_turns_with_the_picture(tiling, orientation):
    metadata = make_metadata(LensGrid(14.286, (5.3, 8.8), -0.5, "hexagonal", 1.04), SIZE)
    metadata["devices"]["mla"]["tiling"] = tiling

    def list_centers():
        camera = read_camera(metadata, "a")
        centers = camera.grid.find_centers(*(indices.ravel() for indices in np.indices((40, 40)) - 20))
        return centers[:, ::-1] if camera.known.shape == "hexagonal-columns" else centers

    centers = list_centers()
    centers = centers[((centers >= 0) & (centers < SIZE)).all(axis=1)]
    indices = np.stack(np.indices(SIZE), axis=-1)
    turned = pictures._turn_upright(indices, orientation)  # each pixel's place before it was turned
    metadata["image"]["orientation"] = orientation
    found = list_centers()
    inside = (found >= 0) & (found < np.array(turned.shape[:2]) - 1)
    places = turned[tuple(np.rint(found[inside.all(axis=1)]).astype(int).T)]
    distances = np.linalg.norm(places[:, None] - centers, axis=-1).min(axis=1)
    assert len(places) > 500
    assert distances.max() < 0.72  # half a pixel in y and x, rounded


def test_a_given_grid_is_taken():
    known = Known(20.0, (9.0, 9.0), 0.0, "square")
    assert "square, pitch 20.000 pixels" in open_file(make_file(), lens_grid=known).notes[0]


@pytest.mark.parametrize(("sensor", "suffix"), [(F01, "lfp"), (ILLUM, "lfr")])
def test_pixels_are_those_that_imageio_reads(sensor, suffix, tmp_path):
    imageio = pytest.importorskip("imageio.v2")
    data = (
        np.random.default_rng(0).integers(0, 256, sensor.height * sensor.width * sensor.bits // 8, np.uint8).tobytes()
    )
    metadata = make_metadata(GRID, (sensor.height, sensor.width), model := {"lfp": "F01", "lfr": "ILLUM"}[suffix])
    path = tmp_path / f"a.{suffix}"
    path.write_bytes(write_container(data, metadata, model))
    words = {"include_thumbnail": False} if suffix == "lfr" else {}
    theirs = imageio.imread(path, format=f"lytro-{suffix}", **words)
    packed, ours = read_frame(path.read_bytes(), "a")
    assert ours == theirs.meta["metadata"]
    levels = 2**sensor.bits - 1
    assert np.array_equal(unpack(packed, sensor), np.rint(theirs * levels).astype(np.uint16))


def test_a_png_of_a_raw_files_size_is_none():
    (size, other) = LYTRO_RAW_SIZES
    assert {size, other} == set(RAW_SENSORS)
    assert find_camera(bytes(other), "a").known.shape == "hexagonal"
    assert find_camera(b"\x89PNG\r\n\x1a\n".ljust(other), "a") is None


def test_a_raw_file_is_its_pixels_alone():
    sensor = F01
    mosaic = np.full((sensor.height, sensor.width), 168 + 1000, np.uint16)
    three = pack(mosaic[:1, :2], 12)
    data = three * (mosaic.size // 2)
    found = pictures.decode(data, name="a.raw")
    assert found.shape == (3280, 3280, 3)
    assert np.allclose(found, 65535 * (1000 / 3927) ** (1 / 2.4), atol=1)


def drop(path):
    def edit(metadata):
        *way, last = path.split(".")
        for key in way:
            metadata = metadata[key]
        del metadata[last]

    return edit


def put(path, value):
    def edit(metadata):
        *way, last = path.split(".")
        for key in way:
            metadata = metadata[key]
        metadata[last] = value

    return edit


@pytest.mark.parametrize(
    ("edit", "error", "message"),
    [
        (drop("image.width"), Unreadable, "its metadata have no number image.width"),
        (put("image.width", 1e300), Unreadable, "its metadata have no number image.width"),
        (put("image.height", 4_000_000), TooLarge, "4000000x440 pixels"),
        (put("image.height", 4_000), Unreadable, "4000x440 pixels are cut off after 264,000 bytes"),
        (put("image.height", -2), Unreadable, "-2x440 pixels"),
        (put("image.width", 442), Unreadable, "400x442 pixels don't fill its packing"),
        (
            put("image.rawDetails.pixelPacking.bitsPerPixel", 16),
            UnsupportedType,
            "packed like a Lytro F01's or Illum's",
        ),
        (put("image.rawDetails.pixelFormat.white.r", 7), Unreadable, "levels of black and white are exchanged"),
        (
            put("image.rawDetails.pixelPacking.endianness", ["big"]),
            UnsupportedType,
            "packed like a Lytro F01's or Illum",
        ),
        (put("devices.mla.tiling", ["hexUniformRowMajor"]), Unreadable, "describe no known lens array"),
        (drop("devices.mla.tiling"), Unreadable, "describe no known lens array"),
        (put("devices.mla.lensPitch", 1.0), Unreadable, "describe lenses 7.14e\\+05 pixels apart"),
    ],
)
def test_metadata_that_do_not_fit_are_refused(edit, error, message):
    with pytest.raises(error, match=message):
        open_file(make_file(edit=edit))


def test_containers_that_are_cut_or_developed_are_refused():
    whole = make_file()
    with pytest.raises(Unreadable, match="a section of 264,000 bytes is cut off"):
        open_file(whole[:100_000])
    with pytest.raises(Unreadable, match="its table of contents is missing"):
        open_file(whole[:16])
    with pytest.raises(UnsupportedType, match="holds no raw picture, only one processed by Lytro's software"):
        open_file(whole.replace(b"frameArray", b"otherArray"))
    with pytest.raises(Unreadable, match="the raw picture or its metadata is missing"):
        open_file(whole.replace(b'"imageRef": "sha1-', b'"imageRef": "sha2-'))
    with pytest.raises(TooLarge, match="over the limit of 1,000"):
        read(Bundle("a.lfp", "a.lfp", {"a.lfp": whole}, Limits(pixels=1000)))
