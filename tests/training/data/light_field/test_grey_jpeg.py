"""Grey JPEG in torch against Pillow's."""

import numpy as np
import pytest

pytest.importorskip("torch", reason="needs the training extra")
import torch

from ciir.training.data.corrupt import compress_jpeg
from ciir.training.data.light_field.grey_jpeg import compress

QUALITIES = [10, 49, 50, 75, 95, 100]


def draw_pictures(height, width):
    """Smooth waves, an edge and noise, `(6, height, width)`."""
    random, (y, x) = np.random.default_rng(0), np.mgrid[:height, :width]
    waves = [128 + 60 * np.sin(y / (2 + n) + n) + 50 * np.sin(x / 3 - n) + 40 * (x > width / 2) for n in range(6)]
    return np.clip(np.stack(waves) + random.normal(0, 8, (6, height, width)), 0, 255).round().astype(np.uint8)


@pytest.mark.parametrize("size", [(32, 40), (21, 30)])
def test_pictures_are_those_of_pillow(size):
    """But for a level here and there: libjpeg's transforms are of whole numbers."""
    pictures = draw_pictures(*size)
    found = compress(torch.from_numpy(pictures).float(), torch.tensor(QUALITIES)).numpy()
    wanted = np.stack([compress_jpeg(*each) for each in zip(pictures, QUALITIES, strict=True)])
    assert found.shape == pictures.shape
    assert (found == found.round()).all()
    # Where a coefficient lies between two steps the other one may be taken.
    assert np.abs(found - wanted).mean((1, 2)).max() < 0.35
    lost = [np.abs(of - pictures.astype(float)).mean((1, 2)) for of in (found, wanted)]
    np.testing.assert_allclose(*lost, rtol=0.02, atol=0.02)
    assert lost[0][0] > 5 * lost[0][4] > 25 * lost[0][5] > 0


def test_incomplete_blocks_are_of_repeated_edges():
    pictures, qualities = draw_pictures(5, 9), torch.tensor(QUALITIES)
    whole = np.pad(pictures, ((0, 0), (0, 3), (0, 7)), mode="edge")
    part, padded = (compress(torch.from_numpy(of).float(), qualities) for of in (pictures, whole))
    assert torch.equal(part, padded[:, :5, :9])


def test_each_picture_has_its_own_quality():
    pictures, qualities = torch.from_numpy(draw_pictures(16, 24)).float(), torch.tensor(QUALITIES)
    together = compress(pictures, qualities)
    for number in range(len(QUALITIES)):
        one = slice(number, number + 1)
        torch.testing.assert_close(compress(pictures[one], qualities[one]), together[one], atol=1.01, rtol=0)
    assert not torch.equal(together, compress(pictures, qualities.flip(0)))


def test_a_flat_picture_stays_flat():
    levels = torch.arange(0.0, 256.0, 5)[:, None, None].expand(-1, 11, 13)
    found = compress(levels, torch.full((len(levels),), 90))
    assert (found - levels).abs().max() <= 1
    assert torch.equal(found, found[:, :1, :1].expand_as(found))
