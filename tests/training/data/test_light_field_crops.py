"""Crops of light fields: augmentation, phase of LR and HR, corruption, and determinism."""

import itertools
from collections import Counter

import numpy as np
import pytest

pytest.importorskip("torch", reason="needs the training extra")
import torch
from PIL import Image

from ciir.models.light_field.windows import select_axis
from ciir.training.data import degrade, layered_scenes, light_field_crops, mesh_views
from ciir.training.data.downscale import KINDS
from ciir.training.data.layered_scenes import LUMA
from ciir.training.data.light_field_crops import STEPS_PER_BLOCK, LightFieldCrops, Window
from ciir.training.loop.prefetch import prefetch_batches
from ciir.training.networks.plane_sweep import MOST, SIDE, PlaneSweep

DISPARITY, PLANES = 0.75, 17
RIGHT = round((DISPARITY + MOST) / (2 * MOST) * (PLANES - 1))
OWN = SIDE**2 // 2
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
        lambda _, count, side: (torch.full((count, 1), DISPARITY), torch.zeros(count, 1, 2)),
    )


@pytest.fixture
def clean(monkeypatch):
    for name, value in (("MISMATCHED", 0.0), ("NOISE", (0.0, 0.0)), ("GRAIN", (0.0, 0.0))):
        monkeypatch.setattr(light_field_crops, name, value)


def crops_of(folder, **given):
    return LightFieldCrops(
        folder, **{"crop": 32, "scale": 2, "batch": 3, "seed": 1, "degradations": {"box": 1}} | given
    )


def luma(image):
    return torch.einsum("nchw,c->nhw", image, torch.tensor(LUMA))


def same(one, other):
    return all(torch.equal(a, b) for a, b in zip((*one[0], one[1]), (*other[0], other[1]), strict=True))


def planes(around, rows, cols):
    """The plane about which the views of each light field differ least."""
    _, spread = PlaneSweep(PLANES)(around, rows, cols)
    return spread[:, :, 5:-5, 5:-5].mean((2, 3)).argmin(1).tolist()


class Drawn:
    """A generator that returns the given values."""

    def __init__(self, *values):
        self.values = list(values)

    def random(self):
        return self.values.pop(0)


def test_a_batch_depends_only_on_seed_and_step(folder):
    crops = crops_of(folder)
    wanted = crops.make_batch(20)
    assert same(crops_of(folder).make_batch(20), wanted)
    crops.make_batch(3)
    assert same(crops.make_batch(20), wanted)
    assert not same(crops.make_batch(21), wanted)
    assert not same(crops_of(folder, seed=2).make_batch(20), wanted)


@pytest.mark.parametrize("turns", list(itertools.product((0.0, 0.9), repeat=3)))
def test_all_parts_are_flipped_in_the_same_way(flat, turns):
    """The sweep finds the layer at its disparity; missing views, which hold noise, stay missing."""
    picture = np.asarray(torch.rand(16, 16, 3, generator=torch.Generator().manual_seed(0)))
    picture = np.asarray(Image.fromarray((picture * 255).astype(np.uint8)).resize((layered_scenes.TEXTURE,) * 2))
    views, colours = layered_scenes.make_scenes(np.random.default_rng(0), [picture], 2, side=24, window=SIDE)
    image, around, high = degrade.box(colours, 4), degrade.box(views, 4), degrade.box(colours, 2)
    window = Window(*(torch.from_numpy(select_axis(*at).present) for at in ((1, 9), (7, 9))))
    missing = ~(window.rows[:, None] * window.cols).bool().flatten()
    around[:, missing] = torch.rand(2, 9, 24, 24, generator=torch.Generator().manual_seed(1))
    assert planes(around, *window) == [RIGHT] * 2
    (image, around, rows, cols), high = light_field_crops._augment(Drawn(*turns), image, around, high, window)
    assert planes(around, rows, cols) == [RIGHT] * 2
    torch.testing.assert_close(luma(image), around[:, OWN], atol=1 / 255, rtol=0)  # each is rounded to 8 bits
    torch.testing.assert_close(degrade.box(high, 2), image, atol=1.01 / 255, rtol=0)
    down, right, swapped = (turn < 0.5 for turn in turns)
    first, last = [0, 1, 1, 1, 1], [1, 1, 1, 1, 0]
    ends = [last if down else first, first if right else last]
    assert [rows.tolist(), cols.tolist()] == (ends[::-1] if swapped else ends)


@pytest.mark.parametrize("kind", KINDS)
def test_low_is_the_degraded_truth_after_augmentation(folder, clean, kind):
    crops = crops_of(folder, degradations={kind: 1})
    for step in range(8):
        inputs, high = crops.make_batch(step)
        if kind == "point":  # of finer samples than the truth's
            aligned = (degrade.box(high, 2) - inputs.image).abs().mean()
            for shifted in (inputs.image.roll(1, 2), inputs.image.roll(1, 3)):
                assert aligned < 0.3 * (degrade.box(high, 2) - shifted).abs().mean()
            continue
        made = {"box": degrade.box, "bicubic": degrade.bicubic}[kind](high, 2)
        assert (made - inputs.image).abs().max() <= 1.01 / 255  # sums in another order may round otherwise


def test_views_around_are_degraded_in_phase_with_the_view(folder):
    crops = crops_of(folder, degradations=dict.fromkeys(KINDS, 1))
    for step in range(6):
        image, around, _ = crops._crop_scenes(np.random.default_rng(step), step)
        # Both are rounded to 8 bits three times on their way, half a level each, and the bicubic kernel's weights
        # add up to 1.5 without their signs. Where it overshoots colours are cut off one by one.
        whole = ((image > 0) & (image < 1)).all(1)
        assert (around[:, OWN] - luma(image))[whole].abs().max() < 4.1 / 255


