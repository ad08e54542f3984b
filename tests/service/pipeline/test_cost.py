import json
import math
import sys

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ciir.errors import BackendUnavailable
from ciir.models import catalogue
from ciir.models.light_field.views import list_required_views
from ciir.models.single import skipping
from ciir.renderer import backends
from ciir.renderer.framing import frame_scene
from ciir.renderer.placement import AS_GIVEN, Placement
from ciir.renderer.scenes import load_scene
from ciir.service.pipeline import cache_folder, cost, plan, prediction
from ciir.service.pipeline.cost import Costs, Rendering, Stage
from ciir.service.pipeline.job import resolve_array
from ciir.service.pipeline.options import Options
from tests.support.pipeline import make_light_field_job, make_mesh_job

INTERPOLATION = {"bicubic x2, interpolation; here": 0.5}


@pytest.fixture
def path(tmp_path, monkeypatch):
    """A costs file in a folder that is not there yet, of a machine called `here`."""
    monkeypatch.setattr(cost, "machine", lambda: "here")
    return tmp_path / "new" / "costs.json"


def write(path, content):
    path.parent.mkdir(exist_ok=True)
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return Costs(path)


@pytest.fixture
def measured(monkeypatch):
    """The milliseconds that each measurement takes; a list, emptied from its end."""
    results = []
    monkeypatch.setattr(cost, "measure", lambda run: results.pop())
    return results


def bicubic(costs):
    """Milliseconds of a pixel that is interpolated."""
    return costs.upscaling("bicubic", 2, pixels=1000, views=1, batches=0).views / (1000 + cost.VIEW_PIXELS)


WORK = cost.VIEWS * (cost.SIDE**2 + cost.VIEW_PIXELS) + cost.CALL_PIXELS
"""Pixels that a measurement of a model counts."""


def test_measurements_are_kept(path, measured):
    measured += [2.0 * WORK]
    costs = Costs(path)
    assert [bicubic(costs), bicubic(costs), bicubic(Costs(path))] == pytest.approx([2.0] * 3)
    assert costs.not_kept == ""
    assert json.loads(path.read_bytes()) == {"bicubic x2, interpolation; here": 2.0}
    assert [file.name for file in path.parent.iterdir()] == ["costs.json"]


@pytest.mark.parametrize(
    "content",
    ["", "{", "[]", "3", '"x"', "{}", '{"NAME": "x"}', '{"NAME": null}', '{"NAME": NaN}', '{"NAME": -1.0}',
     '{"NAME": [1.0]}', '{"bicubic x2, interpolation; elsewhere": 1.0}', "\xff", "[" * 100_000],
)  # fmt: skip
def test_a_damaged_file_or_one_of_another_machine_is_measured_again(path, measured, content):
    costs = write(path, content.replace("NAME", next(iter(INTERPOLATION))))
    measured += [3.0 * WORK]
    assert bicubic(costs) == pytest.approx(3.0)
    assert bicubic(Costs(path)) == pytest.approx(3.0)


def test_a_folder_that_cannot_be_written_is_reported(tmp_path, measured):
    (tmp_path / "file").write_bytes(b"")
    for costs in (Costs(None), Costs(tmp_path / "file" / "costs.json")):
        measured += [1.0]
        assert bicubic(costs) == bicubic(costs)
        assert costs.not_kept
        assert "\n" not in costs.not_kept


def test_rendering_is_scaled_to_this_machine(path):
    costs = write(path, {"raytrace; here": 2.5})
    some = Rendering("raytrace", triangles=1000, rays=100, views=2)
    once, views, _ = some.typical()
    assert costs.rendering(some) == Stage(2.5 * once, 2.5 * views)


def test_opengl_is_not_started_to_be_measured(path, monkeypatch):
    monkeypatch.setattr(backends.selection, "_open", {})
    some = Rendering("raster", triangles=1000, rays=100, views=2)
    once, views, _ = some.typical()
    assert Costs(path).rendering(some) == Stage(cost.OPENGL_START_MS + once, views)
    costs = write(path, {"raster; here": 2.0})  # by a process that had it open
    assert costs.rendering(some) == Stage(cost.OPENGL_START_MS + 2 * once, 2 * views)
    monkeypatch.setattr(backends.selection, "_open", {"raster": None})
    assert costs.rendering(some) == Stage(2 * once, 2 * views)


