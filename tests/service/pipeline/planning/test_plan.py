import pytest

from ciir.errors import UnsupportedScale
from ciir.models import processor
from ciir.models.catalogue import light_field_default_name, picture_default_name
from ciir.service.pipeline.planning.plan import make_plan
from tests.support.pipeline import make_light_field_job, make_mesh_job


def mesh(**options):
    return make_plan(make_mesh_job(**options))


def pictures(**options):
    return make_plan(make_light_field_job(**options))


def test_upscaling_is_the_default():
    for made in (mesh(neighbour_time=0.0), pictures()):
        assert (made.strategy, made.model, made.scale, made.samples) == ("upscale", picture_default_name(), 2, 1)
        assert (made.is_light_field, made.averages_misfits) == (False, True)
    made = mesh()
    assert (made.strategy, made.model, made.scale, made.samples) == ("upscale", light_field_default_name(), 2, 5)
    assert made.is_light_field


def test_direct_averages_over_cells_and_needs_no_model():
    made = mesh(strategy="direct", scale=3)
    assert (made.strategy, made.model, made.scale, made.samples) == ("direct", "none", 3, 4)


@pytest.mark.parametrize(
    ("make", "options", "message"),
    [
        (mesh, {"scale": 3}, "quality upscales by 2, not 3; give strategy direct, which renders the mesh that large"),
        (pictures, {"scale": 3}, "quality upscales by 2, not 3; give a supported scale, or"),
        (
            pictures,
            {"scale": 4},
            "quality upscales by 2, not 4; give .* and upscale the result again, or model bicubic",
        ),
        (pictures, {"scale": 3, "model": "quality"}, "quality upscales by 2, not 3; give a supported scale, or"),
        (mesh, {"scale": 1}, "quality upscales by 2, not 1; give model none"),
        (pictures, {"scale": 1, "model": "bicubic"}, "bicubic upscales by 2, 3, 4, 5, 6, 7, 8, not 1; give model none"),
    ],
)
def test_a_scale_that_the_model_does_not_have(monkeypatch, make, options, message):
    """The remedy is one that works for the kind of input."""
    monkeypatch.setattr(processor, "int8_unsupported_reason", lambda: "no VNNI")
    with pytest.raises(UnsupportedScale, match=message):
        make(**options)


def test_auto_says_why():
    assert pictures(strategy="auto").strategy == "upscale"
    assert any("pictures" in reason for reason in pictures(strategy="auto").reasons)


def test_without_a_model_nothing_is_enlarged():
    made = pictures(model="none", scale=4)
    assert (made.model, made.scale) == ("none", 1)
    assert made.notes == ("scale: 4 changes nothing with model none",)
    assert pictures(model="none").notes == pictures(model="none", scale=1).notes == ()
    assert any("scale" in reason for reason in made.reasons)


def test_without_a_model_auto_leaves_views_as_they_are():
    made = mesh(model="none", strategy="auto", scale=4)
    assert (made.strategy, made.model, made.scale) == ("upscale", "none", 1)


def test_a_lenslet_averages_over_its_pitch():
    assert mesh(sampling="lenslet", model="fast").samples == 4
    assert mesh(sampling="lenslet", model="field").samples == 10  # 2x2 for each of 5x5 cells
    assert mesh(sampling="pinhole", model="field").samples == 5


def test_the_sampling_of_pictures_is_found_where_it_is_unknown():
    grid = {"grid": (3, 3)}
    assert pictures(**grid).finds_sampling
    assert pictures(model="field", **grid).finds_sampling
    for made in (pictures(model="fast", **grid), pictures(sampling="lenslet", **grid), mesh(), mesh(model="field")):
        assert not made.finds_sampling


def test_networks_keep_the_means_of_lenslets():
    assert mesh(sampling="lenslet", model="fast").restores_means
    assert not mesh(sampling="pinhole", model="fast").restores_means
    assert not mesh(sampling="lenslet", model="bicubic").restores_means