def test_the_middle_slot_is_the_luma_of_the_corrupted_view(folder, monkeypatch):
    monkeypatch.setattr(light_field_crops, "MISMATCHED", 0.5)
    monkeypatch.setattr(light_field_crops, "NOISE", (0.5, 0.1))
    monkeypatch.setattr(light_field_crops, "GRAIN", (1.0, 0.1))
    crops = crops_of(folder)
    for step in range(8):
        (image, around, _, _), _ = crops.make_batch(step)
        torch.testing.assert_close(around[:, OWN], luma(image), atol=1e-6, rtol=0)
        assert not torch.equal(around[:, OWN], around[:, 0])


WHOLE = Window(*(torch.from_numpy(select_axis(4, 9).present),) * 2)
OTHERS = [slot for slot in range(SIDE**2) if slot != OWN]


def test_grain_is_independent_between_views(clean, monkeypatch):
    monkeypatch.setattr(light_field_crops, "GRAIN", (1.0, 0.1))
    grey = torch.full((4, 3, 40, 40), 0.5), torch.full((4, 25, 40, 40), 0.5)
    image, around = light_field_crops._corrupt(np.random.default_rng(0), *grey, 1.0)
    strength = image.std((1, 2, 3))
    assert (strength.min() > 0.001, strength.max() < 0.105) == (True, True)
    ratio = around[:, OTHERS].std((2, 3)) / strength[:, None]
    assert (ratio / np.linalg.norm(LUMA) - 1).abs().max() < 0.15  # of 1600 samples each
    noise = around[:, OTHERS].flatten(2) - 0.5
    alike = torch.stack([torch.corrcoef(one) for one in noise]) - torch.eye(24)
    assert alike.abs().max() < 0.15
    assert all(torch.equal(a, b) for a, b in zip(grey, light_field_crops._corrupt(seeded(), *grey, 0.0), strict=True))


def seeded():
    return np.random.default_rng(0)


def test_mismatched_views_are_of_another_scene(clean, monkeypatch):
    monkeypatch.setattr(light_field_crops, "MISMATCHED", 1.0)
    level = torch.tensor([0.2, 0.5, 0.8])[:, None, None, None]
    image, around = light_field_crops._corrupt(seeded(), level.expand(3, 3, 4, 4), level.expand(3, 25, 4, 4), 1.0)
    assert torch.equal(image, level.expand(3, 3, 4, 4))
    assert torch.equal(around[:, OTHERS], level.roll(1, 0).expand(3, 24, 4, 4))
    torch.testing.assert_close(around[:, OWN], level[:, 0].expand(3, 4, 4))


def test_windows_at_the_border_reach_their_share_gradually(folder):
    crops = crops_of(folder, eased=60)
    whole = [all(part[1].all() for part in crops.make_batch(step)[0][2:]) for step in range(60)]
    assert all(whole[:3])
    assert sum(whole[:20]) > sum(whole[40:])


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


def test_light_fields_crop_meshes(folder, mesh, clean, monkeypatch, capsys):
    monkeypatch.setattr(mesh_views, "PICTURES", 2)
    crops = crops_of(folder, meshes=[mesh], degradations={"lenslet": 1}, crop=64)
    assert [tuple(field.high.shape) for field in crops.meshes] == [(3, 96, 96), (3, 192, 192)]
    assert "left out" not in capsys.readouterr().err
    shown = 0
    for step in range(6):
        (image, around, _, _), high = crops.make_batch(step)
        torch.testing.assert_close(around[:, OWN], luma(image), atol=1e-6, rtol=0)
        mean, shifted = degrade.box(high, 2), degrade.box(high.roll(2, 3), 2)
        if (around.flatten(1).std(1) > 0.02).all():
            shown += 1
            assert (mean - image).abs().mean() < 0.5 * (shifted - image).abs().mean()
    assert shown


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"degradations": {}}, "degradations: none given; give shares of bicubic, box, point"),
        ({"degradations": {"box": 0}}, "share of box is 0; give a number above 0"),
        ({"degradations": {"sinc": 1}}, "no 'sinc' here; give bicubic, box, point;"),
        ({"degradations": {"pinhole": 1}}, "no 'pinhole' here"),
        ({"meshes": ["a.obj"], "degradations": {"bicubic-view": 1}}, "no 'bicubic-view' here; .*, pinhole, lenslet$"),
        ({"meshes": ["a.obj"]}, "of no use without pinhole or lenslet; add a share"),
        ({"scale": 4}, "scale is 4; light fields are upscaled by 2: give that"),
    ],
)
def test_wrong_arguments(folder, given, message):
    with pytest.raises(ValueError, match=message) as caught:
        crops_of(folder, **given)
    assert "\n" not in str(caught.value)


def test_pictures_smaller_than_a_texture_are_skipped(tmp_path):
    Image.new("RGB", (layered_scenes.TEXTURE, layered_scenes.TEXTURE - 1)).save(tmp_path / "a.png")
    with pytest.raises(ValueError, match="no picture is as large as 160x160; name others"):
        crops_of(tmp_path)
    Image.new("RGB", (layered_scenes.TEXTURE, layered_scenes.TEXTURE), "red").save(tmp_path / "b.png")
    assert len(crops_of(tmp_path).pictures) == 1
