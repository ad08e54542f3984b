"""BasicLFSR's protocol on folders of views."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

pytest.importorskip("skimage", reason="needs scikit-image, of the bench and training extras")
from PIL import Image

from ciir import models
from ciir.errors import UnknownModel, UnsupportedScale
from ciir.models.cards import read_card
from ciir.models.catalogue import SHIPPED
from ciir.models.light_field.network import LightFieldNetwork
from ciir.models.single.interpolation import Nearest
from ciir.training.evaluation import light_fields
from ciir.training.evaluation.light_fields import load_network, measure

if TYPE_CHECKING:
    from pathlib import Path

SIDE = 24


def save(folder: Path, views: dict[tuple[int, int], np.ndarray]) -> Path:
    folder.mkdir(exist_ok=True)
    for (v, u), pixels in views.items():
        Image.fromarray(pixels).save(folder / f"view_{v:02d}_{u:02d}.png")
    return folder


def field(down: int, across: int) -> dict[tuple[int, int], np.ndarray]:
    """Views of flat 2x2 cells: nearest interpolation inverts their means."""
    random = np.random.default_rng(0)
    small = random.integers(0, 255, (down, across, SIDE // 2, SIDE // 2, 3), np.uint8)
    return {(v, u): small[v, u].repeat(2, axis=0).repeat(2, axis=1) for v in range(down) for u in range(across)}


class Repeat(LightFieldNetwork):
    """A stand-in for a network: repeats each view's pixels, and records its windows."""

    name, scale, radius, threads = "repeat", 2, 0, 1
    card = read_card(SHIPPED / "field.json")

    def __init__(self, uncertainty=0.0):
        self.windows, self.uncertainty = [], uncertainty

    def __call__(self, image, around, rows, cols, disparities, *, cores=None):
        self.windows.append((around, rows.present, cols.present))
        return image.repeat(2, axis=2).repeat(2, axis=3), np.full_like(image[:, :1], self.uncertainty)


