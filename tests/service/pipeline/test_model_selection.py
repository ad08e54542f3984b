"""Which model upscales what, and the reason in the report."""

import pytest

from ciir.models import catalogue, processor
from ciir.models.catalogue import DEFAULT, LIGHT_FIELD_DEFAULT
from ciir.service.pipeline.model_selection import select_model
from tests.support.pipeline import make_light_field_job, make_mesh_job

ALL = [(v, u) for v in range(4) for u in range(5)]


def pictures(model="auto", *, grid=(4, 5), **options):
    return select_model(make_light_field_job(model=model, grid=grid, **options))


def mesh(model="auto", *, grid=(4, 5), wanted=ALL, **options):
    return select_model(make_mesh_job(model=model, grid=grid, wanted=wanted, **options))


def goes_one_by_one(choice, *words):
    (reason,) = choice.reasons
    assert (choice.model, choice.is_light_field) == (DEFAULT, False)
    assert all(word in reason for word in (DEFAULT, *words)), reason
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


def test_auto_renders_no_views_that_nobody_asked_for(stand_in):
    assert goes_one_by_one(mesh(wanted=[(0, 0)]), "8 more views rendered", "name it")
    assert goes_one_by_one(mesh(wanted=ALL[1:]), "1 more views rendered")


def test_a_light_field_network_that_is_named_has_the_views_around_rendered(stand_in):
    choice = mesh(LIGHT_FIELD_DEFAULT, wanted=[(0, 0), (0, 1)])
    assert (choice.model, choice.is_light_field) == (LIGHT_FIELD_DEFAULT, True)
    assert "10 of them" in choice.reasons[0]
    assert mesh(LIGHT_FIELD_DEFAULT).reasons == pictures(LIGHT_FIELD_DEFAULT).reasons == ()


def test_other_models_are_taken_at_their_word(stand_in):
    for model in ("none", "bicubic", DEFAULT):
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
        (pictures(grid=(2, 2)), DEFAULT),
        (mesh(wanted=[(0, 0)]), DEFAULT),
    ):
        assert choice.model == model + twin
        assert choice.reasons[0].startswith(f"model auto: {model}{twin}, ")
        assert choice.reasons[0].endswith(f"{why}{', which this processor supports' if twin else ''}")
    assert pictures(LIGHT_FIELD_DEFAULT, grid=(2, 2)).model == DEFAULT + twin
    assert pictures(LIGHT_FIELD_DEFAULT).model == LIGHT_FIELD_DEFAULT
    assert pictures(DEFAULT).model == DEFAULT
