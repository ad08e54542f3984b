import pytest

from ciir.errors import BackendUnavailable
from ciir.models import catalogue
from ciir.models.light_field.views import needed
from ciir.models.single import skip
from ciir.renderer import backends
from ciir.renderer.framing import frame
from ciir.renderer.scenes import scene
from ciir.service.pipeline import cost, plan, strategy
from ciir.service.pipeline.cost import Stage
from ciir.service.pipeline.model_selection import Job
from ciir.service.pipeline.options import Options


class Costs:
    """Prices by the ray and by the pixel, and a list of what was asked."""

    trouble = ""

    def __init__(self, **prices):
        self.prices = {"raytrace": 1e-4, "raster": 1e-5, "pixel": 1e-3, "start": 0.0, "written": 0.0} | prices
        self.asked = []

    def rendering(self, backend, mesh, *, rays, views, culls):
        self.asked.append((backend, mesh, rays, views))
        start = self.prices["start"] if backend == "raster" and not backends.is_open("raster") else 0.0
        return Stage(start, views * rays * self.prices[backend], 1.0)

    def upscaling(self, model, scale, *, pixels, views):
        self.asked.append((model, scale, pixels, views))
        return Stage(0.0, views * pixels * self.prices["pixel"], 2.0)

    def encoding(self, *, pixels, views):
        self.asked.append(("png", pixels, views))
        return Stage(0.0, views * pixels * self.prices["written"], 1.0)


@pytest.fixture
def prices(monkeypatch):
    """What makes `Costs` the process's; nothing is measured or skipped, and no OpenGL is started."""
    monkeypatch.setattr(strategy, "_seen", lambda *_: 1.0)
    monkeypatch.setattr(backends, "_open", {})
    monkeypatch.setattr(backends, "_refused", {})

    def opened(name, **_):
        backends._open[name] = object()

    monkeypatch.setattr(backends, "open_backend", opened)

    def put(**given):
        made = Costs(**given)
        monkeypatch.setattr(cost, "costs", lambda: made)
        return made

    return put


def job(wanted=((7, 7),)):
    return Job("a.glb", True, (15, 15), False, list(wanted))


def cheapest(limit=None, wanted=((7, 7),), **options):
    return strategy.cheapest(Options(**options), job(wanted), scene("vase"), limit)


def test_the_cheaper_one_is_taken_and_both_prices_are_told(prices):
    prices(pixel=1e-3)  # 10,000 pixels: 10 ms and 1 ms of rays, against 640,000 samples: 6.4 ms
    taken, reason = cheapest()
    assert (taken, reason) == ("direct", f"direct is to take 6.4 ms here, upscale by {catalogue.default()} 11.0 ms")
    prices(pixel=1e-4)
    taken, reason = cheapest()
    assert (taken, reason) == ("upscale", f"upscale by {catalogue.default()} is to take 2.0 ms here, direct 6.4 ms")


def test_what_is_asked_for_is_what_is_priced(prices):
    costs = prices()
    cheapest(lenses=(20, 30), scale=2, sampling="lenslet", model="paper", backend="raytrace", wanted=[(0, 0), (1, 1)])
    mesh = scene("vase")
    assert set(costs.asked) == {
        ("paper", 2, 600, 2),
        ("raytrace", mesh, 600 * 16, 2),
        ("raytrace", mesh, 600 * 64, 2),
        ("png", 2400, 2),
    }
    costs = prices()
    cheapest(lenses=(20, 30), model="field", backend="raytrace")
    further = len(needed([(7, 7)], (15, 15)))
    assert {("field", 2, 600, 1), ("raytrace", mesh, 600, further)} < set(costs.asked)


def test_stages_overlap_where_views_are_many(prices, monkeypatch):
    """100 views of 40,000 pixels, 12 a turn. Rays of pinholes, 1 ms a view, hide behind a network of 10 ms a view that
    leaves them no core: 1,000 ms, half of 100 for sharing, half of 100 more of the first of 9 turns."""
    monkeypatch.setattr(strategy, "available_cores", lambda: 2)
    views = [divmod(number, 15) for number in range(100)]
    prices(raster=1e-9)
    assert f"upscale by fast-int8 {1000 + 50 + 50 / 9:.1f} ms" in cheapest(wanted=views, model="fast-int8")[1]
    prices(written=1e-3, raster=1e-9)  # 40 ms a view, in a thread of its own: what is slowest now
    assert cheapest(wanted=views, model="fast-int8")[1].startswith("direct is to take 4000.0 ms here")


