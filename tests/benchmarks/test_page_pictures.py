import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from ciir.benchmarks import page_pictures
from ciir.renderer.scenes import SCENES
from ciir.service.web.page.routes import FILES
from tests.support.paths import ROOT

IMAGES = ROOT / "docs" / "images"


def test_the_pictures_of_the_page_are_those_that_the_script_takes():
    taken = set(page_pictures.PICTURES)
    assert {path.name for path in IMAGES.glob("page*")} == taken
    pages = "".join((ROOT / name).read_text() for name in ("README.md", "docs/page.md"))
    assert set(re.findall(r"images/(page[\w.]*)", pages)) == taken


def test_each_shipped_scene_has_a_picture():
    assert set(page_pictures.EXAMPLES) == set(SCENES)
    assert {f"examples/{name}.jpg" for name in SCENES} == {name for name in FILES if name.startswith("examples/")}


def test_the_readme_begins_with_looking_around():
    name = re.search(r"!\[[^]]*\]\(([^)]*)\)", (ROOT / "README.md").read_text())[1]
    assert Path(name).name == "page.webp"
    assert (ROOT / name).stat().st_size < 1.5e6
    with Image.open(ROOT / name) as animation:
        assert animation.n_frames == page_pictures.FRAMES
        first = np.asarray(animation.convert("RGB"), int)
        animation.seek(animation.n_frames // 2)
        assert np.abs(np.asarray(animation.convert("RGB")) - first).max() > 50


@pytest.mark.parametrize("name", [name for name in page_pictures.PICTURES if name.endswith(".png")])
def test_a_picture_has_the_size_of_its_window(name):
    with Image.open(IMAGES / name) as picture:
        assert picture.size in [tuple(size.values()) for size in (page_pictures.WIDE, page_pictures.PHONE)]
