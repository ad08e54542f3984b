"""Crops of light fields: augmentation, phase of LR and HR, corruption, and determinism."""

import itertools
from collections import Counter

import numpy as np
import pytest

pytest.importorskip("torch", reason="needs the training extra")
import torch
from PIL import Image

from ciir.models.light_field.planes import LEAST, STEP, Range, describe_window, place_planes
from ciir.models.light_field.windows import WINDOW_SIDE, select_axis
from ciir.training.data import mesh_views
from ciir.training.data.downscale import KINDS
from ciir.training.data.light_field import camera_differences, layered_scenes
from ciir.training.data.light_field import crops as data
from ciir.training.data.light_field.crops import STEPS_PER_BLOCK, LightFieldCrops
from ciir.training.data.light_field.layered_scenes import FINE, LUMA
from ciir.training.data.light_field.textures import Textures
from ciir.training.data.pictures import Pictures
from ciir.training.loop.prefetch import prefetch_batches
from ciir.training.networks.plane_sweep import PlaneSweep
from tests.training import degradations

DISPARITY = 1.0
RANGE = Range(-1.0, 1.25)
PLANES = 10
RIGHT = place_planes(RANGE, PLANES).tolist().index(DISPARITY)
TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Pictures whose details are of 10 texels."""
    folder = tmp_path_factory.mktemp("textures")
    for seed in range(3):
        knots = torch.rand(1, 3, 18, 16, generator=torch.Generator().manual_seed(seed))
        fine = torch.nn.functional.interpolate(knots, scale_factor=10, mode="bicubic", align_corners=False)
        Image.fromarray(fine[0].clamp(0, 1).mul(255).byte().permute(1, 2, 0).numpy()).save(folder / f"{seed}.png")
    return folder


@pytest.fixture
def flat(monkeypatch):
    """Scenes of one flat layer."""
    monkeypatch.setattr(layered_scenes, "LAYERS", (1, 1))
    monkeypatch.setattr(layered_scenes, "PLAIN", 0.0)
    monkeypatch.setattr(layered_scenes, "FLAT", 0.0)
    monkeypatch.setattr(
        layered_scenes,
        "_draw_disparities",
        lambda random, count, side, disparities: (np.full((count, 1), DISPARITY), np.zeros((count, 1, 2))),
    )


@pytest.fixture
def clean(monkeypatch):
    """Views that differ by nothing but their place."""
    monkeypatch.setattr(data, "differ", lambda random, image, around, own, ease: (image, around))


def crops_of(folder, **given):
    usual = {"crop": 32, "scale": 2, "batch": 3, "seed": 1, "degradations": {"box": 1}, "planes": PLANES}
    return LightFieldCrops(folder, **usual | given)


def luma(image):
    return torch.einsum("nchw,c->nhw", image, torch.tensor(LUMA))


def same(one, other):
    return all(torch.equal(a, b) for a, b in zip((*one[0], one[1]), (*other[0], other[1]), strict=True))


def find_planes(inputs):
    """The plane about which the views of each light field differ least."""
    _, spread = PlaneSweep()(inputs.around, inputs.down, inputs.across)
    return spread[:, :, 5:-5, 5:-5].mean((2, 3)).argmin(1).tolist()


def get_own(inputs):
    """The luma of the view itself: as many views are before it as the window says."""
    row, col = (int(2 * number) for number in inputs.window[[0, 2]])
    return inputs.around[:, row * WINDOW_SIDE + col]


def seeded():
    return np.random.default_rng(0)


class Drawn:
    """A generator that returns the given values."""

    def __init__(self, *values):
        self.values = list(values)

    def random(self):
        return self.values.pop(0)

    def integers(self, most):
        assert self.values[0] < most
        return self.values.pop(0)


def test_a_batch_depends_only_on_seed_and_step(folder):
    crops = crops_of(folder)
    wanted = crops.make_batch(20)
    assert same(crops_of(folder).make_batch(20), wanted)
    crops.make_batch(3)
    assert same(crops.make_batch(20), wanted)
    assert not same(crops.make_batch(21), wanted)
    assert not same(crops_of(folder, seed=2).make_batch(20), wanted)


@pytest.fixture
def made(folder, flat):
    """Makes crops of two scenes of a flat layer, of which `own` is the view's place in the window."""
    textures = Textures(Pictures(folder), torch.device("cpu"))

    def make(own):
        views, colours = layered_scenes.make_scenes(
            seeded(), textures, 2, side=24, window=WINDOW_SIDE, own=own, disparities=RANGE
        )
        image, around = (degradations.box(of, FINE) for of in (colours, views))
        return data._Batch(own, RANGE, image, around, degradations.box(colours, 2))

    return make