@pytest.mark.parametrize(("model", "lenses"), [("fast", 100), ("fast", 200), ("field", 200), ("fast", 25)])
@pytest.mark.parametrize("name", ["vase", "globe", "hamburger"])
def test_what_a_network_sees_is_roughly_known_before(name, model, lenses):
    """Of the middle view; boxes may be several, so what is seen is less than what one takes: 0.1 at most here."""
    mesh, options = scene(name), Options(lenses=(lenses, lenses))
    array, card = plan.mesh_array(options), strategy._entry(model).card
    views = backends.open_backend("raytrace")[0].views(mesh.transformed(frame(mesh, array)), array, [(7, 7)])
    _, boxes = skip.found(next(iter(views))[..., :3], card.radius)
    seen = sum(skip.area(box.window) for box in boxes) / lenses**2
    assert strategy._seen(mesh, array, card) == pytest.approx(seen, abs=0.1)


def test_what_a_network_need_not_see_is_not_priced(monkeypatch, prices):
    monkeypatch.setattr(strategy, "_seen", lambda *_: 0.25)
    costs = prices()
    cheapest(model="fast", lenses=(20, 20))
    assert ("fast", 2, 100, 1) in costs.asked
    costs = prices()
    cheapest(model="fast", lenses=(20, 20), skip="none")
    assert ("fast", 2, 400, 1) in costs.asked


def test_interpolation_sees_all():
    assert strategy._seen(scene("vase"), plan.mesh_array(Options()), None) == 1.0


def test_opengl_is_started_only_where_the_cheaper_one_needs_it(prices):
    prices(start=700.0)
    assert cheapest()[0] == "upscale"
    assert not backends.is_open("raster")
    prices(start=700.0, pixel=1.0)
    assert cheapest()[0] == "direct"
    assert backends.is_open("raster")


def test_where_opengl_does_not_work_rays_are_priced(prices, monkeypatch):
    def refuse(name, **_):
        backends._refused[name] = "no OpenGL"
        raise BackendUnavailable("no OpenGL")

    monkeypatch.setattr(backends, "open_backend", refuse)
    prices(pixel=3e-3)  # direct: 6 ms by OpenGL, 64 by rays; upscale: 31
    taken, reason = cheapest()
    assert (taken, "direct 64.0 ms" in reason) == ("upscale", True)


def test_what_can_not_be_done_is_not_taken(prices):
    prices(pixel=1e-9)
    taken, reason = cheapest(scale=3)
    assert (taken, reason) == ("direct", f"direct, as {catalogue.default()} doesn't upscale by 3")
    prices(pixel=1e9)
    taken, reason = cheapest(lenses=(2000, 2000))
    assert (taken, reason) == (
        "upscale", f"upscale, as {2000 * 2000 * 64:,} samples for each view at the larger size are over the limit"
    )  # fmt: skip
    views = [(v, 7) for v in range(10)]
    assert cheapest(limit=10 * 100 * 100 * 64, wanted=views)[0] == "direct"
    assert cheapest(limit=10 * 100 * 100 * 64 - 1, wanted=views)[0] == "upscale"
    assert cheapest(scale=3, lenses=(2000, 2000))[0] == "upscale"  # neither can be done; the pipeline says why


def test_costs_that_are_not_kept_are_told_of(prices):
    prices().trouble = "the disk is full"
    assert cheapest()[1].endswith("; what was measured for it is not kept, as the disk is full")


def test_the_plan_tells_it(prices):
    prices(pixel=1.0)
    made = plan.make(Options(strategy="auto"), job(), mesh=scene("vase"))
    assert (made.strategy, made.enlarge, made.samples) == ("direct", 2, 4)
    assert made.reasons[0].startswith("strategy auto: direct is to take 6.4 ms here")
