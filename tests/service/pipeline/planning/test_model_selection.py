"""Which model upscales what, and the reason in the report."""

from dataclasses import replace

import pytest

from ciir.models import catalogue, processor
from ciir.models.catalogue import FALLBACK, LIGHT_FIELD_DEFAULT
from ciir.renderer.light_field import LightField
from ciir.renderer.view_order.evidence import ORDERS
from ciir.service.pipeline.job import resolve_job
from ciir.service.pipeline.options import Options
from ciir.service.pipeline.planning import model_selection
from ciir.service.pipeline.planning.model_selection import select_model
from tests.support.light_fields import make_views, put_in
from tests.support.pipeline import make_light_field_job, make_mesh_job

ALL = [(v, u) for v in range(4) for u in range(5)]


def pictures(model="auto", *, grid=(4, 5), **options):
    return select_model(make_light_field_job(model=model, grid=grid, **options))


def mesh(model="auto", *, grid=(4, 5), wanted=ALL, **options):
    return select_model(make_mesh_job(model=model, grid=grid, wanted=wanted, **options))


def goes_one_by_one(choice, *words):
    (reason,) = choice.reasons
    assert (choice.model, choice.is_light_field) == (FALLBACK, False)
    assert all(word in reason for word in (FALLBACK, *words)), reason
    return True


@pytest.mark.parametrize("options", [{}, {"grid": (3, 3)}, {"grid": (3, 17)}])
def test_pictures_on_a_grid_help_one_another(stand_in, options):
    choice = pictures(**options)
    assert (choice.model, choice.is_light_field) == (LIGHT_FIELD_DEFAULT, True)
    assert choice.reasons[0].startswith("model auto: field, as the ")


@pytest.mark.parametrize("grid", [(1, 1), (2, 9), (9, 2)])
@pytest.mark.parametrize("model", ["auto", LIGHT_FIELD_DEFAULT])
def test_few_views_go_one_by_one(stand_in, grid, model):
    assert goes_one_by_one(pictures(model, grid=grid), f"{grid[0]}x{grid[1]} views", "3x3")
    assert goes_one_by_one(mesh(model, grid=grid, wanted=[(0, 0)]), f"{grid[0]}x{grid[1]} views")


@pytest.mark.parametrize("model", ["auto", LIGHT_FIELD_DEFAULT])
def test_views_with_transparency_go_one_by_one(stand_in, model):
    assert goes_one_by_one(pictures(model, is_transparent=True), "transparency")


def test_auto_leaves_other_scales_to_the_default_and_its_error(stand_in):
    assert goes_one_by_one(pictures(scale=3), "field upscales by 2 only")
    assert pictures(LIGHT_FIELD_DEFAULT, scale=3).model == LIGHT_FIELD_DEFAULT  # whose loading says what it upscales by


def test_a_mesh_whose_views_are_all_wanted(stand_in):
    assert (mesh().model, mesh().is_light_field) == (LIGHT_FIELD_DEFAULT, True)
    assert mesh(wanted=ALL[::-1]).model == LIGHT_FIELD_DEFAULT


@pytest.fixture
def extra(monkeypatch):
    """Sets the milliseconds that the neighbouring views take, as predicted."""

    def put(ms):
        monkeypatch.setattr(model_selection, "predict_extra", lambda *_, **__: ms)

    return put


@pytest.fixture(autouse=True)
def own_views(monkeypatch, request):
    """Has the lens array's own views help those of a mesh, unless a test asks for `moved`."""
    if "moved" not in request.fixturenames:
        monkeypatch.setattr(model_selection, "is_possible", lambda *_: False)


@pytest.fixture
def moved():
    """Lets the lens array be moved."""


@pytest.mark.parametrize("sampling", ["pinhole", "lenslet"])
def test_auto_renders_the_views_around_those_of_a_mesh(stand_in, extra, sampling):
    extra(82.4)
    choice = mesh(wanted=[(0, 0)], sampling=sampling)
    assert (choice.model, choice.is_light_field, choice.note) == (LIGHT_FIELD_DEFAULT, True, "")
    assert choice.reasons[0].startswith(
        "model auto: field, as the 4x5 views help each other; 19 more are rendered around those asked for: "
        "about 82 ms more than quality alone on a typical machine, and neighbour_time allows 1000 ms"
    )
    assert "1 more are rendered" in mesh(wanted=ALL[1:], sampling=sampling).reasons[0]


def test_auto_renders_none_where_that_takes_longer_than_the_neighbour_time(stand_in, extra):
    extra(1000.6)
    words = "19 more views rendered", "about 1001 ms more than quality", "allows 1000"
    assert goes_one_by_one(mesh(wanted=[(0, 0)]), *words)
    assert mesh(wanted=[(0, 0)], neighbour_time=1.1).is_light_field
    extra(0.0)
    assert mesh(wanted=[(0, 0)]).is_light_field
    assert goes_one_by_one(mesh(wanted=[(0, 0)], neighbour_time=0.0), "19 more views", "neighbour_time 0 allows none")
    assert mesh(neighbour_time=0.0).is_light_field  # all are wanted