@pytest.mark.parametrize("turns", list(itertools.product((0.0, 0.9), repeat=3)))
def test_all_parts_are_flipped_in_the_same_way(made, turns):
    """The sweep finds the layer at its disparity, and the view itself is where rows and columns say."""
    inputs, high = data._augment(Drawn(*turns), made((1, 4)), PLANES, is_small=False)
    assert find_planes(inputs) == [RIGHT] * 2
    torch.testing.assert_close(luma(inputs.image), get_own(inputs), atol=1.01 / 255, rtol=0)  # each is rounded
    torch.testing.assert_close(degradations.box(high, 2), inputs.image, atol=1.01 / 255, rtol=0)
    down, right, swapped = (turn < 0.5 for turn in turns)
    places = [3 if down else 1, 0 if right else 4]
    axes = [select_axis(at, WINDOW_SIDE) for at in (places[::-1] if swapped else places)]
    for found, wanted in zip(inputs[2:], describe_window(*axes, RANGE, PLANES), strict=True):
        np.testing.assert_array_equal(found, wanted)


@pytest.mark.parametrize("own", [(0, 4), (1, 2), (2, 0)])
@pytest.mark.parametrize("shifts", [(0, 0), (1, 2), (2, 1)])
def test_windows_of_small_grids_are_views_around(made, own, shifts):
    """3x3 views, with the view itself in them; nothing else is left."""
    whole = made(own)
    small, _ = data._augment(Drawn(0.9, 0.9, 0.9, *shifts), whole, PLANES, is_small=True)
    assert small.window[:2].sum() == small.window[2:4].sum() == 1  # of halves: two views beside it
    assert find_planes(small) == [RIGHT] * 2
    assert torch.equal(get_own(small), whole.around[:, own[0] * WINDOW_SIDE + own[1]])
    grid = small.around.unflatten(1, (WINDOW_SIDE, WINDOW_SIDE))
    assert not grid[:, 3:].any()
    assert not grid[:, :, 3:].any()
    assert grid[:, :3, :3].flatten(3).any(3).all()


@pytest.mark.parametrize("kind", KINDS)
def test_low_is_the_degraded_truth_after_augmentation(folder, clean, kind):
    crops = crops_of(folder, degradations={kind: 1})
    for step in range(8):
        inputs, high = crops.make_batch(step)
        if kind == "point":  # of finer samples than the truth's
            aligned = (degradations.box(high, 2) - inputs.image).abs().mean()
            for shifted in (inputs.image.roll(1, 2), inputs.image.roll(1, 3)):
                assert aligned < 0.3 * (degradations.box(high, 2) - shifted).abs().mean()
            continue
        made = {"box": degradations.box, "bicubic": degradations.bicubic}[kind](high, 2)
        assert (made - inputs.image).abs().max() <= 1.01 / 255  # sums in another order may round otherwise


def test_views_around_are_degraded_in_phase_with_the_view(folder):
    crops = crops_of(folder, degradations=dict.fromkeys(KINDS, 1))
    for step in range(6):
        own, _, image, around, _ = crops._crop_scenes(np.random.default_rng(step), step)
        # Both are rounded to 8 bits three times on their way, half a level each, and the bicubic kernel's weights
        # add up to 1.5 without their signs. Where it overshoots colours are cut off one by one.
        whole = ((image > 0) & (image < 1)).all(1)
        assert (around[:, own[0] * WINDOW_SIDE + own[1]] - luma(image))[whole].abs().max() < 4.1 / 255


