"""Views through a light-field network, from bytes to pixels, with a stand-in whose results plain loops repeat."""

import io

import numpy as np
import pytest
from PIL import Image
from scipy.ndimage import gaussian_filter, shift

from ciir.errors import TooLarge, UnsuitedModel, UnsupportedScale
from ciir.models import catalogue
from ciir.models.light_field.finishing import Finishing
from ciir.models.sampling import Finding, Sampling
from ciir.renderer.light_field import LightField
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.writers.pictures import encode_png
from ciir.renderer.writers.writer import MemoryWriter
from ciir.service.pipeline import run as pipeline
from ciir.service.pipeline.options import Options
from ciir.service.pipeline.pictures import upscale_files
from ciir.service.pipeline.planning import model_selection
from ciir.service.pipeline.run import reconstruct
from ciir.service.pipeline.source import Input
from ciir.service.pipeline.stages import schedule, view_sources
from ciir.service.pipeline.stages.upscaling import fallback_notes
from tests.support.inputs import EIA_PNG, make_picture
from tests.support.networks import upscale_as_stand_in
from tests.support.pipeline import run

ROUNDED = 0.55
"""Levels: rounding to nearest, and float32 at 16 bits."""
MESH = {"lenses": (12, 10), "pixels": (5, 6), "backend": "raytrace"}


@pytest.fixture
def own_views(monkeypatch):
    """Has the lens array's own views help those of a mesh."""
    monkeypatch.setattr(model_selection, "is_possible", lambda *_: False)


def as_array(views, grid):
    return np.array([[views[v, u] for u in range(grid[1])] for v in range(grid[0])])


@pytest.mark.parametrize(("channels", "dtype"), [(1, np.uint8), (3, np.uint8), (3, np.uint16)])
@pytest.mark.parametrize("wanted", ["center", "cross", "all", "5,5;0,1;5,4"])
def test_pictures_take_the_views_around(stand_in, channels, dtype, wanted):
    eia = make_picture(24, 42, channels, dtype)
    views, report = run(Bundle.from_upload("eia.png", encode_png(eia)), lenses=(4, 7), views=wanted)
    field = eia.reshape(4, 6, 7, 6, channels).transpose(1, 3, 0, 2, 4)
    assert list(views) == [(view["v"], view["u"]) for view in report["views"]]
    for view, picture in views.items():
        assert picture.dtype == dtype
        assert np.abs(picture - upscale_as_stand_in(field, view)).max() < ROUNDED
    field_sha256, quality_sha256 = (
        next(entry.card.sha256 for entry in catalogue.list_entries() if entry.name == name)
        for name in ("field", "quality")
    )
    fallback = {"name": "quality", "scale": 2, "sha256": quality_sha256}
    assert report["model"] == {"name": "field", "scale": 2, "sha256": field_sha256, "fallback": fallback}
    assert report["plan"]["model"] == "field"
    assert any(reason.startswith("model auto: field") for reason in report["plan"]["reasons"])
    assert "upscale" in report["timings_ms"]


def test_the_network_that_helps_is_the_one_that_the_report_names(monkeypatch):
    loaded, load = [], catalogue.load_upscaler
    monkeypatch.setattr(catalogue, "load_upscaler", lambda name, **more: loaded.append(name) or load(name, **more))
    _, report = run(Bundle.from_upload("eia.png", EIA_PNG), lenses=(6, 9), model="field-quality")
    assert report["model"]["name"] == "field-quality"
    assert loaded == [report["model"]["fallback"]["name"]] == [catalogue.prefer_int8("quality")]


def test_the_rounding_of_a_jpeg_is_undone_only_before_views_are_upscaled():
    waves = 128 + 60 * np.sin(np.add.outer(np.arange(96), 0.5 * np.arange(108)) / 9)
    file = io.BytesIO()
    Image.fromarray(waves.astype(np.uint8)).save(file, "JPEG", quality=60)
    eia = Bundle.from_upload("eia.jpg", file.getvalue())
    notes = {model: run(eia, pixels=(6, 6), model=model)[1]["notes"] for model in ("none", "bicubic", "auto")}
    notes["open, as displays and inspections do"] = Input(eia).open(Options(pixels=(6, 6)), "all").notes
    assert {model: any("JPEG" in note for note in found) for model, found in notes.items()} == {
        "none": False,
        "bicubic": True,
        "auto": True,
        "open, as displays and inspections do": False,
    }