def test_auto_keeps_to_the_limit_on_samples(stand_in, extra):
    extra(0.0)
    limit = {"wanted": [(0, 0)], "lenses": (10, 10), "max_pixels": 2000}
    assert mesh(**limit).is_light_field
    assert goes_one_by_one(mesh(**limit | {"max_pixels": 1999}), "19 more views", "1 samples over the limit")


@pytest.mark.parametrize("order", ORDERS)
def test_views_in_a_wrong_order_are_noted(stand_in, order):
    views = put_in(order, make_views())

    def choose(model="auto", *, is_ordered=False):
        content = LightField(views, is_ordered=is_ordered)
        return select_model(resolve_job("a.png", content, Options(model=model), max_views=25))

    for model in ("auto", LIGHT_FIELD_DEFAULT):
        assert choose(model).is_light_field
        note = choose(model).note
        assert note == "" if order == "as given" else note.startswith(f"order: the views seem to be {order}, ")
        assert choose(model, is_ordered=True).note == ""
    assert (choose("bicubic").model, choose("bicubic").note) == ("bicubic", "")


def test_exchanged_views_are_noted(stand_in):
    views = make_views()
    views[2, [1, 3]] = views[2, [3, 1]]
    note = select_model(resolve_job("a.png", LightField(views), Options(), max_views=25)).note
    assert note.startswith("order: around the centre the views seem to be reversed in every other row")


def test_a_light_field_network_that_is_named_has_the_views_around_rendered(stand_in):
    choice = mesh(LIGHT_FIELD_DEFAULT, wanted=[(0, 0), (0, 1)])
    assert (choice.model, choice.is_light_field) == (LIGHT_FIELD_DEFAULT, True)
    assert "18 of them" in choice.reasons[0]
    assert mesh(LIGHT_FIELD_DEFAULT).reasons == pictures(LIGHT_FIELD_DEFAULT).reasons == ()


@pytest.mark.parametrize("model", ["auto", LIGHT_FIELD_DEFAULT])
def test_the_lens_array_is_moved_if_that_takes_no_longer_than_the_neighbour_time(stand_in, extra, moved, model):
    extra(700.0)
    choice = mesh(model, wanted=[(0, 0), (3, 4)])
    assert choice.moves_array
    assert "; each view is rendered through the lens array at 5x5 positions: about 700 ms more" in choice.reasons[0]
    assert mesh(model).moves_array
    assert all(mesh(model, grid=grid, wanted=[(0, 0)]).moves_array for grid in ((1, 1), (1, 9), (9, 2)))
    assert not mesh(model, wanted=[(0, 0)], neighbour_time=0.6).moves_array
    assert not mesh(model, neighbour_time=0.0).moves_array
    assert mesh(model, neighbour_time=0.0).is_light_field  # all are wanted, and help each other
    assert not pictures(model).moves_array


def test_the_lens_array_is_not_moved_for_another_scale(stand_in, extra, moved):
    extra(0.0)
    assert not mesh(LIGHT_FIELD_DEFAULT, scale=3).moves_array  # whose loading says what it upscales by


def test_a_moved_lens_array_keeps_to_the_limits_on_samples(stand_in, extra, moved):
    """Two frames of two views of 12x12 lenses with 25 samples each."""
    extra(0.0)
    limit = {"lenses": (10, 10), "wanted": ALL[:2]}
    for frames in (1, 2):
        most = frames * 2 * 12 * 12 * 25
        for max_pixels, moves in ((most, True), (most - 1, False)):
            job = make_mesh_job(model="auto", grid=(4, 5), max_pixels=max_pixels, **limit)
            assert select_model(replace(job, frames=frames)).moves_array == moves
    assert not mesh(lenses=(2000, 2000), wanted=[(0, 0)]).moves_array  # over 64 million samples in one view


def test_other_models_are_taken_at_their_word(stand_in):
    for model in ("none", "bicubic", "fast"):
        for choice in (pictures(model), mesh(model)):
            assert (choice.model, choice.is_light_field, choice.reasons) == (model, False, ())


def test_an_installation_without_the_light_field_network(stand_in, monkeypatch):
    singles = [entry for entry in catalogue.list_entries() if not entry.is_light_field]
    monkeypatch.setattr(catalogue, "list_entries", lambda: singles)
    assert goes_one_by_one(pictures(), "not installed")


@pytest.mark.parametrize(("against", "twin", "why"), [("", "-int8", "int8"), ("it is too old", "", "it is too old")])
def test_auto_takes_the_int8_twins_where_the_processor_is_made_for_them(monkeypatch, against, twin, why):
    monkeypatch.setattr(processor, "int8_unsupported_reason", lambda: against)
    for choice, model in (
        (pictures(), LIGHT_FIELD_DEFAULT),
        (pictures(grid=(2, 2)), FALLBACK),
        (mesh(wanted=[(0, 0)], neighbour_time=0.0), FALLBACK),
    ):
        assert choice.model == model + twin
        assert choice.reasons[0].startswith(f"model auto: {model}{twin}, ")
        assert choice.reasons[0].endswith(f"{why}{', which this processor supports' if twin else ''}")
    assert pictures(LIGHT_FIELD_DEFAULT, grid=(2, 2)).model == FALLBACK + twin
    assert pictures(LIGHT_FIELD_DEFAULT).model == LIGHT_FIELD_DEFAULT
    assert pictures("fast").model == "fast"
