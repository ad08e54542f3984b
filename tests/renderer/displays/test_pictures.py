"""Pictures of light fields for displays."""

import json
import re

import numpy as np
import pytest

from ciir.renderer.displays.pictures import find_target, show_light_field
from ciir.renderer.light_field import LightField
from ciir.renderer.writers.options import WriterOptions
from tests.support.displays import CALIBRATION


@pytest.mark.parametrize(("bits", "unused"), [(10, 6), (11, 4), (12, 4), (16, 0)])
def test_levels_of_a_camera_fill_the_range(bits, unused):
    """As of a camera of 16 bits that saw the same: a display would show them nearly black."""
    views = np.random.default_rng(1).integers(0, 2**bits, (1, 3, 8, 12, 3), np.uint16)
    views[0, 0, 0, 0] = 2**bits - 1
    options = WriterOptions(quilt="3x1", aspect=1.5)
    target = find_target("quilt", options)
    made = show_light_field(LightField(views, depth_sense="cameras"), target, options)
    wanted = show_light_field(LightField(views << unused, depth_sense="cameras"), target, options)
    assert (made.pixels == wanted.pixels).all()
    assert made.pixels.max() == (2**bits - 1) << unused
    raised = [note for note in made.notes if "multiplied" in note]
    if not unused:
        assert not raised
    else:
        most = 2 ** (16 - unused) - 1
        assert raised == [f"display: no level is over {most}, so levels are multiplied by {2**unused}"]


DISPLAYS = {
    "lenticular": WriterOptions(calibration=json.dumps(CALIBRATION)),
    "panel": WriterOptions(display="[panel]\npixels = [90, 40]\npitch = 0.1\n[lenses]\npitch = 0.5\ngap = 3.0\n"),
}


@pytest.mark.parametrize("kind", DISPLAYS)
def test_pixels_that_are_not_square_make_the_picture_of_square_ones(kind):
    """Columns that are there three times are a third as wide."""
    waves = np.sin(np.arange(60) / 6)
    picture = (128 + 100 * waves[:, None] * waves).round().astype(np.uint8)
    views = np.broadcast_to(picture[..., None], (3, 6, 60, 60, 1))
    target = find_target(kind, DISPLAYS[kind])
    wanted = show_light_field(LightField(views, depth_sense="cameras"), target, DISPLAYS[kind])
    narrow = LightField(views.repeat(3, axis=3), depth_sense="cameras", pixel_aspect=1 / 3)
    made = show_light_field(narrow, target, DISPLAYS[kind])
    assert np.abs(made.pixels.astype(int) - wanted.pixels).mean() < 4
    sharp, of_square = (
        float(re.search(r"disparities from -(\S+) to", " ".join(shown.notes))[1]) for shown in (made, wanted)
    )
    assert sharp == pytest.approx(3 * of_square, rel=0.05)  # in pixels


@pytest.mark.parametrize(
    ("viewer", "grid", "share", "better"),
    [
        ("[viewer]\ndistance = 250\n", (3, 3), 0.36, "the mesh itself, a viewer farther away"),
        ("[viewer]\ndistance = 250\n", (1, 3), 0.26, "the mesh itself, a viewer farther away"),
        ("", (2, 4), 0.51, "the mesh itself, as many rows of views as columns"),  # half as high as wide
        ("", (3, 3), 0, ""),
    ],
)
def test_directions_that_no_view_shows_are_noted(viewer, grid, share, better):
    """On half of the panel of docs/displays.md at half the distance; of one row of views along x alone. The shares are
    those of lenses that eyes in the viewing zone see in such a direction.
    """
    text = "[panel]\npixels = [960, 540]\nppi = 280\n[lenses]\npitch = 1.0\ngap = 3.0\n"
    options = WriterOptions(display=text + viewer)
    field = LightField(np.zeros((*grid, 4, 4, 1), np.uint8), depth_sense="cameras")
    notes = show_light_field(field, find_target("panel", options), options).notes
    found = [note for note in notes if note.startswith("panel")]
    assert len(found) == bool(share)
    if not share:
        return
    assert found[0].endswith(f"the outermost view, because no view covers the direction to the eye; better: {better}")
    distance = 250 if viewer else 1e6
    eyes = (np.arange(40) + 0.5) / 40 - 0.5  # across the zone
    inside, inside_middle = 1.0, 1.0
    for count, side in zip(grid, (49.0, 87.1), strict=True):
        reach = count / max(grid) / 6 if count > 1 else np.inf
        tangents = (np.arange(-side / 2, side / 2) + 0.5)[:, None] / distance - eyes / 3 * (1 + 3 / distance)
        inside *= (np.abs(tangents) <= reach).mean()
        inside_middle *= (np.abs(tangents + eyes / 3 * (1 + 3 / distance)) <= reach).mean()
    assert float(re.match(r"panel: (\d+) % of the lenses", found[0])[1]) / 100 == pytest.approx(share, abs=0.011)
    assert 1 - inside == pytest.approx(share, abs=0.02)
    if viewer:
        middle = re.search(r"\(mean over the viewing zone, (\d+) % seen from the middle\)", found[0])[1]
        assert float(middle) / 100 == pytest.approx(1 - inside_middle, abs=0.02)


@pytest.mark.parametrize(("sense", "shown"), [("cameras", 0), ("lenses", 1)])
def test_only_what_is_shown_counts(sense, shown):
    """A folder's other rows are not even read."""
    views = np.full((2, 3, 8, 12, 3), 1000, np.uint16)
    views[1 - shown] = 65535
    target, options = find_target("quilt", WriterOptions(quilt="3x1", aspect=1.5)), WriterOptions()
    made = show_light_field(LightField(views, depth_sense=sense), target, options)
    assert (made.pixels == 64000).all()
