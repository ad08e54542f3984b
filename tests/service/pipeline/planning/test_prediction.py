import math
from dataclasses import replace

import pytest

from ciir.errors import BackendUnavailable, UnsupportedScale
from ciir.models import catalogue
from ciir.models.light_field.windows import list_required_views
from ciir.models.single import skipping
from ciir.renderer import backends
from ciir.renderer.framing import frame_scene
from ciir.renderer.placement import AS_GIVEN, Placement
from ciir.renderer.scenes import load_scene
from ciir.service.pipeline.job import resolve_array
from ciir.service.pipeline.options import Options
from ciir.service.pipeline.planning import cost, plan, prediction
from ciir.service.pipeline.planning.cost import Stage
from ciir.service.pipeline.planning.plan import Plan
from tests.support.pipeline import make_light_field_job, make_mesh_job


class Prices:
    """Costs by the ray and by the pixel, and a list of what was asked for."""

    not_kept = ""

    def __init__(self, **prices):
        self.prices = {"raytrace": 1e-4, "raster": 1e-5, "pixel": 1e-3, "start": 0.0} | prices
        self.asked = []

    def rendering(self, views):
        self.asked.append((views.backend, views.triangles, views.rays, views.views))
        start = self.prices["start"] if views.backend == "raster" and not backends.is_backend_open("raster") else 0.0
        return Stage(start, views.views * views.rays * self.prices[views.backend])

    def upscaling(self, model, scale, *, pixels, views, batches):
        self.asked.append((model, scale, pixels, views, batches))
        return Stage(0.0, views * pixels * self.prices["pixel"], 2)


@pytest.fixture
def prices(monkeypatch, instant):
    """What makes `Prices` the costs of this process; nothing is measured or skipped, and no OpenGL is started."""
    monkeypatch.setattr(prediction, "_predict_share", lambda *_: 1.0)
    monkeypatch.setattr(backends.selection, "_open", {})
    monkeypatch.setattr(backends.selection, "_refused", {})

    def opened(name, **_):
        backends.selection._open[name] = object()

    monkeypatch.setattr(backends, "open_backend", opened)

    def put(**given):
        made = Prices(**given)
        monkeypatch.setattr(cost, "costs", lambda *, measure=True: made)
        return made

    return put


def select(limit=None, wanted=((7, 7),), name="vase", **options):
    """The strategy that `auto` takes for a mesh, and the reason that the report gives."""
    asked = {"strategy": "auto", "neighbour_time": 0.0} | options
    job = make_mesh_job(wanted=wanted, name=name, max_pixels=limit, **asked)
    made = plan.make_plan(job)
    return made.strategy, made.reasons[0].removeprefix("strategy auto: ")


def test_the_faster_strategy_is_taken_and_both_times_are_reported(prices):
    default = catalogue.picture_default_name()
    prices(pixel=1e-3)  # 10,000 pixels: 10 ms and 1 ms of rays, against 640,000 samples: 6.4 ms
    assert select() == ("direct", f"direct should take 6.4 ms here, upscale by {default} 11.0 ms")
    prices(pixel=1e-4)
    assert select() == ("upscale", f"upscale by {default} should take 2.0 ms here, direct 6.4 ms")


def test_the_estimate_of_a_plan_is_what_strategies_are_compared_by(prices):
    prices(pixel=1e-3)
    jobs = [make_mesh_job(neighbour_time=0.0, strategy=strategy) for strategy in ("direct", "upscale")]
    jobs += [make_mesh_job(model="none"), make_light_field_job(model="fast"), make_light_field_job(model="none")]
    pixels = math.prod(jobs[-1].lenses) * len(jobs[-1].wanted)
    expected = [6.4, 11.0, 1.0, 1e-3 * pixels, 0.0]  # of pictures nothing is rendered
    assert [prediction.predict_plan(job, plan.make_plan(job)) for job in jobs] == pytest.approx(expected)


def test_predictions_are_for_what_is_asked_for(prices):
    costs, triangles = prices(), load_scene("vase").triangles
    select(lenses=(20, 30), scale=2, sampling="lenslet", model="paper", backend="raytrace", wanted=[(0, 0), (1, 1)])
    assert set(costs.asked) == {
        ("paper", 2, 600, 2, 1),
        ("raytrace", triangles, 600 * 16, 2),
        ("raytrace", triangles, 600 * 64, 2),
    }
    costs = prices()
    select(lenses=(20, 30), model="field", backend="raytrace")
    further = len(list_required_views([(7, 7)], (15, 15)))
    assert {("field", 2, 600, 1, 1), ("raytrace", triangles, 600, further)} < set(costs.asked)


@pytest.mark.parametrize(("model", "lenses"), [("fast", 100), ("fast", 200), ("field", 200), ("fast", 25)])
@pytest.mark.parametrize("name", ["vase", "globe", "hamburger"])
@pytest.mark.parametrize(
    "placement", [AS_GIVEN, Placement(place=0.0, zoom=0.7), Placement(place=1.0, rotate=(90.0, 0.0, 0.0), zoom=0.5)]
)
def test_the_share_that_a_network_works_on(name, model, lenses, placement):
    """Of the middle view; boxes may be several, so the real share may be smaller, by 0.1 at most here."""
    mesh, array = load_scene(name), resolve_array(Options(lenses=(lenses, lenses)))
    (card,) = (entry.card for entry in catalogue.list_entries() if entry.name == model)
    placed = mesh.transform(frame_scene(mesh, array, placement))
    views = backends.open_backend("raytrace")[0].render_views(placed, array, [(7, 7)])
    _, boxes = skipping.find_boxes(next(iter(views))[..., :3], card.radius)
    share = sum(skipping.count_pixels(box.region) for box in boxes) / lenses**2
    assert prediction._predict_share(mesh, array, placement, card) == pytest.approx(share, abs=0.1)


