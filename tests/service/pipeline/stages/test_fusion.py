"""Fusion in the pipeline, with the shipped networks."""

import io
import zipfile

import numpy as np
import pytest
from PIL import Image

from ciir.renderer.light_field import LightField
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.view_order.estimate import OrderEstimate
from ciir.renderer.writers.pictures import encode_png
from ciir.service.pipeline.stages.view_sources import LightFieldViews
from tests.support.inputs import CUBE
from tests.support.pipeline import run

MEANS, FILTERED = Image.Resampling.BOX, Image.Resampling.BICUBIC


@pytest.fixture(scope="module")
def fine():
    """7x7 views of 64x48 pixels, (v, u) -> picture: texture that moves by a pixel from one view to the next."""
    random = np.random.default_rng(0)
    pixels = random.integers(0, 256, (24, 19, 3), np.uint8).repeat(3, axis=0).repeat(3, axis=1)
    return {(v, u): pixels[7 - v : 71 - v, 7 - u : 55 - u] for v in range(7) for u in range(7)}


def make_small(fine, way):
    return {view: np.asarray(Image.fromarray(picture).resize((24, 32), way)) for view, picture in fine.items()}


def make_zip(views):
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w") as archive:
        for (v, u), picture in views.items():
            archive.writestr(f"{v}_{u}.png", encode_png(picture))
    return Bundle.from_upload("views.zip", data.getvalue())


def make_array(views, kind, **options):
    stacked = np.array([[views[v, u] for u in range(7)] for v in range(7)])
    data = io.BytesIO()
    Image.fromarray(LightField(stacked).eia().astype(np.uint8)).save(data, kind, **options)
    return Bundle.from_upload(f"array.{kind}", data.getvalue())


def find_fusion(report):
    return [reason for reason in report["plan"]["reasons"] if reason.startswith("fusion")]


def test_filtered_views_are_fused(fine, monkeypatch):
    fetched = []
    fetch = LightFieldViews.fetch_views
    monkeypatch.setattr(LightFieldViews, "fetch_views", lambda self, views: fetched.append(views) or fetch(self, views))
    views, report = run(make_zip(make_small(fine, FILTERED)), model="field", views="3,3;0,0")
    (reason,) = find_fusion(report)
    assert reason == "fusion: 2 of 2 views are means with the upscaled views around them, as they look filtered"
    never, without = run(make_zip(make_small(fine, FILTERED)), model="field", views="3,3;0,0", fusion="never")
    assert find_fusion(without) == []
    for view in views:
        truth = fine[view].astype(int)
        assert np.std(views[view] - truth) < np.std(never[view] - truth)
    alone, _ = run(make_zip(make_small(fine, FILTERED)), model="field", views="0,0")
    assert np.array_equal(alone[0, 0], views[0, 0])


def test_views_that_are_not_fused_need_no_others(fine, monkeypatch):
    decoded = []
    fetch = LightFieldViews.fetch_views
    monkeypatch.setattr(LightFieldViews, "fetch_views", lambda self, views: decoded.extend(views) or fetch(self, views))
    _, report = run(make_zip(make_small(fine, MEANS)), model="field")
    assert find_fusion(report) == []
    assert sorted(decoded) == [(v, u) for v in range(1, 6) for u in range(1, 6)]


def test_views_of_a_jpeg_array_are_fused(fine):
    small = make_small(fine, MEANS)
    seen = {}
    for fusion in ("auto", "never"):
        views, report = run(make_array(small, "jpeg", quality=60), pixels=(7, 7), model="field", fusion=fusion)
        seen[fusion] = np.std(views[3, 3] - fine[3, 3].astype(int))
        assert len(find_fusion(report)) == (fusion == "auto")
    assert find_fusion(run(make_array(small, "jpeg", quality=60), pixels=(7, 7), model="field")[1]) == [
        "fusion: 1 of 1 views are means with the upscaled views around them, as the array is a JPEG"
    ]
    assert seen["auto"] < seen["never"]
    assert find_fusion(run(make_array(small, "png"), pixels=(7, 7), model="field")[1]) == []


