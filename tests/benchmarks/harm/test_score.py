import dataclasses

import numpy as np
import pytest

from ciir.benchmarks.bench.work import reconstruct_views
from ciir.benchmarks.harm import light_fields, meshes, score
from ciir.errors import UnknownModel
from ciir.models import catalogue
from ciir.renderer.scenes import load_scene

pytest.importorskip("skimage", reason="needs scikit-image, of the bench and training extras")


@pytest.fixture
def case():
    views = light_fields.draw_light_field(quick=True)
    (case,) = light_fields.list_cases("drawn", views, [light_fields.Variation("box", (5, 5))])
    return case


def make_model(name, change=0, *, is_light_field=False):
    """Bicubic interpolation, `change` levels brighter."""
    bicubic = catalogue.load_upscaler("bicubic")

    def upscale(views, at, finds_sampling=False):
        picture = score.upscale_pixels(bicubic, views[at][np.newaxis])[0]
        return np.clip(picture.astype(int) + change, 0, 255).astype(np.uint8)

    return score.Model(name, is_light_field, upscale)


def judge(model):
    return lambda case: score.Result(model.upscale(case.views, case.at), model.name, model.is_light_field)


def test_a_model_that_equals_bicubic_does_no_harm(case):
    row = score.score_case(case, [make_model("bright", 3)], judge(make_model("same")))
    assert (row.against_bicubic, row.against_single, row.is_over) == (0, None, False)
    assert row.psnr["bright"] < row.psnr["bicubic"] == row.psnr["default"]


def test_a_model_that_is_worse_than_bicubic_is_over_the_bound(case):
    row = score.score_case(case, [], judge(make_model("bright", 20)))
    assert row.is_over
    assert row.against_bicubic == row.psnr["default"] - row.psnr["bicubic"] < -1
    assert row.best_single == ""
    assert set(row.crops) == {"truth", "bicubic", "default"}
    assert np.all(row.crops["default"].mean() > row.crops["bicubic"].mean() + 10)


def test_a_light_field_network_is_compared_with_the_best_network_of_single_pictures(case):
    networks = [make_model("bright", 3), make_model("same"), make_model("field", 1, is_light_field=True)]
    row = score.score_case(case, networks, judge(make_model("field", 5, is_light_field=True)))
    assert row.best_single == "same"
    assert row.against_single == row.against_bicubic < -score.BOUND
    assert score.score_case(case, networks, judge(make_model("single", 5))).against_single is None


def test_an_exact_picture_is_no_harm(case):
    row = score.score_case(
        dataclasses.replace(case, truth=np.full_like(case.truth, 9), views=np.full_like(case.views, 9)),
        [make_model("same")],
        judge(make_model("same", is_light_field=True)),
    )
    assert (row.against_bicubic, row.against_single) == (0, 0)


@pytest.mark.parametrize("sampling", ["pinhole", "lenslet"])
@pytest.mark.parametrize("model", ["auto", catalogue.LIGHT_FIELD_DEFAULT])
def test_a_mesh_is_reconstructed_as_by_the_pipeline(model, sampling):
    cases = list(meshes.list_cases("vase", load_scene("vase"), [16], ["white"]))
    case = next(case for case in cases if case.factors["sampling"] == sampling)
    expected, report = reconstruct_views(case.source, dataclasses.replace(case.options, model=model))
    result = score.reconstruct_case(case, model)
    assert result.model == report["model"]["name"]
    assert np.array_equal(result.picture, expected[0])


@pytest.mark.parametrize("sampling", ["pinhole", "lenslet"])
def test_networks_make_what_the_pipeline_makes(case, sampling):
    case = dataclasses.replace(case, options=dataclasses.replace(case.options, sampling=sampling))
    networks, left_out = score.list_networks()
    names = {network.name for network in networks}
    assert names | set(left_out) == {entry.name for entry in catalogue.list_entries() if entry.card is not None}
    for network in networks:
        result = score.reconstruct_case(case, network.name)
        assert (result.model, result.is_light_field) == (network.name, network.is_light_field)
        assert np.array_equal(score._upscale_case(network, case), result.picture)


@pytest.mark.parametrize("name", [catalogue.DEFAULT, catalogue.LIGHT_FIELD_DEFAULT])
def test_an_exported_network_is_judged_by_its_card(name, case):
    result = score.make_subject(str(catalogue.SHIPPED / f"{name}.json"))(case)
    assert np.array_equal(result.picture, score.reconstruct_case(case, name).picture)
    assert result.is_light_field == (name == catalogue.LIGHT_FIELD_DEFAULT)


def test_an_unknown_model_is_refused():
    with pytest.raises(UnknownModel, match="gpt"):
        score.make_subject("gpt")