def test_pixels_that_are_skipped_are_not_predicted(monkeypatch, prices):
    monkeypatch.setattr(prediction, "_predict_share", lambda *_: 0.25)
    for options, pixels in (({}, 100), ({"skip": "none"}, 400)):
        costs = prices()
        select(model="fast", lenses=(20, 20), **options)
        assert ("fast", 2, pixels, 1, 1) in costs.asked
    costs = prices()
    select(model="bicubic", lenses=(20, 20))  # which skips nothing
    assert ("bicubic", 2, 400, 1, 1) in costs.asked


def test_without_a_model_views_are_written_as_large_as_they_are(prices, monkeypatch):
    prices()
    written = []
    monkeypatch.setattr(cost, "total", lambda stages, pixels, batches: written.append(pixels) or 0.0)
    for model in ("none", "fast"):
        job = make_light_field_job(model=model)
        prediction.predict_plan(job, plan.make_plan(job))
    assert written == [math.prod(job.lenses) * len(job.wanted) * larger for larger in (1, 4)]


def test_opengl_is_started_only_where_the_faster_strategy_needs_it(prices):
    prices(start=700.0)
    assert select()[0] == "upscale"
    assert not backends.is_backend_open("raster")
    prices(start=700.0, pixel=1.0)
    assert select()[0] == "direct"
    assert backends.is_backend_open("raster")


def test_rays_are_predicted_where_opengl_does_not_work(prices, monkeypatch):
    def refuse(name, **_):
        backends.selection._refused[name] = "no OpenGL"
        raise BackendUnavailable("no OpenGL")

    monkeypatch.setattr(backends, "open_backend", refuse)
    prices(pixel=3e-3)  # direct: 6 ms by OpenGL, 64 by rays; upscale: 31
    taken, reason = select()
    assert (taken, "direct 64.0 ms" in reason) == ("upscale", True)


def test_a_strategy_that_is_not_possible_is_not_taken(prices):
    prices(pixel=1e-9)
    assert select(scale=3) == ("direct", f"direct, as {catalogue.picture_default_name()} doesn't upscale by 3")
    prices(pixel=1e9)
    assert select(lenses=(2000, 2000)) == (
        "upscale", f"upscale, as {2000 * 2000 * 64:,} samples for each view at the larger size are over the limit"
    )  # fmt: skip
    views = [(v, 7) for v in range(10)]
    assert select(limit=10 * 100 * 100 * 64, wanted=views)[0] == "direct"
    assert select(limit=10 * 100 * 100 * 64 - 1, wanted=views)[0] == "upscale"
    with pytest.raises(UnsupportedScale):
        select(scale=3, lenses=(2000, 2000))  # neither is possible


@pytest.mark.parametrize(
    ("bound", "measured"),
    [(0.0, [False]), (7.0, [False]), (10.0, [False, True]), (70.0, [False, True]), (80.0, [False])],
)
def test_what_a_light_field_network_costs_more_is_measured_only_where_it_is_close(prices, monkeypatch, bound, measured):
    typical, here, asked = prices(pixel=1e-3), Prices(pixel=2e-3), []
    monkeypatch.setattr(cost, "costs", lambda *, measure=True: asked.append(measure) or (here if measure else typical))
    job = make_mesh_job(backend="raytrace")
    networks = {entry.name: entry for entry in catalogue.list_entries()}
    extra = prediction.predict_extra(job, job.mesh, networks["field"], networks["fast"], moves_array=False, bound=bound)
    assert extra == pytest.approx(24.0)  # 24 views of 10,000 rays; the networks cost the same here
    assert asked == measured


def test_a_moved_lens_array_costs_its_samples(prices):
    """One view of 102x102x25 rays in place of one of 10,000, and as many cells are cut."""
    prices(pixel=1e-3)
    job = make_mesh_job(backend="raytrace")
    networks = {entry.name: entry for entry in catalogue.list_entries()}
    given = job, job.mesh, networks["field"], networks["fast"]
    own = prediction.predict_extra(*given, moves_array=False, bound=0.0)
    moved = prediction.predict_extra(*given, moves_array=True, bound=0.0)
    ray = own / (24 * 10_000)
    assert moved == pytest.approx((102 * 102 * 25 - 10_000) * ray + 102 * 102 * 25 * prediction.CUT_MS)
    plan = Plan("upscale", "field", 2, 5, is_light_field=True, moves_array=True)
    alone = prediction.predict_plan(job, Plan("upscale", "fast", 2, 1))
    assert prediction.predict_plan(job, plan) - alone == pytest.approx(moved)
    assert prediction.predict_plan(replace(job, frames=3), plan) == pytest.approx(3 * (alone + moved))


def test_costs_that_cannot_be_kept_are_reported(prices):
    prices().not_kept = "the disk is full"
    assert select()[1].endswith("; the measurements behind this could not be kept: the disk is full")
