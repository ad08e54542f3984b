import io
import struct

import numpy as np
import pytest
from PIL import Image

from ciir.errors import UnsupportedType
from ciir.renderer.readers import pictures
from ciir.renderer.readers.meshes.texture_files import Resolver

PIXELS = np.random.default_rng(0).integers(0, 256, (7, 5, 4), np.uint8)


def save(pixels: np.ndarray, kind: str, **options: object) -> bytes:
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, kind, **options)
    return file.getvalue()


def load(name: str, data: bytes, **limits: int) -> tuple[np.ndarray | None, list[str]]:
    """The texture's pixels, and notes."""
    resolver = Resolver({name: data}, "a.obj", **limits)
    texture = resolver.load_texture(name, opaque=False)
    return (None if texture is None else texture.pixels), resolver.notes


@pytest.mark.parametrize("name", ["a.bmp", "a.png"])
@pytest.mark.parametrize("kind", ["BMP", "PPM"])
def test_what_is_a_picture_anywhere_by_its_content(kind: str, name: str) -> None:
    pixels, notes = load(name, save(PIXELS[..., :3], kind))
    assert pixels is not None
    assert np.array_equal(pixels[..., :3], PIXELS[..., :3])
    assert (pixels[..., 3] == 255).all()
    assert notes == []


@pytest.mark.parametrize("options", [{}, {"compression": "tga_rle"}, {"orientation": 1}])
@pytest.mark.parametrize("channels", [3, 4])
def test_tga_by_its_name_and_header(channels: int, options: dict[str, object]) -> None:
    data = save(PIXELS[..., :channels], "TGA", **options)
    pixels, notes = load("Skin.TGA", data)
    assert pixels is not None
    assert np.array_equal(pixels[..., :channels], PIXELS[..., :channels])
    assert notes == []
    assert "not a picture that is read" in load("skin.dat", data)[1][0]


def test_tga_without_bits_of_alpha_is_opaque() -> None:
    data = bytearray(save(PIXELS, "TGA"))
    data[17] &= 0xF0
    pixels, _ = load("a.tga", bytes(data))
    assert pixels is not None
    assert (pixels[..., 3] == 255).all()


def test_gif_with_its_transparent_colour() -> None:
    image = Image.fromarray(np.array([[0, 1], [2, 1]], np.uint8), "P")
    image.putpalette([255, 0, 0, 0, 255, 0, 0, 0, 255])
    file, second = io.BytesIO(), image.rotate(90)
    image.save(file, "GIF", transparency=1, comment=b"x" * 300, save_all=True, append_images=[second])
    pixels, notes = load("a.gif", file.getvalue())
    assert pixels is not None
    assert pixels[..., 3].tolist() == [[255, 0], [255, 0]]
    assert pixels[:, 0, :3].tolist() == [[255, 0, 0], [0, 0, 255]]
    assert notes == []


GIF = save(np.zeros((4, 4), np.uint8), "GIF")


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("a.bmp", save(PIXELS[..., :3], "BMP")[:18] + struct.pack("<iiHHI", 8000, 9000, 1, 24, 0) + bytes(99)),
        ("a.tga", save(PIXELS, "TGA")[:12] + struct.pack("<HH", 8000, 9000) + save(PIXELS, "TGA")[16:]),
        ("a.gif", GIF[:6] + struct.pack("<HH", 8000, 9000) + GIF[10:]),
    ],
)
def test_sizes_are_checked_before_pixels_are_decoded(name: str, data: bytes, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Image.Image, "convert", pytest.fail)
    pixels, notes = load(name, data, max_pixels=1000)
    assert pixels is None
    assert "9000x8000 pixels (rows x columns) are over the limit of 1,000" in notes[0]


def test_a_gif_whose_picture_is_larger_than_its_screen() -> None:
    pixels, notes = load("a.gif", GIF[:6] + struct.pack("<HH", 3, 3) + GIF[10:])
    assert pixels is None
    assert "extends beyond its 3x3 pixels; save it again" in notes[0]


@pytest.mark.parametrize("kind", ["BMP", "TGA", "GIF"])
def test_truncated_at_any_place(kind: str) -> None:
    data = save(PIXELS[..., :3], kind)
    for end in range(6, len(data) - 30, 3):
        pixels, notes = load(f"a.{kind.lower()}", data[:end])
        assert pixels is None
        assert "damaged or cut off" in notes[0] or "not a picture" in notes[0]


@pytest.mark.parametrize("kind", ["TGA", "GIF"])
def test_only_textures_are_read_so(kind: str) -> None:
    with pytest.raises(UnsupportedType, match="not a picture that is read"):
        pictures.decode(save(PIXELS[..., :3], kind), name=f"a.{kind.lower()}")