def test_the_view_in_its_window_is_the_luma_of_the_changed_view(folder, monkeypatch):
    monkeypatch.setattr(camera_differences, "MISMATCHED", 0.5)
    monkeypatch.setattr(camera_differences, "NOISE", (0.5, 0.1))
    monkeypatch.setattr(camera_differences, "JPEG", (0.3, 0.3, 50))
    crops = crops_of(folder)
    for step in range(8):
        inputs, _ = crops.make_batch(step)
        torch.testing.assert_close(get_own(inputs), luma(inputs.image), atol=1e-6, rtol=0)


def test_views_differ_more_and_more(folder, monkeypatch):
    """The shares of changed crops grow from 0 over the eased steps."""
    eases = []

    def record(random, image, around, own, ease):
        eases.append(ease)
        return image, around

    monkeypatch.setattr(data, "differ", record)
    crops = crops_of(folder, eased=4)
    for step in range(6):
        crops.make_batch(step)
    assert eases == [0.0, 0.25, 0.5, 0.75, 1.0, 1.0]


def test_windows_of_small_grids_reach_their_share_gradually(folder):
    crops = crops_of(folder, eased=60)
    whole = [float(crops.make_batch(step)[0].window[:4].sum()) == 4 for step in range(60)]  # 4 views beside it, twice
    assert all(whole[:3])
    assert sum(whole[:20]) > sum(whole[40:])


def test_ranges_of_scenes():
    """From narrow to wide; narrow ones are near zero."""
    random = seeded()
    drawn = np.array([data._draw_range(random) for _ in range(4000)])
    width, middle = drawn[:, 1] - drawn[:, 0], drawn.mean(1)
    assert data.RANGE[0] <= width.min() <= width.max() <= data.RANGE[1]
    assert (width < np.sqrt(np.prod(data.RANGE))).mean() == pytest.approx(0.5, abs=0.03)  # evenly in the logarithm
    assert np.abs(drawn).max() <= data.FARTHEST
    narrow = np.abs(middle[width < 0.4])
    assert 0.4 < narrow.max() <= data.NEAR_ZERO + 0.2
    assert np.abs(middle).max() > 0.8


def test_planes_span_the_range_of_the_scenes(folder, clean, monkeypatch):
    """The scenes' own range and up to a quarter more at each end, in eighths of a pixel."""
    monkeypatch.setattr(data, "_draw_range", lambda random: Range(-0.3, 1.1))
    crops, windows = crops_of(folder), []
    for step in range(12):
        inputs, _ = crops.make_batch(step)
        windows.append(inputs.window[4:].tolist())
        assert inputs.down.shape == inputs.across.shape == (PLANES, 3, WINDOW_SIDE, 11)
    low, high = np.array(windows).T
    assert (low % STEP == 0).all()
    assert (high % STEP == 0).all()
    assert -0.3 - data.LOOSE - STEP < low.min() < low.max() <= -0.3
    assert 1.1 <= high.min() < high.max() < 1.1 + data.LOOSE + STEP
    assert high.max() - low.min() > LEAST * (PLANES - 1)


def test_threads_make_the_same_batches_and_each_scene_once(folder, monkeypatch):
    made = Counter()
    make = layered_scenes.make_scenes

    def counting(random, *args, **kwargs):
        made[str(random.bit_generator.state["state"]["state"])] += 1
        return make(random, *args, **kwargs)

    serial = crops_of(folder)
    wanted = [serial.make_batch(step) for step in range(4, 34)]
    monkeypatch.setattr(layered_scenes, "make_scenes", counting)
    found = list(prefetch_batches(crops_of(folder).make_batch, 4, 34, threads=8, ready=2 * STEPS_PER_BLOCK))
    assert all(same(one, other) for one, other in zip(found, wanted, strict=True))
    assert set(made.values()) == {1}
    assert len(made) == 33 // STEPS_PER_BLOCK + 1


