import io
import zipfile

import numpy as np
import pytest

import ciir
from ciir.errors import InvalidOption, Unreadable
from ciir.renderer.light_field import LightField
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.eia.period import Periods
from ciir.renderer.readers.lenslet.grid import LensGrid
from ciir.renderer.writers.pictures import encode_png
from ciir.service.pipeline.inspection import pictures
from ciir.service.pipeline.inspection.report import inspect
from ciir.service.pipeline.options import Options
from tests.support.inputs import CUBE, make_zip
from tests.support.lenslet.camera import make_camera, take_picture
from tests.support.light_fields import make_views


def look(name, data, **texts):
    return inspect(Bundle.from_upload(name, data), Options.parse(texts))


def look_at(picture, **texts):
    return look("a.png", encode_png(picture), **texts)


@pytest.fixture(scope="module")
def vase():
    return ciir.render("scene:vase", lenses=(40, 50), pixels=(9, 9))


def test_a_mesh_has_bounds():
    found = look("a.off", CUBE)
    vertices = np.array([line.split() for line in CUBE.decode().splitlines()[2:10]], float)
    assert (found["kind"], found["input"]["triangles"], found["input"]["bytes"]) == ("mesh", 12, len(CUBE))
    assert found["bounds"] == [vertices.min(axis=0).tolist(), vertices.max(axis=0).tolist()]


def test_a_shipped_scene():
    assert inspect("vase", Options())["kind"] == "mesh"


def test_the_elemental_images_of_a_scene_are_found_and_read_so(vase):
    found = look_at(vase.eia())
    best = found["candidates"][0]
    assert (found["kind"], best["kind"], best["options"]) == ("eia", "eia", {"pixels": "9x9"})
    assert (best["lenses"], best["pixels"]) == ((40, 50), (9, 9))
    given = look_at(vase.eia(), **best["options"])
    assert given["candidates"] == []
    expected = {"rows": 9, "cols": 9, "height": 40, "width": 50, "depth_sense": "lenses"}
    assert (given["kind"], given["light_field"]) == ("eia", expected)


@pytest.mark.parametrize("kind", ["eia", "mosaic"])
def test_a_picture_that_we_wrote_says_what_it_is(tmp_path, vase, kind):
    vase.save(tmp_path / "a.png", kind)
    data = (tmp_path / "a.png").read_bytes()
    found = look("a.png", data)
    options = {"pixels": "9x9"} | ({"arrangement": "mosaic"} if kind == "mosaic" else {})
    assert found["candidates"] == [{"kind": kind, "options": options, "lenses": (40, 50), "pixels": (9, 9)}]
    assert look("a.png", data, **options)["kind"] == kind


def test_elemental_images_of_an_even_parallax_are_found():
    """Content moves by a pixel from one elemental image to the next: the period is not their size."""
    field = LightField(make_views((15, 15), side=40, disparities=(1, 1), channels=3), depth_sense="lenses")
    assert Periods(field.eia()).find() == (16, 16)
    assert look_at(field.eia())["candidates"][0]["options"] == {"pixels": "15x15"}


def test_a_mosaic():
    views = make_views((4, 5), side=60, disparities=(1, 1), channels=3)
    mosaic = views.swapaxes(1, 2).reshape(240, 300, 3)
    found = look_at(mosaic)
    assert found["candidates"][1]["options"] == {"pixels": "60x60"}
    best = found["candidates"][0]
    assert (found["kind"], best["options"]) == ("mosaic", {"arrangement": "mosaic", "pixels": "4x5"})
    given = look_at(mosaic, **best["options"])
    expected = {"rows": 4, "cols": 5, "height": 60, "width": 60, "depth_sense": "cameras"}
    assert (given["kind"], given["light_field"]) == ("mosaic", expected)


@pytest.mark.parametrize("shape", ["square", "hexagonal"])
@pytest.mark.parametrize("in_columns", [False, True])
def test_the_grid_of_a_raw_picture_is_one_that_can_be_given(shape, in_columns):
    grid = LensGrid(14.37, (6.2, 7.9), 0.4, shape)
    picture = take_picture(make_camera("globe", grid, (420, 480)))
    picture = np.ascontiguousarray(picture.swapaxes(0, 1)) if in_columns else picture
    found = look_at(picture)
    (only,) = found["candidates"]
    assert (found["kind"], only["kind"]) == ("raw", "raw")
    assert only["lens_grid"]["shape"] == (shape if not in_columns or shape == "square" else "hexagonal-columns")
    assert abs(only["lens_grid"]["pitch"] - 14.37) < 0.01  # over 30 lenses 0.3 pixels
    given = look_at(picture, **only["options"])
    again = given["candidates"][0]["lens_grid"]
    for name, digits in {"pitch": 5, "offset": 3, "rotation": 4}.items():
        assert again[name] == pytest.approx(np.round(only["lens_grid"][name], digits))


def test_a_picture_without_lenses_has_no_candidates():
    noise = np.random.default_rng(1).integers(0, 256, (200, 210, 3), np.uint8)
    found = look_at(noise)
    assert (found["kind"], found["candidates"]) == ("picture", [])
    assert (found["input"]["height"], found["input"]["width"]) == (200, 210)
    with pytest.raises(Unreadable, match="no lens grid"):
        look_at(noise, lens_pitch="auto")


def test_a_grid_that_only_the_middle_shows_is_no_candidate(vase, monkeypatch):
    def refuse(*_):
        raise InvalidOption("lens_pitch: 4.97 is out of range; give 5 to 200 pixels")

    monkeypatch.setattr(pictures, "detect_grid", lambda *_: LensGrid(9, (4, 4)))
    monkeypatch.setattr(pictures, "find_grid", refuse)
    assert look_at(vase.eia())["kind"] == "eia"
    with pytest.raises(InvalidOption, match="out of range"):
        look_at(vase.eia(), lens_pitch="auto")


def test_views_are_not_decoded():
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        for v, u in np.ndindex(3, 4):
            archive.writestr(f"view_{v}_{u}.png", encode_png(np.full((5, 6, 3), 10 * v + u, np.uint8)))
    found = look("a.zip", packed.getvalue())
    expected = {"rows": 3, "cols": 4, "height": 5, "width": 6, "depth_sense": "cameras"}
    assert (found["kind"], found["light_field"]) == ("views", expected)


def test_options_that_do_not_fit_are_refused(vase):
    with pytest.raises(InvalidOption, match="does not divide"):
        look_at(vase.eia(), lenses="7x7")


def test_a_picture_alone_in_a_zip_is_inspected_as_the_picture(vase):
    data = encode_png(vase.eia())
    alone, zipped = look("a.png", data), look("a.zip", make_zip({"a.png": data, "notes.txt": b"x"}))
    assert zipped["candidates"] == alone["candidates"]
    assert zipped["kind"] == "eia"