@pytest.mark.parametrize(("channels", "dtype"), [(2, np.uint8), (4, np.uint8), (4, np.uint16)])
def test_alpha_that_is_full_everywhere_is_kept_and_no_hindrance(stand_in, channels, dtype):
    eia = make_picture(24, 42, channels, dtype)
    eia[..., -1] = np.iinfo(dtype).max
    views, report = run(Bundle.from_upload("eia.png", encode_png(eia)), lenses=(4, 7), views="cross")
    assert report["plan"]["model"] == "field"
    plain, _ = run(Bundle.from_upload("eia.png", encode_png(eia[..., :-1])), lenses=(4, 7), views="cross")
    for view, picture in views.items():
        np.testing.assert_array_equal(picture[..., :-1], plain[view])
        assert (picture[..., -1] == np.iinfo(dtype).max).all()
    eia[3, 5, -1] -= 1
    _, report = run(Bundle.from_upload("eia.png", encode_png(eia)), lenses=(4, 7), views="cross")
    assert report["plan"]["model"] == "quality"


@pytest.mark.parametrize("pixels", [1, 2000, 4_000_000])
def test_a_mesh_is_rendered_once_whatever_the_batches(cube, stand_in, own_views, monkeypatch, pixels):
    plain, _ = run(cube, views="all", model="none", **MESH)
    field = as_array(plain, (5, 6))
    monkeypatch.setattr(schedule, "BATCH_PIXELS", pixels)
    rendered = []
    make = view_sources.MeshViews.make_views
    monkeypatch.setattr(
        view_sources.MeshViews, "make_views", lambda self, views: make(self, rendered.extend(views) or views)
    )
    views, report = run(cube, views="all", **MESH)
    assert sorted(rendered) == sorted(plain)
    assert report["plan"]["model"] == "field"
    assert list(views) == list(plain)
    for view, picture in views.items():
        assert np.abs(picture - upscale_as_stand_in(field, view)).max() < ROUNDED


@pytest.mark.parametrize("options", [{"model": "bicubic"}, {"model": "fast", "sampling": "lenslet"}])
def test_upscaled_views_stay_within_the_bits_of_the_camera(options):
    """Else they would count as views of a camera of 12 bits, and be shown a quarter as bright."""
    views = np.random.default_rng(0).integers(0, 2, (2, 2, 24, 24, 3), np.uint16).repeat(2, 2).repeat(2, 3) * 1023
    writer = MemoryWriter()
    reconstruct(LightField(views), Options(views="all", **options), writer)
    assert {picture.max() for picture in writer.views.values()} == {1023}


def test_views_are_dropped(cube, stand_in, monkeypatch):
    """The last view's window is what is left of 30 views by then."""
    monkeypatch.setattr(schedule, "BATCH_PIXELS", 1)
    kept = []
    opened = pipeline.load_upscaler

    def noted(plan, grid, **options):
        upscale = opened(plan, grid, **options)
        return lambda views, wanted: kept.append(len(views)) or upscale(views, wanted)

    monkeypatch.setattr(pipeline, "load_upscaler", noted)
    for model in ("auto", "bicubic"):
        run(cube, views="all", model=model, **MESH)
    assert len(kept) == 2 * 30
    assert kept[29] == 25
    assert set(kept[30:]) == {1}


def test_of_a_mesh_only_the_views_around_are_rendered(cube, stand_in, own_views, monkeypatch):
    rendered = []
    make = view_sources.MeshViews.make_views
    monkeypatch.setattr(
        view_sources.MeshViews, "make_views", lambda self, views: make(self, rendered.extend(views) or views)
    )
    _, report = run(cube, views="0,5", neighbour_time=0.0, **MESH)
    assert report["plan"]["model"] == "quality"
    assert "24 more views rendered" in report["plan"]["reasons"][0]
    assert rendered == [(0, 5)]
    for model, words in (("auto", "24 more are rendered"), ("field", "24 of them")):
        rendered.clear()
        views, report = run(cube, views="0,5", model=model, **MESH)
        assert sorted(rendered) == [(v, u) for v in range(5) for u in range(1, 6)]
        assert words in report["plan"]["reasons"][0]
    assert [(view["v"], view["u"]) for view in report["views"]] == [(0, 5)] == list(views)
    plain, _ = run(cube, views="all", model="none", **MESH)
    assert np.abs(views[0, 5] - upscale_as_stand_in(as_array(plain, (5, 6)), (0, 5))).max() < ROUNDED


def test_views_that_only_help_count_for_the_limit(cube, stand_in):
    options = Options(views="0,5", model="field", **MESH)
    reconstruct(cube, options, MemoryWriter(), max_pixels=25 * 120)
    with pytest.raises(TooLarge, match="25 views of 120 samples each, 24 of them around"):
        reconstruct(cube, options, MemoryWriter(), max_pixels=25 * 120 - 1)


def test_other_scales_and_single_pictures_are_refused(stand_in):
    eia = Bundle.from_upload("eia.png", EIA_PNG)
    with pytest.raises(UnsupportedScale, match="field upscales by 2, not 3"):
        run(eia, lenses=(6, 9), model="field", scale=3)
    with pytest.raises(UnsuitedModel, match="field"):
        upscale_files({"a.png": EIA_PNG}, {"a.png": "a.png"}, print, model="field", scale=2)