@pytest.mark.parametrize("network", [Nearest(2), Repeat()])
def test_a_known_error(tmp_path, network):
    """Of 5x6 views the middle 3x4: cells of 2x2 grey pixels, of which one is 4k levels lighter, and so their mean k.

    Squares of -k, -k, -k and 3k are 3k^2 in the mean, (219/255)^2 of that on Y's studio range. Scores are means in dB.
    """
    steps = {(v, u): 1 + (v + u) % 2 if 1 <= v < 4 and 1 <= u < 5 else 9 for v, u in field(5, 6)}
    views = {place: pixels[..., :1].repeat(3, axis=2) // 2 for place, pixels in field(5, 6).items()}
    for place, step in steps.items():
        views[place][::2, ::2] += np.uint8(4 * step)
    found = measure(network, save(tmp_path / "shelf", views), grid=(3, 4), degradation="box").mean
    wanted = [10 * np.log10(255**4 / 219**2 / (3 * step**2)) for step in (1, 2)]
    assert (found.data, found.pictures) == ("shelf 3x4 (box)", 12)
    assert found.psnr == pytest.approx(np.mean(wanted), abs=1e-4)
    assert 0.9 < found.ssim < 1


@pytest.mark.parametrize("network", [Nearest(2), Repeat()])
def test_grey_views_are_their_own_luma(tmp_path, network):
    """As grey pictures are; as three equal channels of RGB they would have 20 log10(255/219) = 1.32 dB more."""
    views = {place: pixels[..., 0] // 2 for place, pixels in field(3, 3).items()}
    for pixels in views.values():
        pixels[::2, ::2] += np.uint8(4)
    found = measure(network, save(tmp_path / "grey", views), grid=(3, 3), degradation="box").mean
    assert found.psnr == pytest.approx(10 * np.log10(255**2 / 3), abs=1e-4)


def test_grey_views_by_way_of_a_jpeg(tmp_path):
    views = {place: pixels[..., 0] for place, pixels in field(3, 3).items()}
    folder = save(tmp_path / "grey", views)
    found = [measure(Nearest(2), folder, grid=(3, 3), degradation="box", jpeg=q).mean.psnr for q in (30, 95)]
    assert 10 < found[0] < found[1]


@pytest.mark.parametrize(
    ("jpeg", "most", "expected"), [(None, 1000, ("auto", False)), (60, 1000, ("auto", True)), (60, 1, ("never", True))]
)
def test_views_are_fused_as_by_a_reconstruction(tmp_path, monkeypatch, jpeg, most, expected):
    monkeypatch.setattr("ciir.models.light_field.fusion.views.MOST_PIXELS", most)
    asked = []
    upscaler = light_fields.FusingUpscaler

    def record(*arguments, **options):
        asked.append((options["fusion"], options["is_jpeg"]))
        return upscaler(*arguments, **options)

    monkeypatch.setattr(light_fields, "FusingUpscaler", record)
    flat = np.linspace(60, 200, SIDE).astype(np.uint8)[:, None, None].repeat(SIDE, axis=1).repeat(3, axis=2)
    views = {(v, u): flat + np.uint8(v) for v in range(5) for u in range(5)}
    measure(Repeat(), save(tmp_path / "v", views), degradation="box", jpeg=jpeg)
    assert asked == [expected]


def test_the_share_of_the_fallback(tmp_path):
    """Of flat 2x2 cells, which look like means, and not filtered."""
    folder = save(tmp_path / "v", field(3, 3))
    found, low = (measure(Repeat(u), folder, grid=(3, 3), degradation="box") for u in (0.0, 2.0))
    assert (found.mean.fallback, low.mean.fallback, low.averaged) == (0, 1, 0)
    assert low.mean.psnr < found.mean.psnr - 1
    own = measure(Repeat(2.0), folder, grid=(3, 3), degradation="box", network_only=True)
    assert (own.mean.fallback, own.mean.psnr) == (0, np.inf)
    assert measure(Nearest(2), folder, grid=(3, 3), degradation="box").mean.fallback is None


def test_views_outside_the_grid_are_ignored(tmp_path):
    network, views = Repeat(), field(5, 5)
    measure(network, save(tmp_path / "v", views), grid=(3, 3), degradation="box")
    assert len(network.windows) == 9
    (around, rows, cols), middle = network.windows[0], network.windows[4]
    np.testing.assert_array_equal(rows, [1, 0.5, 0.5, 0, 0])
    np.testing.assert_array_equal(cols, rows)
    np.testing.assert_array_equal(middle[1], [0.5, 1, 0.5, 0, 0])
    luma = views[1, 1][::2, ::2] @ np.array([0.299, 0.587, 0.114]) / 255
    np.testing.assert_allclose(around[0, 0], luma, atol=1e-6)


def test_a_model_of_single_pictures_goes_view_by_view(tmp_path):
    folder = save(tmp_path / "v", field(3, 3))
    by_name = measure(load_network("paper", 2), folder, grid=(3, 3), degradation="box")
    by_path = load_network(str(SHIPPED / "paper.json"), 2)
    assert by_name == measure(by_path, folder, grid=(3, 3), degradation="box")
    assert by_name == measure(models.load_upscaler("paper"), folder, grid=(3, 3), degradation="box")
    assert measure(load_network("bicubic", 3), folder, grid=(3, 3)).mean.pictures == 9


def test_a_network_that_is_not_there():
    with pytest.raises(UnknownModel, match="no 'feild' here; give one of best, best-int8, fast, fast-int8"):
        load_network("feild", 2)
    with pytest.raises(UnsupportedScale):
        load_network("fast", 4)
    with pytest.raises(UnsupportedScale, match="paper upscales by 2, not 4"):
        load_network(str(SHIPPED / "paper.json"), 4)


def test_too_few_views_are_refused(tmp_path):
    with pytest.raises(ValueError, match="--grid 2x3: repeat takes 3x3 views or more; give those"):
        measure(Repeat(), save(tmp_path / "v", field(3, 3)), grid=(2, 3))


def refused(folder: Path, **options) -> str:
    with pytest.raises(ValueError) as caught:  # noqa: PT011 - the words are the tests'
        measure(Nearest(2), folder, **options)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_folders_without_a_usable_set_of_views(tmp_path):
    (tmp_path / "empty").mkdir()
    assert refused(tmp_path / "empty")
    assert "not a set of views" in refused(save(tmp_path / "one", field(1, 1)), grid=(1, 1))
    small = {place: pixels[:12, :12] for place, pixels in field(3, 3).items()}
    assert "name larger views" in refused(save(tmp_path / "small", small), grid=(3, 3))
    assert "no 'blur' here" in refused(save(tmp_path / "v", field(3, 3)), grid=(3, 3), degradation="blur")


def test_the_protocol_is_that_of_the_default_grid():
    assert f"central {light_fields.GRID[0]}x{light_fields.GRID[1]}" in light_fields.PROTOCOL
    assert light_fields.describe_protocol() == light_fields.PROTOCOL
    assert "central 3x4" in light_fields.describe_protocol((3, 4))
    assert "with point the truth is the mean of each 2x2 pixels" in light_fields.PROTOCOL


def test_shipped_cards_have_the_protocol():
    assert {read_card(path).protocol for path in SHIPPED.glob("field*.json")} == {light_fields.PROTOCOL}
