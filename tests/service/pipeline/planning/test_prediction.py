import pytest

from ciir.errors import UnsupportedScale
from ciir.models import catalogue, processor
from ciir.models.single import skipping
from ciir.renderer import backends
from ciir.renderer.framing import frame_scene
from ciir.renderer.placement import AS_GIVEN, Placement
from ciir.renderer.scenes import load_scene
from ciir.service.pipeline.job import resolve_array
from ciir.service.pipeline.options import Options
from ciir.service.pipeline.planning import plan, prediction
from tests.support.pipeline import make_mesh_job

ALL = [(v, u) for v in range(15) for u in range(15)]
NETWORKS = {entry.name: entry for entry in catalogue.list_entries()}


def select(limit=None, wanted=((7, 7),), name="vase", **options):
    """The strategy that `auto` takes for a mesh, and the reason that the report gives."""
    asked = {"strategy": "auto", "neighbour_time": 0.0} | options
    job = make_mesh_job(wanted=wanted, name=name, max_pixels=limit, **asked)
    made = plan.make_plan(job)
    return made.strategy, made.reasons[0].removeprefix("strategy auto: ")


def predict(model, *, moves_array=False, rays=10_000, **options):
    """Milliseconds of a job for the vase by both strategies, `upscale` by `model`."""
    job = make_mesh_job(**{"backend": "raytrace", "skip": "none"} | options)
    both = {"upscale": rays, "direct": 64 * rays}
    return prediction.predict_times(job, job.mesh, NETWORKS[model], both, moves_array=moves_array)


def test_the_faster_strategy_is_taken_and_both_times_are_reported(monkeypatch):
    default = catalogue.picture_default_name()
    times = {"upscale": 11.04, "direct": 6.4}
    monkeypatch.setattr(plan, "predict_times", lambda *_, **__: times)
    slower = f"upscale by {default} 11.0 ms"
    assert select() == ("direct", f"direct should take 6.4 ms on a typical machine, {slower}")
    times["upscale"] = 2.0
    faster = f"upscale by {default} should take 2.0 ms"
    assert select() == ("upscale", f"{faster} on a typical machine, direct 6.4 ms")


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({}, ("upscale", "field", True)),
        ({"sampling": "lenslet", "wanted": ALL}, ("upscale", "field", False)),
        ({"strategy": "auto"}, ("direct", "none", False)),
        ({"strategy": "auto", "sampling": "lenslet", "wanted": ALL}, ("upscale", "field", False)),
        ({"strategy": "auto", "neighbour_time": 0.0}, ("upscale", "quality", False)),
        ({"strategy": "auto", "lenses": (25, 25), "name": "hamburger"}, ("upscale", "field", True)),
    ],
)
@pytest.mark.parametrize("against", ["", "no VNNI"])
@pytest.mark.parametrize("refused", [{}, {"raster": "no OpenGL"}])
def test_auto_decides_the_same_on_every_machine(monkeypatch, options, expected, against, refused):
    monkeypatch.setattr(processor, "int8_unsupported_reason", lambda: against)
    monkeypatch.setattr(backends.selection, "_refused", refused)
    made = plan.make_plan(make_mesh_job(**options))
    assert (made.strategy, made.model.removesuffix("-int8"), made.moves_array) == expected


def test_upscaling_costs_its_multiply_adds():
    """Besides the views, which cost the same. A network costs the same in float and in int8."""
    views = predict("bicubic")["upscale"] - 10_000 * prediction.INTERPOLATION_MS
    for name in ("fast", "fast-int8", "paper"):
        macs = 4 * 10_000 * NETWORKS[name].card.macs_per_output_pixel
        assert predict(name)["upscale"] - views == pytest.approx(macs * prediction.MAC_MS)
    twice = predict("fast", wanted=[(0, 0), (1, 1)])["upscale"]
    assert predict("fast")["upscale"] < twice < 2 * predict("fast")["upscale"]  # the mesh is prepared once


def test_direct_casts_more_rays_and_has_no_network():
    few, many = predict("fast"), predict("fast", rays=20_000)
    assert many["direct"] - few["direct"] == pytest.approx(64 * (many["upscale"] - few["upscale"]))
    assert predict("paper")["direct"] == few["direct"]