def test_upscaling_is_linear_and_each_network_is_measured(path, measured, monkeypatch):
    monkeypatch.setattr(cost, "_upscaler", lambda model, scale: None)
    monkeypatch.setattr(cost, "count_available_cores", lambda: 4)
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    measured += [3.0 * WORK, 2.0 * WORK]
    costs = Costs(path)
    pixels = 5 * (100 + cost.VIEW_PIXELS) + 2 * cost.CALL_PIXELS
    for model, ms in (("fast", 2.0), ("field", 3.0), ("fast", 2.0)):
        assert costs.upscaling(model, 2, pixels=100, views=5, batches=2) == Stage(0.0, pytest.approx(ms * pixels), 4)
    monkeypatch.delitem(sys.modules, "onnxruntime")
    assert costs.upscaling("fast", 2, pixels=100, views=5, batches=2).once == cost.NETWORK_START_MS
    for name in json.loads(path.read_bytes()):
        (card,) = [entry.card for entry in catalogue.list_entries() if name.startswith(f"{entry.name} x2, ")]
        assert card.sha256[:12] in name


@pytest.fixture
def instant(monkeypatch):
    """Jobs cost nothing beside their stages."""
    monkeypatch.setattr(cost, "JOB_MS", 0.0)
    monkeypatch.setattr(cost, "WRITE_MS", 0.0)
    monkeypatch.setattr(cost, "count_available_cores", lambda: 2)


@pytest.mark.usefixtures("instant")
def test_the_stages_of_many_batches_overlap(monkeypatch):
    slow, light, both = Stage(1.0, 100.0), Stage(1.0, 20.0), Stage(1.0, 100.0, 2)
    assert cost.total([slow, light], 0, 10) == pytest.approx(2 + 12 + 0.9 * 100)  # as fast as the slowest
    assert cost.total([both, light], 0, 10) == pytest.approx(2 + 12 + 0.9 * 110)  # no core is left for the other
    monkeypatch.setattr(cost, "count_available_cores", lambda: 1)
    assert cost.total([slow, light], 0, 10) == pytest.approx(2 + 120)


@settings(derandomize=True, deadline=None, max_examples=100)
@given(st.lists(st.floats(0, 1e4), min_size=1, max_size=4), st.integers(1, 99), st.integers(0, 10**6))
def test_overlapping_stages_take_at_least_the_slowest_and_at_most_the_sum(given, batches, written):
    writing = written * cost.WRITE_MS
    stages = [Stage(0.0, ms) for ms in given]
    found = cost.total(stages, written, batches) - cost.JOB_MS
    assert max(*given, writing) <= found + 1e-6
    assert found <= sum(given) + writing + 1e-6  # float64: some 1e-12 of sums up to 4e4
    assert found <= cost.total(stages, written, max(1, batches - 1)) - cost.JOB_MS + 1e-6


@pytest.mark.parametrize(
    ("cores", "wall", "work", "expected"),
    [(4, 0.010, 0.020, 10), (4, 0.030, 0.030, 30), (4, 0.010, 0.080, 20), (4, 0.100, 0.050, 50), (1, 0.030, 0.030, 30)],
)
def test_other_processes_do_not_count(monkeypatch, cores, wall, work, expected):
    """They hold the cores in two rounds of three, which then take twice as long."""
    clock, runs = {"wall": 0.0, "work": 0.0}, []

    def run():
        runs.append(None)
        clock["wall"] += wall * (1 if len(runs) % 3 == 0 else 2)
        clock["work"] += work

    monkeypatch.setattr(cost.time, "perf_counter", lambda: clock["wall"])
    monkeypatch.setattr(cost.time, "process_time", lambda: clock["work"])
    monkeypatch.setattr(cost, "count_available_cores", lambda: cores)
    assert cost.measure(run) == pytest.approx(expected)
    assert len(runs) > cost.ROUNDS


