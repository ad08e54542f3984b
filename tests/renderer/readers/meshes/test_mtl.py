import pytest

from ciir.renderer.surface import DEFAULT_COLOR
from tests.renderer.readers.meshes.test_obj import PICTURE, TEXTURED, read
from tests.support.meshes import FRONT


@pytest.mark.parametrize("color", ["xyz 0.5 0.5 0.5", "0.5 0.5", "0,5 0,5 0,5", "spectral red.rfl"])
def test_a_colour_that_cannot_be_read_is_left_out_with_a_note(color: str) -> None:
    scene = read(TEXTURED, {"a.mtl": f"newmtl a\nKd {color}\nd 0.5".encode()})
    assert scene.parts[0].colors[0] == pytest.approx([*[DEFAULT_COLOR[0] * FRONT] * 3, 0.5])
    assert scene.notes == (f"material a: Kd {color} can't be read and is left out; write numbers as in 0.5 0.5 1",)


def test_options_of_a_texture_that_cannot_be_read_are_left_out_with_a_note() -> None:
    scene = read(TEXTURED, {"a.mtl": b"newmtl a\nmap_Kd -s 0,5 2 1 -o 0.25 0 0 x.png", "x.png": PICTURE})
    (plain,) = read(TEXTURED, {"a.mtl": b"newmtl a\nmap_Kd -o 0.25 0 0 x.png", "x.png": PICTURE}).parts
    assert scene.parts[0].uv.tolist() == plain.uv.tolist()
    assert scene.notes == ("material a: -s 0,5 2 1 can't be read and is left out; write numbers as in 0.5 0.5 1",)
