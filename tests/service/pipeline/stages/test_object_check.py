"""Objects that hardly stand out from the background are noted, with a background that helps."""

import numpy as np
import pytest

from ciir.service.pipeline.stages.object_check import ObjectCheck


def make_picture(level, share, *, background=(0, 0, 0), alpha=255):
    """100 pixels of the background, and 100 of the object, of which a `share` has another `level`."""
    picture = np.zeros((2, 100, 4), np.uint8)
    picture[..., :3] = background
    picture[1, :, 3] = alpha
    picture[1, : round(100 * share), :3] = level
    return picture


@pytest.mark.parametrize(
    ("background", "level", "share", "other"),
    [
        ((0, 0, 0), (0, 0, 16), 1.0, "ffffff"),  # black on black
        ((0, 0, 0), (0, 0, 17), 0.05, "ffffff"),
        ((0, 0, 0), (0, 0, 17), 0.06, None),
        ((255, 255, 255), (240, 255, 255), 1.0, "000000"),  # white on white
        ((250, 0, 0), (233, 0, 0), 1.0, None),
        ((250, 0, 0), (255, 16, 16), 1.0, "ffffff"),
    ],
)
def test_what_stands_out(background, level, share, other):
    check = ObjectCheck(background)
    check.add(make_picture(level, share, background=background, alpha=1))
    notes = check.list_notes()
    assert len(notes) == (other is not None)
    if other:
        assert notes[0].endswith(f"background {other}")
        assert "{:02x}{:02x}{:02x}:".format(*background) in notes[0]


def test_one_picture_that_shows_the_object_is_enough():
    check = ObjectCheck((0, 0, 0))
    for level in (0, 100, 0):
        check.add(make_picture(level, 1.0))
    assert check.list_notes() == []


def test_no_object_at_all():
    check = ObjectCheck((0, 0, 0))
    check.add(np.zeros((2, 2, 4), np.uint8))
    (note,) = check.list_notes()
    assert "none of the requested views shows the object: it is smaller than a pixel, edge-on, or" in note
    assert "give another rotate, zoom or delta, more lenses, or other views" in note