@pytest.mark.parametrize("backend", ["raytrace", "raster"])
def test_a_backend_is_measured(backend, monkeypatch):
    monkeypatch.setattr(cost, "LEAST_MS", 0.0)
    try:
        assert 0 < cost._factor(backend) < math.inf
    except BackendUnavailable as error:
        pytest.skip(str(error))


@pytest.mark.parametrize(
    ("environment", "expected"),
    [
        ({"CIIR_CACHE": "/a", "XDG_CACHE_HOME": "/b", "HOME": "/c"}, "/a"),
        ({"XDG_CACHE_HOME": "/b", "HOME": "/c"}, "/b/ciir"),
        ({"HOME": "/c"}, "/c/.cache/ciir"),
    ],
)
def test_the_cache_folder(monkeypatch, environment, expected):
    for name in ("CIIR_CACHE", "XDG_CACHE_HOME", "HOME"):
        monkeypatch.delenv(name, raising=False)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    assert str(cache_folder.folder()) == expected


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
    default = catalogue.default_name()
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
    assert select(scale=3) == ("direct", f"direct, as {catalogue.default_name()} doesn't upscale by 3")
    prices(pixel=1e9)
    assert select(lenses=(2000, 2000)) == (
        "upscale", f"upscale, as {2000 * 2000 * 64:,} samples for each view at the larger size are over the limit"
    )  # fmt: skip
    views = [(v, 7) for v in range(10)]
    assert select(limit=10 * 100 * 100 * 64, wanted=views)[0] == "direct"
    assert select(limit=10 * 100 * 100 * 64 - 1, wanted=views)[0] == "upscale"
    assert select(scale=3, lenses=(2000, 2000))[0] == "upscale"  # neither is possible; the pipeline reports why


@pytest.mark.parametrize(
    ("bound", "measured"),
    [(0.0, [False]), (7.0, [False]), (10.0, [False, True]), (70.0, [False, True]), (80.0, [False])],
)
def test_what_a_light_field_network_costs_more_is_measured_only_where_it_is_close(prices, monkeypatch, bound, measured):
    typical, here, asked = prices(pixel=1e-3), Prices(pixel=2e-3), []
    monkeypatch.setattr(cost, "costs", lambda *, measure=True: asked.append(measure) or (here if measure else typical))
    job = make_mesh_job(backend="raytrace")
    networks = {entry.name: entry for entry in catalogue.list_entries()}
    extra = prediction.predict_extra(job, job.mesh, networks["field"], networks["fast"], bound=bound)
    assert extra == pytest.approx(24.0)  # 24 views of 10,000 rays; the networks cost the same here
    assert asked == measured


def test_typical_costs_are_taken_where_nothing_is_measured(path, measured):
    costs = Costs(path, measure=False)
    networks = {entry.name: entry.card for entry in catalogue.list_entries()}
    ms = {}
    for name in ("fast", "field", "fast-int8", "bicubic"):
        ms[name] = costs.upscaling(name, 2, pixels=1000, views=1, batches=0).views / (1000 + cost.VIEW_PIXELS)
    assert ms["bicubic"] == cost.TYPICAL_INTERPOLATION_MS
    assert ms["field"] == pytest.approx(4 * networks["field"].macs_per_output_pixel * cost.TYPICAL_MAC_MS["float32"])
    assert ms["fast-int8"] < ms["fast"] < ms["field"]
    some = Rendering("raytrace", triangles=1000, rays=100, views=2)
    assert costs.rendering(some) == some.typical()
    assert not path.exists()
    kept = write(path, INTERPOLATION)
    assert bicubic(Costs(path, measure=False)) == bicubic(kept) == pytest.approx(0.5)


def test_costs_that_cannot_be_kept_are_reported(prices):
    prices().not_kept = "the disk is full"
    assert select()[1].endswith("; the measurements behind this could not be kept: the disk is full")