def test_rendering_is_predicted_for_the_backend_that_the_job_has():
    rays = 64_000  # more than the vase has triangles
    auto, by_rays, by_opengl = (
        predict("fast", backend=name, rays=rays)["upscale"] for name in ("auto", "raytrace", "raster")
    )
    assert auto == by_opengl < by_rays
    assert predict("fast", backend="auto")["upscale"] == predict("fast")["upscale"]


def test_triangles_that_are_skipped_are_not_predicted():
    """400 rays meet few of 24,960."""
    options = {"lenses": (20, 20), "rays": 400}
    assert predict("bicubic", skip="exact", **options)["upscale"] < 0.5 * predict("bicubic", **options)["upscale"]


@pytest.mark.parametrize(("model", "lenses"), [("fast", 100), ("fast", 200), ("field", 200), ("fast", 25)])
@pytest.mark.parametrize("name", ["vase", "globe", "hamburger"])
@pytest.mark.parametrize(
    "placement", [AS_GIVEN, Placement(place=0.0, zoom=0.7), Placement(place=1.0, rotate=(90.0, 0.0, 0.0), zoom=0.5)]
)
def test_the_share_that_a_network_works_on(name, model, lenses, placement):
    """Of the middle view; boxes may be several, so the real share may be smaller, by 0.1 at most here."""
    mesh, array = load_scene(name), resolve_array(Options(lenses=(lenses, lenses)))
    card = NETWORKS[model].card
    placed = mesh.transform(frame_scene(mesh, array, placement))
    views = backends.open_backend("raytrace")[0].render_views(placed, array, [(7, 7)])
    _, boxes = skipping.find_boxes(next(iter(views))[..., :3], card.radius)
    share = sum(skipping.count_pixels(box.region) for box in boxes) / lenses**2
    assert prediction._predict_share(mesh, array, placement, card) == pytest.approx(share, abs=0.1)


def test_pixels_that_are_skipped_are_not_predicted(monkeypatch):
    monkeypatch.setattr(prediction, "_predict_share", lambda *_: 0.25)
    job, every = (make_mesh_job(skip=skip) for skip in ("exact", "none"))
    for name, share in (("fast", 0.25), ("bicubic", 1.0)):  # interpolation skips nothing
        part, whole = (prediction._predict_upscaling(each, job.mesh, NETWORKS[name]) for each in (job, every))
        assert part == pytest.approx(share * whole)


def test_a_strategy_that_is_not_possible_is_not_taken(monkeypatch):
    times = {"upscale": 1.0, "direct": 2.0}
    monkeypatch.setattr(plan, "predict_times", lambda *_, **__: times)
    assert select(scale=3) == ("direct", f"direct, as {catalogue.picture_default_name()} doesn't upscale by 3")
    times["upscale"] = 3.0
    assert select(lenses=(2000, 2000)) == (
        "upscale", f"upscale, as {2000 * 2000 * 64:,} samples for each view at the larger size are over the limit"
    )  # fmt: skip
    views = [(v, 7) for v in range(10)]
    assert select(limit=10 * 100 * 100 * 64, wanted=views)[0] == "direct"
    assert select(limit=10 * 100 * 100 * 64 - 1, wanted=views)[0] == "upscale"
    with pytest.raises(UnsupportedScale):
        select(scale=3, lenses=(2000, 2000))  # neither is possible


def test_a_light_field_network_costs_the_views_that_help():
    """24 more views of 10,000 rays; or one of 102x102x25 rays in place of one of 10,000, and as many cells are cut."""
    job = make_mesh_job(backend="raytrace", skip="none")
    given = job, job.mesh, NETWORKS["field"], NETWORKS["fast"]
    networks = predict("field", moves_array=True)["upscale"]
    own = prediction.predict_extra(*given, moves_array=False)
    moved = prediction.predict_extra(*given, moves_array=True)
    ray = (predict("fast", rays=20_000)["upscale"] - predict("fast")["upscale"]) / 10_000
    assert own > 24 * 10_000 * ray
    rest = own - 24 * (10_000 * ray + 0.046)  # what `field` takes longer than `fast`
    assert moved - rest == pytest.approx((102 * 102 * 25 - 10_000) * ray + 102 * 102 * 25 * prediction.CUT_MS)
    assert moved == pytest.approx(networks - predict("fast")["upscale"])
    assert prediction.predict_extra(*given[:2], NETWORKS["fast"], NETWORKS["paper"], moves_array=False) == 0.0