def test_always_fuses_all_views(fine):
    _, report = run(make_array(make_small(fine, MEANS), "png"), pixels=(7, 7), model="field", fusion="always")
    assert find_fusion(report) == [
        "fusion: 1 of 1 views are means with the upscaled views around them, as fusion is always",
        "fusion: 1 of 1 views are also brought closer to what those around them saw",
    ]


def test_opaque_alpha_stays(fine):
    small = {
        view: np.concatenate([picture, np.full((*picture.shape[:2], 1), 255, np.uint8)], axis=2)
        for view, picture in make_small(fine, MEANS).items()
    }
    made, _ = run(make_zip(small), model="field", fusion="always")
    plain, _ = run(
        make_zip({view: picture[..., :3] for view, picture in small.items()}), model="field", fusion="always"
    )
    assert np.array_equal(made[3, 3][..., :3], plain[3, 3])
    assert np.all(made[3, 3][..., 3] == 255)


def test_views_beyond_the_window_may_be_transparent(fine):
    small = {
        view: np.concatenate([picture, np.full((*picture.shape[:2], 1), 255, np.uint8)], axis=2)
        for view, picture in make_small(fine, FILTERED).items()
    }
    small[0, 0][4:8, 4:8, 3] = 0  # which view (3,3) needs only if it is fused
    _, report = run(make_zip(small), model="field")
    assert any("transparency" in note for note in report["notes"])


def test_where_fusion_changes_nothing_a_note_says_so(fine):
    for model in ("fast", "bicubic"):
        _, report = run(make_array(make_small(fine, MEANS), "png"), pixels=(7, 7), model=model, fusion="always")
        assert any(note.startswith(f"fusion: always changes nothing with {model}") for note in report["notes"])
    array = make_array(make_small(fine, MEANS), "png")
    assert (
        "fusion: always changes nothing with model none"
        in run(array, pixels=(7, 7), model="none", fusion="always")[1]["notes"]
    )
    cube = Bundle.from_upload("cube.off", CUBE)
    for fusion, notes in (("always", 1), ("never", 0)):
        _, report = run(cube, lenses=(8, 8), pixels=(3, 3), backend="raytrace", fusion=fusion)
        assert report["notes"].count("fusion: always changes nothing with a mesh") == notes


@pytest.mark.parametrize("shape", [(1, 9), (9, 1), (2, 3)])
def test_tiny_views(shape):
    views = np.random.default_rng(0).integers(0, 256, (5, 5, *shape, 3)).astype(np.uint8)
    made, _ = run(LightField(views), model="field", fusion="always")
    assert made[2, 2].shape == (2 * shape[0], 2 * shape[1], 3)


def test_views_in_a_wrong_order_are_fused_with_their_true_neighbours(fine, monkeypatch):
    estimate = OrderEstimate("transposed", 9, 9)
    monkeypatch.setattr("ciir.service.pipeline.job.estimate_order", lambda _: estimate)
    small = make_small(fine, FILTERED)
    right = np.array([[small[v, u] for u in range(7)] for v in range(7)])
    made, report = run(LightField(right.swapaxes(0, 1)), model="field", views="1,0;3,5")
    wished, _ = run(LightField(right, is_ordered=True), model="field", views="0,1;5,3")
    assert len(find_fusion(report)) == 1
    assert np.array_equal(made[1, 0], wished[0, 1])
    assert np.array_equal(made[3, 5], wished[5, 3])


def test_what_is_never_fused_needs_only_its_window(fine):
    small = {
        view: np.concatenate([picture, np.full((*picture.shape[:2], 1), 255, np.uint8)], axis=2)
        for view, picture in make_small(fine, FILTERED).items()
    }
    small[0, 0][4:8, 4:8, 3] = 0
    _, report = run(make_zip(small), model="field", fusion="never")
    assert report["plan"]["model"] == "field"


def test_large_views_are_not_fused_automatically(fine, monkeypatch):
    monkeypatch.setattr("ciir.models.light_field.fusion.views.MOST_PIXELS", 32 * 24 - 1)
    _, report = run(make_zip(make_small(fine, FILTERED)), model="field")
    (reason,) = find_fusion(report)
    assert reason == "fusion auto: no view is fused, as views of more than 767 pixels take long"
