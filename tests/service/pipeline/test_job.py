import pytest

from ciir.errors import InvalidOption, TooLarge, UnknownModel
from ciir.service.pipeline.job import resolve_array, resolve_job
from ciir.service.pipeline.options import Options
from tests.support.pipeline import make_light_field_job, make_mesh_job


@pytest.mark.parametrize("strategy", ["upscale", "direct", "auto"])
def test_an_unknown_model_is_an_error_with_every_strategy(strategy):
    with pytest.raises(UnknownModel, match=r"no 'gpt' here; give one of .*nearest, auto, none$"):
        make_mesh_job(model="gpt", strategy=strategy)


@pytest.mark.parametrize(
    "options",
    [
        {"strategy": "direct"},
        {"backend": "raster"},
        {"sampling": "lenslet", "model": "none"},
        {"background": (1, 2, 3)},
        {"neighbour_time": 0.0},
    ],
)
def test_options_of_meshes_are_refused_for_pictures(options):
    with pytest.raises(InvalidOption, match=rf"{next(iter(options))}.*a\.png"):
        make_light_field_job(**options)


def test_pickup_is_refused_for_a_mesh():
    with pytest.raises(InvalidOption, match="pickup"):
        make_mesh_job(pickup="optical")


def test_an_order_is_refused_for_a_mesh():
    with pytest.raises(InvalidOption, match=r"order.*a\.glb is a mesh"):
        make_mesh_job(order="given")


def test_the_order_of_views_is_looked_for_only_where_it_is_not_known():
    assert make_mesh_job().order is None
    assert make_light_field_job().order.order == "as given"
    assert make_light_field_job(is_ordered=True).order is None


def test_too_many_views():
    job = make_light_field_job(grid=(4, 4))
    with pytest.raises(TooLarge, match="all of 4x4"):
        resolve_job("a.png", job.content, Options(views="all"), max_views=15)


def test_default_lens_array_of_a_mesh():
    array = resolve_array(Options())
    assert (array.rows, array.cols, array.pixels_v, array.pixels_u, array.pitch) == (100, 100, 15, 15, 1.0)
    assert array.delta == pytest.approx(0.4 / 15)


def test_pitch_and_delta_of_pictures_are_known_only_where_given():
    assert (make_light_field_job().pitch, make_light_field_job().delta) == (None, None)
    job = make_light_field_job(pitch=2.0, delta=0.5)
    assert (job.array.pitch, job.array.delta) == (2.0, 0.5)


def test_only_alpha_makes_a_job_transparent():
    assert make_light_field_job(is_transparent=True).is_transparent
    assert not make_light_field_job().is_transparent
    assert not make_mesh_job().is_transparent
