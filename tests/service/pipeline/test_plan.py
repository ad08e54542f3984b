import pytest

from ciir.errors import InvalidOption, TooLarge, UnknownModel
from ciir.models.catalogue import default_name
from ciir.renderer.scenes import load_scene
from ciir.service.pipeline import plan
from ciir.service.pipeline.model_selection import Job
from ciir.service.pipeline.options import Options


def mesh(**options):
    return plan.make(Options(**options), Job("a.glb", True, (15, 15), False, [(7, 7)]), mesh=load_scene("vase"))


def pictures(**options):
    return plan.make(Options(**options), Job("a.png", False, (2, 9), False, [(1, 4)]))


def test_upscaling_is_the_default():
    for made in (mesh(), pictures()):
        assert (made.strategy, made.model, made.enlarge, made.samples) == ("upscale", default_name(), 2, 1)
        assert not made.is_light_field


def test_direct_averages_over_cells_and_needs_no_model():
    made = mesh(strategy="direct", scale=3)
    assert (made.strategy, made.model, made.enlarge, made.samples) == ("direct", "none", 3, 4)


def test_auto_says_why():
    assert pictures(strategy="auto").strategy == "upscale"
    assert any("pictures" in reason for reason in pictures(strategy="auto").reasons)


def test_without_a_model_nothing_is_enlarged():
    made = pictures(model="none", scale=4)
    assert (made.model, made.enlarge) == ("none", 1)
    assert any("scale" in reason for reason in made.reasons)


def test_without_a_model_auto_leaves_views_as_they_are():
    made = mesh(model="none", strategy="auto", scale=4)
    assert (made.strategy, made.model, made.enlarge) == ("upscale", "none", 1)


@pytest.mark.parametrize("strategy", ["upscale", "direct", "auto"])
def test_a_model_that_is_not_there_is_never_passed_over(strategy):
    with pytest.raises(UnknownModel, match=r"'gpt'.*none"):
        mesh(model="gpt", strategy=strategy)


def test_what_could_not_be_read_back_is_not_written():
    with pytest.raises(TooLarge, match="a side"):
        plan.check_eia(Options(lenses=(70_000, 9), pixels=(2, 2)))
    with pytest.raises(TooLarge, match="a side"):
        plan.check_size(70_000, 9, 2, 1, None)


def test_a_lenslet_averages_over_its_pitch():
    assert mesh(sampling="lenslet").samples == 4


@pytest.mark.parametrize(
    "options",
    [{"strategy": "direct"}, {"backend": "raster"}, {"sampling": "lenslet"}, {"background": (1, 2, 3)}],
)
def test_what_is_for_meshes_is_refused_for_pictures(options):
    with pytest.raises(InvalidOption, match=rf"{next(iter(options))}.*a\.png"):
        pictures(**options)


def test_pickup_is_refused_for_a_mesh():
    with pytest.raises(InvalidOption, match="pickup"):
        mesh(pickup="optical")


def test_default_lens_array_of_a_mesh():
    array = plan.mesh_array(Options())
    assert (array.rows, array.cols, array.pixels_v, array.pixels_u, array.pitch) == (100, 100, 15, 15, 1.0)
    assert array.delta == pytest.approx(0.4 / 15)


def test_the_limit_on_samples_says_how_many_views_only_help():
    plan.check_work(10_000, 25, 250_000)
    with pytest.raises(TooLarge, match=r"25 views of 10,000 samples each are 250,000.*fewer views, fewer lenses or"):
        plan.check_work(10_000, 25, 249_999)
    with pytest.raises(TooLarge, match=r"24 of them around those asked for, are 250,000.*model fast"):
        plan.check_work(10_000, 25, 249_999, further=24)
    with pytest.raises(TooLarge, match=r"fewer lenses or a smaller scale or strategy upscale$"):
        plan.check_work(10_000, 25, 249_999, "direct")


def test_limits():
    plan.check_size(100, 100, 2, 225, 225 * 40_000)
    with pytest.raises(TooLarge, match="225 views of 200x200"):
        plan.check_size(100, 100, 2, 225, 225 * 40_000 - 1)
    with pytest.raises(TooLarge, match=r"a\.png"):
        plan.check_size(4096, 4096, 2, 1, None, what="a.png")
    with pytest.raises(TooLarge, match="all of 4096x4096"):
        plan.check_views("all", (4096, 4096), 4096**2 - 1)
    plan.check_views("all", (4096, 4096), 4096**2)
    plan.check_views("center", (4096, 4096), 1)
    plan.check_views("0,0;1,1;", (4, 4), 2)
    with pytest.raises(TooLarge, match="3 are over the limit of 2; name fewer"):
        plan.check_views("0,0;1,1;2,2", (4, 4), 2)
    plan.check_samples(plan.mesh_array(Options(lenses=(2000, 2000))), 4)
    with pytest.raises(TooLarge, match=r"2001x2000.*pinhole"):
        plan.check_samples(plan.mesh_array(Options(lenses=(2001, 2000))), 4)
    with pytest.raises(TooLarge, match=r"2001x2000.*give fewer lenses or a smaller scale or strategy upscale$"):
        plan.check_samples(plan.mesh_array(Options(lenses=(2001, 2000))), 4, "direct")
    with pytest.raises(TooLarge, match="elemental"):
        plan.check_eia(Options(lenses=(1000, 1000)))
