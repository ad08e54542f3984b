import struct
import sys

import numpy as np
import pytest

from ciir.errors import TooLarge, Unreadable, UnsupportedType
from ciir.renderer.readers import pictures
from tests.support.meshes.ktx2 import ETC1S, PIXELS, UASTC

pytest.importorskip("opengl_basisu", reason="needs the extra basisu")


# ETC1S stores 5 bits of each colour and a step of brightness: half a step of 255 / 31.
@pytest.mark.parametrize(("data", "error"), [(ETC1S, 4), (UASTC, 0)])
def test_the_largest_level(data: bytes, error: int) -> None:
    read = pictures.decode(data, name="a")
    assert read.shape == (8, 12, 4)
    assert np.abs(read[..., :3].astype(int) - PIXELS).max() <= error
    assert (read[..., 3] == 255).all()


def test_sizes_are_checked_before_anything_is_unpacked() -> None:
    with pytest.raises(TooLarge, match="8x12 pixels"):
        pictures.decode(UASTC, name="a", max_pixels=90)
    inflated = bytearray(UASTC)
    inflated[44] = 2  # Zstandard
    inflated[96:104] = struct.pack("<Q", 2**30)
    with pytest.raises(Unreadable, match="1,073,741,824 bytes for 8x12 pixels"):
        pictures.decode(bytes(inflated), name="a")


def test_truncated_at_any_place() -> None:
    for end in range(12, len(UASTC)):
        with pytest.raises(Unreadable):
            pictures.decode(UASTC[:end], name="a")


def test_without_the_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "opengl_basisu", None)
    with pytest.raises(UnsupportedType, match=r"a KTX2 texture.*pip install '\.\[basisu\]' .*, or save it as PNG"):
        pictures.decode(UASTC, name="a")