@pytest.fixture(scope="module")
def mesh(tmp_path_factory):
    file = tmp_path_factory.mktemp("mesh") / "a.obj"
    file.write_text(TETRAHEDRON)
    return file


def check_rendered(crops):
    """Truth, view and window show the same in batches of rendered light fields."""
    shown = 0
    for step in range(8):
        inputs, high = crops.make_batch(step)
        image, around = inputs.image, inputs.around
        torch.testing.assert_close(get_own(inputs), luma(image), atol=0.51 / 255, rtol=0)  # it is rounded
        mean, shifted = degradations.box(high, 2), degradations.box(high.roll(2, 3), 2)
        if (around.flatten(1).std(1) > 0.02).all():
            shown += 1
            assert (mean - image).abs().mean() < 0.5 * (shifted - image).abs().mean()
    assert shown


def test_light_fields_crop_meshes(folder, mesh, clean, monkeypatch, capsys):
    monkeypatch.setattr(mesh_views, "PICTURES", 2)
    crops = crops_of(folder, meshes=[mesh], degradations={"lenslet": 1}, crop=64)
    assert [tuple(field.high.shape) for field in crops.rendered] == [(3, 96, 96), (3, 192, 192)]
    assert "left out" not in capsys.readouterr().err
    check_rendered(crops)


def test_light_fields_of_solids(folder, clean):
    crops = crops_of(folder, scenes=3, degradations={"lenslet": 1}, crop=64)
    assert len({field.high.numpy().tobytes() for field in crops.rendered}) == 3
    check_rendered(crops)
    again = crops_of(folder, scenes=3, degradations={"lenslet": 1}, crop=64)
    assert same(crops.make_batch(2), again.make_batch(2))


def test_a_batch_of_rendered_light_fields_is_of_similar_ranges(folder, clean, monkeypatch):
    """And its planes span those of all that it may be of."""
    monkeypatch.setattr(data, "ALIKE", 2)
    monkeypatch.setattr(data, "LOOSE", 0.0)
    crops = crops_of(folder, scenes=1, degradations={"pinhole": 1}, batch=16)
    (field,) = crops.rendered
    ranges = [Range(-0.5, 0.0), Range(-0.75, -0.25), Range(-2.0, -1.0), Range(-1.75, -1.25)]
    crops.rendered = []
    for level, disparities in enumerate(ranges):
        views = {"pinhole": torch.full_like(field.views["pinhole"], 40 * level)}
        crops.rendered.append(field._replace(views=views, disparities=disparities))
    seen = set()
    for step in range(8):
        inputs, _ = crops.make_batch(step)
        shown = {round(level) for level in (inputs.around.amax((1, 2, 3)) * 255 / 40).tolist()}
        assert shown in ({0, 1}, {2, 3})
        assert inputs.window[4:].tolist() == ([-0.75, 0.0] if shown == {0, 1} else [-2.0, -1.0])
        seen |= shown
    assert seen == {0, 1, 2, 3}


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"degradations": {}}, "degradations: none given; give shares of bicubic, box, point"),
        ({"degradations": {"box": 0}}, "share of box is 0; give a number above 0"),
        ({"degradations": {"sinc": 1}}, "no 'sinc' here; give bicubic, box, point;"),
        ({"degradations": {"pinhole": 1}}, "no 'pinhole' here"),
        ({"meshes": ["a.obj"], "degradations": {"bicubic-view": 1}}, "no 'bicubic-view' here; .*, pinhole, lenslet$"),
        ({"meshes": ["a.obj"]}, "of no use without pinhole or lenslet; add a share"),
        ({"scenes": 2}, "of no use without pinhole or lenslet; add a share"),
        (
            {"scenes": 2, "degradations": {"pinhole": 1}, "crop": 200},
            "crops of up to 192 pixels, not 200; set a smaller",
        ),
        ({"scale": 4}, "scale is 4; light fields are upscaled by 2: give that"),
    ],
)
def test_wrong_arguments(folder, given, message):
    with pytest.raises(ValueError, match=message) as caught:
        crops_of(folder, **given)
    assert "\n" not in str(caught.value)
