import numpy as np
import pytest

from ciir.renderer.readers.pictures import decode
from ciir.service.cli.main import main
from ciir.service.demo import contact_sheet, demo
from tests.support.inputs import make_picture


@pytest.fixture
def small(monkeypatch):
    monkeypatch.setattr(demo, "LENSES", (20, 20))
    monkeypatch.setattr(demo, "PIXELS", (3, 3))
    monkeypatch.setattr(demo, "SCENES", ("vase", "hamburger"))


def test_demo(small, tmp_path, capsys):
    out = tmp_path / "demo"
    assert main(["demo", "-o", str(out), "--backend", "raytrace"]) == 0
    pictures = {path.name: decode(path.read_bytes(), name=path.name) for path in out.iterdir()}
    assert {name: picture.shape[:2] for name, picture in pictures.items() if name != "contact_sheet.png"} == {
        "eia.png": (60, 60),
        "view_before.png": (20, 20),
        "view_after.png": (40, 40),
    }
    assert np.array_equal(pictures["view_before.png"], pictures["eia.png"][1::3, 1::3])
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 1 + 2 * 3 + 1
    assert lines[0].split()[1:] == ["decode", "plan", "render", "map", "upscale", "encode", "total"]
    assert lines[-1].endswith(
        "eia.png, view_before.png, view_after.png of the hamburger; contact_sheet.png of all scenes"
    )


def test_contact_sheet_shows_the_pictures_themselves():
    small, *large = (make_picture(20, 20), *(make_picture(40, 40, seed=seed) for seed in range(3)))
    sheet = contact_sheet.draw([contact_sheet.Row("noise", small, *large)], network="paper")
    for column, picture in enumerate((small, *large)):
        step = 80 // len(picture)
        left = contact_sheet.MARGIN + column * (80 + contact_sheet.MARGIN)
        shown = sheet[contact_sheet.HEAD : contact_sheet.HEAD + 80, left : left + 80]
        assert np.array_equal(shown[::step, ::step], picture)
        assert np.array_equal(shown[step - 1 :: step, step - 1 :: step], picture)
