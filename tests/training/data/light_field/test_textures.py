"""Textures are parts of the pictures that are large enough."""

import numpy as np
import pytest

pytest.importorskip("torch", reason="needs the training extra")
import torch
from PIL import Image

from ciir.training.data.light_field.textures import TEXTURE, Textures
from ciir.training.data.pictures import Pictures

SIZES = [(TEXTURE + 3, TEXTURE + 40), (TEXTURE, TEXTURE), (TEXTURE - 1, 400), (TEXTURE + 20, TEXTURE + 1)]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Pictures whose colours tell the number, the row and the column of each pixel."""
    folder = tmp_path_factory.mktemp("textures")
    for number, size in enumerate(SIZES):
        rows, cols = np.indices(size)
        picture = np.stack([np.full(size, number * 50), rows, cols % 256], axis=-1).astype(np.uint8)
        Image.fromarray(picture).save(folder / f"{number}.png")
    return folder


def test_parts_of_all_large_pictures_are_cut(folder):
    textures = Textures(Pictures(folder), torch.device("cpu"))
    parts = textures.cut(np.random.default_rng(0), 200)
    assert parts.shape == (200, 3, TEXTURE, TEXTURE)
    levels = parts.mul(255).round().int()
    rows, cols = torch.arange(TEXTURE)[:, None], torch.arange(TEXTURE)
    places = {}
    for part in levels:
        number, top, left = part[:, 0, 0].tolist()
        assert (part[0] == number).all()
        assert torch.equal(part[1], (top + rows).expand(-1, TEXTURE).int())
        assert torch.equal(part[2], ((left + cols) % 256).expand(TEXTURE, -1).int())
        places.setdefault(number // 50, []).append((top, left))
    assert set(places) == {0, 1, 3}
    for number, found in places.items():
        most = [length - TEXTURE for length in SIZES[number]]
        assert set(np.min(found, axis=0)) == {0}  # each place is drawn, the first and the last ones too
        assert all(0.9 * limit <= end <= limit for end, limit in zip(np.max(found, axis=0), most, strict=True))


def test_parts_depend_only_on_the_generator(folder):
    cut = [Textures(Pictures(folder), torch.device("cpu")).cut(np.random.default_rng(seed), 5) for seed in (1, 1, 2)]
    assert torch.equal(cut[0], cut[1])
    assert not torch.equal(cut[0], cut[2])


def test_small_pictures_are_skipped_with_a_note(tmp_path, folder, capsys):
    textures = Textures(Pictures(folder), torch.device("cpu"))
    assert capsys.readouterr().err == "train: 1 of 4 pictures are skipped: they are smaller than 160x160 pixels\n"
    assert [picture.shape[:2] for picture in (textures.pictures[number] for number in range(3))] == [
        size for size in SIZES if min(size) >= TEXTURE
    ]
    assert len(textures.pictures) == 3
    Image.new("RGB", (TEXTURE, TEXTURE - 1)).save(tmp_path / "a.png")
    with pytest.raises(ValueError, match="no picture is as large as 160x160; name others"):
        Textures(Pictures(tmp_path), torch.device("cpu"))