def test_the_fallback_share_is_noted(stand_in):
    eia = Bundle.from_upload("eia.png", EIA_PNG)
    _, report = run(eia, lenses=(6, 9))
    assert report["notes"] == []
    assert [view["fallback"] for view in report["views"]] == [0.0]
    stand_in.uncertainty = 1.1
    _, report = run(eia, lenses=(6, 9))
    (note,) = report["notes"]
    assert note.startswith(
        "100 % of the pixels were made by quality from their view alone: the neighbouring views don't match there "
        "(another scene, "
    )
    (reason,) = (why for why in report["plan"]["reasons"] if "bicubic" in why)
    assert reason.startswith("the view is a mean with bicubic interpolation (")
    assert "because what quality made doesn't fit it" in reason
    assert [view["fallback"] for view in report["views"]] == [1.0]
    _, report = run(eia, lenses=(6, 9), model="fast")
    assert "fallback" not in report["views"][0]


def test_the_fallback_share_of_one_of_many_views_is_noted():
    finished = [Finishing(), Finishing(fallback=0.42), Finishing(fallback=0.1), *[Finishing()] * 20]
    (note,) = fallback_notes(finished, of_mesh=False)
    assert note.startswith("in 1 of 23 views, up to 42 % of the pixels were made by ")
    assert fallback_notes(finished[2:], of_mesh=False) == []


def test_misaligned_views_are_noted_and_do_not_count_for_the_share():
    finished = [Finishing(fallback=1.0, misalignment=0.4)] * 3 + [Finishing()] * 7
    (note,) = fallback_notes(finished, of_mesh=False)
    assert note.startswith("3 of 10 views were upscaled alone, by quality")
    assert "about 0.4 pixels from where they should be" in note
    assert len(fallback_notes([*finished, *[Finishing(fallback=1.0)] * 5], of_mesh=False)) == 2


def test_the_fallback_share_of_a_mesh_is_noted_with_its_own_causes(cube, stand_in):
    stand_in.uncertainty = 1.1
    _, report = run(cube, views="center", model="field", **MESH)
    (note,) = report["notes"]
    assert note.endswith("the neighbouring views don't match there (too few lenses, or depths too far apart)")


@pytest.mark.parametrize(
    ("found", "expected"),
    [
        (None, []),
        (Sampling("means", 1, 0, 0), []),
        (Sampling("means", 1, 0.5, 0), ["are brought closer to what was seen"]),
        (Sampling("filter", 1, 0, 0), ["are means of the results of field and quality"]),
        (Sampling("filter", 1, 1, 0), ["are means of the results of field and quality", "are brought closer"]),
    ],
)
def test_the_report_says_what_follows_from_the_sampling(stand_in, monkeypatch, found, expected):
    monkeypatch.setattr("ciir.models.light_field.views.find_sampling", lambda *_: Finding(found))
    eia = Bundle.from_upload("eia.png", EIA_PNG)
    for options, parts in (({}, expected), ({"sampling": "lenslet"}, []), ({"model": "fast"}, [])):
        _, report = run(eia, lenses=(6, 9), **options)
        said = [why for why in report["plan"]["reasons"] if why.startswith("views ")]
        assert len(said) == len(parts)
        assert all(part in why for part, why in zip(parts, said, strict=True))


def test_the_network_that_is_shipped():
    views, report = run(Bundle.from_upload("eia.png", EIA_PNG), lenses=(6, 9), views="0,0;1,2")
    assert report["plan"]["model"] == catalogue.light_field_default_name()
    assert report["model"]["fallback"]["name"] == catalogue.prefer_int8("quality")
    assert views[1, 2].shape == (12, 18, 3)
    assert len(report["model"]["sha256"]) == 64


def test_views_apart_help_where_content_hardly_moves(stand_in, monkeypatch):
    """A textured plane that moves by an eighth of a pixel: every second of 10x10 views makes up a window."""
    monkeypatch.setattr(
        "ciir.models.light_field.views.find_sampling", lambda *_: Finding(None)
    )  # what the stand-in lacks
    texture = gaussian_filter(np.random.default_rng(3).random((96, 96)), 1.5)
    texture = 40 + 170 * (texture - texture.min()) / np.ptp(texture)
    views = np.array([[shift(texture, (v / 8, u / 8), mode="reflect") for u in range(10)] for v in range(10)])
    field = views.round().astype(np.uint8)[..., np.newaxis]
    made, report = run(LightField(field), views="4,5;3,0", model="auto")
    for (v, u), picture in made.items():
        apart = field[v % 2 :: 2, u % 2 :: 2]
        assert np.abs(picture - upscale_as_stand_in(apart, (v // 2, u // 2))).max() < ROUNDED
    assert "views 2 apart are used" in report["plan"]["reasons"][0]
