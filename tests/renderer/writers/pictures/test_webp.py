import io

import numpy as np
import pytest
from PIL import Image

from ciir.errors import InvalidOption
from ciir.renderer.writers.pictures import encode, webp
from ciir.service.cli.main import main


@pytest.mark.parametrize(("channels", "mode"), [(1, "RGB"), (2, "RGBA"), (3, "RGB"), (4, "RGBA")])
def test_every_bit_is_kept(channels, mode):
    pixels = np.random.default_rng(0).integers(0, 256, (7, 5, channels), np.uint8)
    with Image.open(io.BytesIO(encode(pixels, ".webp"))) as image:
        assert (image.format, image.mode) == ("WEBP", mode)
        written = np.asarray(image)
    colours = np.repeat(pixels[..., :1], 3, axis=2) if channels < 3 else pixels[..., :3]
    np.testing.assert_array_equal(written[..., :3], colours)
    if mode == "RGBA":
        np.testing.assert_array_equal(written[..., 3], pixels[..., -1])


@pytest.mark.parametrize("pixels", [np.zeros((4, 4, 3), np.uint16), np.zeros((1, webp.MAX_SIDE + 1), np.uint8)])
def test_what_webp_cannot_hold_is_refused(pixels):
    with pytest.raises(InvalidOption, match=r"WebP holds 8 bit and 16383.*\.png"):
        webp.encode(pixels)


def test_the_command_line_writes_it(tmp_path):
    out = tmp_path / "view.webp"
    options = ["--lenses", "12x10", "--pixels", "3x3", "--backend", "raytrace", "--model", "none"]
    assert main(["reconstruct", "scene:vase", "-o", str(out), *options]) == 0
    with Image.open(out) as image:
        assert (image.format, image.size) == ("WEBP", (10, 12))
